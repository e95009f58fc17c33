"""A live page agrees with Python at any dimensions and omits a wrong formula."""

import tomllib

import numpy as np
import pytest
from browser import in_browser
from model_files import model_text

import mechsim as ms
from mechsim.codegen import geometry
from mechsim.codegen.geometry import Formula, parametric_geometry
from mechsim.io.readers import open_model, parametric_model
from mechsim.pictures.render.drawn_model import drawn_as
from mechsim.pictures.view.offline_page import page
from mechsim.pictures.view.pose_grid import View, motion_grid
from mechsim.report.live_page import live_page
from mechsim.shapes.body import rod_radius
from mechsim.shapes.joints import link_shapes

SPEED = 20.0
# changed dimensions in the form of `set=`, and values of the drivers in SI
CHANGED = {
    "four_bar": ({"crank": 0.037, "coupler": 0.118}, (0.9,)),
    "rssr": ({"crank": 0.0137, "gamma1": 0.41}, (-1.1,)),
    "jansen": ({"m": "15.4 mm", "j": "50.6 mm", "b": "41.9 mm"}, (0.7,)),
    "spherical_four_bar": ({"crank": "31 deg", "coupler": "72 deg"}, (1.2,)),
    "stewart_gough": ({"base": "103 mm"}, (0.157, 0.154, 0.158, 0.152, 0.156, 0.155)),
}


OWN_BAR = model_text("live_own_bar.toml")


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pages")

    def path_of(name):
        path = folder / f"{name}.html"
        if not path.exists():
            path.write_text(page(live_view(name)), encoding="utf-8")
        return path

    return path_of


def live_view(name):
    """Return a live page with few solved poses to save time."""
    solver = ms.load(name)
    if solver.motion_laws.crank:
        angles = np.linspace(-0.2, 0.2, 5)
        grid = motion_grid(
            "motion", solver.mechanism, solver.solve(angles), driver=solver.mechanism.crank.name
        )
    else:
        times = np.linspace(0.0, 0.1, 5)
        motion = solver.solve(t=times)
        grid = motion_grid("motion", solver.mechanism, motion, driver="time", unit="s", nodes=times)
    live = live_page(open_model(name), solver, parametric_model(name), SPEED)
    return View(solver.mechanism, [grid], solver.name, live=live, **drawn_as(solver))


# a press with a load of each kind and a spring; the page opens its values where the file states them
LOADED = model_text("live_loads_press.toml")


def open_live(window, path):
    window.complaints.clear()
    window.open(path, 1280, "light")
    assert window.run("document.documentElement.dataset.ready") == "yes", window.complaints
    # the camera follows the size of the stage when the page has been laid out, in the next frame
    window.run("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
    assert window.run("state.grid.name") == "live"


def open_text(window, folder, text):
    """Open the page of a model; return the model's path."""
    path = folder / "own.toml"
    path.write_text(text)
    path.with_suffix(".html").write_text(page(live_view(str(path))))
    open_live(window, path.with_suffix(".html"))
    return path


def set_dimension(window, name, value):
    """Set the slider of a dimension, return its number."""
    i = window.run(f"state.grid.sliders.findIndex(slider => slider.name === 'dimension.{name}')")
    window.run(f"setSlider({i}, {value!r})")
    return i


def change(window, name):
    """Set dimensions and drivers in the page; return its state."""
    changed, drivers = CHANGED[name]
    solver = parametric_model(name, set=changed)
    for i, value in enumerate(drivers):
        window.run(f"setSlider({i}, {value!r})")
    for dimension in changed:
        set_dimension(window, dimension, solver.dimensions[dimension].value)
    return window.run(
        "(() => { const s = state.grid.solutionAt(state.values); return { reached: s.reached, points: "
        "Object.fromEntries(Object.entries(s.points).map(([name, point]) => [name, point.position])), "
        "torques: Array.from(s.torques) }; })()"
    )


@in_browser
@pytest.mark.parametrize("name", CHANGED)
def test_the_page_agrees_with_python_at_changed_dimensions(window, pages, name):
    open_live(window, pages(name))
    state = change(window, name)
    assert state["reached"]
    changed, drivers = CHANGED[name]
    solver = ms.compile(name, set=changed)
    rates = [[SPEED if len(drivers) == 1 else 0.0] * len(drivers)]
    solved = solver.solve_drivers([drivers], rates)
    links, mechanism = list(solver.code.formulas.links), solver.code.assembly.source.mechanism
    for point, position in state["points"].items():
        link, local = mechanism.points[point]
        numbers = solved.links[0, links.index(link)]
        exact = numbers[:3] + numbers[3:12].reshape(3, 3) @ np.array(local)
        # the page and Python solve the same equations in doubles: required 1e-10, measured 1e-15 of the size
        np.testing.assert_allclose(position, exact, rtol=0.0, atol=1e-12 * mechanism.characteristic_length)
    np.testing.assert_allclose(state["torques"], np.ravel(solved.torques), rtol=1e-10, atol=1e-12)
    # unchanged dimensions give another configuration
    start = window.run("Object.values(state.grid.live.first.points).map(point => point.position)")
    assert np.abs(np.array(start) - np.array([*state["points"].values()])).max() > 1e-4
    assert not window.complaints


@in_browser
def test_a_saved_file_gives_the_mechanism_of_the_page(window, pages, tmp_path):
    for name in ("rssr", "jansen", "four_bar"):
        open_live(window, pages(name))
        state = change(window, name)
        text = window.run("state.grid.live.toml(state.values)")
        tomllib.loads(text)
        path = tmp_path / f"{name}.toml"
        path.write_text(text)
        motion = ms.load(path).solve([CHANGED[name][1][0]])
        for point, position in state["points"].items():
            np.testing.assert_allclose(motion.points[point].position[0], position, rtol=0.0, atol=1e-12)
        # the file has the dimensions of the page as parameters, with their changed values
        shown = parametric_model(name, set=CHANGED[name][0])
        saved = parametric_model(str(path))
        named = {dimension.name.replace(".", "_"): dimension.value for dimension in shown.dimensions.values()}
        assert CHANGED[name][0].keys() <= saved.values().keys() <= named.keys()
        assert saved.values() == pytest.approx({key: named[key] for key in saved.values()}, rel=1e-12)
        units = {key.replace(".", "_"): dimension.unit for key, dimension in shown.dimensions.items()}
        assert {key: dimension.unit for key, dimension in saved.dimensions.items()}.items() <= units.items()


@in_browser
def test_a_saved_line_keeps_its_other_values_and_its_comment(window, tmp_path):
    open_text(window, tmp_path, OWN_BAR)
    set_dimension(window, "long_bar", 0.125)
    lines = window.run("state.grid.live.toml(state.values)").splitlines()
    changed = [(a, b) for a, b in zip(OWN_BAR.splitlines(), lines, strict=True) if a != b]
    assert len(changed) == 1
    assert tomllib.loads(changed[0][1])["parameters"] == {
        "short": 40.0, "long_bar": 125.0, "rocker_": 80.0, "base": "3*short"
    }  # fmt: skip
    assert changed[0][1].endswith("# of my bench")
    # names appear as typed
    assert "long_bar [mm]" in window.run("document.getElementById('dimensions').textContent")


def radii(window, line):
    """Return the distances of the starts of a line's segments from the crank's pivot."""
    start = window.run(f"Array.from({line}.geometry.attributes.instanceStart.array)")
    return np.hypot(*np.reshape(start, (-1, 3))[:, :2].T)


@in_browser
def test_solids_are_those_that_are_drawn_of_the_changed_design(window, pages):
    open_live(window, pages("warp_knitter"))
    set_dimension(window, "pivot2.x", 0.057)
    set_dimension(window, "crank1", 0.011)
    shown = window.run(
        "Object.entries(solids).flatMap(([link, group]) => group.children.map((holder, i) => "
        "[...holder.position.toArray(), holder.children[0].scale.z * DATA.bodies[link][i].half.at(-1)]))"
    )
    design = parametric_model("warp_knitter").describe({"pivot2.x": 0.057, "crank1": 0.011})
    drawn = link_shapes(design, radius=rod_radius(ms.load("warp_knitter").mechanism))
    right = [[*shape.centre, shape.half_sizes[-1]] for own in drawn.values() for shape in own]
    # the teeth follow to second order in the dimension: measured 2e-9 m of 2 mm
    np.testing.assert_allclose(shown, right, rtol=0.0, atol=1e-8)


@in_browser
def test_the_former_path_stays_faded_behind_the_changed_one(window, pages):
    open_live(window, pages("four_bar"))
    assert not window.run("formerLines[0].visible")
    for crank in (0.035, 0.033):
        set_dimension(window, "crank", crank)
    window.run("setSlider(0, 0.5)")
    # the line of A is the circle of the crank, in floats of 32 bits; the former one not that in between
    np.testing.assert_allclose(radii(window, "pathLines[0]"), 0.033, rtol=1e-6)
    np.testing.assert_allclose(radii(window, "formerLines[0]"), 0.032, rtol=1e-6)
    faded = "formerLines[0].material.opacity < 0.5 * pathLines[0].material.opacity"
    assert window.run(f"formerLines[0].visible && {faded}")
    window.run("flip('paths')")
    assert not window.run("formerLines[0].visible")


@in_browser
def test_a_dragged_point_follows_the_pointer_within_its_reach(window, pages):
    open_live(window, pages("stewart_gough"))
    before, after, target = window.run(
        "(() => { const at = () => pixel(pointMarks[0].getWorldPosition(new THREE.Vector3())); "
        "const a = at(), goal = [a[0] + 25, a[1] - 15]; dragTo({ point: DATA.points[0].name }, goal); "
        "return [a, at(), goal]; })()"
    )
    # half a pixel
    assert np.linalg.norm(np.subtract(after, target)) < 0.5 < np.linalg.norm(np.subtract(before, target))
    open_live(window, pages("four_bar"))
    # point A moves on a circle of 40 mm: the crank ends in the direction of the pointer
    angle, reached = window.run(
        "(() => { const o = pixel(new THREE.Vector3()); "
        "for (let i = 0; i < 40; i++) dragTo({ point: DATA.points[0].name }, [o[0] - 300, o[1] - 300]); "
        "return [state.values[0], DATA.points[0].name]; })()"
    )
    assert reached == "A"
    assert angle == pytest.approx(0.75 * np.pi, abs=1e-3)


@in_browser
def test_a_dragged_pivot_changes_the_dimension_that_places_it(window, pages):
    open_live(window, pages("four_bar"))
    pivots = (
        "Object.fromEntries(DATA.joints.filter(joint => joint.pivot).map(joint => [joint.name, "
        "pixel(new THREE.Vector3(...joint.at).applyMatrix4(bodies[joint.link].matrixWorld))]))"
    )
    crank, rocker = (window.run(pivots)[name] for name in ("crank", "rocker"))
    corner = window.run("(b => [b.left, b.top])(stage.getBoundingClientRect())")
    start = rocker[0] + corner[0], rocker[1] + corner[1]
    window.drag(start, (start[0] + 20, start[1]), (start[0] + 40, start[1] - 30))
    ground = window.run("state.values[state.grid.sliders.findIndex(one => one.name === 'dimension.ground')]")
    # the frame of 100 mm is drawn from pivot to pivot; it lies along x, and the pointer's height is ignored
    assert ground == pytest.approx(0.1 * (rocker[0] - crank[0] + 40) / (rocker[0] - crank[0]), rel=1e-3)
    assert window.run(pivots)["rocker"] == pytest.approx([rocker[0] + 40, rocker[1]], abs=0.5)
    # no dimension places the crank's pivot: the mouse turns the view there
    assert window.run(f"grabbed({crank}, 16)") is None
    assert not window.complaints


@in_browser
def test_a_finger_drags_points_and_pivots_and_scrolls_elsewhere(window, pages):
    open_live(window, pages("four_bar"))
    window.as_phone(390, 844)
    window.run("new Promise(done => setTimeout(done, 400))")
    assert window.run("matchMedia('(pointer: coarse)').matches")
    # targets of at least 24 pixels, as WCAG 2.2 asks for
    targets = (
        "[...document.querySelectorAll('button, select, input, summary')].filter(one => one.offsetParent)"
    )
    assert min(window.run(f"{targets}.map(one => one.getBoundingClientRect().height)")) >= 24
    positions = (
        "(() => { const box = stage.getBoundingClientRect(), "
        "pivot = DATA.joints.find(joint => joint.name === 'rocker'); "
        "const mark = pointMarks[DATA.points.findIndex(point => point.name === 'A')]; "
        "const seen = [mark.getWorldPosition(new THREE.Vector3()), new THREE.Vector3(...pivot.at), "
        "new THREE.Vector3()].map(pixel); return seen.map(([x, y]) => [x + box.left, y + box.top]); })()"
    )
    point, pivot, crank = window.run(positions)
    # the crank rotates until A is in the direction of the finger
    window.swipe(point, *((point[0] - 4 * k, point[1] - 6 * k) for k in range(1, 9)))
    reached = np.subtract(window.run(positions)[0], crank)
    target = np.subtract(point, crank) - [32.0, 48.0]
    assert np.arctan2(*reached) == pytest.approx(np.arctan2(*target), abs=0.02)
    window.swipe(pivot, *((pivot[0] + 2 * k, pivot[1]) for k in range(1, 11)))
    assert window.run(positions)[1] == pytest.approx([pivot[0] + 20.0, pivot[1]], abs=1.0)
    assert window.run("scrollY") == 0
    corner = window.run("(box => [box.left + 12, box.bottom - 70])(stage.getBoundingClientRect())")
    window.swipe(corner, *((corner[0], corner[1] - 15 * k) for k in range(1, 15)))
    assert window.run("new Promise(done => setTimeout(() => done(scrollY), 300))") > 100
    assert not window.complaints


@in_browser
def test_loads_have_sliders_and_the_torque_follows_as_in_python(window, tmp_path):
    path = open_text(window, tmp_path, LOADED)
    changed = {"force on B x": -8.5, "force on B y": 3.0, "moment on rod z": 0.2}
    changed |= {"load on the crank": -0.45, "mass of slider": 3.5}
    names = window.run("state.grid.sliders.map(slider => slider.name)")
    assert {name for name in names if name.startswith("load.")} == {f"load.{name}" for name in changed}
    torques = []
    for values in ({}, changed):
        for name, value in values.items():
            window.run(f"setSlider({names.index('load.' + name)}, {value})")
        window.run("setSlider(0, 0.7)")
        torques.append(window.run("state.grid.solutionAt(state.values).torques[0]"))
    saved = tmp_path / "saved.toml"
    saved.write_text(window.run("state.grid.live.toml(state.values)"))
    # the saved file has the changed loads, and its weight, inertia, loads and spring need the same torque
    for file, torque in zip((path, saved), torques, strict=True):
        model = ms.dynamics.dynamic_model(ms.load(file))
        exact = ms.dynamics.prescribed(model, [0.7], speed=SPEED).forces.torque[0]
        assert torque == pytest.approx(exact, rel=1e-10)
    assert abs(torques[1] - torques[0]) > 0.1
    assert tomllib.loads(saved.read_text())["forces"]["loads"]["press"]["force"] == [-8.5, 3.0, 0]
    path.write_text(LOADED.replace("crank_torque", "joint_springs.slide = { stiffness = 10 }\ncrank_torque"))
    assert live_view(str(path)).live.data["uncounted"] == "springs in joints"
    # a ball marks the end of the spring on the frame, at 0.2 m; the picture reaches it (the slider: 0.124 m)
    solids = window.run("DATA.bodies.ground.filter(solid => solid.kind === 'sphere').map(solid => solid.at)")
    assert solids == [pytest.approx([0.2, 0.01, 0.0])]
    view = window.run("DATA.cameras[0]")
    assert view["centre"][0] + view["width"] / 2.0 > 0.2
    assert not window.complaints


@in_browser
def test_curves_keep_the_former_design_and_stay_over_the_crank(window, pages):
    open_live(window, pages("four_bar"))
    legend = "document.querySelectorAll('.curve')[0].textContent"
    shown = "state.chosen[0].{}.rows"
    before = window.run(shown.format("shown"))
    i = set_dimension(window, "crank", 0.033)
    assert "crank [°]" in window.run(legend)
    assert window.run("document.querySelectorAll('.curve .former').length") > 0
    np.testing.assert_allclose(window.run(shown.format("former")), before)
    # a kept design remains that of comparison, whatever is changed later
    window.run("document.querySelector('[data-tool=kept]').click()")
    fixed = window.run(shown.format("former"))
    window.run(f"changedAt = -Infinity; setSlider({i}, 0.035); changedAt = -Infinity; setSlider({i}, 0.036)")
    np.testing.assert_allclose(window.run(shown.format("former")), fixed)
    assert np.abs(np.array(fixed) - before).max() > 1e-3


@in_browser
def test_the_address_stores_dimensions_and_limits_are_reported(window, pages):
    open_live(window, pages("four_bar"))
    window.run("setSlider(0, 0.5)")
    i = set_dimension(window, "crank", 0.045)
    window.run("(() => { location.hash = '#grid=0&crank=30&dimension.crank=41'; addressed(); })()")
    values = window.run("state.values")
    assert values[0] == pytest.approx(np.deg2rad(30.0))
    assert values[i] == pytest.approx(0.041)
    # a value beyond the slider's range widens it
    window.run(f"setSlider({i}, 0.049)")
    assert window.run(f"state.values[{i}]") == 0.049
    assert window.run(f"+sliderRows[{i}].querySelector('input[type=range]').max") == pytest.approx(49.0)
    window.run(f"setSlider({i}, 0.041)")
    # a crank of 41 mm on a frame of 150 mm cannot reach 180 degrees: the other links have 110 and 80 mm
    set_dimension(window, "ground", 0.15)
    window.run("setSlider(0, Math.PI)")
    assert "Not reachable" in window.run("document.getElementById('trouble').textContent")


def test_a_dimension_with_a_wrong_formula_is_omitted(monkeypatch):
    designs, model = parametric_model("four_bar"), open_model("four_bar")
    valid = parametric_geometry(model, designs).dimensions
    assert {"ground", "crank", "coupler", "rocker"} == {dimension.name for dimension in valid}
    translated = geometry.translated_vectors

    def wrong(*args):
        vectors = dict(translated(*args))
        for key, (x, y, z) in vectors.items():
            off = Formula(x.javascript, lambda si, x=x: x.value(si) + 1e-4 * si["crank"], x.toml)
            vectors[key] = (off, y, z)
        return vectors

    monkeypatch.setattr(geometry, "translated_vectors", wrong)
    assert "crank" not in {dimension.name for dimension in parametric_geometry(model, designs).dimensions}


def test_dimensions_that_change_more_than_points_are_omitted():
    # numbers of teeth change a coupling
    planetary = parametric_geometry(open_model("planetary_gear"), parametric_model("planetary_gear"))
    assert planetary.dimensions == ()
