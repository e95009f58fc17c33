"""What plain MuJoCo is told of a scene beside its parts: step, integrator, solver, softness of equalities."""

import copy
from dataclasses import dataclass, fields
from typing import Any

import mujoco
import numpy as np

from mechsim.errors import InputError
from mechsim.simulation.settings import INTEGRATORS, SOLVERS

JACOBIANS = ("dense", "sparse", "auto")
# flag of MJCF -> its bit, and whether the bit stands for off
FLAGS = {
    "refsafe": (int(mujoco.mjtDisableBit.mjDSBL_REFSAFE), True),
    "eulerdamp": (int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP), True),
    "island": (int(mujoco.mjtDisableBit.mjDSBL_ISLAND), True),
    "diagexact": (int(mujoco.mjtEnableBit.mjENBL_DIAGEXACT), False),
    "contact": (int(mujoco.mjtDisableBit.mjDSBL_CONTACT), True),
    "limit": (int(mujoco.mjtDisableBit.mjDSBL_LIMIT), True),
    "frictionloss": (int(mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS), True),
    "actuation": (int(mujoco.mjtDisableBit.mjDSBL_ACTUATION), True),
    "spring": (int(mujoco.mjtDisableBit.mjDSBL_SPRING), True),
}
# what a user may free, so that it need not stay as it is -> the flag that switches it off
FREEABLE = {
    "contacts": "contact",
    "limits": "limit",
    "friction": "frictionloss",
    "actuators": "actuation",
    "springs": "spring",
}
OPTIONS = ("timestep", "integrator", "solver", "iterations", "ls_iterations", "tolerance", "jacobian")
_WORDS: dict[str, tuple[str, Any, tuple[str, ...]]] = {
    "integrator": ("mjINT_", mujoco.mjtIntegrator, INTEGRATORS),
    "solver": ("mjSOL_", mujoco.mjtSolver, SOLVERS),
    "jacobian": ("mjJAC_", mujoco.mjtJacobian, JACOBIANS),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class PlainSettings:
    """Settings that an MJCF file can say; None leaves what the file has.

    Attributes:
        timestep: in [s].
        integrator: one of `settings.INTEGRATORS`.
        solver: one of `SOLVERS`.
        iterations: of the solver, at most.
        ls_iterations: of its line search, at most.
        tolerance: at which it stops.
        jacobian: one of `JACOBIANS`.
        solref: of all equality constraints.
        solimp: likewise.
        refsafe: whether time constants are kept at two steps or more.
        eulerdamp: whether Euler takes joint damping implicitly.
        island: whether constraints are solved island by island.
        diagexact: whether the diagonal of the constraint inertia is exact.
        contact: whether there are contacts.
        limit: whether joints and tendons have ends.
        frictionloss: whether anything rubs dry.
        actuation: whether actuators act.
        spring: whether springs of joints and tendons act.
        compliance: factor on the inverse weights that scale softness, after compiling: no file states it.
    """

    timestep: float | None = None
    integrator: str | None = None
    solver: str | None = None
    iterations: int | None = None
    ls_iterations: int | None = None
    tolerance: float | None = None
    jacobian: str | None = None
    solref: tuple[float, float] | None = None
    solimp: tuple[float, float, float, float, float] | None = None
    refsafe: bool | None = None
    eulerdamp: bool | None = None
    island: bool | None = None
    diagexact: bool | None = None
    contact: bool | None = None
    limit: bool | None = None
    frictionloss: bool | None = None
    actuation: bool | None = None
    spring: bool | None = None
    compliance: float | None = None

    @property
    def in_file(self) -> bool:
        """Whether a file can say all of it."""
        return self.compliance is None

    def applied(self, model: mujoco.MjModel) -> mujoco.MjModel:
        """Return a copy of a compiled model with these settings."""
        model = copy.copy(model)
        for name in OPTIONS:
            value = getattr(self, name)
            if value is not None:
                setattr(model.opt, name, _number(name, value))
        _set_flags(model.opt, self)
        if self.solref is not None:
            model.eq_solref[:] = self.solref
        if self.solimp is not None:
            model.eq_solimp[:] = self.solimp
        if self.compliance is not None:
            model.body_invweight0[:] *= self.compliance
            model.dof_invweight0[:] *= self.compliance
        return model

    def put_into(self, spec: mujoco.MjSpec) -> None:
        """Change a specification to these settings.

        Raises:
            InputError: for a compliance, which no file can say.
        """
        if self.compliance not in (None, 1.0):
            raise InputError(
                f"compliance is {self.compliance:g}, and an MJCF file can only state 1; leave it out, or let "
                "`mechsim tune --python` write lines that run it"
            )
        for name in OPTIONS:
            value = getattr(self, name)
            if value is not None:
                setattr(spec.option, name, _number(name, value))
        _set_flags(spec.option, self)
        for one in spec.equalities:
            one.solref = one.solref if self.solref is None else self.solref
            one.solimp = one.solimp if self.solimp is None else self.solimp

    def without_idle(self, model: mujoco.MjModel) -> "PlainSettings":
        """Return the same without what a compiled model has already."""
        has = settings_of(model)
        return PlainSettings(
            **{name: value for name, value in self.as_dict().items() if value != getattr(has, name)}
        )

    def as_dict(self) -> dict[str, Any]:
        """Return what is not left to the file."""
        told = {one.name: getattr(self, one.name) for one in fields(self)}
        return {name: value for name, value in told.items() if value is not None}


def settings_of(model: mujoco.MjModel) -> PlainSettings:
    """Return what a compiled model has; of equalities only what all have."""
    told: dict[str, Any] = {name: _text(name, getattr(model.opt, name)) for name in OPTIONS}
    for name, (bit, off) in FLAGS.items():
        told[name] = bool((model.opt.disableflags if off else model.opt.enableflags) & bit) != off
    for name, values in (("solref", model.eq_solref), ("solimp", model.eq_solimp)):
        told[name] = tuple(values[0].tolist()) if len(values) and (values == values[0]).all() else None
    return PlainSettings(**told)


def _set_flags(option: Any, settings: PlainSettings) -> None:
    for name, (bit, off) in FLAGS.items():
        on = getattr(settings, name)
        if on is not None:
            field = "disableflags" if off else "enableflags"
            bits = getattr(option, field)
            setattr(option, field, bits | bit if on != off else bits & ~bit)


def _number(name: str, value: Any) -> Any:
    if name not in _WORDS:
        return value
    prefix, kind, _ = _WORDS[name]
    return int(getattr(kind, prefix + str(value).upper()))


def _text(name: str, value: Any) -> Any:
    if name not in _WORDS:
        return int(value) if isinstance(value, int | np.integer) else float(value)
    prefix, kind, words = _WORDS[name]
    return next(word for word in words if int(getattr(kind, prefix + word.upper())) == int(value))
