"""Specifications without meshes, which compile in milliseconds, for computations without geometry."""

import mujoco
import numpy as np

from mechsim.simulation.mjcf_reader.repairs import PLACEHOLDER_INERTIA, PLACEHOLDER_MASS

# minimum half-length in [m] of a box in place of a mesh
MIN_HALF_LENGTH = 1e-6
FROM_GEOMS = int(mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE)
FROM_FILE = int(mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO)


def has_replaceable_meshes(spec: mujoco.MjSpec) -> bool:
    """Return whether a specification has meshes, and compilation keeps all its bodies."""
    return bool(spec.meshes) and not spec.compiler.fusestatic


def remove_meshes(spec: mujoco.MjSpec) -> list[int]:
    """Delete the meshes of a specification before it is compiled, and return the indices of their geoms.

    Each geom becomes a point. A body with inertia from its geoms gets a placeholder inertia, which
    `copy_shapes` replaces by that of the compiled model.
    """
    geoms = [number for number, geom in enumerate(spec.geoms) if geom.meshname]
    elements = list(spec.geoms)
    for number in geoms:
        geom = elements[number]
        geom.type, geom.meshname = mujoco.mjtGeom.mjGEOM_SPHERE, ""
        geom.size = np.full(3, MIN_HALF_LENGTH)
        body = geom.parent
        if body.id and not body.explicitinertial:
            body.mass, body.inertia = PLACEHOLDER_MASS, np.full(3, PLACEHOLDER_INERTIA)
    for skin in list(spec.skins):
        spec.delete(skin)
    for mesh in list(spec.meshes):
        spec.delete(mesh)
    return geoms


def copy_shapes(spec: mujoco.MjSpec, model: mujoco.MjModel, geoms: list[int]) -> None:
    """Copy the inertias of a model with meshes to a specification without, and add boxes of equal size.

    There are no boxes if the compiler discards visual geoms.
    """
    elements, bodies = list(spec.geoms), list(spec.bodies)
    changed = {elements[number].parent.id for number in geoms if not elements[number].parent.explicitinertial}
    if spec.compiler.inertiafromgeom == FROM_GEOMS:
        changed = set(range(1, model.nbody))
        spec.compiler.inertiafromgeom = FROM_FILE
    for number in changed - {0}:
        body = bodies[number]
        body.explicitinertial, body.fullinertia = True, [np.nan] + [0.0] * 5
        body.mass, body.inertia = model.body_mass[number], model.body_inertia[number]
        body.ipos, body.iquat = model.body_ipos[number], model.body_iquat[number]
    for number in geoms if len(elements) == model.ngeom else ():
        geom, (centre, half) = elements[number], np.split(model.geom_aabb[number], 2)
        rotated = np.zeros(3)
        mujoco.mju_rotVecQuat(rotated, centre, model.geom_quat[number])
        geom.type = mujoco.mjtGeom.mjGEOM_BOX
        geom.size = np.maximum(half, MIN_HALF_LENGTH)
        geom.pos, geom.quat = model.geom_pos[number] + rotated, model.geom_quat[number]
        geom.contype = geom.conaffinity = 0
