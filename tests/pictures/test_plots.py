import io
import re
import xml.etree.ElementTree as ET
from dataclasses import replace

import matplotlib
import numpy as np
import pytest
from grids import grid
from scipy.integrate import solve_ivp

import mechsim as ms
from mechsim.mechanism.belts import belts_of
from mechsim.pictures.number_text import readable
from mechsim.pictures.plots.figure import round_numbers
from mechsim.pictures.plots.motion import TwoCurves, agreement_plot
from mechsim.pictures.plots.vibration import bode_plot
from mechsim.report import plot_table
from mechsim.report.plot_table import PLOTS, PlotSource

ANGLES = np.linspace(0.0, 2.0 * np.pi, 37)
ERRORS = {"P2": 1e-9 * np.sin(ANGLES), "P3": 0.0 * ANGLES}


@pytest.fixture(scope="module")
def figures(linkage, motion):
    return [
        ms.plots.motion_plot(motion),
        ms.plots.coupler_curve(linkage.mechanism, motion),
        ms.plots.transmission_plot(ANGLES, linkage.transmission_angle(ANGLES)),
        ms.plots.error_plot(ANGLES, ERRORS, tolerance=1e-8),
    ]


@pytest.fixture(scope="module")
def vectors(figures):
    """Return every plot as SVG, computed once."""
    return [ms.plots.drawn(figure) for figure in figures]


@pytest.mark.long
@pytest.mark.parametrize(
    ("kind", "start"), grid([("svg", b"<?xml"), ("png", b"\x89PNG"), ("pdf", b"%PDF")], ("svg",))
)
def test_every_plot_is_written_in_every_format(figures, vectors, kind, start):
    for drawing in vectors if kind == "svg" else (ms.plots.drawn(figure, kind) for figure in figures):
        assert drawing.startswith(start)
        assert len(drawing) > 2000


@pytest.mark.slow
def test_a_figure_is_independent_of_the_style_of_its_user(figures):
    # ticks are created late, in the style active at that time
    for figure in figures:
        with matplotlib.rc_context({"svg.hashsalt": "mechsim", "font.size": 20.0, "grid.color": "red"}):
            out = io.BytesIO()
            figure.savefig(out, format="svg", metadata={"Date": None})
        sizes = [
            set(re.findall(rb"scale\(([0-9.]+)", plane_curve))
            for plane_curve in (out.getvalue(), ms.plots.drawn(figure))
        ]
        assert sizes[0] == sizes[1]
        assert b"#ff0000" not in out.getvalue()


@pytest.mark.long
def test_plots_are_self_contained_and_reproducible(linkage, motion, vectors):
    # one plot per module: names and dates are set in one function for all
    repeated = (
        ms.plots.error_plot(ANGLES, ERRORS, tolerance=1e-8),
        ms.plots.coupler_curve(linkage.mechanism, motion),
    )
    assert {ms.plots.drawn(figure) for figure in repeated} <= set(vectors)
    for plane_curve in vectors:
        for element in ET.fromstring(plane_curve).iter():
            for name, link in element.attrib.items():
                assert not name.endswith("href") or link.startswith("#")


def test_units_are_chosen_by_magnitude():
    assert readable([0.013], "m") == (1e-3, "mm")
    assert readable([-3.0, np.nan], "m/s") == (1.0, "m/s")
    assert readable([3e-6], "m") == (1e-6, "µm")
    assert readable([0.0], "m") == (1.0, "m")


def test_a_path_in_space_is_drawn_in_three_projections(linkage, motion):
    flat = ms.catalog.make("four_bar")
    plane_curve = ms.plots.coupler_curve(flat.mechanism, flat.solve(ANGLES))
    three = ms.plots.coupler_curve(linkage.mechanism, motion)
    assert [len(figure.axes) for figure in (plane_curve, three)] == [1, 3]


def test_nan_errors_leave_a_gap_in_the_curve():
    errors = np.full(37, np.nan)
    assert ms.plots.drawn(ms.plots.error_plot(ANGLES, {"P2": errors})).startswith(b"<?xml")
    errors[3:9] = 1e-7
    figure = ms.plots.error_plot(ANGLES, {"P2": errors}, tolerance=1e-6)
    assert ms.plots.drawn(figure).startswith(b"<?xml")
    (line, _) = figure.axes[0].get_lines()
    assert np.isnan(line.get_ydata()).sum() == 31


def test_forces_of_a_file_are_included_in_its_plots(monkeypatch):
    monkeypatch.setattr(plot_table, "SAMPLES", 36)
    linkage = ms.load("quick_return")
    loaded = replace(
        linkage, forces=ms.Forces(gravity=(0.0, 0.0, 0.0), crank_torque=ms.load_profile.constant(-0.5))
    )
    study = PlotSource(solver=loaded, speed=1e-3).study()
    assert study.forces.torque == pytest.approx(0.5, abs=1e-6)


@pytest.mark.parametrize("limits", [(2.1, 4.4), (6.0, 9.0), (0.3, 700.0)])
def test_a_logarithmic_axis_within_a_decade_has_labels(limits):
    figure, axes = ms.plots.blank(1, 1, (4.0, 3.0))
    ax = axes[0, 0]
    ax.set_xscale("log")
    ax.set_xlim(*limits)
    round_numbers(ax.xaxis)
    figure.canvas.draw()
    inside = [tick for tick in ax.get_xticks() if limits[0] <= tick <= limits[1]]
    assert len(inside) >= 2
    assert all(label.get_text() for label in ax.get_xticklabels())
    assert not len(ax.xaxis.get_minorticklocs())


def test_a_fixed_point_is_drawn_flat_with_a_note_on_rounding(linkage, motion):
    """A pin on the frame whose coordinates and rates have a rounding error of 1e-17."""
    noise = 1e-17 * np.random.default_rng(3).normal(size=(3, len(motion), 3))
    position = np.array([0.03, -0.02, 0.01])
    name, moving = next(iter(motion.points.items()))
    rates = {"velocity": 100.0 * noise[1], "acceleration": 1e4 * noise[2]}
    pin = replace(moving, position=position + noise[0], **rates)
    both = replace(motion, points={"pin": pin, name: moving})
    figure = ms.plots.motion_plot(both)
    for row in range(3):
        flat, signal = figure.axes[2 * row : 2 * row + 2]
        drawn = max(float(np.ptp(line.get_ydata())) for line in flat.get_lines())
        low, high = flat.get_ylim()
        assert high - low > 1e6 * drawn
        assert any("rounding" in text.get_text() for text in flat.texts) or row == 0
        assert not signal.texts
    fixed_pin = replace(motion, points={next(iter(linkage.mechanism.points)): pin})
    ax = ms.plots.coupler_curve(linkage.mechanism, fixed_pin).axes[0]
    low, high = ax.get_xlim()
    assert high - low > 1.0
    assert "stands still within" in ax.get_title("left")


def test_a_rounding_sized_difference_is_drawn_as_zero():
    exact = 0.1 + 0.02 * np.sin(np.linspace(0.0, 6.0, 50))[:, None]
    common = {"name": "P.x", "unit": "m", "instants": np.linspace(0.0, 6.0, 50), "over": "rad"}
    common |= {"exact": exact, "components": "x", "tolerance": 1e-9, "source": "own.py", "shares": {}}
    for gap, drawn, message in ((1e-17, 0.0, "rounding, below"), (1e-11, 1e-11, "at most")):
        claimed = exact + gap * np.cos(np.linspace(0.0, 6.0, 50))[:, None]
        ax = agreement_plot(TwoCurves(claimed=claimed, **common)).axes[1]
        largest = np.abs(ax.get_lines()[0].get_ydata()).max()
        assert largest == pytest.approx(drawn / 1e-6, rel=1e-2)
        assert message in ax.get_title("left")


def test_a_schematic_has_a_symbol_and_a_name_per_joint():
    source = PlotSource(solver=ms.catalog.make("four_bar"), speed=1.0)
    figure = PLOTS["schematic"].figure(source)
    (ax,) = figure.axes
    circles = [patch for patch in ax.patches if hasattr(patch, "radius")]
    assert len(circles) == len(source.solver.mechanism.joints)
    assert {"A", "B", "C", "crank", "rocker"} <= {text.get_text() for text in ax.texts}
    for text in ax.texts:
        if text.get_text() in ("A", "B", "crank", "rocker"):
            assert min(np.hypot(*np.subtract(circle.center, text.xy)) for circle in circles) < 1e-12
    assert ms.plots.drawn(figure, "pdf").startswith(b"%PDF")


def schematic(name, start, stop, count=20):
    """Return a solver, the points of every line of its schematic, (n, 2) each, and the positions of names."""
    solver = ms.load(name)
    along = solver.solve if solver.motion_laws.crank else lambda times: solver.solve(t=times)
    motion = along(np.linspace(start, stop, count))
    (ax,) = ms.plots.schematic_plot(solver.mechanism, motion, solver.forces).axes
    return solver, lines_of(ax), {text.get_text(): np.array(text.xy) for text in ax.texts}


def lines_of(ax):
    """Return the points of every line, (n, 2) each."""
    return [np.column_stack(line.get_data()) for line in ax.get_lines()]


def circle_of(line):
    """Return centre and radius of a closed line."""
    centre = line[:-1].mean(0)
    return centre, float(np.linalg.norm(line - centre, axis=1).mean())


def test_a_schematic_names_joints_on_one_pin_together():
    _, _, names = schematic("jansen", 0.0, 6.0)
    # both triangles of Jansen's leg turn about the same pivot of the frame
    assert [name for name in names if "hip" in name] == ["hip_b, hip_c"]


def test_a_schematic_shows_the_pitch_circles_of_gears():
    _, lines, _ = schematic("planetary_gear", 0.0, 6.0)
    rings = [line for line in lines if len(line) > 60]
    assert len(rings) == 3
    centres, radii = zip(*map(circle_of, rings), strict=True)
    for centre, radius, ring in zip(centres, radii, rings, strict=True):
        np.testing.assert_allclose(np.linalg.norm(ring - centre, axis=1), radius, rtol=2e-3)
    planet, sun, ring = np.argsort(radii)
    # the planet touches the sun from outside and the ring from inside
    arm = float(np.linalg.norm(centres[planet] - centres[sun]))
    assert arm == pytest.approx(radii[sun] + radii[planet], rel=2e-3)
    assert radii[ring] == pytest.approx(radii[sun] + 2.0 * radii[planet], rel=2e-3)


def test_a_schematic_shows_the_pitch_circle_and_the_pitch_line_of_a_rack():
    _, lines, _ = schematic("rack_steering", -0.2, 0.2)
    (circle,) = (line for line in lines if len(line) > 60)
    (pitch_line,) = (line for line in lines if len(line) == 3)
    centre, radius = circle_of(circle)
    along = (pitch_line[-1] - pitch_line[0]) / np.linalg.norm(pitch_line[-1] - pitch_line[0])
    off = pitch_line[0] - centre
    # the line touches the circle
    assert abs(off[0] * along[1] - off[1] * along[0]) == pytest.approx(radius, rel=1e-9)


def test_a_schematic_shows_the_legs_of_a_platform():
    _, lines, names = schematic("stewart_gough", 0.0, 0.2)
    for foot in (names[f"u{i}"] for i in range(1, 7)):
        (leg,) = (line for line in lines if len(line) == 2 and np.hypot(*(line[0] - foot)) < 1e-12)
        # farther than a symbol is wide
        assert np.hypot(*(leg[1] - foot)) > 0.05


def test_a_schematic_shows_profiles_rollers_belts_and_springs():
    _, lines, _ = schematic("cam_follower", 0.0, 6.0)
    profile, roller = (line for line in lines if len(line) > 60)
    centre, radius = circle_of(roller)
    # the roller touches the profile
    assert np.linalg.norm(profile - centre, axis=1).min() == pytest.approx(radius, rel=0.02)
    belt, lines, _ = schematic("belt_drive", 0.0, 6.0)
    strand, *pulleys = (line for line in lines if len(line) > 60)
    paths = list(belts_of(belt.mechanism))
    length = np.linalg.norm(np.diff(strand, axis=0), axis=1).sum()
    assert length == pytest.approx(paths[0].length, rel=1e-3)
    assert 1 + len(pulleys) == sum(1 + len(path.radii) for path in paths)
    suspension, lines, names = schematic("bicycle_suspension", 0.0, 0.1)
    (zigzag,) = (line for line in lines if len(line) == 12)
    ends = sorted([names["shock"].tolist(), names["frame"].tolist()])
    np.testing.assert_allclose(sorted(zigzag[[0, -1]].tolist()), ends)
    # a damper is a piston in a cylinder that is open towards it
    (spring,) = suspension.forces.springs
    damper = replace(suspension.forces, springs=(replace(spring, stiffness=0.0),))
    motion = suspension.solve(np.linspace(0.0, 0.1, 20))
    figure = ms.plots.schematic_plot(suspension.mechanism, motion, damper)
    (symbol,) = (line for line in lines_of(figure.axes[0]) if np.isnan(line).any())
    np.testing.assert_allclose(symbol[[0, -1]], zigzag[[0, -1]])
    along = (symbol - symbol[0]) @ (symbol[-1] - symbol[0]) / np.sum((symbol[-1] - symbol[0]) ** 2)
    assert along[6] < along[1] < along[7]


def test_a_schematic_shows_massless_rods():
    solver, lines, names = schematic("peaucellier_rods", -0.3, 0.3)
    bars = [np.linalg.norm(line[1] - line[0]) for line in lines if len(line) == 2]
    for joint in solver.mechanism.joints:
        if joint.kind == "distance":
            assert min(abs(bar - joint.length) for bar in bars) < 1e-9
    assert names["OA, OB"] == pytest.approx([0.0, 0.0])


def test_a_schematic_shows_the_drum_the_pulley_and_both_falls_of_a_hoist():
    _, lines, _ = schematic("hoist", 0.0, 1.0)
    circles = [line for line in lines if len(line) > 60]
    # the pulley between falls that are as far apart as the drum is thick to its middle
    widths = sorted(float(np.ptp(circle[:, 0])) for circle in circles)
    assert widths == pytest.approx([0.05, 0.1], abs=2e-2)
    falls = [line for line in lines if len(line) == 3]
    across = sorted({round(float(fall[0, 0]), 6) for fall in falls})
    assert len(across) == 2
    assert np.diff(across) == pytest.approx([0.05])


@pytest.mark.long
@pytest.mark.parametrize("name", ["looper", "hoist", "machines/needle_drive", "machines/engine"])
def test_names_in_a_schematic_cover_neither_each_other_nor_the_scale(name):
    solver = ms.load(name if "/" not in name else f"models/{name}.toml")
    figure = PLOTS["schematic"].figure(PlotSource(solver=solver, speed=1.0))
    figure.draw_without_rendering()
    boxes = [text.get_window_extent() for text in figure.axes[0].texts]
    assert not any(a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[:i])


def test_a_pivot_at_which_a_tracked_point_stands_has_one_name():
    linkage = ms.catalog.make("four_bar")
    (pivot,) = (joint for joint in linkage.mechanism.joints if joint.name == "crank")
    mechanism = replace(linkage.mechanism, points={"axle": ("crank", pivot.b.point)})
    motion = linkage.solve(np.linspace(0.0, 6.0, 20))
    names = {text.get_text() for text in ms.plots.schematic_plot(mechanism, motion).axes[0].texts}
    assert names & {"axle", "crank", "axle, crank", "rocker"} == {"axle", "rocker"}


def test_a_schematic_is_not_mirrored():
    linkage = ms.catalog.make("four_bar")
    mechanism, axis = linkage.mechanism, (0.0, 0.0, -1.0)
    joints = tuple(
        replace(joint, a=replace(joint.a, axis=axis), b=replace(joint.b, axis=axis))
        for joint in mechanism.joints
    )
    backwards = replace(mechanism, joints=joints)
    figure = ms.plots.schematic_plot(backwards, linkage.solve(np.linspace(0.0, 6.0, 20)))
    names = {text.get_text(): text.xy for text in figure.axes[0].texts}
    # the rocker's pivot is at positive x
    assert names["rocker"][0] - names["crank"][0] == pytest.approx(linkage.ground)


def test_a_run_without_a_motion_law_is_plotted_over_time():
    model = "models/machines/landing_gear.toml"
    axes = ms.plot(model, duration="0.6 s").axes

    def fall(_time, state):
        s, v = state
        return [v, 9.81 - 6000.0 / 1200.0 * (1.0 - s / 0.45) ** -1.3 - 9000.0 / 1200.0 * v * abs(v)]

    expected = solve_ivp(fall, (0.0, 0.6), [0.0, 0.0], rtol=1e-10, atol=1e-12, dense_output=True).sol
    for ax, factor, row in ((axes[0], -1e-3, 0), (axes[1], -1.0, 1)):
        time, drawn = ax.get_lines()[0].get_data()
        np.testing.assert_allclose(factor * drawn, expected(time)[row], atol=1e-7)


def test_a_diagram_shows_the_initial_state_of_a_file():
    figure = ms.plot("models/machines/spring_gripper.toml", kind="schematic")
    names = {text.get_text(): text.xy for text in figure.axes[0].texts}
    # left.q = 120 deg, a finger of 80 mm
    finger = np.subtract(names["left"], names["joint left"])
    np.testing.assert_allclose(finger, 0.08 * np.array([-0.5, 0.75**0.5]), atol=1e-9)


def test_the_transmission_angle_is_drawn_in_degrees():
    (ax,) = ms.plot("four_bar", kind="quantities", quantities=["transmission"]).axes
    angle, drawn = ax.get_lines()[0].get_data()
    expected = ms.catalog.make("four_bar").transmission_angle(np.deg2rad(angle))
    np.testing.assert_allclose(drawn, np.rad2deg(expected), atol=1e-6)


def test_a_response_of_zero_is_drawn_without_a_warning():
    nothing = {"frequency": np.array([1.0, 2.0]), "magnitude": np.zeros(2), "phase": np.zeros(2)}
    assert ms.plots.drawn(bode_plot(nothing, "P.x")).startswith(b"<?xml")
