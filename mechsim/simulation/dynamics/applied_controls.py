"""Forces applied to a freely moving model at every stage of a MuJoCo step, and its preparation.

MuJoCo calls `callbacks.c` at every stage; what it cannot evaluate is called in Python.
"""

import copy
import ctypes
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from typing import Any, Literal

import mujoco
import numpy as np

from mechsim.errors import InputError, MissingToolError, OutputError
from mechsim.mechanism.actuators import Actuator
from mechsim.mechanism.instructions import (
    CONTROLLER,
    EXPRESSION,
    INSTRUCTION,
    Instructions,
    NotCompiledError,
    Variable,
)
from mechsim.mechanism.motion_laws import State
from mechsim.mechanism.nonlinear_springs import OPEN, Phases, SoftStop, phases_of
from mechsim.numerics.arrays import Array
from mechsim.simulation.dynamics.inverse_dynamics import stiffen_friction
from mechsim.simulation.dynamics.loaded_model import LoadedModel
from mechsim.simulation.dynamics.stepped_friction import UpdatedFriction
from mechsim.simulation.mjcf.force_elements import AXES, native
from mechsim.simulation.mjcf.link_inertias import MASSLESS
from mechsim.simulation.model_loops import ModelLoops
from mechsim.simulation.settings import Settings
from mechsim.simulation.state import has_dry_friction
from mechsim.simulation.velocity_products import (
    CallbackData,
    callback_data,
    compiled_rows,
    nonlinear_rows,
    velocity_products,
)

# largest number of solutions for the forces of drives under dry friction, relative difference of a force
# after the first, and error of accelerations relative to the prescribed ones at which they are solved
MAX_SOLUTIONS, SMALL_DIFFERENCE, SOLVED = 8, 1e-3, 1e-9


def prepared(
    model: LoadedModel, settings: Settings, timestep: float, iterations: int, softer: float = 1.0
) -> ModelLoops:
    """Return the loops of a copy of the model for stepping, with stiff loops and without virtual inertia.

    Args:
        model: the model.
        settings: of the integrator and the constraints.
        timestep: in [s].
        iterations: of Newton's method in MuJoCo's constraint solver, with equalities alone.
        softer: factor on the compliance of dry friction; that of the loops is one of the settings.
    """
    loops = replace(model.loops, model=copy.copy(model.model))
    _weigh_massless(loops.model)
    inertias = loops.model.dof_armature.copy(), loops.model.dof_M0.copy()
    settings.apply(loops, timestep)
    stiffen_friction(loops.model, timestep, settings.compliance_used / softer)
    # a difference would leave the rounding of the virtual drive inertia
    loops.model.dof_armature[:], loops.model.dof_M0[:] = inertias
    loops.model.opt.iterations = max(loops.model.opt.iterations, iterations)
    return loops


def _weigh_massless(model: mujoco.MjModel) -> None:
    """Give massless bodies the inverse weights of the heaviest body.

    MuJoCo makes constraints compliant in proportion to inverse weights. By those of negligible masses, a
    coupling of a virtual body would yield more than the links move.
    """
    heavy, largest = copy.copy(model), model.body_mass.max()
    massless = (model.body_mass < MASSLESS * largest) & (model.body_mass > 0.0)
    if not massless.any():
        return
    heavy.body_mass[massless], heavy.body_inertia[massless] = largest, model.body_inertia.max()
    mujoco.mj_setConst(heavy, mujoco.MjData(heavy))
    for name in ("body_invweight0", "dof_invweight0", "tendon_invweight0"):
        getattr(model, name)[:] = getattr(heavy, name)


class AppliedControls:
    """Motor, loads, friction, controllers and prescribed motion of a model, set in MuJoCo's data.

    Args:
        model: the mechanism and its forces.
        loops: of the prepared model.
        laws: prescribed coordinate -> its motion law.
        phases: phases of the nonlinear springs at the start; empty for those without memory.
    """

    def __init__(
        self,
        model: LoadedModel,
        loops: ModelLoops,
        laws: Mapping[str, State] | None = None,
        phases: Phases = (),
    ) -> None:
        dry = list(model.dry)
        rubbing = any(friction.varies for friction in model.forces.friction)
        self.friction = UpdatedFriction(model, loops, dry) if rubbing else None
        self.model, self.loops = replace(model, dry=dry), loops
        self.impacts = ImpactMemory(model, loops, phases) if phases else None
        self.controllers = Controllers(model)
        self.drives = Drives(model, loops.model, laws or {})
        self.crank = loops.crank_address if model.mechanism.has_crank else None
        over = {profile.over for profile in model.forces.load_profiles} - {None}
        self.reacts = bool(model.dry or model.forces.nonlinear_springs or model.forces.bushings)
        other = self.reacts or self.controllers.used or self.drives.names
        self.constant = not (other or over or model.forces.actuators)
        self.compiled = None if self.remembers or self.drives.names else self._compiled()

    @property
    def executed(self) -> Literal["C", "Python"]:
        """What evaluates the forces: "C" if no step needs Python."""
        rows = nonlinear_rows(self.loops) and not compiled_rows(self.loops)
        in_python = self.remembers or self.drives.names or rows
        return "C" if (self.constant or self.compiled) and not in_python else "Python"

    @property
    def remembers(self) -> bool:
        """Whether each step depends on the one before it."""
        return self.friction is not None or self.impacts is not None

    def begin_step(self, data: mujoco.MjData) -> None:
        """Set what depends on the step before, from the present state."""
        if self.friction:
            self.friction.update(data)
        if self.impacts:
            self.impacts.update(data)

    def return_to(self, step: int) -> None:
        """Set what depends on the step before as it was at the start of a step."""
        if self.friction:
            self.friction.set(self.friction.history[step])
        if self.impacts:
            self.impacts.phases = self.impacts.history[step]

    def apply(self, data: mujoco.MjData) -> None:
        """Set controls and applied forces at MuJoCo's state."""
        if self.drives.evaluating:
            return
        angle = data.qpos[[self.crank]] if self.crank is not None else np.zeros(1)
        controls = self.model.controls(angle, np.array([data.time]))
        data.ctrl[:] = controls[0]
        if self.reacts:
            controls = data.ctrl[None]
            before = self.impacts.phases if self.impacts else ()
            self.model.react(data.actuator_length[None], data.actuator_velocity[None], controls, before)
            data.ctrl[:] = controls[0]
        data.qfrc_applied[:] = 0.0
        self.controllers.apply(data)
        self.drives.apply(data)

    def require_covered(self, time: float) -> None:
        """Raise InputError for a load table that ends before a time, where C has no number."""
        self.model.controls(np.zeros(1), np.array([time]))

    @contextmanager
    def installed(self, data: mujoco.MjData) -> Generator[Callable[[], None]]:
        """Apply them at every stage of a step of `data`; restore MuJoCo's callbacks afterwards.

        Yields what `velocity_products` yields.
        """
        with velocity_products(self.loops, data) as expand:
            before = mujoco.get_mjcb_control()
            if self.constant or self.compiled:
                self.apply(data)
            if self.compiled:
                library, qpos = self.compiled.library, ctypes.c_void_p(data.qpos.ctypes.data)
                library.select_forces(self.compiled.addresses, qpos)
                mujoco.set_mjcb_control(library.apply_forces)
            elif not self.constant:
                mujoco.set_mjcb_control(lambda _, state: self.apply(state))
            try:
                yield expand
            finally:
                mujoco.set_mjcb_control(before)

    def _compiled(self) -> CallbackData | None:
        """Return the forces in C; None if none varies, without a compiler, or with a function in Python."""
        if not self.constant:
            coordinates, others = self.controllers.coordinates, self.controllers.others
            with suppress(NotCompiledError, MissingToolError, OutputError):
                return compiled_controls(self.model, coordinates, others, self.crank)
        return None


class ImpactMemory:
    """The approach rates at which contacts of nonlinear springs closed in a stepped model.

    Where the length passes the limit between two steps, the rate is interpolated there.

    Args:
        model: the mechanism and its forces.
        loops: of the model to be stepped.
        phases: phases at the start.
    """

    def __init__(self, model: LoadedModel, loops: ModelLoops, phases: Phases) -> None:
        self.model, self.stepped, self.phases = model, loops.model, phases
        self.history = list[Phases]()
        self.last: tuple[Array, Array] | None = None

    def update(self, data: mujoco.MjData) -> None:
        """Set the phases of the next step by the present state."""
        mujoco.mj_fwdPosition(self.stepped, data)
        mujoco.mj_fwdVelocity(self.stepped, data)
        pair = self.model.springs(data.actuator_length[None], data.actuator_velocity[None])
        lengths, rates = (values[0].copy() for values in pair)
        springs, before = self.model.forces.nonlinear_springs, self.phases
        if self.last is not None:
            # of a contact that closed since the last step: where its gap was zero
            gaps, last = (
                np.array(
                    [spring.law.remaining(OPEN, *pair) for spring, *pair in zip(springs, *state, strict=True)]
                )
                for state in ((lengths, rates), self.last)
            )
            share = gaps / np.where(gaps < last, gaps - last, 1.0)
            closing = phases_of(springs, lengths, rates - share * (rates - self.last[1]))
            before = tuple(b or c for b, c in zip(before, closing, strict=True))
        self.phases = phases_of(springs, lengths, rates, before)
        self.last = lengths, rates
        self.history.append(self.phases)


class Controllers:
    """Controllers, and actuators that MuJoCo does not have, as forces applied to its degrees of freedom.

    Args:
        model: with the controllers among its forces.
    """

    def __init__(self, model: LoadedModel) -> None:
        self.used, self.others = model.forces.controllers, list[tuple[int, int, Actuator]]()
        states = 0
        for i, actuator in enumerate(model.forces.actuators):
            if not native(actuator):
                self.others.append((model.actuators.actuators.start + i, states, actuator))
            states += actuator.inflow is not None
        names = sorted(model.forces.controlled)
        # coordinate -> its address in qpos and its degree of freedom
        self.coordinates = dict(zip(names, zip(*dofs_of(model, names), strict=True), strict=True))

    def apply(self, data: mujoco.MjData) -> None:
        """Set the applied forces at MuJoCo's state."""
        if not (self.used or self.others):
            return
        values = {name: data.qpos[address] for name, (address, _) in self.coordinates.items()}
        rates = {name: data.qvel[dof] for name, (_, dof) in self.coordinates.items()}
        for controller in self.used:
            effort = controller.effort(values, rates, np.array([data.time]))
            data.qfrc_applied[self.coordinates[controller.coordinate][1]] += float(effort[0])
        for number, state, actuator in self.others:
            control = actuator.input(np.array(data.time))
            length, speed = data.actuator_length[number], data.actuator_velocity[number]
            activation = np.array(0.0 if actuator.inflow is None else data.act[state])
            force = float(actuator.force(control, length, speed, activation))
            if actuator.inflow is not None:
                data.ctrl[number] = actuator.state_rate(control, length, speed, activation)
            first, count = data.moment_rowadr[number], data.moment_rownnz[number]
            arms = slice(first, first + count)
            data.qfrc_applied[data.moment_colind[arms]] += data.actuator_moment[arms] * force


class Drives:
    """Forces that move degrees of freedom along motion laws, from MuJoCo's own accelerations.

    Under equality constraints accelerations are linear in applied forces: one more evaluation for each
    drive gives the forces of the prescribed accelerations. Where dry friction starts to slide they are
    piecewise linear, and Newton's method repeats this with smaller differences.

    Args:
        model: of the loops.
        stepped: the model to be stepped.
        laws: coordinate -> time to value, rate and acceleration.
    """

    def __init__(self, model: LoadedModel, stepped: mujoco.MjModel, laws: Mapping[str, State]) -> None:
        self.names, self.laws, self.stepped = tuple(laws), tuple(laws.values()), stepped
        self.dofs = np.array(dofs_of(model, laws)[1], dtype=np.int64)
        self.scratch = mujoco.MjData(stepped)
        self.rubbing = has_dry_friction(stepped)
        self.evaluating = False
        self.forces, self.others = np.zeros(len(laws)), np.zeros(stepped.nv)

    def apply(self, data: mujoco.MjData) -> None:
        """Set the applied forces of a state, once its controls are set."""
        if not self.names or self.evaluating:
            return
        self.evaluating = True
        self.others = data.qfrc_applied.copy()
        for name in ("qpos", "qvel", "ctrl", "qacc_warmstart"):
            getattr(self.scratch, name)[:] = getattr(data, name)
        self.scratch.time = data.time
        target = np.array([float(np.ravel(law(np.array([data.time]))[2])[0]) for law in self.laws])
        base, difference = self._accelerations(self.forces), 1.0
        for _ in range(MAX_SOLUTIONS):
            scale = difference * (1.0 + np.abs(self.forces))
            columns = [self._accelerations(self.forces + row) - base for row in np.diag(scale)]
            self.forces = self.forces + scale * np.linalg.solve(np.array(columns).T, target - base)
            if not self.rubbing:
                break
            base, difference = self._accelerations(self.forces), SMALL_DIFFERENCE
            if np.abs(target - base).max() <= SOLVED * (1.0 + np.abs(target).max()):
                break
        data.qfrc_applied[self.dofs] += self.forces
        self.evaluating = False

    def _accelerations(self, forces: Array) -> Array:
        self.scratch.qfrc_applied[:] = self.others
        self.scratch.qfrc_applied[self.dofs] += forces
        mujoco.mj_forward(self.stepped, self.scratch)
        return np.array(self.scratch.qacc[self.dofs])


def dofs_of(model: LoadedModel, names: Iterable[str]) -> tuple[list[int], list[int]]:
    """Return addresses in qpos and degrees of freedom of joint coordinates.

    Raises:
        InputError: for a coordinate at which the loops are cut, or that the model does not have.
    """
    names = [*names]
    for name in names:
        if name not in model.joints:
            raise InputError(
                f"{model.mechanism.name}: MuJoCo's loops are cut at coordinate {name!r}; "
                " give initial values of other joints"
            )
    chosen = [model.joints[name] for name in names]
    return model.model.jnt_qposadr[chosen].tolist(), model.model.jnt_dofadr[chosen].tolist()


_CONSTANTS = ("side", "rest", "stiffness", "damping", "preload")
_MATRIX = ("f8", (6, 6))
SPRING = np.dtype(
    [
        *((name, "i4") for name in ("control", "table", "over_rate")),
        *((name, "f8") for name in _CONSTANTS),
        ("expression", EXPRESSION),
    ],
    align=True,
)
BUSHING = np.dtype([("control", "i4"), ("stiffness", *_MATRIX), ("damping", *_MATRIX)], align=True)
DRY = np.dtype([("control", "i4"), ("count", "i4"), ("magnitude", "f8")], align=True)
DRIVEN = np.dtype([("control", "i4"), ("state", "i4")], align=True)


def compiled_controls(
    model: LoadedModel,
    coordinates: Mapping[str, tuple[int, int]],
    others: Sequence[tuple[int, int, Actuator]],
    crank: int | None,
) -> CallbackData:
    """Return the forces of a model for the C code.

    Args:
        model: the mechanism and its forces.
        coordinates: coordinate -> its address in qpos and its degree of freedom.
        others: actuators that MuJoCo does not have, with the numbers of their controls and states.
        crank: address of the crank in qpos; None without one.

    Raises:
        NotCompiledError: if a force is a function in Python.
        MissingToolError: if there is no C compiler.
        OutputError: if the cache is not writable.
    """
    added = Instructions()

    def variable(name: str, letter: str) -> Variable:
        address, dof = coordinates[name]
        return ("coordinate", address, 0.0) if letter == "q" else ("rate", dof, 1.0)

    controllers = [
        (coordinates[controller.coordinate][1], added.add_controller(controller, variable))
        for controller in model.forces.controllers
    ]
    gears = np.zeros((len(others), model.model.nv))
    for gear, (_, _, actuator) in zip(gears, others, strict=True):
        if actuator.ends:
            raise NotCompiledError(f"the line of {actuator.name}")
        for name, ratio in actuator.gear.items():
            gear[coordinates[name][1]] += ratio
    dry = [(joint.actuators[0], len(joint.actuators), joint.magnitude) for joint in model.dry]
    bushings = [(columns.start, *bushing.matrices) for bushing, columns in model.bushings]
    control = np.array(_varying(model, crank, added), CONTROLLER)
    actuators = added.add_actuators([actuator for _, _, actuator in others])
    springs = _springs(model, added)
    return callback_data(
        control,
        np.array(controllers, CONTROLLER),
        actuators,
        springs,
        np.array(bushings, BUSHING),
        np.array(dry, DRY),
        np.array([(control, state) for control, state, _ in others], DRIVEN),
        gears,
        np.array(added.rows, INSTRUCTION),
        np.array(added.numbers),
    )


def _varying(model: LoadedModel, crank: int | None, added: Instructions) -> list[tuple[int, tuple[int, int]]]:
    """Return the controls that depend on time or crank angle, with their expressions."""
    forces, kinds = model.forces, model.actuators
    angle: Variable = ("number", 0, 0.0) if crank is None else ("coordinate", crank, 0.0)
    profiles = [] if forces.crank_torque is None else [(kinds.crank_torque.start, forces.crank_torque)]
    for first, loads in (
        (kinds.loads.start, [load.force for load in forces.loads]),
        (kinds.couples.start, [couple.moment for couple in forces.couples]),
    ):
        profiles += [(first + len(AXES) * i, profile) for i, profile in enumerate(loads)]
    rows = [
        (first + k, expression)
        for first, profile in profiles
        if profile.over is not None
        for k, expression in enumerate(added.add_load(profile, angle))
    ]
    actuators = enumerate(forces.actuators, kinds.actuators.start)
    return rows + [(i, added.add_control(actuator)) for i, actuator in actuators if native(actuator)]


def _springs(model: LoadedModel, added: Instructions) -> np.ndarray[Any, Any]:
    """Return the nonlinear springs and stops."""
    springs = model.forces.nonlinear_springs
    table = np.zeros(len(springs), SPRING)
    for i, (row, spring) in enumerate(zip(table, springs, strict=True), model.actuators.nonlinear.start):
        for name, value in added.add_spring(spring).items():
            row[name] = value
        row["control"] = i
        if isinstance(law := spring.law, SoftStop):
            if law.exponent != 1.0:
                raise NotCompiledError("a contact law of Hertz")
            row["side"] = law.side
    return table
