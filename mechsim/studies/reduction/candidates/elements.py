"""Candidates among contacts, visual elements, limits, actuators, equalities, springs and dampers."""

from collections.abc import Collection
from functools import partial
from typing import Any

import mujoco
import numpy as np

from mechsim.errors import first_names, several
from mechsim.simulation.plain_settings import PlainSettings
from mechsim.studies.reduction.candidates.bodies import (
    LISTED,
    RemovalCandidate,
    delete,
    existing,
)
from mechsim.studies.reduction.reduced_scene import Evidence

CONTACTS_DISABLED = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
# largest force of an actuator at rest, in [N m] or [N]
MAX_FORCE_AT_REST = 1e-12
# field of a joint or tendon -> its value without effect, and its name in messages
SPRING_FIELDS = {
    "frictionloss": (0.0, "Coulomb friction"),
    "stiffness": (np.zeros(3), "spring"),
    "damping": (np.zeros(3), "damper"),
}


def contacts(observed: Evidence) -> list[RemovalCandidate]:
    """Propose to disable contacts if none occurred, otherwise those of geoms without contact."""
    if observed.spec.option.disableflags & CONTACTS_DISABLED:
        return []
    if not observed.touched:
        edit = PlainSettings(contact=False).put_into
        return [RemovalCandidate("contacts", "contact detection (no contacts)", edit)]
    names = [
        geom.name
        for geom in observed.spec.geoms
        if geom.name not in observed.touched and (geom.contype or geom.conaffinity)
    ]
    what = f"contacts of {several(len(names), 'geom')} without contact"

    def edit_geoms(spec: mujoco.MjSpec) -> None:
        for geom in spec.geoms:
            if geom.name in names:
                geom.contype = geom.conaffinity = 0
        delete(spec, (pair for pair in spec.pairs if pair.geomname1 in names or pair.geomname2 in names))

    return [RemovalCandidate("contacts", what, edit_geoms)] if names else []


def visual_elements(observed: Evidence) -> list[RemovalCandidate]:
    """Propose to remove each kind of element that exerts no force: sensors, cameras, geoms, meshes."""
    spec, edits = observed.spec, dict[str, Any]()
    if spec.sensors:
        edits[several(len(spec.sensors), "sensor")] = lambda spec: delete(spec, spec.sensors)
    if count := len(spec.cameras) + len(spec.lights):
        edits[several(count, "camera or light", "cameras and lights")] = lambda spec: delete(
            spec, (*spec.cameras, *spec.lights)
        )
    # tendons wrap around these geoms, or contact pairs name them
    wraps = {
        wrap.target.name
        for tendon in spec.tendons
        for wrap in tendon.path
        if wrap.type in (mujoco.mjtWrap.mjWRAP_SPHERE, mujoco.mjtWrap.mjWRAP_CYLINDER)
    }
    pairs = {name for pair in spec.pairs for name in (pair.geomname1, pair.geomname2)}
    geoms = [geom.name for geom in spec.geoms if geom.name not in wraps | pairs | observed.touched]
    if geoms:
        what = f"{several(len(geoms), 'geom')} without contact, with their meshes and materials"
        edits[what] = partial(_without_geoms, names=geoms)
    elif spec.materials or spec.textures or spec.meshes:
        edits["materials, textures and meshes"] = _without_assets
    return [RemovalCandidate("visual-only elements", what, edit) for what, edit in edits.items()]


def _without_geoms(spec: mujoco.MjSpec, names: Collection[str]) -> None:
    """Remove geoms; bodies keep their inertial properties."""
    for body in list(spec.bodies)[1:]:
        if any(geom.name in names for geom in body.geoms) and not body.explicitinertial:
            spec.adopt_inertial(body)
    delete(spec, (geom for geom in spec.geoms if geom.name in names))
    _without_assets(spec)


def _without_assets(spec: mujoco.MjSpec) -> None:
    """Remove materials, textures and skins, and the meshes and height fields that no geom uses."""
    meshes, fields = {geom.meshname for geom in spec.geoms}, {geom.hfieldname for geom in spec.geoms}
    for element in (*spec.geoms, *spec.sites, *spec.tendons):
        element.material = ""
    delete(spec, (*spec.skins, *spec.materials, *spec.textures))
    delete(spec, (mesh for mesh in spec.meshes if mesh.name not in meshes))
    delete(spec, (field for field in spec.hfields if field.name not in fields))


def _with_value(spec: mujoco.MjSpec, names: Collection[str], field: str, value: Any) -> None:
    """Give a field of joints and tendons another value."""
    for element in (*spec.joints, *spec.tendons):
        if element.name in names:
            setattr(element, field, value)


def limits(observed: Evidence) -> list[RemovalCandidate]:
    """Propose to remove all limits that were never reached, and, one at a time, each of the others."""
    model = observed.model
    names = [model.joint(j).name for j in range(model.njnt) if model.jnt_limited[j]]
    names += [model.tendon(t).name for t in range(model.ntendon) if model.tendon_limited[t]]
    unused = [name for name in names if name not in observed.limited]
    were = "was" if len(unused) == 1 else "were"
    options = {f"{several(len(unused), 'limit')} that {were} never reached": unused} if unused else {}
    options |= {f"limit of {name}": [name] for name in names if name in observed.limited}
    unlimited = partial(_with_value, field="limited", value=int(mujoco.mjtLimited.mjLIMITED_FALSE))
    return [
        RemovalCandidate("limits", what, partial(unlimited, names=group), only_if_faster=group is not unused)
        for what, group in options.items()
    ]


def actuators(observed: Evidence) -> list[RemovalCandidate]:
    """Propose to remove the actuators that no motion law controls and that exerted no force."""
    names = [
        name
        for name, force in observed.forces.items()
        if force <= MAX_FORCE_AT_REST and name not in observed.scene.ctrl
    ]
    what = f"{several(len(names), 'actuator')} at rest: {first_names(names, LISTED)}"

    def edit(spec: mujoco.MjSpec) -> None:
        delete(spec, (actuator for actuator in spec.actuators if actuator.name in names))

    return [RemovalCandidate("actuators", what, edit)] if names else []


def redundant_equalities(observed: Evidence) -> list[RemovalCandidate]:
    """Propose to remove each equality that is inactive or implied by the others."""
    return [
        RemovalCandidate(
            "redundant equalities",
            f"equality {name}, implied by the others",
            lambda spec, name=name: delete(spec, existing(spec, "equality", name)),
        )
        for name in observed.redundant
    ]


def springs(observed: Evidence) -> list[RemovalCandidate]:
    """Propose to remove Coulomb friction, springs and dampers: from all joints and tendons, and from each."""
    candidates: list[RemovalCandidate] = []
    for field, (none, what) in SPRING_FIELDS.items():
        # in a prescribed joint these only change the drive force
        names = [
            element.name
            for element in (*observed.spec.joints, *observed.spec.tendons)
            if np.any(getattr(element, field)) and element.name not in observed.scene.joint_laws
        ]
        options = {f"{what} of all {len(names)} joints that have one": names} if len(names) > 1 else {}
        options |= {f"{what} of {name}": [name] for name in names}
        removed = partial(_with_value, field=field, value=none)
        candidates += [
            RemovalCandidate("springs", text, partial(removed, names=group), only_if_faster=True)
            for text, group in options.items()
        ]
    return candidates
