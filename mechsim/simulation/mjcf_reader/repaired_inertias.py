"""Repairs inertias that MuJoCo rejects; kinematics does not depend on them."""

import re
from collections.abc import Iterable

import mujoco

# a mesh that bounds no volume
_FLAT = re.compile(r"mesh volume is too small: (\S+)")
# the least mass and moment of a moving body, in [kg] and [kg m2]
MASS, MOMENT = 1e-6, 1e-12


def with_possible_inertias(spec: mujoco.MjSpec, message: str) -> str:
    """Have MuJoCo even out inertias that break the triangle inequality, or raise those that are nought.

    Meshes that bound no volume weigh as shells.

    Args:
        spec: changed in place.
        message: what MuJoCo said.

    Returns:
        What was changed, in words; empty where the refusal is of something else.
    """
    text = " ".join(message.split())
    if "A + B >= C" in text and not spec.compiler.balanceinertia:
        spec.compiler.balanceinertia = 1
        return (
            "moments of inertia break the triangle inequality and MuJoCo refuses the file: read as with "
            '<compiler balanceinertia="true"/>, which evens them out'
        )
    if "must be larger than mjMINVAL" in text and spec.compiler.boundmass < MASS:
        spec.compiler.boundmass, spec.compiler.boundinertia = MASS, MOMENT
        return (
            "a moving body has no mass or no inertia and MuJoCo refuses the file: read as with "
            f'<compiler boundmass="{MASS:g}" boundinertia="{MOMENT:g}"/>'
        )
    flat = _FLAT.search(text)
    if flat and (mesh := spec.mesh(flat[1])) and mesh.inertia != mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL:
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
        return f'mesh {flat[1]!r} bounds no volume and MuJoCo refuses it: read as with inertia="shell"'
    return ""


def minimum_mass(remarks: Iterable[str]) -> float:
    """Return the mass in [kg] to which bodies without any were raised, by the remarks; 0 where none was."""
    return MASS if any("boundmass" in remark for remark in remarks) else 0.0
