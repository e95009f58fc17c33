"""Settings of time stepping: integrator, step, constraint compliance, virtual drive inertia and others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any, Literal

import mujoco
import numpy as np
from numpy.typing import NDArray

from mechsim.errors import InputError, several
from mechsim.mechanism.links import VIRTUAL_PREFIX
from mechsim.numerics.arrays import REVOLUTION, Array, number, numbers, unique
from mechsim.simulation.mjcf.generator import DRIVE_INERTIA_RATIO
from mechsim.simulation.model_loops import ModelLoops
from mechsim.simulation.plain_settings import INTEGRATORS, SOLVERS, PlainSettings
from mechsim.simulation.state import data_at, dense_rows, has_dry_friction, is_disabled, mass_matrix
from mechsim.units import option, parse, parse_vector, si

Jacobian = Literal["dense", "sparse"]
KINDS: dict[Jacobian, int] = {
    "dense": int(mujoco.mjtJacobian.mjJAC_DENSE),
    "sparse": int(mujoco.mjtJacobian.mjJAC_SPARSE),
}
# below this number of DOFs, or above this fraction of nonzero entries, sparse matrices are at most a tenth
# faster (validation/choices/matrices.py)
SPARSE_MIN_DOFS, SPARSE_MAX_FILL = 40, 0.25
# difference of accelerations, relative to the largest, above which it is not rounding
AGREEMENT_TOLERANCE = 1e-6


def faster_matrices(model: mujoco.MjModel) -> Jacobian:
    """Return the faster kind of matrices for a model with equality constraints only."""
    if model.nv < SPARSE_MIN_DOFS:
        return "dense"
    before = int(model.opt.jacobian)
    try:
        dense, filled = accelerations_and_fill(model, "dense")
        if filled > SPARSE_MAX_FILL:
            return "dense"
        sparse, _ = accelerations_and_fill(model, "sparse")
    finally:
        model.opt.jacobian = before
    agree = float(np.abs(sparse - dense).max()) <= AGREEMENT_TOLERANCE * float(np.abs(dense).max())
    return "sparse" if agree else "dense"


def accelerations_and_fill(model: mujoco.MjModel, kind: Jacobian) -> tuple[Array, float]:
    """Return the accelerations, (nv,), at distinct rates, and the fraction of nonzero matrix entries."""
    model.opt.jacobian = KINDS[kind]
    data = data_at(model, model.qpos0, np.sin(np.arange(model.nv) + 1.0))
    filled = np.nan
    if kind == "dense":
        inertia = mass_matrix(data)
        touched = (dense_rows(data) != 0.0).astype(np.float64)
        filled = float(((inertia != 0.0) | (touched.T @ touched > 0.0)).mean())
    return data.qacc.copy(), filled


# rules of numbers, with the message for others
POSITIVE = {"least": np.nextafter(0.0, 1.0), "remedy": "{name} is {value}; give a finite number above 0"}
COUNT = {"least": 1, "remedy": "{name} is {value}; give a whole number above 0"}


def setting(default: Any, about: str, **declared: Any) -> Any:
    """Declare a setting of a run, written as `--setting NAME=VALUE` on the command line.

    Args:
        default: value if none is set.
        about: meaning of the setting.
        declared: `options`, the allowed words; or `least`, with the message `remedy` for smaller numbers; or
            `count` of its numbers and the `fewest` that must be given; `row`, its name in a report and the
            function of its text.
    """
    return field(default=default, metadata={"about": about, **declared})


def check_setting(name: str, value: Any, rule: Mapping[str, Any]) -> None:
    """Raise InputError for a value that the declaration of a setting does not allow."""
    if "options" in rule and value not in rule["options"]:
        raise InputError(f"there is no {name} {value!r}; choose from {', '.join(rule['options'])}")
    if "least" in rule and not rule["least"] <= number(value) < np.inf:
        raise InputError(rule["remedy"].format(name=name, value=value))
    if "count" in rule:
        values = numbers(value)
        if values.shape != (rule["count"],) or not np.isfinite(values).all():
            raise InputError(f"{name} is {value}; give {rule['count']} finite numbers")


JACOBIANS = ("auto", *KINDS)
PLAIN_NAMES = {item.name for item in fields(PlainSettings)}
# time constant of the constraints, in steps, below which stepping oscillates
LEAST_CONSTANT = 10.0


# default factor on constraint compliance: measured in validation/choices/constraint_settings.py
COMPLIANCE = 1e-8
# minimum Newton iterations of the constraint solver with constraints other than equalities
ITERATIONS = 100


def _compliance(value: float | None) -> str:
    return f"{COMPLIANCE if value is None else value:g} of MuJoCo's compliance"


def _steps(value: float | None) -> str:
    return "a tenth of a turn" if value is None else f"{value:g} steps"


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """Settings of a time-stepped run.

    The defaults give stiff loops: fourth-order steps, constraints stiffened beyond MuJoCo's limit of 0.9999
    by scaling the inverse weights in their regularisation, and a time constant of a tenth of a revolution. A
    time constant proportional to the step would keep a stiff mode in every step and reduce the order of the
    Runge-Kutta method from four to two. Measured in validation/choices/constraint_settings.py.

    Each field declares its meaning, its valid values and the message for others; `row` is its name and text
    in a report.
    """

    integrator: str = setting(
        "RK4",
        "How MuJoCo steps.",
        options=INTEGRATORS,
        row=("integrator", str),
    )
    steps_per_turn: int = setting(
        1000,
        "Steps in a turn of the crank.",
        least=4,
        remedy="{value} steps a turn are too few; give at least 4",
        row=("steps per turn", str),
    )
    constant_steps: float | None = setting(
        None,
        "Time constant of the constraints, in steps; None takes a tenth of a turn, at least ten steps. "
        "`solref` overrides it.",
        row=("constraint time constant", _steps),
        **POSITIVE,
    )
    solref: tuple[float, float] | None = setting(
        None,
        "MuJoCo's two numbers, as they are; None for (time constant, 1).",
        count=2,
        fewest=2,
    )
    solimp: tuple[float, float, float, float, float] = setting(
        (0.9999, 0.9999, 0.001, 0.5, 2.0),
        "MuJoCo's five numbers (dmin, dmax, width, midpoint, power).",
        count=5,
        fewest=2,
    )
    compliance: float | None = setting(
        None,
        "Factor on the compliance of constraints; 1 is MuJoCo's own. None takes 1e-8, and another value "
        "where a position tolerance requires it.",
        row=("constraint compliance", _compliance),
        **POSITIVE,
    )
    refsafe: bool = setting(False, "Whether MuJoCo keeps the time constant above two steps.")
    diagexact: bool = setting(
        False,
        "Whether MuJoCo computes the diagonal of the constraint inertia exactly.",
    )
    jacobian: str = setting(
        "auto",
        "Matrices in the constraint solver; auto takes the faster, and dense if the two differ.",
        options=JACOBIANS,
    )
    solver: str | None = setting(
        None,
        "MuJoCo's constraint solver; None takes Newton's method.",
        options=SOLVERS,
    )
    iterations: int | None = setting(
        None,
        "Maximum iterations of the solver; None takes enough for an exact solution.",
        **COUNT,
    )
    ls_iterations: int | None = setting(
        None,
        "Maximum iterations of the solver's line search; None takes MuJoCo's.",
        **COUNT,
    )
    residual: float | None = setting(
        None,
        "Residual at which the solver stops; None makes all iterations.",
        least=0.0,
        remedy="{name} is {value}; give a finite number, 0 or above",
    )
    eulerdamp: bool = setting(True, "Whether Euler treats joint damping implicitly.")
    island: bool = setting(False, "Whether MuJoCo solves independent groups of constraints separately.")
    drive_inertia: float | None = setting(
        None,
        "Inertia on the crank, or on each driver, that holds its speed, in [kg m2]; None for 1e12 times that "
        "of the links, which no reaction of theirs and no redundant constraint turns.",
        **POSITIVE,
    )

    def __post_init__(self) -> None:
        for setting_ in fields(self):
            value = getattr(self, setting_.name)
            if value is not None or setting_.default is not None:
                check_setting(setting_.name, value, setting_.metadata)

    def timestep(self, speed: float) -> float:
        """Return the step in [s] at a crank speed in [rad/s]."""
        return REVOLUTION / abs(speed) / self.steps_per_turn

    @property
    def constant(self) -> float:
        """The time constant of the constraints in steps."""
        return self.constant_steps or max(LEAST_CONSTANT, self.steps_per_turn / 10.0)

    @property
    def compliance_used(self) -> float:
        """The compliance in effect."""
        return COMPLIANCE if self.compliance is None else self.compliance

    def apply(self, loops: ModelLoops, timestep: float) -> Settings:
        """Set up a compiled model for a run; its own constraint and solver settings are replaced.

        Args:
            loops: of the model.
            timestep: in [s].

        Returns:
            The settings with all automatic choices made.
        """
        model = loops.model
        contacts = model.ngeom > 0 and not is_disabled(model, mujoco.mjtDisableBit.mjDSBL_CONTACT)
        limits = bool(model.jnt_limited.any() or model.tendon_limited.any())
        friction = has_dry_friction(model)
        equalities = not (contacts or limits or friction)
        # the cost is then quadratic: one step of Newton's method is exact
        # unless forces depend on the state, so that `discrete` solves equations iteratively
        springy = model.nu or model.ntendon or model.dof_damping.any() or model.jnt_stiffness.any()
        exact = equalities and not (self.integrator == "discrete" and springy)
        constant = self.constant * timestep
        solref = constant, 1.0
        if constant**2 <= 1e-12 and not self.refsafe:
            # MuJoCo needs stiffness and damping instead of time constant and damping ratio
            solref = -1.0 / constant**2, -2.0 / constant
        plain: dict[str, Any] = {name: value for name, value in self.as_dict().items() if name in PLAIN_NAMES}
        plain |= {
            "timestep": timestep,
            "solver": self.solver or "Newton",
            "iterations": self.iterations or (1 if exact else max(model.opt.iterations, ITERATIONS)),
            # relative to the virtual inertia a remaining gradient is always small
            "tolerance": self.residual or 0.0,
            "solref": self.solref or solref,
            "sensor": False,
            "compliance": self.compliance_used,
        }
        PlainSettings(**plain).set_in(model)
        # noslip recomputes accelerations from forces, whose rounding is divided by the small compliance
        model.opt.noslip_iterations = 0
        rows = [row.equality for row in (*loops.couplings, *loops.rods)]
        tendons = [i for i in rows if model.eq_type[i] == int(mujoco.mjtEq.mjEQ_TENDON)]
        ends = unique(np.stack([model.eq_obj1id[tendons], model.eq_obj2id[tendons]]))
        model.tendon_invweight0[ends[ends >= 0]] *= self.compliance_used
        # a light body of a chain of slides would make its constraint softer than the loops
        virtual = [i for i in range(model.nbody) if model.body(i).name.startswith(VIRTUAL_PREFIX)]
        others = np.delete(model.body_invweight0, virtual, 0)
        model.body_invweight0[virtual] = np.minimum(model.body_invweight0[virtual], others.max(0))
        inertia = self.drive_inertia or drive_inertia(loops, self.compliance_used)
        set_armature(model, np.array([loops.crank]), inertia)
        used = replace(self, compliance=self.compliance_used)
        if self.jacobian == "auto":
            used = replace(used, jacobian=faster_matrices(model) if equalities else "dense")
        model.opt.jacobian = KINDS["sparse" if used.jacobian == "sparse" else "dense"]
        return used

    def as_dict(self) -> dict[str, Any]:
        """Return the settings as plain data."""
        return asdict(self)

    def rows(self) -> dict[str, str]:
        """Return the settings of a report, by name."""
        options = ((setting_.metadata.get("row"), getattr(self, setting_.name)) for setting_ in fields(self))
        return {row[0]: row[1](value) for row, value in options if row}


# settings with options of their own
OWN_OPTIONS = ("compliance", "drive_inertia")
NAMED = {item.name: item for item in fields(Settings) if item.name not in OWN_OPTIONS}


def setting_of(text: str) -> tuple[str, Any]:
    """Return name and value of a setting written as NAME=VALUE.

    Raises:
        InputError: for an unknown name, or a value of the wrong kind.
    """
    name, _, value = text.partition("=")
    if name not in NAMED:
        raise InputError(f"there is no setting {name!r}; choose from {', '.join(NAMED)}")
    rule, default, label = NAMED[name].metadata, NAMED[name].default, f"setting {name}"
    if isinstance(default, bool):
        if value not in ("true", "false"):
            raise InputError(f"{label} is {value!r}; give true or false")
        return name, value == "true"
    if "options" in rule:
        return name, value
    if "count" in rule:
        numbers, least, most = parse_vector(value, "1", label), rule["fewest"], rule["count"]
        if not least <= len(numbers) <= most:
            expected = str(least) if least == most else f"{least} to {most}"
            raise InputError(
                f"{label} is {value!r}, {several(len(numbers), 'number')}; give {expected}, with commas"
            )
        return name, numbers + (default if isinstance(default, tuple) else ())[len(numbers) :]
    number = float(parse(value, "1", label))
    return name, int(number) if number.is_integer() else number


@dataclass(frozen=True, slots=True, kw_only=True)
class SettingOptions:
    """Settings of the steps of a run."""

    setting: tuple[tuple[str, Any], ...] = option(
        (),
        f"Setting of the steps: {', '.join(NAMED)}.",
        read=setting_of,
        many=True,
        metavar="NAME=VALUE",
    )
    compliance: float | None = option(
        None, "Factor on MuJoCo's constraint compliance. Default: 1e-8, or what the tolerance requires."
    )
    drive_inertia: float | None = option(
        None,
        "Virtual inertia that keeps the driver's speed, in kg m2. Default: 1e12 that of the links.",
    )

    def stated(self) -> dict[str, Any]:
        """Return the settings that are given, by name."""
        own = {name: getattr(self, name) for name in OWN_OPTIONS}
        return dict(self.setting) | {name: value for name, value in own.items() if value is not None}


# settings of a driven run -> names in plain MuJoCo
MUJOCO_NAMES = {"residual": "tolerance"}


def plain_settings(
    settings: Mapping[str, Any],
    timestep: float | str | None,
    file_timestep: float,
    speed: float | None = None,
) -> PlainSettings:
    """Return settings of a run for plain MuJoCo; the file determines the others.

    Args:
        settings: settings by their names in `Settings`.
        timestep: time step in [s] or as text, instead of steps per revolution.
        file_timestep: time step of the file in [s].
        speed: crank speed in [rad/s], required for steps per revolution.

    Raises:
        InputError: for a setting of driven runs only, or two settings that exclude each other.
    """
    Settings(**settings)  # raises for values that no run can have
    values = {MUJOCO_NAMES.get(name, name): value for name, value in settings.items()}
    step = si(timestep, "s", "the time step")
    if step is not None and not 0.0 < step < np.inf:
        raise InputError(f"time step is {timestep}; give a finite time above 0")
    if "steps_per_turn" in values:
        if speed is None:
            raise InputError("setting steps_per_turn applies to a crank; give --timestep instead")
        if step is not None:
            raise InputError("both --timestep and setting steps_per_turn were given; give only one")
        step = REVOLUTION / abs(speed) / values["steps_per_turn"]
    if "constant_steps" in values:
        if "solref" in values:
            raise InputError("both constant_steps and solref were given; give only one")
        values["solref"] = values["constant_steps"] * (step or file_timestep), 1.0
    plain = {name: value for name, value in values.items() if name in PLAIN_NAMES}
    return PlainSettings(timestep=step, **plain)


def set_armature(model: mujoco.MjModel, dofs: NDArray[np.int64], armature: float | Array) -> None:
    """Set the armature of DOFs in a compiled model.

    MuJoCo's compiler stores the mass matrix of bodies for which it is constant and diagonal; it is updated.
    """
    model.dof_M0[dofs] += armature - model.dof_armature[dofs]
    model.dof_armature[dofs] = armature


def drive_inertia(loops: ModelLoops, compliance: float) -> float:
    """Return the virtual drive inertia that keeps a crank's speed, in [kg m2], at a compliance of the loops.

    It is a multiple of the inertia of all links at the distance of the characteristic length. It grows with
    the stiffness of the loops beyond the default, as the conflict of redundant constraints does: at
    compliance 1e-10 this made the crank of a Bennett linkage 7e-8 faster.
    """
    model, length = loops.model, loops.characteristic_length
    inertia = float(model.body_mass.sum() * length**2 + model.body_inertia.max(-1).sum())
    return DRIVE_INERTIA_RATIO * max(1.0, COMPLIANCE / compliance) * inertia
