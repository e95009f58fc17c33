"""Candidates among contacts, visual elements, limits, actuators, equalities, springs and dampers."""

from collections.abc import Collection, Sequence
from typing import Any

import mujoco
import numpy as np

from mechsim.studies.reduction.candidates.candidate import (
    NotApplicable,
    RemovalCandidate,
    count_text,
    name_list,
)
from mechsim.studies.reduction.observations import Evidence

OFF = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
CONTACTS = "contacts"


def contacts(observed: Evidence) -> list[RemovalCandidate]:
    """Propose to disable contacts if none occurred, otherwise those of geoms that touched nothing."""
    if observed.spec.option.disableflags & OFF:
        return []
    if not observed.touched:
        return [RemovalCandidate(CONTACTS, "looking for contacts: nothing touched", _disable_contacts)]
    apart = [
        geom.name
        for geom in observed.spec.geoms
        if geom.name not in observed.touched and (geom.contype or geom.conaffinity)
    ]
    if not apart:
        return []
    what = f"contacts of {count_text(len(apart), 'geom')} that touched nothing"
    return [RemovalCandidate(CONTACTS, what, lambda spec: _without_contacts(spec, apart))]


def _disable_contacts(spec: mujoco.MjSpec) -> None:
    spec.option.disableflags |= OFF


def _without_contacts(spec: mujoco.MjSpec, names: list[str]) -> None:
    for geom in spec.geoms:
        if geom.name in names:
            geom.contype = geom.conaffinity = 0
    for pair in list(spec.pairs):
        if pair.geomname1 in names or pair.geomname2 in names:
            spec.delete(pair)


VISUAL = "visual-only elements"


def visual_elements(observed: Evidence) -> list[RemovalCandidate]:
    """Propose to remove each kind of visual-only element."""
    spec, candidates = observed.spec, list[RemovalCandidate]()
    if spec.sensors:
        candidates.append(RemovalCandidate(VISUAL, count_text(len(spec.sensors), "sensor"), _no_sensors))
    if count := len(spec.cameras) + len(spec.lights):
        candidates.append(
            RemovalCandidate(VISUAL, count_text(count, "camera or light", "cameras and lights"), _no_cameras)
        )
    used = _used_geoms(spec) | observed.touched
    geoms = [geom.name for geom in spec.geoms if geom.name not in used]
    if geoms:
        what = f"{count_text(len(geoms), 'geom')} that touched nothing, with their meshes and materials"
        candidates.append(RemovalCandidate(VISUAL, what, lambda spec: _no_geoms(spec, geoms)))
    elif spec.materials or spec.textures or spec.meshes:
        candidates.append(RemovalCandidate(VISUAL, "materials, textures and meshes", _no_assets))
    return candidates


def _no_sensors(spec: mujoco.MjSpec) -> None:
    _delete(spec, spec.sensors)


def _no_cameras(spec: mujoco.MjSpec) -> None:
    _delete(spec, spec.cameras)
    _delete(spec, spec.lights)


def _used_geoms(spec: mujoco.MjSpec) -> set[str]:
    """Return the geoms that tendons wrap around or that contact pairs name."""
    wraps = {
        wrap.target.name
        for tendon in spec.tendons
        for wrap in tendon.path
        if wrap.type in (mujoco.mjtWrap.mjWRAP_SPHERE, mujoco.mjtWrap.mjWRAP_CYLINDER)
    }
    pairs = {name for pair in spec.pairs for name in (pair.geomname1, pair.geomname2)}
    return wraps | pairs


def _no_geoms(spec: mujoco.MjSpec, names: Sequence[str]) -> None:
    """Remove geoms; inertial properties of bodies stay."""
    bodies = [body for body in list(spec.bodies)[1:] if any(geom.name in names for geom in body.geoms)]
    for body in bodies:
        if not body.explicitinertial:
            spec.adopt_inertial(body)
    _delete(spec, [geom for geom in spec.geoms if geom.name in names])
    _no_assets(spec)


def _no_assets(spec: mujoco.MjSpec) -> None:
    """Remove materials, textures and skins, and the meshes and height fields that no geom uses."""
    meshes = {geom.meshname for geom in spec.geoms}
    fields = {geom.hfieldname for geom in spec.geoms}
    _delete(spec, spec.skins)
    for elements in (spec.geoms, spec.sites, spec.tendons):
        for element in elements:
            element.material = ""
    _delete(spec, spec.materials)
    _delete(spec, spec.textures)
    _delete(spec, [mesh for mesh in spec.meshes if mesh.name not in meshes])
    _delete(spec, [field for field in spec.hfields if field.name not in fields])


def _delete(spec: mujoco.MjSpec, elements: Sequence[Any]) -> None:
    for element in list(elements):
        spec.delete(element)


LIMITS = "limits"
NONE = int(mujoco.mjtLimited.mjLIMITED_FALSE)


def limits(observed: Evidence) -> list[RemovalCandidate]:
    """Propose to remove all limits that were never reached, and each of the others."""
    model = observed.model
    joints = [model.joint(j).name for j in range(model.njnt) if model.jnt_limited[j]]
    tendons = [model.tendon(t).name for t in range(model.ntendon) if model.tendon_limited[t]]
    free = [name for name in (*joints, *tendons) if name not in observed.limited]
    candidates: list[RemovalCandidate] = []
    if free:
        what = f"{count_text(len(free), 'limit')} that {'was' if len(free) == 1 else 'were'} never reached"
        candidates.append(RemovalCandidate(LIMITS, what, lambda spec: _without_limits(spec, free)))
    for name in (*joints, *tendons):
        if name in observed.limited:
            edit = lambda spec, names=(name,): _without_limits(spec, names)  # noqa: E731
            candidates.append(RemovalCandidate(LIMITS, f"limit of {name}", edit, only_if_faster=True))
    return candidates


def _without_limits(spec: mujoco.MjSpec, names: Collection[str]) -> None:
    for element in (*spec.joints, *spec.tendons):
        if element.name in names:
            element.limited = NONE


ACTUATORS = "actuators"
# largest force of an idle actuator, in [N m] or [N]
MAX_FORCE_AT_REST = 1e-12


def actuators(observed: Evidence) -> list[RemovalCandidate]:
    """Propose to remove the actuators that no motion law controls and that exerted no force."""
    still = [
        name
        for name, most in observed.forces.items()
        if most <= MAX_FORCE_AT_REST and name not in observed.scene.ctrl
    ]
    if not still:
        return []
    what = f"{count_text(len(still), 'actuator')} at rest: {name_list(still)}"
    return [RemovalCandidate(ACTUATORS, what, lambda spec: _without_actuators(spec, still))]


def _without_actuators(spec: mujoco.MjSpec, names: list[str]) -> None:
    """Remove actuators."""
    for actuator in list(spec.actuators):
        if actuator.name in names:
            spec.delete(actuator)


EQUALITIES = "redundant equalities"


def redundant_equalities(observed: Evidence) -> list[RemovalCandidate]:
    """Propose to remove each equality that is inactive or implied by the others."""
    candidates: list[RemovalCandidate] = []
    for name in observed.redundant:
        edit = lambda spec, name=name: _without_equality(spec, name)  # noqa: E731
        candidates.append(RemovalCandidate(EQUALITIES, f"equality {name}, which the others imply", edit))
    return candidates


def _without_equality(spec: mujoco.MjSpec, name: str) -> None:
    equality = spec.equality(name)
    if equality is None:
        raise NotApplicable(f"equality {name} is removed already")
    spec.delete(equality)


SPRINGS = "springs"
# field of a joint or tendon -> its name in messages
KINDS = {
    "frictionloss": "dry friction",
    "stiffness": "spring",
    "damping": "damper",
}


def springs(observed: Evidence) -> list[RemovalCandidate]:
    """Propose to remove each kind from all joints and tendons that have it, and from each one."""
    candidates: list[RemovalCandidate] = []
    for field, what in KINDS.items():
        elements = (*observed.spec.joints, *observed.spec.tendons)
        # in a prescribed joint these only change the drive force
        names = [
            element.name
            for element in elements
            if _has(element, field) and element.name not in observed.scene.joint_laws
        ]
        if not names:
            continue
        if len(names) > 1:
            edit = lambda spec, names=tuple(names), field=field: _without_springs(spec, names, field)  # noqa: E731
            candidates.append(
                RemovalCandidate(
                    SPRINGS, f"{what} of all {len(names)} joints that have one", edit, only_if_faster=True
                )
            )
        for name in names:
            edit = lambda spec, names=(name,), field=field: _without_springs(spec, names, field)  # noqa: E731
            candidates.append(RemovalCandidate(SPRINGS, f"{what} of {name}", edit, only_if_faster=True))
    return candidates


def _has(element: Any, field: str) -> bool:
    return bool(np.any(np.asarray(getattr(element, field)) != 0.0))


def _without_springs(spec: mujoco.MjSpec, names: tuple[str, ...], field: str) -> None:
    for element in (*spec.joints, *spec.tendons):
        if element.name in names:
            setattr(element, field, 0.0 if field == "frictionloss" else np.zeros(3))
