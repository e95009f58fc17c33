"""A four-bar released from rest under its weight: error against cost of mechsim and its peers.

The catalogue's planar four-bar, steel rods, crank level at the start, one second of a motion in which the
crank swings through more than a revolution and back. Reference: the reduced equation of motion, derived by
hand in this file, by DOP853 at 1e-13. Error: the largest distance of pins A and B from it at 20 instants, in
cranks. Cost: processor time of the integration alone, the least of three runs. Exudyn: generalised alpha,
index 3, full Newton, and index 2, bodies with three coordinates. Pinocchio has no integrators: its
constrained dynamics with Baumgarte's correction under RK4, the loop over steps in Python.

Run: pip install -e '.[peers]' && python validation/peers/released.py
The script names and skips a peer that is not installed.
"""

import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from problem import Array, Problem
from scipy.integrate import solve_ivp

import mechsim as ms
from mechsim.mechanism.forces import Forces
from mechsim.simulation.dynamics.forward_run import stepped_run

GRAVITY, DURATION, INSTANTS, ROUNDS = 9.81, 1.0, 20, 3
WEIGHT = Forces(gravity=(0.0, -GRAVITY, 0.0))
# of Baumgarte's correction in [1/s]
BAUMGARTE_RATE = 100.0
TIMES = np.linspace(0.0, DURATION, INSTANTS + 1)
# pins A and B, (instants + 1, 2, 2) in [m], and the time of the integration in [s]
Solution = tuple[Array, float]


@dataclass(frozen=True)
class Released(Problem):
    """The four-bar at rest, without a driver."""

    speed: float = 0.0

    @property
    def duration(self) -> float:
        return DURATION

    @cached_property
    def bars(self) -> tuple[float, ...]:
        """Lengths of crank, coupler, rocker and ground in [m]."""
        four_bar: Any = self.closed_form
        return four_bar.crank, four_bar.coupler, four_bar.rocker, four_bar.ground

    def pins(self, crank: Array, rocker: Array) -> Array:
        """Return pins A and B at angles of crank and rocker, (n, 2, 2)."""
        a, _, c, d = self.bars
        pin_a = a * np.stack([np.cos(crank), np.sin(crank)], 1)
        pin_b = np.array([d, 0.0]) + c * np.stack([np.cos(rocker), np.sin(rocker)], 1)
        return np.stack([pin_a, pin_b], 1)


def reduced(problem: Released, angle: Any) -> tuple[Any, Any, Any]:
    """Return inertia, potential and pin B at a crank angle, which may include a complex step."""
    a, b, c, d = problem.bars
    crank = np.cos(angle), np.sin(angle)
    dx, dy = d - a * crank[0], -a * crank[1]
    square = dx * dx + dy * dy
    along = 0.5 + (b * b - c * c) / (2.0 * square)
    across = np.sqrt(b * b / square - along * along)
    # directions of coupler and rocker; B lies on the left of the line from A to the fixed pivot
    coupler = (along * dx - across * dy) / b, (along * dy + across * dx) / b
    rocker = (a * crank[0] + b * coupler[0] - d) / c, (a * crank[1] + b * coupler[1]) / c

    def sine(p: Any, q: Any) -> Any:
        return p[1] * q[0] - p[0] * q[1]

    coupler_rate = a * sine(crank, rocker) / (b * sine(rocker, coupler))
    rocker_rate = a * sine(crank, coupler) / (c * sine(rocker, coupler))
    inertia, potential = 0.0, 0.0
    frames = {
        "crank": (0.0, 0.0, crank, 1.0, (0.0, 0.0)),
        "coupler": (a * crank[0], a * crank[1], coupler, coupler_rate, (-a * crank[1], a * crank[0])),
        "rocker": (d, 0.0, rocker, rocker_rate, (0.0, 0.0)),
    }
    for name, (_, y, (cos, sin), rate, velocity) in frames.items():
        body = problem.inertia(name)
        u, v, _ = body.centre
        across_x, across_y = cos * u - sin * v, sin * u + cos * v
        point = velocity[0] - rate * across_y, velocity[1] + rate * across_x
        inertia += body.mass * (point[0] ** 2 + point[1] ** 2) + body.moments[2][2] * rate**2
        potential += body.mass * GRAVITY * (y + across_y)
    return inertia, potential, (d + c * rocker[0], c * rocker[1])


def reference(problem: Released) -> Array:
    """Return pins A and B at the instants, (instants + 1, 2, 2) in [m]."""

    def rates(_: float, state: Array) -> list[float]:
        inertia, potential, _ = reduced(problem, state[0] + 1e-30j)
        acceleration = -(0.5 * inertia.imag / 1e-30 * state[1] ** 2 + potential.imag / 1e-30) / inertia.real
        return [state[1], float(acceleration)]

    result = solve_ivp(rates, (0.0, DURATION), [0.0, 0.0], "DOP853", TIMES, rtol=1e-13, atol=1e-13)
    a = problem.bars[0]
    pins = [((a * np.cos(x), a * np.sin(x)), reduced(problem, x)[2]) for x in result.y[0]]
    return np.array(pins)


def by_mechsim(problem: Released) -> Iterator[tuple[str, str, Callable[[], Solution]]]:
    """Yield series, setting and solver of mechsim's two methods."""
    model = ms.dynamics.dynamic_model(problem.closed_form, WEIGHT)

    def analytic(tolerance: float) -> Solution:
        begin = time.process_time()
        run = ms.dynamics.run(model, duration=DURATION, samples=INSTANTS, tolerance=tolerance)
        seconds = time.process_time() - begin
        return np.stack([run.motion.points[name].position[:, :2] for name in "AB"], 1), seconds

    def stepped(steps: int) -> Solution:
        run = stepped_run(model.mechanism, WEIGHT, {}, {}, TIMES, steps // INSTANTS)
        return np.stack([run.motion.points[name].position[:, :2] for name in "AB"], 1), run.seconds

    for tolerance in (1e-5, 1e-7, 1e-9, 1e-11, 3e-13):
        yield "mechsim, analytic", f"tolerance {tolerance:g}", lambda t=tolerance: analytic(t)
    for steps in (500, 1000, 2000, 4000, 16_000):
        yield "mechsim, MuJoCo stepped (RK4)", f"{steps} steps", lambda n=steps: stepped(n)


def by_pinocchio(problem: Released) -> Iterator[tuple[str, str, Callable[[], Solution]]]:
    """Yield series, setting and solver of Pinocchio."""
    import pinocchio as pin
    from by_pinocchio import Baumgarte, Solver

    class Free(Solver):
        """The same tree and loop without armature of the crank, under gravity."""

        def __init__(self, steps: int):
            super().__init__(problem, Baumgarte("", steps, constants=BAUMGARTE_RATE * DURATION))
            self.model.armature[0] = 0.0
            self.model.gravity.linear = np.array([0.0, -GRAVITY, 0.0])
            self.data = self.model.createData()
            pin.initConstraintDynamics(self.model, self.data, self.constraints, self.workspace)

    def solved(steps: int) -> Solution:
        solver = Free(steps)
        begin = time.process_time()
        angles = np.array([q for q, _ in solver.stepped()])
        seconds = time.process_time() - begin
        return problem.pins(angles[:, 0], angles[:, -1]), seconds

    for steps in (500, 1000, 2000, 4000, 16_000):
        yield "Pinocchio (Python), RK4, Baumgarte", f"{steps} steps", lambda n=steps: solved(n)


def by_exudyn(problem: Released) -> Iterator[tuple[str, str, Callable[[], Solution]]]:
    """Yield series, setting and solver of Exudyn."""
    from by_exudyn import exudyn, items

    def solved(steps: int, index: int) -> Solution:
        container = exudyn.SystemContainer()
        system = container.AddSystem()
        ground = system.AddObject(items.ObjectGround())
        bodies: dict[str, int] = {}
        sensors: dict[str, int] = {}
        for link in problem.mechanism.links:
            start, inertia = problem.link(link.name), problem.inertia(link.name)
            angle = float(np.arctan2(start.rotation[0, 1, 0], start.rotation[0, 0, 0]))
            # referred to the centre of mass, where gravity acts
            centre = start.position[0] + start.rotation[0] @ np.array(inertia.centre)
            node = system.AddNode(items.NodeRigidBody2D(referenceCoordinates=[*centre[:2], angle]))
            bodies[link.name] = system.AddObject(
                items.ObjectRigidBody2D(nodeNumber=node, mass=inertia.mass, inertia=inertia.moments[2][2])
            )
            marker = system.AddMarker(items.MarkerBodyMass(bodyNumber=bodies[link.name]))
            system.AddLoad(items.LoadMassProportional(markerNumber=marker, loadVector=[0.0, -GRAVITY, 0.0]))
            recorded = {"storeInternal": True, "outputVariableType": exudyn.OutputVariableType.Coordinates}
            sensors[link.name] = system.AddSensor(items.SensorNode(nodeNumber=node, **recorded))
        for joint in problem.mechanism.joints:
            markers = []
            for end in (joint.a, joint.b):
                if end.link == "ground":
                    body, local = ground, np.array(end.point)
                else:
                    body = bodies[end.link]
                    local = np.array(end.point) - np.array(problem.inertia(end.link).centre)
                markers.append(system.AddMarker(items.MarkerBodyRigid(bodyNumber=body, localPosition=local)))
            system.AddObject(items.RevoluteJoint2D(markerNumbers=markers))
        system.Assemble()
        options = exudyn.SimulationSettings()
        options.solution.file.write = False
        options.solution.sensors.writePeriod = DURATION / INSTANTS
        options.parallel.numberOfThreads = 1
        options.linearSolver.solverType = exudyn.LinearSolverType.EigenDense
        integration = options.timeIntegration
        integration.endTime, integration.numberOfSteps = DURATION, steps
        integration.verboseMode = 0
        integration.newton.useModifiedNewton = False
        integration.generalizedAlpha.spectralRadius = 0.9
        if index == 2:
            integration.generalizedAlpha.useNewmark = True
            integration.generalizedAlpha.useIndex2Constraints = True
        solver = exudyn.MainSolverImplicitSecondOrder()
        system.sys["dynamicSolver"] = solver
        if not solver.InitializeSolver(system, options):
            raise RuntimeError("Exudyn could not start")
        begin = time.process_time()
        finished = solver.SolveSteps(system, options)
        seconds = time.process_time() - begin
        solver.FinalizeSolver(system, options)
        if not finished:
            return np.full((INSTANTS + 1, 2, 2), np.inf), seconds
        angles = {
            name: system.GetSensorStoredData(sensors[name])[-INSTANTS - 1 :, 3]
            + np.arctan2(*problem.link(name).rotation[0, [1, 0], 0])
            for name in ("crank", "rocker")
        }
        return problem.pins(angles["crank"], angles["rocker"]), seconds

    for index in (3, 2):
        for steps in (500, 1000, 2000, 4000, 16_000):
            name = f"Exudyn index {index}" + (", full Newton" if index == 3 else ", trapezoidal rule")
            yield name, f"{steps} steps", lambda n=steps, i=index: solved(n, i)


def main() -> None:
    problem = Released(ms.catalog.make("four_bar"))
    exact = reference(problem)
    print("| solver | setting | error [cranks] | ms |\n| --- | --- | --- | --- |")
    for peer in (by_mechsim, by_pinocchio, by_exudyn):
        try:
            for series, setting, solve in peer(problem):
                runs = [solve() for _ in range(ROUNDS)]
                error = float(np.linalg.norm(runs[0][0] - exact, axis=2).max()) / problem.crank
                seconds = min(seconds for _, seconds in runs)
                print(f"| {series} | {setting} | {error:.1e} | {1e3 * seconds:.3g} |", flush=True)
        except ModuleNotFoundError as error:
            print(f"{error.name} is not installed, so it is skipped", file=sys.stderr)


if __name__ == "__main__":
    main()
