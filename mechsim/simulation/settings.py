"""How a model is stepped: integrator, step, constraint softness, flywheel; each declares all told of it."""

from dataclasses import asdict, dataclass, fields, replace
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from mechsim.numerics.angles import TURN
from mechsim.numerics.arrays import Array
from mechsim.simulation import setting_fields
from mechsim.simulation.matrices import KINDS, quicker
from mechsim.simulation.mjcf.generator import DRIVE_INERTIA_RATIO
from mechsim.simulation.model_loops import ModelLoops

INTEGRATORS = ("Euler", "implicitfast", "implicit", "RK4", "discrete")
JACOBIANS = ("auto", *KINDS)
SOLVERS = ("PGS", "CG", "Newton")
# time constant of the constraints, in steps, below which stepping rings
LEAST_CONSTANT = 10.0


# factor on softness where none is asked for: measured in validation/choices/constraint_settings.py
COMPLIANCE = 1e-8
# steps of Newton's method where there is more than equalities, at least
ITERATIONS = 100


def _compliance(value: float | None) -> str:
    return f"{COMPLIANCE if value is None else value:g} of MuJoCo's softness"


def _steps(value: float | None) -> str:
    return "a tenth of a turn" if value is None else f"{value:g} steps"


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """Settings of a time-stepped run.

    The defaults are the hard loop: fourth-order steps, constraints stiffened beyond MuJoCo's cap of
    0.9999 by scaling the inverse weights it softens them with, and a time constant that is a tenth of
    a turn. A time constant that shrinks with the step keeps a stiff mode in every step, and the order
    of Runge's method falls from four to two. Measured in validation/choices/constraint_settings.py.

    Each field declares all that is told of it: what it is, which values it takes and how others are
    refused; `doc` is its help on the command line, `row` its name and text in a report.
    """

    integrator: str = setting_fields.choice(
        "RK4",
        INTEGRATORS,
        "How MuJoCo steps.",
        doc=f"{', '.join(INTEGRATORS[:-1])} or {INTEGRATORS[-1]}.",
        row=("integrator", str),
    )
    steps_per_turn: int = setting_fields.number(
        1000,
        "Steps in a turn of the crank.",
        least=4,
        remedy="{value} steps a turn is a step of a quarter turn or more; take at least 4",
        doc="Steps in a turn of the crank.",
        row=("steps per turn", str),
    )
    constant_steps: float | None = setting_fields.number(
        None,
        "Time constant of the constraints, in steps; None takes a tenth of a turn, at least ten steps. "
        "`solref` overrides it.",
        doc="Time constant of the constraints, in steps; a tenth of a turn if left out, in a file 20.",
        row=("constraint time constant", _steps),
    )
    solref: tuple[float, float] | None = setting_fields.numbers(
        None,
        2,
        "MuJoCo's two numbers, as they are; None for (time constant, 1).",
        doc="Two numbers with a comma, as MuJoCo takes them.",
    )
    solimp: tuple[float, float, float, float, float] = setting_fields.numbers(
        (0.9999, 0.9999, 0.001, 0.5, 2.0),
        5,
        "MuJoCo's five numbers (dmin, dmax, width, midpoint, power).",
        doc="Two to five numbers with commas, as MuJoCo takes them.",
        fewest=2,
    )
    compliance: float | None = setting_fields.number(
        None,
        "Factor on the compliance of constraints; 1 is MuJoCo's own. None takes 1e-8, and another value "
        "where a position tolerance requires it.",
        doc="Factor on constraint compliance; 1 is MuJoCo's own. Default 1e-8, or what a tolerance needs.",
        row=("constraint compliance", _compliance),
    )
    refsafe: bool = setting_fields.switch(
        False,
        "Whether MuJoCo keeps the time constant at two steps or more.",
        doc="Whether MuJoCo keeps the time constant at two steps or more.",
    )
    diagexact: bool = setting_fields.switch(
        False,
        "Whether MuJoCo computes the diagonal of the constraint inertia exactly.",
        doc="Whether the diagonal of the constraint inertia is exact.",
    )
    jacobian: str = setting_fields.choice(
        "auto",
        JACOBIANS,
        "Matrices in the constraint solver; auto takes the quicker, and dense wherever the two do not agree.",
        doc=f"Matrices in the constraint solver: {', '.join(JACOBIANS[:-1])} or {JACOBIANS[-1]}.",
    )
    solver: str | None = setting_fields.choice(
        None,
        SOLVERS,
        "MuJoCo's constraint solver; None takes Newton's method.",
        doc=f"{', '.join(SOLVERS[:-1])} or {SOLVERS[-1]}; {SOLVERS[-1]} if left out.",
    )
    iterations: int | None = setting_fields.number(
        None,
        "Iterations of the solver, at most; None takes what is exact.",
        least=1,
        remedy="{name} is {value}; give a whole number above 0",
        doc="Iterations of the solver, at most; what is exact if left out.",
    )
    ls_iterations: int | None = setting_fields.number(
        None,
        "Iterations of the solver's line search, at most; None leaves MuJoCo's.",
        least=1,
        remedy="{name} is {value}; give a whole number above 0",
        doc="Iterations of the solver's line search, at most.",
    )
    residual: float | None = setting_fields.number(
        None,
        "At which the solver stops; None never before its iterations are made.",
        least=0.0,
        remedy="{name} is {value}; give a finite number, 0 or above",
        doc="At which the solver stops.",
    )
    eulerdamp: bool = setting_fields.switch(
        True,
        "Whether Euler takes joint damping implicitly.",
        doc="Whether Euler takes joint damping implicitly.",
    )
    island: bool = setting_fields.switch(
        False,
        "Whether constraints are solved island by island.",
        doc="Whether constraints are solved island by island.",
    )
    drive_inertia: float | None = setting_fields.number(
        None,
        "Inertia on the crank, or on each driver, that holds its speed, in [kg m2]; None for 1e12 times that "
        "of the links, which no reaction of theirs and no redundant constraint turns.",
        doc="Virtual inertia on the driver that keeps its speed, kg m2; default 1e12 times the links'.",
    )

    def __post_init__(self) -> None:
        for one in fields(self):
            value = getattr(self, one.name)
            if value is not None or one.default is not None:
                setting_fields.check(one.name, value, one.metadata)

    def timestep(self, speed: float) -> float:
        """Return the step in [s] at a crank speed in [rad/s]."""
        return TURN / abs(speed) / self.steps_per_turn

    @property
    def constant(self) -> float:
        """The time constant of the constraints in steps."""
        return self.constant_steps or max(LEAST_CONSTANT, self.steps_per_turn / 10.0)

    @property
    def compliance_used(self) -> float:
        """The compliance that is taken."""
        return COMPLIANCE if self.compliance is None else self.compliance

    def apply(self, loops: ModelLoops, timestep: float, *, bending: bool = False) -> "Settings":
        """Set up a compiled model for a run; its own constraint and solver settings are replaced.

        Args:
            loops: of the model.
            timestep: in [s].
            bending: whether constraints will ask for the accelerations by which couplings bend.

        Returns:
            The settings, with what was left to choose chosen.
        """
        model = loops.model
        option = model.opt
        option.timestep = timestep
        option.integrator = int(getattr(mujoco.mjtIntegrator, f"mjINT_{self.integrator.upper()}"))
        option.solver = int(mujoco.mjtSolver.mjSOL_NEWTON)
        equalities = _only_equalities(model)
        # beside flywheels what is left of a gradient is always a small part
        option.iterations, option.tolerance = max(option.iterations, ITERATIONS), 0.0
        if equalities and not (self.integrator == "discrete" and _springy(model)):
            # the cost is then quadratic: one step of Newton's method is exact
            option.iterations = 1
        disable, enable = mujoco.mjtDisableBit, mujoco.mjtEnableBit
        if self.solver is not None:
            option.solver = int(getattr(mujoco.mjtSolver, f"mjSOL_{self.solver.upper()}"))
        option.iterations = option.iterations if self.iterations is None else int(self.iterations)
        option.ls_iterations = option.ls_iterations if self.ls_iterations is None else int(self.ls_iterations)
        # this takes accelerations anew from the forces: their rounding, over the softness of hard loops
        option.noslip_iterations = 0
        option.tolerance = option.tolerance if self.residual is None else self.residual
        _set(option, "disableflags", int(disable.mjDSBL_SENSOR), True)
        _set(option, "disableflags", int(disable.mjDSBL_ISLAND), not self.island)
        _set(option, "disableflags", int(disable.mjDSBL_EULERDAMP), not self.eulerdamp)
        _set(option, "disableflags", int(disable.mjDSBL_REFSAFE), not self.refsafe)
        _set(option, "enableflags", int(enable.mjENBL_DIAGEXACT), self.diagexact)
        model.eq_solref[:] = self.solref or self._solref(timestep, self.constant)
        model.eq_solimp[:] = self.solimp
        model.body_invweight0[:] *= self.compliance_used
        model.dof_invweight0[:] *= self.compliance_used
        model.tendon_invweight0[_coupled_tendons(model, loops)] *= self.compliance_used
        if not bending:
            # a constraint leaves out the bend of a polynomial: the sooner it draws back the better
            bent = [one.equality for one in loops.couplings if one.nonlinear]
            model.eq_solref[bent] = self.solref or self._solref(timestep, LEAST_CONSTANT)
        set_armature(
            model,
            np.array([loops.crank]),
            self.drive_inertia
            or drive_inertia(
                model.body_mass, model.body_inertia, loops.characteristic_length, self.compliance_used
            ),
        )
        used = replace(self, compliance=self.compliance_used)
        if self.jacobian == "auto":
            used = replace(used, jacobian=quicker(model) if equalities else "dense")
        option.jacobian = KINDS["sparse" if used.jacobian == "sparse" else "dense"]
        return used

    def _solref(self, timestep: float, steps: float) -> tuple[float, float]:
        """Return a time constant in steps, or stiffness and damping where its square is MuJoCo's zero."""
        constant = steps * timestep
        if constant**2 > 1e-12 or self.refsafe:
            return constant, 1.0
        return -1.0 / constant**2, -2.0 / constant

    def as_dict(self) -> dict[str, Any]:
        """Return the settings as plain data."""
        return asdict(self)

    def rows(self) -> dict[str, str]:
        """Return the settings that a report tells, by name."""
        told = ((one.metadata.get("row"), getattr(self, one.name)) for one in fields(self))
        return {row[0]: row[1](value) for row, value in told if row}


def set_armature(model: mujoco.MjModel, dofs: NDArray[np.int64], armature: float | Array) -> None:
    """Give freedoms an armature in a compiled model.

    Of a body whose mass matrix is a diagonal anywhere MuJoCo keeps that diagonal from its compiler on.
    """
    model.dof_M0[dofs] += armature - model.dof_armature[dofs]
    model.dof_armature[dofs] = armature


def drive_inertia(mass: Array, inertia: Array, size: Any, compliance: float) -> Any:
    """Return the inertia that holds a crank's speed, in [kg m2], or (d,) of d designs.

    It is so many times that of all links about a point as far off as the longest of them, and as much more as
    loops are held harder than usual: in that proportion redundant constraints fight: at compliance 1e-10 this
    made the crank of a Bennett linkage 7e-8 faster.

    Args:
        mass: of the bodies, (..., nbody) in [kg].
        inertia: their principal moments, (..., nbody, 3) in [kg m2].
        size: yardstick of lengths, in [m], or (d,).
        compliance: of the loops, as in `Settings`.
    """
    return (
        DRIVE_INERTIA_RATIO
        * max(1.0, COMPLIANCE / compliance)
        * (mass.sum(-1) * size**2 + inertia.max(-1).sum(-1))
    )


def _coupled_tendons(model: mujoco.MjModel, loops: ModelLoops) -> list[int]:
    """Return the tendons that couplings of a model are of."""
    numbers = [one.equality for one in loops.couplings]
    of = [i for i in numbers if model.eq_type[i] == int(mujoco.mjtEq.mjEQ_TENDON)]
    return sorted({int(end) for i in of for end in (model.eq_obj1id[i], model.eq_obj2id[i]) if end >= 0})


def _set(option: Any, field: str, bits: int, on: bool) -> None:
    value = getattr(option, field)
    setattr(option, field, value | bits if on else value & ~bits)


def _only_equalities(model: mujoco.MjModel) -> bool:
    contacts = model.ngeom > 0 and not model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    limits = bool(model.jnt_limited.any() or model.tendon_limited.any())
    friction = bool((model.dof_frictionloss > 0.0).any() or (model.tendon_frictionloss > 0.0).any())
    return not (contacts or limits or friction)


def _springy(model: mujoco.MjModel) -> bool:
    """Say whether forces depend on the state, so that `discrete` has equations of its own to iterate on."""
    return bool(model.nu or model.ntendon or model.dof_damping.any() or model.jnt_stiffness.any())
