"""The suites of others: figures kept here are right, changed ones are not, and a clone is read from git."""

import subprocess

import numpy as np
import pytest
import yaml
from model_files import model_text
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import mechsim as ms
from validation.published.table import Row
from validation.suites import __main__ as command
from validation.suites import (
    chrono,
    exudyn,
    gepetto,
    kamino,
    loops,
    menagerie,
    modelica,
    page,
    pmks,
    squeezer,
    textbooks,
)
from validation.suites.case import Case, Clone, kept, printed_case, rejected
from validation.suites.released import entries, model_of, run_of


@pytest.mark.parametrize("case", ["Revolute_Case02", "Universal_Case03", "LinActuator_Case02"])
def test_figures_of_adams(case):
    result = chrono.compared(case, None)
    assert len(result.rows) >= 8
    assert result.outcome == "right", result


def test_a_changed_figure_is_an_unexplained_difference(monkeypatch):
    def changed(name):
        for case, what, accepted, time, *numbers in kept(name):
            shift = 0.1 if what == "Rforce" else 0.0
            yield [case, what, accepted, time, *(str(float(number) + shift) for number in numbers)]

    monkeypatch.setattr(chrono, "kept", changed)
    result = chrono.compared("Revolute_Case02", None)
    assert result.outcome == "unexplained"
    assert [row.quantity for row in result.rows if not row.passed] == ["Rforce"]


def test_a_case_without_rows_is_not_right():
    assert Case("empty").outcome == "unexplained"
    assert Case("empty", rejected="no such joint").outcome == "rejected"


@pytest.mark.parametrize(
    ("measured", "outcome"), [(1e-3, "source wrong"), (3e-3, "unexplained"), (None, "unexplained")]
)
def test_a_fault_counts_only_with_evidence(measured, outcome):
    evidence = () if measured is None else (Row("by a third method", measured, 2e-3, "m", "stated"),)
    rows = (Row("position", 1.0, 1e-3, "m", "printed"),)
    assert Case("a", rows, source_fault="a wrong digit", evidence=evidence).outcome == outcome
    if evidence:
        stated = {"source wrong": "rejected"}.get(outcome, outcome)
        assert Case("a", rejected="no assembly", evidence=evidence).outcome == stated


def test_a_stated_cause_of_a_rejection_needs_its_words_in_the_message():
    cause = {"rejected": "it has no motor", "says": "no actuator"}
    assert rejected("a", ms.InputError("no actuator acts on a joint"), cause).outcome == "rejected"
    assert rejected("a", ms.InputError("the loops do not close"), cause).outcome == "unexplained"
    assert rejected("a", ms.InputError("the loops do not close"), {}).outcome == "unexplained"


@pytest.mark.parametrize(
    ("exact", "caused", "outcome"),
    [
        ("x=2.00", "x=2.31", "source wrong"),
        ("x=2.10", "x=2.31", "unexplained"),
        ("x=2.00", "x=2.5", "unexplained"),
    ],
)
def test_a_fault_must_lead_from_our_value_to_the_printed_one(exact, caused, outcome):
    entry = {"values": "x=2.3", "source_fault": "a wrong sign", "exact": exact, "caused": caused}
    assert printed_case("a", entry, {"x": 2.001}.__getitem__).outcome == outcome


# at a right angle: C at x = 4, and its velocity is that of the crank pin, which is parallel to the guide
ROWS = "sample_id,x,y,vx,vy,ax,ay\n0,8,0,0,0,{},0\n1,4,0,-6,0,{},0\n"


@pytest.mark.parametrize(("last", "outcome"), [(9.0, "right"), (9.1, "unexplained")])
def test_a_clone_is_read_from_git(tmp_path, last, outcome):
    """Slider-crank, r 3, l 5, w 2: x'' = -w^2 (r + r^2/l) at 0, w^2 r^2/sqrt(l^2 - r^2) at 90 deg."""
    files = {
        "case.json": model_text("suites_slider_crank.json"),
        "matlab/samples.csv": "sample_id,input_angle_rad,input_direction\n0,0.5,1\n1,2.0707963267948966,1\n",
        "matlab/joints/C.csv": ROWS.format(-4 * (3 + 9 / 5), last),
        # of the rod -r w/l at 0 and w^2 r/sqrt(l^2 - r^2) at 90 deg
        "matlab/links/BC.csv": "sample_id,omega_rad_s,alpha_rad_s2\n0,-1.2,0\n1,0,3\n",
    }
    for name, text in files.items():
        path = tmp_path / pmks.ROOT / "slider" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    git = ["git", "-c", "user.name=a", "-c", "user.email=a@b", "-C", str(tmp_path)]
    for words in (["init", "-q"], ["add", "."], ["commit", "-qm", "x"]):
        subprocess.run([*git, *words], check=True)
    (case,) = pmks.cases(Clone(tmp_path))
    assert case.outcome == outcome, case


@pytest.mark.slow
def test_figures_of_all_suites():
    assert command.main([]) == 0


def test_an_unknown_suite_is_rejected(capsys):
    with pytest.raises(SystemExit) as error:
        command.main(["adams"])
    assert error.value.code == 2
    assert "there is no suite adams; give chrono" in capsys.readouterr().err


@pytest.mark.long
def test_printed_answers_of_textbooks(monkeypatch):
    outcomes = {case.name: case.outcome for case in textbooks.cases(None)}
    assert len(outcomes) == 30
    stated = textbooks.entries("textbooks")
    faults = {name for name, entry in stated.items() if "source_fault" in entry}
    assert {name for name, outcome in outcomes.items() if outcome == "source wrong"} == faults
    assert {*outcomes.values()} == {"right", "source wrong"}
    # another printed answer
    monkeypatch.setattr(
        textbooks, "entries", lambda _: {"Beer 15.9, Geneva wheel": {"values": "omega S=-4.18"}}
    )
    assert [case.outcome for case in textbooks.cases(None)] == ["unexplained"]


def stated_values(suite, name):
    """Return the values by a third method of an entry."""
    pairs = entries(suite)[name]["exact"].split("; ")
    return {quantity: float(number) for quantity, number in (pair.split("=") for pair in pairs)}


@pytest.mark.parametrize(
    ("name", "crank", "rod", "speed", "middle"),
    [("Khurmi 8.1, engine", 0.15, 0.6, -300.0, 0.5), ("Khurmi 7.2, engine", 0.5, 2.0, -180.0, 0.25)],
)
def test_the_exact_answers_of_the_engines(name, crank, rod, speed, middle):
    """Rod at the angle p below the line of stroke: l sin p = r sin t, derivatives by hand."""
    w, t = speed * np.pi / 30.0, np.pi / 4.0
    p = np.arcsin(crank * np.sin(t) / rod)
    rate = crank * np.cos(t) * w / (rod * np.cos(p))
    second = (rate**2 * np.sin(p) * rod - crank * np.sin(t) * w**2) / (rod * np.cos(p))
    pin, along = crank * w * np.array([-np.sin(t), np.cos(t)]), rod * np.array([np.sin(p), np.cos(p)])
    end, mid = (np.hypot(*(pin - fraction * rate * along)) for fraction in (1.0, middle))
    values = {"omega 3": -rate, "alpha 3": -second, "v G": mid, "v C": end}
    for quantity, stated in stated_values("textbooks", name).items():
        assert values[quantity] == pytest.approx(stated, rel=2e-4)


def test_the_exact_answers_of_the_joint():
    a, w, t = np.deg2rad(20.0), 50.0 * np.pi, np.linspace(0.0, np.pi, 200_001)
    b = np.sin(a) ** 2
    largest = np.abs(w**2 * np.cos(a) * b * np.sin(2.0 * t) / (1.0 - b * np.cos(t) ** 2) ** 2).max()
    stated = stated_values("textbooks", "Khurmi 9.9, Hooke's joint")
    assert stated == pytest.approx({"alpha": largest, "torque": 0.12 * largest}, rel=2e-4)


def test_the_branch_that_jumps_at_a_fold_gives_the_printed_value():
    """A pendulum of 1 m, slide at x = 2 cos a - 1: where x = -1 the mass is mirrored, DOP853."""

    def rates(_, state):
        return [state[1], -9.80665 * np.cos(state[0]) / 1.001]

    def folded(_, state):
        return np.cos(state[0])

    folded.terminal = True
    options = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13}
    stated = entries("loops")["multibody_joint_rrr"]
    whole = solve_ivp(rates, (0.0, 1.0), [-np.pi / 3.0, 0.0], **options).y[0, -1]
    assert stated["exact"] == f"slide.q={2.0 * np.cos(whole) - 1.0:.6f}"
    first = solve_ivp(rates, (0.0, 1.0), [-np.pi / 3.0, 0.0], events=folded, **options)
    second = solve_ivp(rates, (first.t[-1], 1.0), -first.y[:, -1], **options).y[0, -1]
    assert stated["caused"] == f"slide.q={2.0 * np.cos(second) - 1.0:.6f}"


@pytest.mark.long
def test_the_double_pendulum_in_which_dymola_errs_agrees_with_an_independent_integration():
    """Two boxes of 0.5 m, moments about their centres, in coordinates of the joints; DOP853."""
    run = run_of(model_of("modelica/Examples.Elementary.DoublePendulumInitTip"), 5.0)
    m, length, g = 7700.0 * 0.06**2 * 0.5, 0.5, 9.80665
    c, inertia = 0.5 * length, 7700.0 * 0.06**2 * 0.5 * (0.5**2 + 0.06**2) / 12.0

    def rates(_, state):
        a, q, u, v = state
        b, w, coupled = a + q, u + v, m * length * c
        mass = np.array([[inertia + m * (c**2 + length**2), coupled * np.cos(q)], [0.0, inertia + m * c**2]])
        mass[1, 0] = mass[0, 1]
        right = [
            -m * g * (c + length) * np.cos(a) - 0.1 * u + coupled * np.sin(q) * w**2,
            -m * g * c * np.cos(b) - coupled * np.sin(q) * u**2,
        ]
        first, second = np.linalg.solve(mass, right)
        return [u, v, first, second - first]

    first, second = (run.motion.joints[name].value for name in ("revolute1", "revolute2"))
    start = [first[0], second[0], 0.0, 0.0]
    # both bars of 0.5 m, their tip at (0.7, 0.3)
    assert np.allclose(0.5 * np.exp(1j * start[0]) * (1.0 + np.exp(1j * start[1])), 0.7 + 0.3j)
    exact = solve_ivp(rates, (0.0, 5.0), start, "DOP853", rtol=1e-12, atol=1e-13).y[:2, -1]
    assert np.abs(exact - [first[-1], second[-1]]).max() < 1e-8
    late = solve_ivp(rates, (0.0, 4.91), start, "DOP853", rtol=1e-12, atol=1e-13).y[3, -1]
    assert late == pytest.approx(
        entries("modelica")["Examples/Elementary/DoublePendulumInitTip"]["exact"]["value"], abs=1e-7
    )
    # Dymola's table ends 0.02 rad off
    assert modelica.compared("Examples/Elementary/DoublePendulumInitTip", None).outcome == "source wrong"
    assert modelica.compared("Examples/Loops/PlanarFourbar", None).outcome == "right"


@pytest.mark.long
def test_the_orbit_in_which_dymola_errs_agrees_with_kepler():
    """Body 2 passes the centre at 0.07 m; Lagrange's f and g of the eccentric anomaly."""
    run = run_of(model_of("modelica/Examples.Elementary.PointGravity"), 5.0)
    start, speed = np.array([0.6, 0.6]), np.array([0.6, 0.0])
    radius, inward = np.hypot(*start), start @ speed
    a = 1.0 / (2.0 / radius - speed @ speed)
    times = run.time

    def time_of(change):
        sine, cosine = np.sin(change), 1.0 - np.cos(change)
        return a**1.5 * (change - sine) + radius * a**0.5 * sine + inward * a * cosine

    change = np.array([brentq(lambda x, t=t: time_of(x) - t, 0.0, 20.0, xtol=1e-15) for t in times])
    f = 1.0 - a / radius * (1.0 - np.cos(change))
    g = times - a**1.5 * (change - np.sin(change))
    exact = f[:, None] * start + g[:, None] * speed
    assert np.abs(run.motion.points["B"].position[:, :2] - exact).max() < 1e-9
    stated = entries("modelica")["Examples/Elementary/PointGravity"]["exact"]
    x = change[np.abs(times - stated["at"]).argmin()]
    now = a + (radius - a) * np.cos(x) + inward * a**0.5 * np.sin(x)
    velocity = -(a**0.5) / (now * radius) * np.sin(x) * start + (1.0 - a / now * (1.0 - np.cos(x))) * speed
    assert velocity[0] == pytest.approx(stated["value"], abs=1e-10)
    assert modelica.compared("Examples/Elementary/PointGravity", None).outcome == "source wrong"


@pytest.mark.long
def test_the_point_masses_in_which_dymola_errs_agree_with_an_independent_integration():
    def rates(_, state):
        position, speed = state[:12].reshape(4, 3), state[12:].reshape(4, 3)
        pull = -position / np.linalg.norm(position, axis=1)[:, None] ** 3
        pull[2:] += 10.0 * np.array([position[3] - position[2], position[2] - position[3]])
        return np.r_[speed.ravel(), pull.ravel()]

    positions = [0.0, 0.6, 0.0, 0.6, 0.6, 0.0, 0.0, 0.8, 0.0, 0.3, 0.8, 0.0]
    speeds = [1.0, 0.0, 0.0, *(3 * [0.6, 0.0, 0.0])]
    stated = entries("modelica")["Examples/Elementary/PointGravityWithPointMasses"]["exact"]
    end = solve_ivp(rates, (0.0, stated["at"]), positions + speeds, "DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    assert end[22] == pytest.approx(stated["value"], abs=1e-10)


@pytest.mark.long
def test_the_four_bar_in_which_dymola_errs_agrees_with_an_integration_in_one_coordinate():
    """M a'' + M' a'^2 / 2 + V' + d a' = 0, inertia M and potential V over the angle a by Fourier series."""
    count, length = 256, np.sqrt(1.1)
    a, order = np.arange(count) * 2.0 * np.pi / count, np.fft.fftfreq(count, 1.0 / count)

    def derivative(values):
        terms = np.fft.fft(values, axis=0)
        terms[count // 2] = 0.0
        return np.fft.ifft((1j * order * terms.T).T, axis=0).real

    def series(values, angle):
        return float((np.fft.fft(values) / count * np.exp(1j * order * angle)).sum().real)

    c, s = np.cos(a), np.sin(a)
    ball = np.stack([0.0 * a, 0.5 * c - 0.1 * s, 0.5 * s + 0.1 * c], 1)
    slide = np.sqrt(length**2 - (ball[:, 1] - 0.2) ** 2 - ball[:, 2] ** 2) - 1.0
    cross = np.stack([1.0 + slide, 0.2 + 0.0 * a, 0.0 * a], 1)
    along = (ball - cross) / length
    second = np.cross([0.0, 1.0, 0.0], along)
    second /= np.linalg.norm(second, axis=1)[:, None]
    spin = [(derivative(axis) ** 2).sum(1) for axis in (along, second, np.cross(along, second))]
    centre = cross + 0.4767312946227961 * (ball - cross)
    inertia = 0.33 + 2.0 * (0.25**2 + 0.05**2) + 3.023782929080177 * derivative(slide) ** 2
    inertia = inertia + (derivative(centre) ** 2).sum(1) + 0.05 * sum(spin)
    weight = 9.80665 * derivative(2.0 * (0.25 * c - 0.05 * s) + centre[:, 1])
    half = 0.5 * derivative(inertia)

    def rates(_, state):
        angle, rate = state
        return [
            rate,
            -(series(half, angle) * rate**2 + series(weight, angle) + 0.1 * rate) / series(inertia, angle),
        ]

    stated = entries("modelica")["ModelicaTest/FourbarVariants/JointUSR"]["exact"]
    start = [0.0, -0.4 / series(derivative(slide), 0.0)]
    end = solve_ivp(rates, (0.0, stated["at"]), start, "DOP853", rtol=1e-11, atol=1e-12).y[0, -1]
    assert series(slide, end) == pytest.approx(stated["value"], abs=1e-9)


def test_the_impulses_that_make_a_start_of_exudyn_consistent():
    """Two masses of 3 kg on rods, four coordinates with multipliers; projection of 4 and 10 m/s."""
    points = np.array([0.0, 2.0, 4.0, 5.0])
    stated = np.array([4.0, 0.0, 10.0, 0.0])

    def jacobian(p):
        return np.array([[*p[:2], 0, 0], [*(p[:2] - p[2:]), *(p[2:] - p[:2])], [0, 0, p[2] - 4.0, p[3]]])

    rows = jacobian(points)
    speed = stated - rows.T @ np.linalg.solve(rows @ rows.T, rows @ stated)
    assert speed == pytest.approx([7.0, 0.0, 7.0, 0.0])

    def rates(_, state):
        p, v = state[:4], state[4:]
        rows, weight = jacobian(p), np.array([0.0, -9.81, 0.0, -9.81])
        turning = [v[:2] @ v[:2], (v[2:] - v[:2]) @ (v[2:] - v[:2]), v[2:] @ v[2:]]
        pull = np.linalg.solve(rows @ rows.T, -np.array(turning) - rows @ weight)
        return np.r_[v, weight + rows.T @ pull]

    end = solve_ivp(rates, (0.0, 2.0), np.r_[points, speed], "DOP853", rtol=1e-10, atol=1e-11).y[:2, -1]
    coarse, fine = np.array(
        [entries("exudyn")["fourBarMechanismTest"]["values"][q] for q in ("B.x", "B.y")]
    ).T
    assert end == pytest.approx(fine + (fine - coarse) / 3.0, abs=1e-6)


def test_the_values_to_which_exudyn_converges(monkeypatch):
    outcomes = {case.name: case.outcome for case in exudyn.cases(None)}
    assert len(outcomes) == 6
    assert set(outcomes.values()) == {"right"}
    # Exudyn's value of its own step is not the converged one
    bricard = exudyn.entries("exudyn")["bricardMechanism"]
    bricard["values"]["P.x"] = [0.274481776, 0.274481776 + 1e-12]
    monkeypatch.setattr(exudyn, "entries", lambda _: {"bricardMechanism": bricard})
    assert [case.outcome for case in exudyn.cases(None)] == ["unexplained"]


def test_a_coarse_step_misses_the_digits_of_the_squeezer(monkeypatch):
    monkeypatch.setattr(squeezer, "DIGITS", {1e-6: 9.0, 1e-10: 9.0})
    monkeypatch.setattr(squeezer, "STEPPED", {})
    outcomes = [case.outcome for case in squeezer.cases(None)]
    assert outcomes == ["unexplained", "right", "right", "rejected", "rejected"]


ROBOT = model_text("suites_five_bar.urdf")
SIDECAR = "closed_loop: [[end_b, in_d]]\ntype: [3d]\nname_mot: [left, right]\n"


def test_a_robot_is_compared_with_its_files(tmp_path):
    files = tmp_path / "robot.urdf", tmp_path / "robot.yaml"
    for file, text in zip(files, (ROBOT, SIDECAR), strict=True):
        file.write_text(text)
    moved, sidecar = gepetto.motion_of(*files, ["left", "right"], {}), yaml.safe_load(SIDECAR)
    assert gepetto.residual(ROBOT, sidecar, moved) <= gepetto.TOLERANCE
    for right, wrong in (("1.2 0 0", "1.3 0 0"), ('"end_d"/><origin xyz="1', '"end_d"/><origin xyz="1.1')):
        assert gepetto.residual(ROBOT.replace(right, wrong), sidecar, moved) > 0.05
    # arms of two links of 1 m, pivots 1.2 m and 9 m apart
    for base, gap in (("1.2 0 0", 0.0), ("9 0 0", 5.0)):
        robot = gepetto.Robot(ROBOT.replace("1.2 0 0", base), sidecar)
        assert robot.least_gap(["end_b"]) == pytest.approx(gap, abs=1e-7)


SPINNING_ROD = model_text("suites_spinning_rod.xml")


def test_a_scene_with_a_loop_is_evaluated_by_mujoco(monkeypatch):
    """One joint in the loop, one outside and the rotation of the rod about its line are fixed."""
    monkeypatch.setattr(menagerie, "INSTANTS", 50)
    monkeypatch.setattr(menagerie, "entries", lambda _: {"rod": {"spins": {"ball": [1.0, 0.0, 0.0]}}})
    assert menagerie.compared("rod", SPINNING_ROD).outcome == "right"
    moved = menagerie.moved
    for old, new, wrong in (
        ('.08 0 0"/', '.0801 0 0"/', {"loops", "motor forces"}),
        ('mass=".1"', 'mass=".11"', {"motor forces"}),
        ('finger" pos="0 0', 'finger" pos="0 .01', {"poses of bodies", "motor forces"}),
    ):
        other = menagerie.described(SPINNING_ROD.replace(old, new))
        monkeypatch.setattr(menagerie, "moved", lambda _, *words, other=other: moved(other, *words))
        rows = menagerie.compared("rod", SPINNING_ROD).rows
        assert {row.quantity for row in rows if not row.passed} >= wrong


@pytest.mark.parametrize("free", ["rotX", "transZ", "rotX rotZ", "rotX transX", "transX transY transZ", ""])
def test_a_usd_file_is_compared_with_its_joints(tmp_path, free):
    """A run violates each joint that leaves one motion less than the joint of the run."""
    pytest.importorskip("pxr")

    def written(name, free):
        axes = [f"{what}{axis}" for what in ("trans", "rot") for axis in "XYZ"]
        limits = [
            f"    float limit:{each}:physics:{end}" for each in axes for end in ("low = 1", "high = -1")
        ]
        text = model_text(
            "suites_usd_joint.usda",
            schemas=", ".join(f'"PhysicsLimitAPI:{each}"' for each in axes if each not in free),
            limits="\n".join(line for line in limits if line.split(":")[1] not in free),
        )
        path = tmp_path / f"{name}.usda"
        path.write_text(text)
        return path

    path = written("joint", free.split())
    if not free:
        with pytest.raises(
            ms.InputError, match="joint cannot move: its loops and locked joints leave no degree"
        ):
            kamino.compared("joint", path)
        return
    assert kamino.compared("joint", path).outcome == "right"
    run = ms.dynamics.run(str(path), initial=kamino.rates(ms.load(str(path), still=True)), duration=0.2)
    for each in free.split():
        other = written("other", [name for name in free.split() if name != each])
        assert kamino.residual(other, run.motion) > 1e-3


def test_printed_values_of_other_engines(monkeypatch):
    computed = [*loops.cases(None)]
    assert [case.outcome for case in computed] == ["right", "source wrong", "source wrong"]
    (row,) = (row for row in computed[1].rows if not row.passed)
    # its rate of joint 2 opens the loop: velocity of the ends by the file's own numbers
    a, b, c = 1.6707963267948966, -1.4591054166649482, 1.5397303602625536
    for rate, limit in ((-0.47295, 1.2e-3), (-0.47195, 5e-6)):
        u, v, w = 0.5, 0.5 + rate, 0.34126
        arms = 0.5j * np.exp(1j * a) * u + 1.2j * np.exp(1j * (a + b)) * v - 0.75j * np.exp(1j * c) * w
        assert 0.3 * limit < abs(arms) < limit
    assert row.quantity == "joint2.v=-0.47295"


def test_a_suite_writes_its_own_section_and_leaves_the_others(monkeypatch, tmp_path):
    monkeypatch.setattr(page, "PAGE", tmp_path / "page.md")
    page.PAGE.write_text("")
    first, second = exudyn.SUITE, loops.SUITE
    suites, clones = {"a": first, "b": second}, {"a": None, "b": None}
    page.write(suites, clones, {"a": [Case("one", rejected="no such joint")], "b": [Case("two")]})
    before = page.PAGE.read_text()
    page.write(suites, clones, {"b": [Case("two")]})
    assert page.PAGE.read_text() == before
    page.write(suites, clones, {"a": []})
    after = page.PAGE.read_text()
    assert "no such joint" not in after
    assert page.counts(second, [Case("two")]) in after
    assert after.endswith(before[before.index(f"## {second.title}") :])
