"""A platform driven by its pose in the page agrees with Python within 1e-10."""

import numpy as np
import pytest
from browser import Browser, in_browser
from scipy.spatial.transform import Rotation

import mechsim as ms
from mechsim.analytic.solvers import KinematicSolver
from mechsim.model.motion_laws import make_motion_laws, steady
from mechsim.pictures.view.offline_page import page
from mechsim.pictures.view.pose_grid import View, motion_grid
from mechsim.report.driver_views import platform_of
from mechsim.report.views import mechanism_view

# platform and its coordinates; poses within its reach, in [m] and [rad] relative to the start
PLATFORMS = {
    "stewart_gough": ("plate", "x y z rx ry rz", (0.012, -0.009, 0.02, 0.15, -0.2, 0.11)),
    "delta_robot": ("plate", "x y z", (0.02, -0.015, 0.018)),
    "planar_3rrr": ("plate", "x y rz", (0.008, -0.006, 0.2)),
    "five_bar": ("forearm_l", "x y", (0.012, 0.014)),
    "humanoid_ankle": ("foot", "rx rz", (0.12, -0.15)),
}


@pytest.fixture(scope="module")
def window(tmp_path_factory):
    with Browser(tmp_path_factory.mktemp("profile")) as browser:
        yield browser


def platform_view(solver, limits):
    """Return a page with few poses other than those of the platform to save time."""
    times = np.linspace(0.0, 0.1, 5)
    motion = solver.solve(t=times)
    grid = motion_grid("motion", solver.mechanism, motion, driver="time", unit="s", nodes=times)
    return View(solver.mechanism, [grid], solver.name, platform=platform_of(solver.mechanism, limits))


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    folder, written = tmp_path_factory.mktemp("pages"), {}

    def path_of(name, limits=None):
        key = (name, bool(limits))
        if key not in written:
            written[key] = folder / f"{name}{bool(limits)}.html"
            written[key].write_text(page(platform_view(ms.load(name), limits or {})), encoding="utf-8")
        return written[key]

    return path_of


def open_platform(window, path):
    """Open a page and choose its platform; return the values of the sliders in SI."""
    window.complaints.clear()
    window.open(path, 1280, "light")
    assert window.run("document.documentElement.dataset.ready") == "yes", window.complaints
    window.run("choose(DATA.grids.length - 1)")
    return window.run("state.values")


def move(window, values):
    """Move the platform's sliders one after the other; return drivers and the message of the page."""
    for i, value in enumerate(values):
        window.run(f"setSlider({i}, {value!r})")
    return drivers_of(window), window.run("document.getElementById('trouble').textContent")


def drivers_of(window):
    names = window.run("DATA.platform.drivers.map(driver => driver.name)")
    values = window.run(
        "DATA.platform.drivers.map((_, i) => state.grid.read(state.grid.readouts[i], state.values)[0])"
    )
    return dict(zip(names, values, strict=True))


def python_motion(mechanism, start, drivers):
    """Solve the mechanism along a linear path of its drivers from its start; return the motion."""
    states = {name: steady(start[name], value - start[name]) for name, value in drivers.items()}
    solver = KinematicSolver(mechanism, motion_laws=make_motion_laws(mechanism, states, 1.0))
    return solver.solve(t=np.linspace(0.0, 1.0, 11))


@in_browser
@pytest.mark.parametrize("name", PLATFORMS)
def test_the_page_agrees_with_python_on_a_platform(window, pages, name):
    link, coordinates, displacement = PLATFORMS[name]
    origin = "P" if name == "five_bar" else link
    start = open_platform(window, pages(name))
    assert window.run("state.grid.sliders.map(slider => slider.name)") == [
        f"{link if len(coordinate) == 2 else origin}.{coordinate}" for coordinate in coordinates.split()
    ]
    first = drivers_of(window)
    for by in (1.0, -0.7, 0.35):
        values = [value + by * step for value, step in zip(start, displacement, strict=True)]
        drivers, message = move(window, values)
        assert message == ""
        solver = ms.load(name)
        motion = python_motion(solver.mechanism, first, drivers)
        poses = np.reshape(window.run("[...state.poses]"), (-1, 7))
        for own, pose in zip(window.run("state.grid.links"), poses, strict=True):
            if own not in motion.spinning:
                rotation = Rotation.from_quat(pose[3:], scalar_first=True).as_matrix()
                assert np.abs(motion.links[own].position[-1] - pose[:3]).max() < 1e-10
                assert np.abs(motion.links[own].rotation[-1] - rotation).max() < 1e-9
        assert_pose(motion, solver.mechanism, link, coordinates.split(), values)
    assert window.complaints == []


def assert_pose(motion, mechanism, link, coordinates, values):
    """Compare the pose that Python finds with the requested coordinates."""
    own = motion.links[link]
    point = np.array(
        next(local_position for name, local_position in mechanism.points.values() if name == link)
    )
    position = own.position[-1] + own.rotation[-1] @ point  # not compared for a platform that only rotates
    angles = Rotation.from_matrix(own.rotation[-1]).as_euler("XYZ")
    result = dict(zip(("x", "y", "z", "rx", "ry", "rz"), (*position, *angles), strict=True))
    for coordinate, value in zip(coordinates, values, strict=True):
        assert result[coordinate] == pytest.approx(value, abs=1e-10)


@in_browser
def test_the_reachable_range_ends_at_the_limit_of_a_leg(window, pages):
    legs = {f"l{i}": (0.14, 0.17) for i in range(1, 7)}
    start = open_platform(window, pages("stewart_gough", legs))
    low, high = window.run("state.grid.range(state.values, 1)")
    for value, within in ((high - 1e-5, True), (high + 1e-5, False), (low + 1e-5, True), (low - 1e-5, False)):
        values = [start[0], value, *start[2:]]
        drivers, message = move(window, values)
        assert (message == "") == within
        if within:
            assert all(0.14 - 1e-9 <= length <= 0.17 + 1e-9 for length in drivers.values())
        else:
            assert "limit" in message
            assert "Not reachable" in message
        move(window, start)
    assert window.complaints == []


@in_browser
def test_the_band_of_a_slider_shows_its_reachable_range(window, pages):
    open_platform(window, pages("planar_3rrr"))
    assert window.run("new Promise(done => setTimeout(() => done(true), 3000))")
    bands = window.run(
        "[...document.querySelectorAll('.reach')].map(b => [b.hidden, b.getBoundingClientRect().width])"
    )
    assert len(bands) == 3
    assert all(not hidden and width > 3.0 for hidden, width in bands)
    labels = window.run("[...document.querySelectorAll('.reachable')].map(label => label.textContent)")
    assert all(label.startswith("reachable: ") and " to " in label for label in labels)


@in_browser
def test_an_unreachable_pose_is_reported_and_the_sliders_continue(window, pages):
    start = open_platform(window, pages("five_bar"))
    unreachable = [start[0] + 0.08, start[1] + 0.05]
    _, message = move(window, unreachable)
    assert message.startswith("Not reachable: ")
    assert "the last pose on the way there is shown" in message
    _, message = move(window, start)
    assert message == ""


@pytest.mark.long
def test_a_platform_needs_several_coupled_drivers(monkeypatch):
    assert platform_of(ms.catalog.make("four_bar").mechanism, {}) is None
    assert platform_of(ms.load("parallel_gripper").mechanism, {}) is None
    monkeypatch.setattr("mechsim.report.driver_views.NODES", {2: 3})
    assert mechanism_view(ms.load("five_bar"), 1.0).platform.coordinates == ("x", "y")
    for name, (link, coordinates, _) in PLATFORMS.items():
        platform = platform_of(ms.load(name).mechanism, {})
        assert (platform.link, " ".join(platform.coordinates)) == (link, coordinates)
