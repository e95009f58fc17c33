import io
import re
import sys
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import matplotlib
import numpy as np
import pytest
from grids import grid

from mechsim import catalog, load_profile
from mechsim.errors import InputError, OutputError
from mechsim.model.forces import Forces
from mechsim.pictures import plots
from mechsim.pictures.number_text import readable
from mechsim.pictures.plots.figure import round_numbers
from mechsim.pictures.plots.motion import TwoCurves, agreement_plot
from mechsim.report import plot_table
from mechsim.report.plot_table import PLOTS, PlotOptions, PlotSource
from mechsim.subjects.readers import load

TURN = np.linspace(0.0, 2.0 * np.pi, 37)
ERRORS = {"P2": 1e-9 * np.sin(TURN), "P3": 0.0 * TURN}


@pytest.fixture(scope="module")
def drive():
    return catalog.make("rssr")


@pytest.fixture(scope="module")
def motion(drive):
    return drive.solve(TURN, 60.0)


class SmallPlan:
    pole = np.zeros(2)
    vectors = {"a": np.array([1.0, 0.4]), "b": np.array([0.3, 0.9])}  # noqa: RUF012
    lines = (("a", "b"),)
    scale = 0.02


@pytest.fixture(scope="module")
def figures(drive, motion):
    return [
        plots.motion_plot(motion),
        plots.coupler_curve(drive.mechanism, motion),
        plots.space_curve(drive.mechanism, motion),
        plots.transmission_plot(TURN, drive.transmission_angle(TURN)),
        plots.error_plot(TURN, ERRORS, tolerance=1e-8),
        plots.velocity_plan_plot(SmallPlan(), "crank 2 stopped"),
    ]


@pytest.fixture(scope="module")
def vectors(figures):
    """Every plot as SVG; drawing takes its time."""
    return [plots.drawn(figure) for figure in figures]


@pytest.mark.parametrize(
    ("form", "start"), grid([("svg", b"<?xml"), ("png", b"\x89PNG"), ("pdf", b"%PDF")], ("svg", "png"))
)
def test_every_plot_comes_in_every_format(figures, vectors, form, start):
    for drawing in vectors if form == "svg" else (plots.drawn(figure, form) for figure in figures):
        assert drawing.startswith(start)
        assert len(drawing) > 2000


@pytest.mark.slow
def test_a_figure_looks_the_same_drawn_by_its_user_as_by_the_house(figures):
    # marks on the axes are made late, in whatever look then holds
    for figure in figures:
        with matplotlib.rc_context({"svg.hashsalt": "mechsim", "font.size": 20.0, "grid.color": "red"}):
            out = io.BytesIO()
            figure.savefig(out, format="svg", metadata={"Date": None})
        sizes = [
            set(re.findall(rb"scale\(([0-9.]+)", item)) for item in (out.getvalue(), plots.drawn(figure))
        ]
        assert sizes[0] == sizes[1]
        assert b"#ff0000" not in out.getvalue()


def test_a_figure_can_be_changed_and_drawn_again(motion):
    figure = plots.motion_plot(motion)
    assert b"<!-- mine -->" not in plots.drawn(figure)
    figure.axes[0].set_title("mine")
    assert b"<!-- mine -->" in plots.drawn(figure)


def test_plots_need_nothing_from_elsewhere_and_are_the_same_every_time(drive, motion, vectors):
    # one of each module: what could differ, names and dates, is made in one place for all
    again = (
        plots.error_plot(TURN, ERRORS, tolerance=1e-8),
        plots.coupler_curve(drive.mechanism, motion),
    )
    assert {plots.drawn(figure) for figure in again} <= set(vectors)
    for item in vectors:
        for element in ET.fromstring(item).iter():
            for name, link in element.attrib.items():
                assert not name.endswith("href") or link.startswith("#")


def test_units_suit_the_numbers():
    assert readable([0.013], "m") == (1e-3, "mm")
    assert readable([-3.0, np.nan], "m/s") == (1.0, "m/s")
    assert readable([3e-6], "m") == (1e-6, "µm")
    assert readable([0.0], "m") == (1.0, "m")


def test_a_plane_curve_is_seen_once_and_a_space_curve_from_three_sides(drive, motion):
    flat = catalog.make("four_bar")
    item = plots.coupler_curve(flat.mechanism, flat.solve(TURN))
    three = plots.coupler_curve(drive.mechanism, motion)
    assert [len(figure.axes) for figure in (item, three)] == [1, 3]


def test_errors_that_are_not_numbers_leave_a_gap():
    errors = np.full(37, np.nan)
    assert plots.drawn(plots.error_plot(TURN, {"P2": errors})).startswith(b"<?xml")
    errors[3:9] = 1e-7
    figure = plots.error_plot(TURN, {"P2": errors}, tolerance=1e-6)
    assert plots.drawn(figure).startswith(b"<?xml")
    (line, _) = figure.axes[0].get_lines()
    assert np.isnan(line.get_ydata()).sum() == 31


def test_errors_of_motion_laws_are_drawn_over_time():
    source = PlotSource(solver=load("five_bar"), speed=1.0)
    (ax,) = PLOTS["poses"].draw(source).axes
    assert ax.get_xlabel() == "time [s]"
    assert ax.get_lines()[0].get_xdata()[-1] == pytest.approx(source.solver.motion_laws.duration)


def test_what_cannot_be_plotted_is_rejected(motion, tmp_path):
    with pytest.raises(InputError, match="no point 'Q'"):
        plots.motion_plot(motion, ["Q"])
    with pytest.raises(InputError, match="no plot format 'bmp'"):
        plots.drawn(plots.motion_plot(motion), "bmp")
    with pytest.raises(InputError, match=r"not one of .svg, .png, .pdf"):
        plots.format_of("plot.jpg")
    assert plots.format_of(Path("plot.pdf")) == "pdf"
    with pytest.raises(OutputError, match="no directory"):
        plots.write(tmp_path / "missing" / "plot.svg", plots.motion_plot(motion))


def test_plotting_touches_no_global_state(motion):
    before = dict(matplotlib.rcParams)
    plots.drawn(plots.motion_plot(motion))
    assert "matplotlib.pyplot" not in sys.modules or not matplotlib.pyplot.get_fignums()
    assert dict(matplotlib.rcParams) == before


def test_curves_of_assemblies_are_cut_at_a_turn_unless_they_swing_over_more_than_one():
    arc = np.linspace(0.0, 2.0 * np.pi, 73)
    swing = 7.0 * np.sin(arc)
    table = plots.AssemblyTable(
        [{"arc": arc, "turn": arc + 1.0, "swing": swing, "P.x": np.cos(arc)}],
        {"arc": "", "turn": "rad", "swing": "rad", "P.x": "m"},
    )
    line = plots.assembly_plot(table, ("turn", "swing")).axes[0].get_lines()[0]
    x, y = line.get_xdata(), line.get_ydata()
    assert np.isnan(x).sum() == 1
    assert 0.0 <= np.nanmin(x) < np.nanmax(x) <= 360.0
    assert np.nanmax(y) == pytest.approx(np.rad2deg(7.0))
    assert plots.assembly_plot(table, ("turn", "swing", "P.x")).axes[0].name == "3d"
    with pytest.raises(InputError, match="1 coordinates to plot over"):
        plots.assembly_plot(table, ("turn",))


def test_efforts_of_motion_laws_are_drawn_over_time_by_both_methods_and_balance(monkeypatch):
    monkeypatch.setattr(plot_table, "SAMPLES", 36)
    source = PlotSource(solver=load("five_bar"), speed=1.0, options=PlotOptions(method="simulated"))
    (ax,) = PLOTS["torque"].draw(source).axes
    assert ax.get_xlabel() == "time [s]"
    reported = dict(zip((line.get_label() for line in ax.get_lines()), ax.get_lines(), strict=True))
    study = source.study()
    for name, values in study.forces.drives.items():
        label = next(item for item in reported if item.startswith(name))
        drawn = reported[label].get_ydata()
        assert drawn / np.abs(drawn).max() == pytest.approx(values / np.abs(values).max())
    assert "MuJoCo" in reported
    for kind in ("reactions", "power"):
        assert plots.drawn(PLOTS[kind].draw(source)).startswith(b"<?xml")


def test_what_a_file_states_acts_on_a_mechanism_is_in_its_plots(monkeypatch):
    monkeypatch.setattr(plot_table, "SAMPLES", 36)
    drive = load("quick_return")
    pulled = replace(drive, forces=Forces(gravity=(0.0, 0.0, 0.0), crank_torque=load_profile.constant(-0.5)))
    study = PlotSource(solver=pulled, speed=1e-3).study()
    assert study.forces.torque == pytest.approx(0.5, abs=1e-6)


@pytest.mark.parametrize("limits", [(2.1, 4.4), (6.0, 9.0), (0.3, 700.0)])
def test_a_logarithmic_axis_has_numbers_whatever_part_of_a_decade_it_holds(limits):
    figure, axes = plots.blank(1, 1, (4.0, 3.0))
    ax = axes[0, 0]
    ax.set_xscale("log")
    ax.set_xlim(*limits)
    round_numbers(ax.xaxis)
    figure.canvas.draw()
    inside = [at for at in ax.get_xticks() if limits[0] <= at <= limits[1]]
    assert len(inside) >= 2
    assert all(label.get_text() for label in ax.get_xticklabels())
    assert not len(ax.xaxis.get_minorticklocs())


def test_derivatives_of_small_torques_are_drawn_in_a_readable_unit():
    at = np.linspace(0.0, 6.0, 5)
    curves = {"torque": {"crank": 3e-5 * np.cos(at), "gamma": np.full(5, 1e-4)}}
    figure = plots.sensitivity_plot("angle", at, curves, {"torque": "N m"}, {"crank": "m", "gamma": "rad"})
    ax = figure.axes[0]
    assert "[µN m per mm or °]" in ax.get_title(loc="left")
    largest = max(np.abs(line.get_ydata()).max() for line in ax.get_lines())
    assert largest == pytest.approx(100.0 * np.pi / 180.0)


@pytest.mark.parametrize(("name", "across", "planes"), [("stewart_gough", 6, 6), ("jansen", 6, 2)])
def test_reactions_of_many_joints_fit_a_page_in_the_plane_they_lie_in(monkeypatch, name, across, planes):
    monkeypatch.setattr(plot_table, "SAMPLES", 24)
    source = PlotSource(solver=load(name), speed=1.0)
    figure = PLOTS["reactions"].draw(source)
    forces = source.study().forces.reactions
    assert figure.axes[0].get_gridspec().get_geometry() == (planes, across)
    drawn = [ax for ax in figure.axes if ax.axison]
    assert len(drawn) == len(forces) * (2 if name == "stewart_gough" else 1)
    assert all(ax.lines for ax in drawn)


def test_a_force_s_rounding_is_not_drawn_as_a_force():
    upright = np.linspace(-1.0, 1.0, 9)[:, None] * np.array([1e-15, 0.0, 40.0])
    reactions = {
        name: SimpleNamespace(link="rod", force=force, moment=force, project=lambda f, m: (f, m))
        for name, force in {"A": upright, "B": np.tile([3e-14, 0.0, 0.0], (9, 1))}.items()
    }
    efforts = SimpleNamespace(reactions=reactions, unbounded=np.zeros(9, dtype=bool))
    figure = plots.reaction_plot(SimpleNamespace(forces=efforts))
    for ax in figure.axes:
        assert tuple(ax.dataLim.intervalx) == (0.0, 0.0)


def test_what_stands_still_to_rounding_is_drawn_flat_and_reports_so(drive, motion):
    """A pin on the frame, whose coordinates and rates are left by a solver at 1e-17 of the linkage."""
    noise = 1e-17 * np.random.default_rng(3).normal(size=(3, len(motion), 3))
    place = np.array([0.03, -0.02, 0.01])
    pin = replace(
        next(iter(motion.points.values())),
        position=place + noise[0],
        velocity=100.0 * noise[1],
        acceleration=1e4 * noise[2],
    )
    name, moving = next(iter(motion.points.items()))
    both = replace(motion, points={"pin": pin, name: moving})
    figure = plots.motion_plot(both)
    for row in range(3):
        flat, signal = figure.axes[2 * row : 2 * row + 2]
        drawn = max(float(np.ptp(line.get_ydata())) for line in flat.get_lines())
        low, high = flat.get_ylim()
        assert high - low > 1e6 * drawn
        assert any("rounding" in text.get_text() for text in flat.texts) or row == 0
        assert not signal.texts
    still = replace(motion, points={next(iter(drive.mechanism.points)): pin})
    for figure in (plots.coupler_curve(drive.mechanism, still), plots.space_curve(drive.mechanism, still)):
        low, high = figure.axes[0].get_xlim()
        assert high - low > 1.0
    assert "stands still within" in plots.coupler_curve(drive.mechanism, still).axes[0].get_title("left")


def test_a_difference_of_rounding_is_drawn_as_none():
    exact = 0.1 + 0.02 * np.sin(np.linspace(0.0, 6.0, 50))[:, None]
    reported = {
        "name": "P.x",
        "unit": "m",
        "instants": np.linspace(0.0, 6.0, 50),
        "over": "rad",
        "exact": exact,
    }
    reported |= {"components": "x", "tolerance": 1e-9, "source": "own.py", "shares": {}}
    for gap, drawn, says in ((1e-17, 0.0, "rounding, below"), (1e-11, 1e-11, "at most")):
        claimed = exact + gap * np.cos(np.linspace(0.0, 6.0, 50))[:, None]
        ax = agreement_plot(TwoCurves(claimed=claimed, **reported)).axes[1]
        largest = np.abs(ax.get_lines()[0].get_ydata()).max()
        assert largest == pytest.approx(drawn / 1e-6, rel=1e-2)
        assert says in ax.get_title("left")


def test_plots_of_the_table_are_titled_with_mechanism_and_speed():
    source = PlotSource(solver=catalog.make("four_bar"), speed=10.0 * 2.0 * np.pi)
    figure = PLOTS["motion"].figure(source)
    assert figure.get_suptitle() == "four-bar, crank at 600 rpm"
    # a planar mechanism has no z
    assert [line.get_label() for line in figure.axes[0].get_lines()] == ["x", "y"]
    assert len({line.get_linestyle() for line in PLOTS["curve"].figure(source).axes[0].get_lines()[::2]}) == 3
    programmed = PLOTS["motion"].figure(PlotSource(solver=load("five_bar"), speed=1.0))
    assert programmed.get_suptitle() == "five-bar, 1 s by its motion laws"


def test_a_logarithmic_axis_has_a_tick_at_each_decade():
    figure = plots.error_plot([0.0, 1.0, 2.0], {"a": [1e-14, 1e-9, 1e-5]})
    ax = figure.axes[0]
    low, high = ax.get_ylim()
    ticks = [t for t in ax.yaxis.get_majorticklocs() if low <= t <= high]
    assert np.allclose(np.diff(np.log10(ticks)), 1.0)


def test_a_schematic_has_a_symbol_for_each_joint_and_names_at_their_points():
    source = PlotSource(solver=catalog.make("four_bar"), speed=1.0)
    figure = PLOTS["schematic"].figure(source)
    (ax,) = figure.axes
    circles = [patch for patch in ax.patches if hasattr(patch, "radius")]
    assert len(circles) == len(source.solver.mechanism.joints)
    assert {"A", "B", "C", "crank", "rocker"} <= {text.get_text() for text in ax.texts}
    for text in ax.texts:
        if text.get_text() in ("A", "B", "crank", "rocker"):
            assert min(np.hypot(*np.subtract(circle.center, text.xy)) for circle in circles) < 1e-12
    assert plots.drawn(figure, "pdf").startswith(b"%PDF")
