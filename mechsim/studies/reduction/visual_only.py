"""Visual-only elements and sensors, which act on nothing: cameras, lights, geoms without contact, meshes."""

from collections.abc import Sequence
from typing import Any

import mujoco

from mechsim.studies.reduction.candidate import Candidate, count_text
from mechsim.studies.reduction.evidence import Evidence

CATEGORY = "visual-only elements"


def propose(observed: Evidence) -> list[Candidate]:
    """Propose to remove each kind of visual-only element."""
    spec, candidates = observed.spec, list[Candidate]()
    if spec.sensors:
        candidates.append(Candidate(CATEGORY, count_text(len(spec.sensors), "sensor"), _no_sensors))
    if count := len(spec.cameras) + len(spec.lights):
        candidates.append(
            Candidate(CATEGORY, count_text(count, "camera or light", "cameras and lights"), _no_cameras)
        )
    used = _used_geoms(spec) | observed.touched
    geoms = [geom.name for geom in spec.geoms if geom.name not in used]
    if geoms:
        what = f"{count_text(len(geoms), 'geom')} that touched nothing, with their meshes and materials"
        candidates.append(Candidate(CATEGORY, what, lambda spec: _no_geoms(spec, geoms)))
    elif spec.materials or spec.textures or spec.meshes:
        candidates.append(Candidate(CATEGORY, "materials, textures and meshes", _no_assets))
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
