"""A scene under inspection: the compiled model at its start, its loops, and assembled states nearby."""

import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from mechsim.errors import MechsimError, MobilityError, first_names
from mechsim.mechanism.finding import NO_POSITION, FilePosition, Finding
from mechsim.mechanism.motion_laws import CRANK, MotionLaws, State, make_motion_laws
from mechsim.numerics import rank as numerical_rank
from mechsim.numerics.arrays import Array
from mechsim.simulation import loop_jacobian
from mechsim.simulation.closed_configurations import CONVERGED, ROUNDED_ERROR
from mechsim.simulation.custom_model import at_initial_state, from_file, parameter_profile
from mechsim.simulation.drivers import PARAMETER_JOINT
from mechsim.simulation.mjcf.compiling import compiled, quiet
from mechsim.simulation.mjcf.included_files import included_lines
from mechsim.simulation.mjcf_reader.equality_constraints import CONNECT, TENDON, WELD, is_readable
from mechsim.simulation.mjcf_reader.mjcf_model import MjcfModel
from mechsim.simulation.mobility import require_determined, residual_mobility
from mechsim.simulation.poses.follow import follow
from mechsim.simulation.state import SLIDE, data_at, dense_rows, is_disabled

# elements of a file that a finding can refer to
Element = (
    mujoco.MjsBody
    | mujoco.MjsJoint
    | mujoco.MjsGeom
    | mujoco.MjsEquality
    | mujoco.MjsActuator
    | mujoco.MjsTendon
)
EQUALITY = int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
OFF = mujoco.mjtDisableBit
# singular values below this fraction of the largest count as zero: files are rounded to 1e-6
RANK_TOLERANCE = 1e-5
# largest displacement of a joint from the start in sample states, in [rad] or [m]
PERTURBATION = 0.1
# limit of Newton steps, and residual of an assembled state as a fraction of the characteristic length
MAX_NEWTON_STEPS, CLOSED_TOLERANCE = 30, 1e-10


@dataclass(frozen=True, slots=True)
class Loop:
    """An active equality constraint.

    Attributes:
        name: of the constraint.
        number: index in the model.
        kind: MuJoCo's number for the type of the constraint.
        element: the equality in the file.
    """

    name: str
    number: int
    kind: int
    element: mujoco.MjsEquality

    @property
    def closes(self) -> bool:
        """Whether the constraint joins points of bodies (connect or weld) and does not couple coordinates."""
        return self.kind in (CONNECT, WELD)


@dataclass(frozen=True, eq=False)
class Inspected:
    """A scene and the motion laws of its drivers.

    Attributes:
        read: the file as read.
        motion_laws: motion laws of the drivers; `CRANK` if there are none.
    """

    read: MjcfModel
    motion_laws: MotionLaws = CRANK

    @cached_property
    def model(self) -> mujoco.MjModel:
        """The compiled model."""
        return compiled(self.read.spec.copy())

    @cached_property
    def loops_only(self) -> mujoco.MjModel:
        """The model with its loops and Coulomb friction as the only constraints."""
        model = compiled(self.read.spec.copy())
        model.opt.disableflags |= int(OFF.mjDSBL_CONTACT) | int(OFF.mjDSBL_LIMIT)
        model.opt.jacobian = int(mujoco.mjtJacobian.mjJAC_DENSE)
        return model

    @cached_property
    def loop_data(self) -> mujoco.MjData:
        """Data of `loops_only`, for one state after another: new data takes a hundred times as long."""
        return mujoco.MjData(self.loops_only)

    @cached_property
    def started(self) -> mujoco.MjData:
        """MuJoCo's data of the model at rest at its start; do not change it."""
        return data_at(self.model, self.read.qpos)

    @cached_property
    def length(self) -> float:
        """Characteristic length of the mechanism, in [m]."""
        return self.read.mechanism.characteristic_length

    @property
    def drivers(self) -> tuple[str, ...]:
        """The driven joints."""
        return self.read.mechanism.drivers

    @cached_property
    def loops(self) -> tuple[Loop, ...]:
        """The active equality constraints that are joints or couplings."""
        model = self.model
        if is_disabled(model, OFF.mjDSBL_EQUALITY):
            return ()
        elements = list(self.read.spec.equalities)
        return tuple(
            Loop(model.equality(i).name, i, int(model.eq_type[i]), elements[i])
            for i in range(model.neq)
            if model.eq_active0[i] and is_readable(model, i)
        )

    @cached_property
    def included(self) -> Mapping[tuple[str, ...], FilePosition]:
        """Positions of the elements of included files, by kind and name."""
        # a model object has no file
        return included_lines(self.read.path) if Path(self.read.path).is_file() else {}

    def in_metres(self, loop: Loop) -> bool:
        """Whether the gap of a loop is a length: that of points, slides or tendons through sites."""
        if loop.closes:
            return True
        law = next((law_ for law_ in self.read.mechanism.laws if law_.name == loop.name), None)
        joints = list(law.left_terms) if law else []
        return self.read.mechanism.unit(joints[0]) == "m" if joints else loop.kind == TENDON

    def finding(
        self, kind: str, element: Element | None, value: float, message: str, remedy: str, name: str = ""
    ) -> Finding:
        """Return a finding about an element of the file, by default called as there; None without a line."""
        position = NO_POSITION if element is None else self.location(element)
        name = name or ("" if element is None else str(element.name))
        return Finding(kind=kind, object=name, value=value, message=message, remedy=remedy, **position)

    def location(self, element: Element) -> FilePosition:
        """Return the position of an element in the file, or in a file that it includes."""
        match = re.search(r"line (\d+)", str(element.info))
        number = int(match[1]) if match else None
        # MuJoCo reports no line for elements of included files
        if number != 0:
            return {"file": "", "line": number}
        kind, line = type(element).__name__.removeprefix("Mjs").lower(), NO_POSITION
        if isinstance(element, mujoco.MjsEquality):
            line = self.included.get((kind, str(element.name1), str(element.name2)), line)
        return self.included.get((kind, str(element.name)), line)

    def loop_residuals(self, qpos: Array) -> tuple[Array, Array, Array]:
        """Return the residuals (m,) of the loops, their Jacobian (m, nv), and the loop of each row, (m,)."""
        data = self.loop_data
        data.qpos[:] = qpos
        mujoco.mj_fwdPosition(self.loops_only, data)
        rows = self.loop_rows(data)
        jacobian = self.without_rounding(dense_rows(data)[rows])
        return data.efc_pos[rows].copy(), jacobian, data.efc_id[rows].copy()

    def loop_rows(self, data: mujoco.MjData) -> NDArray[np.bool_]:
        """Return a mask of MuJoCo's constraint rows that belong to the loops, (m,)."""
        numbers = [loop.number for loop in self.loops]
        return (data.efc_type == EQUALITY) & np.isin(data.efc_id, numbers)

    def without_rounding(self, jacobian: Array) -> Array:
        """Return the Jacobian of the loops, (m, nv), or zeros if all its entries are rounding errors."""
        return jacobian * (np.abs(jacobian).max(initial=0.0) > RANK_TOLERANCE * min(1.0, self.length))

    @cached_property
    def closed(self) -> Array | None:
        """The assembled state nearest to the start, (nq,); None if the loops do not close."""
        nearest = None if self.read.nearest is None else self.assembled_from(self.read.nearest)
        return self.assembled_from(self.read.qpos) if nearest is None else nearest

    def assembled_from(self, qpos: Array) -> Array | None:
        """Return the assembled state nearest to qpos, (nq,); None if Newton's method does not converge."""
        qpos, last = qpos.copy(), np.inf
        for _ in range(MAX_NEWTON_STEPS):
            gap, jacobian, _ = self.loop_residuals(qpos)
            error = float(np.abs(gap).max(initial=0.0)) / self.length
            if error <= CLOSED_TOLERANCE or (error < ROUNDED_ERROR and last < CONVERGED):
                return qpos
            step = -numerical_rank.least_norm(jacobian[None], gap[None], RANK_TOLERANCE, 0.0)[0]
            if not np.isfinite(step).all():
                return None
            last = float(np.abs(step).max())
            mujoco.mj_integratePos(self.loops_only, qpos, step, 1.0)
        return None

    @cached_property
    def sample_states(self) -> tuple[Array, ...]:
        """States near the start, (nq,) each, assembled if possible, since the start may be singular."""
        start = self.read.qpos if self.closed is None else self.closed
        _, jacobian, _ = self.loop_residuals(start)
        free = null_space(jacobian)
        if not len(free):
            return (start,)
        # every DOF has its own nonzero weight
        order = 1.0 + 0.3 * np.arange(len(free))
        states = [start]
        for weights in (order, -order, np.cos(order), -np.cos(order)):
            direction = weights @ free
            direction *= PERTURBATION / max(float(np.abs(direction).max()), 1e-300)
            guess = start.copy()
            mujoco.mj_integratePos(self.loops_only, guess, direction, 1.0)
            state = guess if self.closed is None else self.assembled_from(guess)
            states += [] if state is None else [state]
        return tuple(states)

    @cached_property
    def sample_jacobians(self) -> tuple[tuple[Array, Array], ...]:
        """The Jacobian of the loops in each of `sample_states`, (m, nv), and the loop of each row, (m,)."""
        return tuple(self.loop_residuals(qpos)[1:] for qpos in self.sample_states)

    @cached_property
    def generic(self) -> tuple[Array, Array]:
        """The sample Jacobian of the loops with the highest rank, (m, nv), and the loop of each row, (m,)."""
        return self.sample_jacobians[self.regular[0]]

    @cached_property
    def regular(self) -> list[int]:
        """The numbers of the sample states in which the loops have their highest rank; 0 is the start."""
        ranks = [loop_rank(jacobian) for jacobian, _ in self.sample_jacobians]
        return [number for number, own in enumerate(ranks) if own == max(ranks)]


def loop_rank(matrix: Array) -> int:
    """Return the rank of a Jacobian, (m, n)."""
    return numerical_rank.rank(matrix, RANK_TOLERANCE, 0.0)


def null_space(matrix: Array) -> Array:
    """Return a null-space basis of a Jacobian (m, n), (k, n)."""
    return numerical_rank.null_space(matrix, RANK_TOLERANCE, 0.0)


# default swing: amplitude in [rad], or as a fraction of the characteristic length; duration in [s]; and the
# number of attempts, each with half the amplitude of the previous attempt
REACH, STROKE, DURATION, TRIES = 0.3, 0.1, 1.0, 4
# number of states of a motion
SAMPLES = 101
# maximum number of drivers in a description
MAX_LISTED = 4


@dataclass(frozen=True, slots=True)
class Swing:
    """Assembled states of a scene, evenly spaced in time.

    Attributes:
        time: (n,) in [s].
        qpos: (n, nq).
        qvel: (n, nv).
        qacc: (n, nv).
        description: the moving drivers, as text.
    """

    time: Array
    qpos: Array
    qvel: Array
    qacc: Array
    description: str


@lru_cache(maxsize=1)
def driver_swing(scene: Inspected) -> Swing | None:
    """Return the motion of a scene under its motion laws, or a swing of its drivers if it has none.

    None if the drivers do not determine the motion, or the loops cannot be closed along it.
    """
    mechanism = scene.read.mechanism
    if not scene.motion_laws.crank:
        with suppress(MechsimError, np.linalg.LinAlgError, FloatingPointError):
            return _moved(scene, scene.motion_laws, "the motion laws")
        return None
    for half in range(TRIES if scene.drivers else 0):
        displacements = reaches(scene, 0.5**half)
        swings = [f"{name} by {by:.3g}" for name, by in displacements.items()]
        description = f"a swing of {first_names(swings, MAX_LISTED, 'more drivers')} in {DURATION:g} s"
        states = {name: wave(mechanism.guess_coordinates[name], by) for name, by in displacements.items()}
        try:
            laws = make_motion_laws(mechanism, states, DURATION)
            return _moved(scene, laws, description, returns=True)
        except MobilityError:  # no smaller swing is determined either
            return None
        except (MechsimError, np.linalg.LinAlgError, FloatingPointError):
            continue
    return None


def wave(start: float, reach: float) -> State:
    """Return the motion law of a swing from the start by `reach` and back."""
    w, half = 2.0 * np.pi / DURATION, 0.5 * reach

    def state(time: Array) -> tuple[Array, Array, Array]:
        sine, cosine = np.sin(w * time), np.cos(w * time)
        return start + half * (1.0 - cosine), half * w * sine, half * w**2 * cosine

    return state


def reaches(scene: Inspected, fraction: float = 1.0) -> Mapping[str, float]:
    """Return the swing of each driver within its limits: joint -> displacement in [rad] or [m]."""
    mechanism, result = scene.read.mechanism, dict[str, float]()
    for name in mechanism.drivers:
        slides = scene.model.joint(name).type[0] == SLIDE
        reach = fraction * (STROKE * scene.length if slides else REACH)
        low, high = scene.read.limits.get(name, (-np.inf, np.inf))
        up, down = high - mechanism.guess_coordinates[name], mechanism.guess_coordinates[name] - low
        result[name] = min(reach, up) if up >= min(reach, down) else -min(reach, down)
    return result


@quiet()
def _moved(scene: Inspected, laws: MotionLaws, description: str, *, returns: bool = False) -> Swing:
    """Return the motion under motion laws; with `returns` the second half is the first half reversed."""
    closed = from_file(scene.read, laws.drivers)
    require_determined(closed, residual_mobility(closed))
    closed = at_initial_state(closed, laws)
    time = np.linspace(0.0, laws.duration, SAMPLES)
    angle, speed, _ = parameter_profile(laws).state(time)
    # the second half of a swing is the first one, reversed
    states = follow(closed.loops, closed.qpos, angle[: SAMPLES // 2 + 1] if returns else angle)
    chunks = np.split(states, range(closed.loops.chunk, len(states), closed.loops.chunk))
    rates = np.concatenate(
        [loop_jacobian.tangent(closed.loops, closed.loops.linearised(chunk)[1]) for chunk in chunks]
    )
    if returns:
        states, rates = (np.concatenate([each, each[-2::-1]]) for each in (states, rates))
    rates *= speed[:, None]
    # states and rates without the entries of the path parameter
    parameter = closed.model.joint(PARAMETER_JOINT)
    qpos = np.delete(states, int(parameter.qposadr[0]), axis=1)
    qvel = np.delete(rates, int(parameter.dofadr[0]), axis=1)
    assert qpos.shape[1] == scene.model.nq
    return Swing(time, qpos, qvel, np.gradient(qvel, time, axis=0, edge_order=2), description)
