"""The drivers of a model and their motion laws, as functions of a path parameter.

The path parameter is the angle of an added hinge joint, which replaces a single crank.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from numpy.typing import NDArray

from mechsim.errors import InputError
from mechsim.numerics.arrays import Array
from mechsim.simulation.state import SLIDE, scalar_joints

# name of the hinge joint, and of its body, whose angle is the path parameter
PARAMETER_JOINT = "mechsim:path_parameter"
# path parameter (n,) in [rad] -> drivers' values and first two derivatives by it, (drivers, n) each
Law = Callable[[Array], tuple[Array, Array, Array]]


@dataclass(frozen=True)
class Drivers:
    """The driven coordinates of a model as functions of the path parameter.

    Of a crank, whose angle is the path parameter, there are none.

    Attributes:
        names: names of the model's joints.
        addresses: addresses of their coordinates in qpos, (k,).
        dofs: indices of their DOFs, (k,).
        slides: whether each is a displacement, (k,).
        law: values and derivatives by the path parameter.
        text: path parameter -> driver values as text.
        crank: whether a crank is driven.
    """

    names: tuple[str, ...]
    addresses: NDArray[np.intp]
    dofs: NDArray[np.intp]
    slides: NDArray[np.bool_]
    law: Law
    text: Callable[[float], str]
    crank: bool = False

    def locked_at(self, values: Array) -> "Drivers":
        """Return drivers locked at values (k,), or (k, n) for n states."""
        law, text = _constant_law(self.names, values)
        return self if self.crank else replace(self, law=law, text=text)


def with_parameter_joint(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """Return a copy of a specification with the hinge of the path parameter, on which no force acts."""
    spec = spec.copy()
    body = spec.worldbody.add_body(name=PARAMETER_JOINT, gravcomp=0.0)
    body.explicitinertial = True
    # negligible, but above MuJoCo's minimum
    body.mass, body.inertia = 1e-9, np.full(3, 1e-12)
    body.add_joint(
        name=PARAMETER_JOINT,
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=(0.0, 0.0, 1.0),
        pos=(0.0, 0.0, 0.0),
        ref=0.0,
        springref=0.0,
        armature=0.0,
        frictionloss=0.0,
        damping=np.zeros(3),
        stiffness=np.zeros(3),
        limited=int(mujoco.mjtLimited.mjLIMITED_FALSE),
        actfrclimited=int(mujoco.mjtLimited.mjLIMITED_FALSE),
        actgravcomp=0,
    )
    return spec


def find_drivers(model: mujoco.MjModel, names: tuple[str, ...]) -> Drivers:
    """Return the drivers of given names, locked in the model's reference configuration.

    Raises:
        InputError: if a name is no hinge or slide of the model.
    """
    single = scalar_joints(model)
    for name in names:
        if name not in single:
            known_names = ", ".join(joint for joint in single if joint and joint != PARAMETER_JOINT)
            raise InputError(
                f"the model has no hinge or slide called {name!r} to drive (it has {known_names or 'none'})"
            )
    joints = np.array([single[name] for name in names], dtype=np.intp)
    addresses = model.jnt_qposadr[joints].astype(np.intp)
    slides = model.jnt_type[joints] == SLIDE
    law, text = _constant_law(names, model.qpos0[addresses])
    return Drivers(names, addresses, model.jnt_dofadr[joints].astype(np.intp), slides, law, text)


def _constant_law(names: tuple[str, ...], values: Array) -> tuple[Law, Callable[[float], str]]:
    values = np.reshape(values, (len(names), -1)) if names else np.zeros((0, 1))

    def law(angle: Array) -> tuple[Array, Array, Array]:
        zeros = np.zeros((len(values), len(angle)))
        return values + zeros, zeros, zeros

    def text(_: float) -> str:
        return ", ".join(f"{name} = {value:.6g}" for name, value in zip(names, values[:, 0], strict=True))

    return law, text


NONE = np.zeros(0, dtype=np.intp)
SINGLE_CRANK = Drivers(
    (), NONE, NONE, NONE > 0, _constant_law((), np.zeros(0))[0], lambda s: f"crank angle {s:.6g} rad", True
)
