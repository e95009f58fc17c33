"""mechsim itself: closed form, loop equations, generated C, and MuJoCo by configurations and by steps.

Inside the time: for stepping the rollout in C, every step recorded; for configurations `poses.follow`; for
loop equations, with path tracing, and generated C `solve` with rates and accelerations. Outside: model,
assembly, compilation, the batch of simulations, points and torque from states.
"""

import copy
import time
from dataclasses import dataclass, field, replace

import numpy as np
from problem import SAMPLES, Array, Positions, Problem
from protocol import Setting, Solver

from mechsim.codegen.compiled import compile
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.forces import Forces
from mechsim.mechanism.scene import Scene
from mechsim.simulation import Settings, constant, loop_jacobian
from mechsim.simulation.dynamics.prescribed_motion import driven
from mechsim.simulation.model_loops import ModelLoops, read_loops
from mechsim.simulation.poses import follow
from mechsim.simulation.source import assembled
from mechsim.simulation.stepping import step

CLOSED_FORM = "mechsim, closed form"
LOOPS, COMPILED = "mechsim, loop equations", "mechsim, compiled to C"
STEPS = (20, 40, 60, 100, 200, 500, 1000, 3000)
POSES = (20, 100, 1000, 10_000)
MUJOCO = Settings(
    integrator="Euler", solref=(0.02, 1.0), solimp=(0.9, 0.95, 0.001, 0.5, 2.0), compliance=1.0, refsafe=True
)


@dataclass(frozen=True)
class Stepped(Setting):
    """A revolution stepped with mechsim's settings."""

    settings: Settings = field(default_factory=Settings)


def settings(problem: Problem) -> list[Setting]:
    stiff, default = (
        [Stepped(series, n, settings=replace(base, steps_per_turn=n)) for n in STEPS]
        for series, base in (("mechsim, stepped (RK4)", Settings()), ("MuJoCo's defaults (Euler)", MUJOCO))
    )
    series_names = (CLOSED_FORM, LOOPS, COMPILED, "mechsim, configurations in MuJoCo")
    solved = [Setting(series, n, poses=True) for series in series_names for n in POSES]
    return [*solved, *stiff, *default]


def build(problem: Problem, setting: Setting) -> Solver:
    if isinstance(setting, Stepped):
        return StepSolver(problem, setting)
    solvers = {CLOSED_FORM: ClosedFormSolver, LOOPS: LoopSolver, COMPILED: CompiledCode}
    return solvers.get(setting.series, PoseSolver)(problem, setting)


# no force acts on the linkage except the drive torque
SCENE = Scene(level="dynamics", forces=Forces())


class ClosedFormSolver:
    """The closed form: the reference, whose errors are zero by definition."""

    def __init__(self, problem: Problem, setting: Setting):
        self.problem, self.angles = problem, problem.angles(setting.samples)

    def run(self) -> tuple[float, Positions]:
        begin = time.process_time()
        positions = self.problem.closed_form.positions(self.angles)
        return time.process_time() - begin, positions

    def torque(self) -> None:
        """None: the reduced equation is the reference for torques."""


class LoopSolver:
    """The loop equations of any mechanism, independent of the closed form."""

    def __init__(self, problem: Problem, setting: Setting):
        self.problem, self.angles = problem, problem.angles(setting.samples)
        self.solver = KinematicSolver(problem.closed_form.mechanism)

    def run(self) -> tuple[float, Positions]:
        # a copy has no traced path
        solver = replace(self.solver)
        begin = time.process_time()
        motion = solver.solve(self.angles, self.problem.speed)
        seconds = time.process_time() - begin
        return seconds, {name: point.position for name, point in motion.points.items()}

    def torque(self) -> None:
        """None: kinematics only."""


class CompiledCode:
    """The loop equations as generated C: links, joints, map and torques of each configuration."""

    def __init__(self, problem: Problem, setting: Setting):
        self.problem = problem
        angles = problem.angles(setting.samples)
        self.drivers, self.rates = angles[:, None], np.full((len(angles), 1), problem.speed)
        self.solver = compile(KinematicSolver(problem.mechanism))
        self.positions = list(problem.mechanism.points.items())

    def run(self) -> tuple[float, Positions]:
        begin = time.process_time()
        solved = self.solver.configurations(self.drivers, self.rates, np.zeros_like(self.rates))
        seconds = time.process_time() - begin
        names = list(self.solver.code.formulas.links)
        result: dict[str, Array] = {}
        for name, (link, local) in self.positions:
            numbers = solved.links[:, names.index(link)]
            result[name] = numbers[:, :3] + numbers[:, 3:12].reshape(-1, 3, 3) @ np.array(local)
        return seconds, result

    def torque(self) -> None:
        """None: the generated code includes gravity, which these problems lack."""


class PoseSolver:
    """The configurations of a revolution, solved in MuJoCo."""

    def __init__(self, problem: Problem, setting: Setting):
        self.problem = problem
        self.loops = read_loops(assembled(problem.mechanism, SCENE).compile())
        self.initial_state = loop_jacobian.close(self.loops, self.loops.model.qpos0[None])[0]
        self.angles = problem.angles(setting.samples)
        self.names = list(problem.mechanism.points)

    def run(self) -> tuple[float, Positions]:
        begin = time.process_time()
        states = follow.follow(self.loops, self.initial_state, self.angles)
        return time.process_time() - begin, points(self.loops, states, self.names)

    def torque(self) -> Array:
        problem = self.problem
        result = driven(problem.mechanism, speed=problem.speed, samples=len(self.angles) - 1)
        return result.forces.torque


class StepSolver:
    """A revolution stepped in MuJoCo."""

    def __init__(self, problem: Problem, setting: Stepped):
        self.problem = problem
        self.model = assembled(problem.mechanism, SCENE).compile()
        self.settings, self.record_interval = setting.settings, setting.steps // SAMPLES
        self.profile = constant(problem.speed, 1.0, problem.start)
        loops = read_loops(self.model)
        initial_state = loop_jacobian.close(loops, self.model.qpos0[None])
        rates = loop_jacobian.tangent(loops, loops.linearise(initial_state)[1]) * problem.speed
        self.start: tuple[Array, Array] = initial_state[0], rates[0]
        self.names = list(problem.mechanism.points)

    def run(self) -> tuple[float, Positions]:
        # the settings change the constraints of the model in each run
        loops = read_loops(copy.copy(self.model))
        steps = self.settings.steps_per_turn
        stepping = step(loops, self.settings, self.profile, self.start, steps, self.record_interval)
        return stepping.processor, points(loops, stepping.states.qpos, self.names)

    def torque(self) -> Array:
        problem, settings = self.problem, self.settings
        result = driven(
            problem.mechanism, speed=problem.speed, method="step", samples=SAMPLES, settings=settings
        )
        return result.forces.torque


def points(loops: ModelLoops, states: Array, names: list[str]) -> Positions:
    """Return the tracked points at states, (n, 3) each."""
    sites = loops.posed.site_positions(np.ascontiguousarray(states))
    return {name: sites[:, loops.model.site(name).id].copy() for name in names}
