"""What is looked at or measured and acts on nothing: sensors, cameras, lights, geoms, meshes, sites."""

from collections.abc import Sequence
from typing import Any

import mujoco

from mechsim.studies.reduction.candidate import Candidate, counted
from mechsim.studies.reduction.evidence import Evidence

FAMILY = "ornaments"


def propose(seen: Evidence) -> list[Candidate]:
    """Propose to leave out each kind of ornament there is."""
    spec, found = seen.spec, list[Candidate]()
    if spec.sensors:
        found.append(Candidate(FAMILY, counted(len(spec.sensors), "sensor"), _no_sensors))
    if count := len(spec.cameras) + len(spec.lights):
        found.append(Candidate(FAMILY, counted(count, "camera or light", "cameras and lights"), _no_looks))
    used = _used_geoms(spec) | seen.touched
    geoms = [geom.name for geom in spec.geoms if geom.name not in used]
    if geoms:
        what = f"{counted(len(geoms), 'geom')} that touched nothing, with what they are drawn by"
        found.append(Candidate(FAMILY, what, lambda spec: _no_geoms(spec, geoms)))
    elif spec.materials or spec.textures or spec.meshes:
        found.append(Candidate(FAMILY, "materials, textures and meshes", _no_assets))
    return found


def _no_sensors(spec: mujoco.MjSpec) -> None:
    _delete(spec, spec.sensors)


def _no_looks(spec: mujoco.MjSpec) -> None:
    _delete(spec, spec.cameras)
    _delete(spec, spec.lights)


def _used_geoms(spec: mujoco.MjSpec) -> set[str]:
    """Return the geoms that tendons wrap round or that sensors measure."""
    wraps = {
        part.target.name
        for tendon in spec.tendons
        for part in tendon.path
        if part.type in (mujoco.mjtWrap.mjWRAP_SPHERE, mujoco.mjtWrap.mjWRAP_CYLINDER)
    }
    pairs = {name for pair in spec.pairs for name in (pair.geomname1, pair.geomname2)}
    return wraps | pairs


def _no_geoms(spec: mujoco.MjSpec, names: Sequence[str]) -> None:
    """Leave geoms out; what bodies weigh stays what it was."""
    bodies = [body for body in list(spec.bodies)[1:] if any(geom.name in names for geom in body.geoms)]
    for body in bodies:
        if not body.explicitinertial:
            spec.adopt_inertial(body)
    _delete(spec, [geom for geom in spec.geoms if geom.name in names])
    _no_assets(spec)


def _no_assets(spec: mujoco.MjSpec) -> None:
    """Leave out what geoms were drawn by, except meshes and height fields that some still are."""
    meshes = {geom.meshname for geom in spec.geoms}
    fields = {geom.hfieldname for geom in spec.geoms}
    _delete(spec, spec.skins)
    for parts in (spec.geoms, spec.sites, spec.tendons):
        for part in parts:
            part.material = ""
    _delete(spec, spec.materials)
    _delete(spec, spec.textures)
    _delete(spec, [mesh for mesh in spec.meshes if mesh.name not in meshes])
    _delete(spec, [field for field in spec.hfields if field.name not in fields])


def _delete(spec: mujoco.MjSpec, parts: Sequence[Any]) -> None:
    for part in list(parts):
        spec.delete(part)
