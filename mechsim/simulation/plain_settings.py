"""Settings of plain MuJoCo for a scene: step, integrator, solver, flags, compliance of the loops."""

import copy
from dataclasses import dataclass, fields
from typing import Any

import mujoco
import numpy as np

from mechsim.errors import InputError

INTEGRATORS = ("Euler", "implicitfast", "implicit", "RK4", "discrete")
SOLVERS = ("PGS", "CG", "Newton")
JACOBIANS = ("dense", "sparse", "auto")
# flag of MJCF -> its bit, and whether the bit disables
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
    "sensor": (int(mujoco.mjtDisableBit.mjDSBL_SENSOR), True),
    "energy": (int(mujoco.mjtEnableBit.mjENBL_ENERGY), False),
}
# kind of element that `--allow` permits to disable -> flag
ALLOWABLE = {
    "contacts": "contact",
    "limits": "limit",
    "friction": "frictionloss",
    "actuators": "actuation",
    "springs": "spring",
}
OPTIONS = ("timestep", "integrator", "solver", "iterations", "ls_iterations", "tolerance", "jacobian")
# option with named values -> name -> number
NUMBERS: dict[str, dict[str, int]] = {
    name: {word: int(getattr(kind, prefix + word.upper())) for word in words}
    for name, prefix, kind, words in (
        ("integrator", "mjINT_", mujoco.mjtIntegrator, INTEGRATORS),
        ("solver", "mjSOL_", mujoco.mjtSolver, SOLVERS),
        ("jacobian", "mjJAC_", mujoco.mjtJacobian, JACOBIANS),
    )
}
# highest impedance that MuJoCo accepts
LOWEST_COMPLIANCE_SOLIMP = (0.9999, 0.9999, 0.001, 0.5, 2.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class PlainSettings:
    """Settings of a scene; None keeps the file's own.

    Attributes:
        timestep: time step in [s].
        integrator: one of `INTEGRATORS`.
        solver: one of `SOLVERS`.
        iterations: largest number of solver iterations.
        ls_iterations: largest number of line search iterations.
        tolerance: tolerance at which the solver stops.
        jacobian: one of `JACOBIANS`.
        solref: `solref` of all equality constraints.
        solimp: `solimp` of all equality constraints.
        refsafe: whether time constants are at least two steps.
        eulerdamp: whether Euler integrates joint damping implicitly.
        island: whether constraints are solved by islands.
        diagexact: whether the diagonal of the constraint inertia is exact.
        contact: whether contacts are active.
        limit: whether limits of joints and tendons are active.
        frictionloss: whether Coulomb friction is active.
        actuation: whether actuators are active.
        spring: whether springs of joints and tendons are active.
        sensor: whether sensors are computed.
        energy: whether energies are computed in every step.
        compliance: factor on the inverse weights that scale compliance, applied after compilation; not part
            of MJCF.
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
    sensor: bool | None = None
    energy: bool | None = None
    compliance: float | None = None

    def applied(self, model: mujoco.MjModel) -> mujoco.MjModel:
        """Return a copy of a compiled model with these settings."""
        model = copy.copy(model)
        self.set_in(model)
        return model

    def set_in(self, model: mujoco.MjModel) -> None:
        """Change a compiled model to these settings."""
        self._set_options(model.opt)
        if self.solref is not None:
            model.eq_solref[:] = self.solref
        if self.solimp is not None:
            model.eq_solimp[:] = self.solimp
        if self.compliance is not None:
            model.body_invweight0[:] *= self.compliance
            model.dof_invweight0[:] *= self.compliance

    def put_into(self, spec: mujoco.MjSpec) -> None:
        """Change a specification to these settings.

        Raises:
            InputError: for a compliance, which no file can contain.
        """
        if self.compliance not in (None, 1.0):
            raise InputError(
                f"compliance is {self.compliance:g}, but an MJCF file can only contain 1; leave it out"
            )
        self._set_options(spec.option)
        for equality in spec.equalities:
            equality.solref = equality.solref if self.solref is None else self.solref
            equality.solimp = equality.solimp if self.solimp is None else self.solimp

    def _set_options(self, option: Any) -> None:
        for name in OPTIONS:
            value = getattr(self, name)
            if value is not None:
                value = NUMBERS[name][value] if name in NUMBERS else value
                setattr(option, name, type(getattr(option, name))(value))
        for name, (bit, off) in FLAGS.items():
            on = getattr(self, name)
            if on is not None:
                field = "disableflags" if off else "enableflags"
                bits = getattr(option, field)
                setattr(option, field, bits | bit if on != off else bits & ~bit)

    def changes_to(self, model: mujoco.MjModel) -> "PlainSettings":
        """Return those settings that differ from the settings of a compiled model."""
        own, stated = settings_of(model), self.as_dict().items()
        return PlainSettings(**{name: value for name, value in stated if value != getattr(own, name)})

    def as_dict(self) -> dict[str, Any]:
        """Return the settings that are not None."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: value for name, value in values.items() if value is not None}


UNCHANGED = PlainSettings()


def settings_of(model: mujoco.MjModel) -> PlainSettings:
    """Return the settings of a compiled model; those of equalities only if all equalities agree."""
    settings: dict[str, Any] = {name: option_value(name, getattr(model.opt, name)) for name in OPTIONS}
    for name, (bit, off) in FLAGS.items():
        settings[name] = bool((model.opt.disableflags if off else model.opt.enableflags) & bit) != off
    for name, values in (("solref", model.eq_solref), ("solimp", model.eq_solimp)):
        settings[name] = tuple(values[0].tolist()) if len(values) and (values == values[0]).all() else None
    return PlainSettings(**settings)


def option_value(name: str, value: Any) -> Any:
    """Return the value of an option in MuJoCo as that of a setting: a name or a number."""
    if name not in NUMBERS:
        return int(value) if isinstance(value, int | np.integer) else float(value)
    return next(word for word, own in NUMBERS[name].items() if own == int(value))
