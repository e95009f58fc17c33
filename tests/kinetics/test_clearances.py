"""Clearances of revolute joints against an integration in maximal coordinates, and what they reject."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from model_files import model_text
from scipy.integrate import solve_ivp

import mechsim as ms
from mechsim.kinetics import dynamic_model
from mechsim.kinetics.dynamic_run import initial_values
from mechsim.kinetics.gaps import released
from mechsim.mechanism.clearances import hertz_stiffness
from mechsim.mechanism.links import EX, EY, GROUND
from mechsim.simulation.dynamics.forward_run import stepped_run
from mechsim.studies.dynamics_check import crosscheck_forward

G, RADIUS = np.array([0.0, -9.81]), 0.5e-3
TEXT = model_text("clearance_slider_crank.toml")


@dataclass(frozen=True)
class Planar:
    """Bodies by their centres of mass, with pins between points; the last pin has the clearance.

    The equations of motion have a multiplier for each constraint (Nikravesh 1988, chapter 8).
    """

    masses: dict
    pins: list
    slider: str = ""

    def index(self, name):
        return 3 * list(self.masses).index(name)

    @property
    def mass(self):
        return np.concatenate([[m, m, j] for m, j in self.masses.values()])

    def arm(self, q, name, point):
        """Point of a body, its Jacobian (2, 3) in the body's coordinates, and the turned arm."""
        if name == GROUND:
            return np.array(point), np.zeros((2, 3)), np.zeros(2)
        x, y, angle = q[self.index(name) : self.index(name) + 3]
        c, s = np.cos(angle), np.sin(angle)
        r = np.array([c * point[0] - s * point[1], s * point[0] + c * point[1]])
        return np.array([x, y]) + r, np.array([[1, 0, -r[1]], [0, 1, r[0]]]), r

    def separation(self, q, v, pin):
        """Vector between both points of a pin, its Jacobian, and its velocity-product term."""
        rows, gap, product = np.zeros((2, len(q))), np.zeros(2), np.zeros(2)
        for (name, point), sign in zip(pin, (-1, 1), strict=True):
            position, jacobian, r = self.arm(q, name, point)
            gap += sign * position
            if name != GROUND:
                i = self.index(name)
                rows[:, i : i + 3] += sign * jacobian
                product -= sign * r * v[i + 2] ** 2
        return gap, rows, product

    def constraints(self, q, v):
        each = [self.separation(q, v, pin)[1:] for pin in self.pins[:-1]]
        if self.slider:
            each.append((np.eye(len(q))[self.index(self.slider) + 1 :][:2], np.zeros(2)))
        return np.concatenate([rows for rows, _ in each]), np.concatenate([product for _, product in each])

    def solved(self, rows, right, below):
        """Solve the equations with a diagonal mass matrix and constraint rows; return the first unknowns."""
        n, m = len(right), len(rows)
        matrix = np.block([[np.diag(self.mass), rows.T], [rows, np.zeros((m, m))]])
        return np.linalg.solve(matrix, np.concatenate([right, below]))[:n]

    def radial(self, q, v):
        """Distance of hole and pin, its rate, and its direction in the coordinates."""
        gap, rows, _ = self.separation(q, v, self.pins[-1])
        distance = np.hypot(*gap)
        direction = gap / max(distance, 1e-300) @ rows
        return distance, direction @ v, direction

    def rates(self, y, force):
        q, v = np.split(y, 2)
        weights = np.concatenate([[m * G[0], m * G[1], 0.0] for m, _ in self.masses.values()])
        rows, product = self.constraints(q, v)
        distance, rate, direction = self.radial(q, v)
        pressed = force(distance, rate) * direction if force else 0.0
        return np.concatenate([v, self.solved(rows, weights - pressed, -product)])

    def struck(self, y, restitution):
        """State after an impact of pin and hole."""
        q, v = np.split(y, 2)
        rows, _ = self.constraints(q, v)
        _, rate, direction = self.radial(q, v)
        every = np.concatenate([rows, direction[None]])
        right = np.append(np.zeros(len(rows)), -restitution * rate)
        return np.concatenate([q, self.solved(every, self.mass * v, right)])


def integrated(bodies, start, times, clearance):
    """Return states at instants, and instants at which pin and hole touch or part."""
    y, t, events, states = start, 0.0, [], np.empty((len(times), len(start)))
    force, radius = None, clearance.radius
    while True:

        def crossing(_, y):
            return bodies.radial(*np.split(y, 2))[0] - radius

        crossing.terminal, crossing.direction = True, -1.0 if force else 1.0
        # the pin is at the limit just after an event
        crossing_later = crossing if not events else _later(crossing, t)
        result = solve_ivp(
            lambda _, y, force=force: bodies.rates(y, force),
            (t, times[-1]),
            y,
            method="DOP853",
            rtol=1e-13,
            atol=1e-15,
            events=crossing_later,
            dense_output=True,
            max_step=1e-3,
        )
        within = (times >= t) & (times <= result.t[-1])
        if within.any():
            states[within] = result.sol(times[within]).T
        if result.status == 0:
            return states, events
        t, y = result.t[-1], result.y[:, -1]
        events.append(t)
        if not clearance.stiffness:
            y = bodies.struck(y, clearance.restitution)
        elif force:
            force = None
        else:
            force = _law(clearance, bodies.radial(*np.split(y, 2))[1])


def _later(crossing, t):
    def later(time, y):
        return crossing(time, y) if time > t + 1e-9 else -crossing.direction

    later.terminal, later.direction = True, crossing.direction
    return later


def _law(clearance, approach):
    e = clearance.restitution
    hysteresis = 8 * (1 - e) / (5 * e) if clearance.law == "flores" else 3 * (1 - e**2) / 4

    def force(distance, rate):
        depth = distance - clearance.radius
        return np.sign(depth) * clearance.stiffness * abs(depth) ** 1.5 * (1 + hysteresis * rate / approach)

    return force


def body(name, mass, moment):
    return ms.Link(name, inertia=ms.Inertia(mass, (0, 0, 0), (moment, moment, moment)))


def slider_crank():
    bodies = Planar(
        {"crank": (0.3, 1e-4), "rod": (0.21, 2.5e-4), "slider": (0.14, 1e-4)},
        [
            ((GROUND, (0, 0)), ("crank", (-0.025, 0))),
            (("crank", (0.025, 0)), ("rod", (-0.06, 0))),
            (("rod", (0.06, 0)), ("slider", (0, 0))),
        ],
        "slider",
    )
    guide = ms.Joint(
        "D", "prismatic", ms.End(GROUND, axis=EX, reference=EY), ms.End("slider", axis=EX, reference=EY)
    )
    return bodies, (guide,), {"A.q": 0.5, "A.v": 60.0}, 0.018


def four_bar():
    bodies = Planar(
        {"crank": (0.2, 1e-4), "coupler": (0.4, 4e-4), "rocker": (0.3, 3e-4)},
        [
            ((GROUND, (0, 0)), ("crank", (-0.02, 0))),
            (("crank", (0.02, 0)), ("coupler", (-0.06, 0))),
            ((GROUND, (0.13, 0)), ("rocker", (-0.04, 0))),
            (("coupler", (0.06, 0)), ("rocker", (0.04, 0))),
        ],
    )
    return bodies, (), {"A.q": 1.0, "A.v": 25.0}, 0.06


def pendulum():
    bodies = Planar(
        {"arm": (0.5, 1e-3), "bob": (0.3, 5e-4)},
        [((GROUND, (0, 0)), ("arm", (-0.1, 0))), (("arm", (0.1, 0)), ("bob", (-0.05, 0)))],
    )
    return bodies, (), {"A.q": -0.3, "A.v": 4.0, "B.turn.v": -6.0}, 0.05


LAWS = [
    ms.Clearance("", RADIUS, 0.7),
    ms.Clearance("", RADIUS, 0.8, 2e8),
    ms.Clearance("", RADIUS, 0.6, 5e8, law="flores"),
]


def made(case, clearance):
    """The bodies of a case, its model with a clearance, initial values and duration."""
    bodies, _, initial, duration = case()
    forces = ms.Forces(
        gravity=(0, -9.81, 0), clearances=(replace(clearance, joint="ABCD"[len(bodies.pins) - 1]),)
    )
    return bodies, released(dynamic_model(mechanism_of(case), forces)), initial, duration


def mechanism_of(case):
    bodies, joints, initial, _ = case()
    pins = tuple(
        ms.Joint("ABCD"[k], "revolute", *(ms.End(name, (*point, 0)) for name, point in pin))
        for k, pin in enumerate(bodies.pins)
    )
    links = tuple(body(name, *values) for name, values in bodies.masses.items())
    return ms.Mechanism(case.__name__, links, (*pins, *joints), driver="A", start=initial["A.q"], points={})


def states_of(bodies, motion):
    """States of the bodies in a motion, (n, 2 size)."""
    links = [motion.links[name] for name in bodies.masses]
    q = [
        np.column_stack([link.position[:, :2], np.arctan2(link.rotation[:, 1, 0], link.rotation[:, 0, 0])])
        for link in links
    ]
    v = [np.column_stack([link.velocity[:, :2], link.angular_velocity[:, 2]]) for link in links]
    return np.hstack([*q, *v])


@pytest.mark.parametrize("clearance", LAWS, ids=lambda c: c.law if c.stiffness else "restitution")
@pytest.mark.parametrize(
    "case",
    [four_bar, *(pytest.param(case, marks=pytest.mark.long) for case in (slider_crank, pendulum))],
    ids=lambda case: case.__name__,
)
def test_a_free_pin_moves_as_in_maximal_coordinates(case, clearance):
    bodies, model, initial, duration = made(case, clearance)
    run = ms.dynamics.run(model, initial=initial, duration=duration, samples=60)
    assert (run.outcome, run.executed) == ("done", "C")
    mine = states_of(bodies, run.motion)
    exact, events = integrated(bodies, mine[0], run.time, model.forces.clearances[0])
    assert len(events) > 2
    assert run.events == pytest.approx(events, abs=1e-9)
    positions = (mine - exact)[:, : mine.shape[1] // 2]
    assert np.abs((positions + np.pi) % (2 * np.pi) - np.pi).max() <= 1e-8 * 0.1
    assert run.energy_error <= 1e-10


@pytest.mark.long
def test_a_run_agrees_with_mujoco_free_and_in_contact(tmp_path):
    (tmp_path / "model.toml").write_text(TEXT)
    initial = {"A.q": 0.5, "A.v": 60.0}
    for old, new in (
        ("", ""),
        ("restitution=0.9", "restitution=0"),
        ("restitution=0.9", "restitution=0.9,stiffness=2e8"),
    ):
        (tmp_path / "model.toml").write_text(TEXT.replace(old, new))
        model = released(dynamic_model(ms.load(str(tmp_path / "model.toml"), still=True)))
        run = ms.dynamics.run(model, initial=initial, duration=0.012, samples=200)
        verdict = crosscheck_forward(run, model, initial_values(model, initial))
        assert verdict.passed, verdict
        assert len({check.variant for check in verdict.checks}) > 1
        if new:
            assert any(segment.closed or segment.phases > (0.0,) for segment in run.segments)
    softer = replace(model.forces.clearances[0], stiffness=2.02e8).contact
    springs = tuple(replace(spring, law=softer) for spring in model.forces.nonlinear_springs)
    changed = replace(model, forces=replace(model.forces, nonlinear_springs=springs))
    assert not crosscheck_forward(run, changed, initial_values(model, initial)).passed


@pytest.mark.long
def test_mujoco_converges_through_impacts():
    _, model, initial, _ = made(slider_crank, ms.Clearance("", RADIUS, 0.8, 2e8))
    run = ms.dynamics.run(model, initial=initial, duration=0.012, samples=4)
    values = initial_values(model, initial)
    exact, errors = run.motion.links["slider"].position[-1], []
    for substeps in (250, 500, 1000):
        stepped = stepped_run(
            model.mechanism, model.forces, values.coordinates, values.rates, run.time, substeps
        )
        errors.append(np.abs(stepped.motion.links["slider"].position[-1] - exact).max())
    # second order
    assert errors[1] <= errors[0] * 2.0**-1.8
    assert errors[2] <= errors[1] * 2.0**-1.8


def test_a_small_clearance_approaches_the_ideal_joint():
    bodies, _, initial, _ = four_bar()

    def end(radius):
        forces = ms.Forces(clearances=(ms.Clearance("D", radius, 0.0),) if radius else ())
        run = ms.dynamics.run(mechanism_of(four_bar), forces, initial=initial, duration=0.1, samples=4)
        return states_of(bodies, run.motion)[-1]

    exact = end(0.0)
    errors = [np.abs(end(radius) - exact)[:9].max() for radius in (1e-4, 1e-5, 1e-6)]
    assert errors[1] < 0.2 * errors[0]
    assert errors[2] < 0.2 * errors[1]


def test_a_stiffness_by_hertz_is_that_of_lankarani_and_nikravesh():
    # P. Flores, Nonlinear Dynamics 61 (2010): bearing of 10 mm, clearance 0.5 mm, steel
    assert hertz_stiffness(10e-3, 9.5e-3, 207e9, 0.3) == pytest.approx(6.61e10, rel=1e-3)


@pytest.mark.long
def test_peaks_of_acceleration_fall_with_the_clearance_as_published(tmp_path):
    """Crank 50 mm, rod 120 mm, 5,000 rpm, bearing of 10 mm (P. Flores, Nonlinear Dynamics 61 (2010) 633-653).

    There the peaks with 0.5 mm are several times those of ideal joints, the pin flies, collides and slides,
    and a smaller clearance approaches the ideal joint. The paper states these in words and plots.
    """
    ideal, ratios, touching = 0.05 * (5000 * np.pi / 30) ** 2 * (1 + 5 / 12), [], []
    for pin in (9.5, 9.9):
        text = f'hole_radius=10,pin_radius={pin},restitution=0.9,young="207 GPa"'
        (tmp_path / "model.toml").write_text(TEXT.replace("radius=0.5,restitution=0.9", text))
        model = ms.load(str(tmp_path / "model.toml"), drive={"A": "5000rpm"})
        run = ms.dynamics.run(model, prescribed=("A",), duration=0.024, samples=12000)
        ratios.append(np.abs(run.motion.points["S"].acceleration[6000:, 0]).max() / ideal)
        pin_joints = (run.motion.joints[f"C.{letter}"].value[6000:] for letter in "xy")
        touching.append((np.hypot(*pin_joints) > 1e-3 * (10 - pin)).mean())
        assert run.energy_error <= 1e-10
    assert ratios[0] > 3.0
    assert 1.0 < ratios[1] < 1.5
    assert 0.5 < touching[0] < touching[1]
    assert touching[0] < 0.95
