"""Changes of specifications before compilation: possible inertias, and no missing or slow assets."""

import re
from collections.abc import Iterable, Sequence
from typing import Any

import mujoco
import numpy as np

# MuJoCo's message about a mesh that encloses no volume
_FLAT = re.compile(r"mesh volume is too small: (\S+)")
# minimum mass and moment of inertia of a moving body, in [kg] and [kg m2]
MIN_MASS, MIN_INERTIA = 1e-6, 1e-12


def with_possible_inertias(spec: mujoco.MjSpec, message: str) -> str:
    """Change the compiler settings for inertias that are zero or violate the triangle inequality.

    Meshes that enclose no volume become shells.

    Args:
        spec: specification, changed in place.
        message: error message of MuJoCo.

    Returns:
        The change, as text; empty if the error has another cause.
    """
    text = " ".join(message.split())
    if "A + B >= C" in text and not spec.compiler.balanceinertia:
        spec.compiler.balanceinertia = 1
        return (
            "moments of inertia break the triangle inequality and MuJoCo refuses the file: read as with "
            '<compiler balanceinertia="true"/>, which evens them out'
        )
    if "must be larger than mjMINVAL" in text and spec.compiler.boundmass < MIN_MASS:
        if any(not (body.mass >= 0.0 and np.min(body.inertia) >= 0.0) for body in spec.bodies):
            return ""  # no mass that is missing, but a negative one, or one that is not a number
        spec.compiler.boundmass, spec.compiler.boundinertia = MIN_MASS, MIN_INERTIA
        return (
            "a moving body has no mass or no inertia and MuJoCo refuses the file: read as with "
            f'<compiler boundmass="{MIN_MASS:g}" boundinertia="{MIN_INERTIA:g}"/>'
        )
    flat = _FLAT.search(text)
    if flat and (mesh := spec.mesh(flat[1])) and mesh.inertia != mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL:
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
        return f'mesh {flat[1]!r} bounds no volume and MuJoCo refuses it: read as with inertia="shell"'
    return ""


def minimum_mass(remarks: Iterable[str]) -> float:
    """Return the mass in [kg] assigned to massless bodies, according to the remarks; 0 if there are none."""
    return MIN_MASS if any("boundmass" in remark for remark in remarks) else 0.0


_FILE = re.compile(r"(?:opening|open|find|load|read)\w* (?:file |resource )?'([^']+)'", re.IGNORECASE)
# inertia of a body whose meshes are missing, in [kg] and [kg m2]
PLACEHOLDER_MASS, PLACEHOLDER_INERTIA = 1.0, 1e-3
# kinds of assets: name in messages -> list of the specification, and attribute of geoms that have one
ASSETS = {
    "meshes": ("meshes", "meshname"),
    "textures": ("textures", None),
    "height fields": ("hfields", "hfieldname"),
    "skins": ("skins", None),
}


def without_missing(spec: mujoco.MjSpec, message: str) -> str:
    """Omit the assets of the kind whose file MuJoCo does not find.

    Args:
        spec: specification, changed in place.
        message: error message of MuJoCo.

    Returns:
        The omitted assets, as text; empty if the error names no file of an asset.
    """
    match = _FILE.search(message)
    if not match:
        return ""
    missing = match[1]
    for kind, (attribute, reference) in ASSETS.items():
        assets = list(getattr(spec, attribute))
        files = [name for asset in assets for name in (asset.file, *getattr(asset, "cubefiles", ())) if name]
        if not any(_same_file(missing, name) for name in files):
            continue
        if reference:
            _no_shapes(spec, [geom for geom in spec.geoms if getattr(geom, reference)])
        if kind == "textures":
            remove_textures(spec)
        else:
            for asset in assets:
                spec.delete(asset)
        return f"file {missing} is missing: read without its {kind}"
    return ""


def _same_file(missing: str, name: str) -> bool:
    # MuJoCo shortens package:///part.stl in URDF files to one slash
    path, asset = (re.sub(r"[\\/]+", "/", text) for text in (missing, name))
    return path.endswith(asset.lstrip("./"))


def _no_shapes(spec: mujoco.MjSpec, geoms: Sequence[Any]) -> None:
    """Replace geoms by invisible points; bodies with mass from geoms get a placeholder inertia."""
    for geom in geoms:
        body = geom.parent
        geom.type = mujoco.mjtGeom.mjGEOM_SPHERE
        geom.size = np.array([1e-3, 0.0, 0.0])
        geom.rgba = np.zeros(4)
        geom.meshname = geom.hfieldname = geom.material = ""
        geom.contype = geom.conaffinity = 0
        if body.id and not body.explicitinertial:
            body.explicitinertial = True
            body.mass, body.inertia = PLACEHOLDER_MASS, np.full(3, PLACEHOLDER_INERTIA)
            body.ipos, body.iquat = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
    if spec.compiler.inertiafromgeom == FROM_GEOMS:
        spec.compiler.inertiafromgeom = FROM_FILE


# minimum half-length in [m] of a box in place of a mesh
MIN_HALF_LENGTH = 1e-6
FROM_GEOMS = int(mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE)
FROM_FILE = int(mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO)


def remove_textures(spec: mujoco.MjSpec) -> None:
    """Delete the textures of a specification, which every copy of its model would contain."""
    for material in spec.materials:
        material.textures = [""] * len(material.textures)
    for texture in list(spec.textures):
        spec.delete(texture)


def has_replaceable_meshes(spec: mujoco.MjSpec) -> bool:
    """Return whether a specification has meshes, and compilation keeps all its bodies."""
    return bool(spec.meshes) and not spec.compiler.fusestatic


def remove_meshes(spec: mujoco.MjSpec) -> list[int]:
    """Delete the meshes of a specification before it is compiled, and return the indices of their geoms.

    Each geom becomes a point. A body with inertia from its geoms gets a placeholder inertia, which
    `copy_shapes` replaces by that of the compiled model.
    """
    geoms = {number: geom for number, geom in enumerate(spec.geoms) if geom.meshname}
    for geom in geoms.values():
        geom.type, geom.meshname = mujoco.mjtGeom.mjGEOM_SPHERE, ""
        geom.size = np.full(3, MIN_HALF_LENGTH)
        body = geom.parent
        if body.id and not body.explicitinertial:
            body.mass, body.inertia = PLACEHOLDER_MASS, np.full(3, PLACEHOLDER_INERTIA)
    for asset in [*spec.skins, *spec.meshes]:
        spec.delete(asset)
    return list(geoms)


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
