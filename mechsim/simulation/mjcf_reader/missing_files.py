"""A specification without the assets whose files are missing: kinematics need none of them."""

import re
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

_FILE = re.compile(r"(?:opening|open|find|load|read)\w* (?:file |resource )?'([^']+)'", re.IGNORECASE)
# stands in for the inertia of a body whose meshes are gone, in [kg] and [kg m2]
MASS, MOMENT = 1.0, 1e-3


def without_missing(spec: mujoco.MjSpec, message: str) -> str:
    """Leave out the assets of the kind whose file MuJoCo did not find.

    Args:
        spec: changed in place.
        message: what MuJoCo said.

    Returns:
        What was left out, in words; empty where the refusal names no asset's file.
    """
    match = _FILE.search(message)
    if not match:
        return ""
    missing = match[1]
    kinds: dict[str, Sequence[Any]] = {
        "meshes": spec.meshes,
        "textures": spec.textures,
        "height fields": spec.hfields,
        "skins": spec.skins,
    }
    for kind, assets in kinds.items():
        if any(_same_file(missing, name) for asset in assets for name in _files(asset)):
            _LEAVE_OUT[kind](spec)
            return f"file {missing} is missing: read without its {kind}"
    return ""


def _files(asset: Any) -> list[str]:
    return [name for name in (asset.file, *getattr(asset, "cubefiles", ())) if name]


def _same_file(missing: str, name: str) -> bool:
    return missing == name or missing.replace("\\", "/").endswith(name.replace("\\", "/").lstrip("./"))


def _no_meshes(spec: mujoco.MjSpec) -> None:
    _no_shapes(spec, [geom for geom in spec.geoms if geom.meshname])
    for mesh in list(spec.meshes):
        spec.delete(mesh)


def _no_height_fields(spec: mujoco.MjSpec) -> None:
    _no_shapes(spec, [geom for geom in spec.geoms if geom.hfieldname])
    for field in list(spec.hfields):
        spec.delete(field)


def _no_shapes(spec: mujoco.MjSpec, geoms: Sequence[Any]) -> None:
    """Make geoms points that touch nothing, and give bodies that had their mass from them a stand-in."""
    for geom in geoms:
        body = geom.parent
        geom.type = mujoco.mjtGeom.mjGEOM_SPHERE
        geom.size = np.array([1e-3, 0.0, 0.0])
        geom.meshname = geom.hfieldname = geom.material = ""
        geom.contype = geom.conaffinity = 0
        if body.id and not body.explicitinertial:
            body.explicitinertial = True
            body.mass, body.inertia = MASS, np.full(3, MOMENT)
            body.ipos, body.iquat = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
    if spec.compiler.inertiafromgeom == int(mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE):
        spec.compiler.inertiafromgeom = int(mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO)


def _no_textures(spec: mujoco.MjSpec) -> None:
    for material in spec.materials:
        material.textures = [""] * len(material.textures)
    for texture in list(spec.textures):
        spec.delete(texture)


def _no_skins(spec: mujoco.MjSpec) -> None:
    for skin in list(spec.skins):
        spec.delete(skin)


_LEAVE_OUT = {
    "meshes": _no_meshes,
    "textures": _no_textures,
    "height fields": _no_height_fields,
    "skins": _no_skins,
}
