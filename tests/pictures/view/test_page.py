"""The page in a browser: dragged points agree with the closed form at every size and in both schemes."""

import json
import re
from functools import cache

import numpy as np
import pytest
from browser import in_browser
from model_files import FOLDER, model_text

import mechsim as ms
from mechsim.kinetics import dynamic_model
from mechsim.pictures.view.offline_page import page
from mechsim.report.views import mechanism_view, release_view
from mechsim.studies.release import Release

LINKAGE = ms.catalog.make("four_bar")


@cache
def text():
    return page(mechanism_view(LINKAGE, ms.units.rpm(600)))


@cache
def data():
    return json.loads(re.search(r'id="data">(.*?)</script>', text(), re.S)[1])


@pytest.fixture(scope="module")
def path_of_page(tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "view.html"
    path.write_text(text(), encoding="utf-8")
    return path


def open_fresh(window, page, fragment="", width=1280, scheme="light"):
    window.complaints.clear()
    window.open(page, width, scheme, fragment)
    assert window.run("document.documentElement.dataset.ready") == "yes", window.complaints


def expected(window, point, degrees):
    """Return the position of a point on the stage by the closed form and the recorded camera."""
    position = LINKAGE.positions([np.deg2rad(degrees)])[point][0]
    view = data()["cameras"][0]
    width, height = window.run("[document.getElementById('stage').clientWidth, stage.clientHeight]")
    scale = 0.82 * min(width / view["width"], height / view["height"])
    back, up = np.array(view["back"]), np.array(view["up"])
    offset = position - np.array(view["centre"])
    return np.array([width / 2.0 + scale * offset @ np.cross(up, back), height / 2.0 - scale * offset @ up])


def shown(window, point):
    """Return the position of a point as reported by the page."""
    result = window.run(
        f"(one => [+one.dataset.x, +one.dataset.y])(document.querySelector('[data-point={point}]'))"
    )
    return np.array(result)


def dragged(window, fraction):
    """Drag the slider to a fraction of its length, and return the angle in degrees that it shows."""
    box = "(b => [b.left, b.top + b.height / 2, b.width])(slider0.getBoundingClientRect())"
    x, y, width = window.run(box)
    now = window.run("(slider0.value - slider0.min) / (slider0.max - slider0.min)")
    window.drag(*((x + 8 + share * (width - 16), y) for share in (now, (now + fraction) / 2.0, fraction)))
    return window.run("+slider0.value")


def test_a_page_is_self_contained_and_small():
    assert len(text().encode()) < 6e6
    outside = re.sub(r"<script>.*?</script>", "", text(), flags=re.S)
    assert not re.search(r'(src|href)="(?!data:)', outside)
    assert "@import" not in text()


@in_browser
def test_points_follow_a_dragged_slider_as_the_closed_form(window, path_of_page):
    open_fresh(window, path_of_page)
    for fraction in (0.31, 0.64, 0.997):
        degrees = dragged(window, fraction)
        assert degrees == pytest.approx(360.0 * fraction, abs=2.0)
        for point in LINKAGE.mechanism.points:
            assert np.abs(shown(window, point) - expected(window, point, degrees)).max() < 1.0
        # an error of three degrees would be detected
        assert np.abs(shown(window, "A") - expected(window, "A", degrees + 3.0)).max() > 1.0
    assert window.complaints == []
    loaded = window.run("performance.getEntriesByType('resource').map(one => one.name)")
    assert [item for item in loaded if not item.startswith("data:")] == []


@in_browser
def test_points_are_drawn_at_their_reported_positions(window, path_of_page):
    open_fresh(window, path_of_page, "#crank=123&paths=off&names=off&joints=off")
    image = window.look().astype(int)
    left, top = window.run("(b => [b.left, b.top])(stage.getBoundingClientRect())")
    for point in data()["points"]:
        x, y = expected(window, point["name"], 123.0) + np.array([left, top])
        colour = np.round(255 * np.array(point["colour"]))
        neighbourhood = image[round(y) - 30 : round(y) + 31, round(x) - 30 : round(x) + 31]
        rows, columns = np.nonzero(np.abs(neighbourhood - colour).max(-1) <= 1)
        assert len(rows) > 20
        middle = np.array([columns.mean() - 30 + round(x), rows.mean() - 30 + round(y)])
        assert np.abs(middle + 0.5 - (x, y)).max() < 1.5


@in_browser
def test_the_links_cast_a_shadow_on_the_wall_behind_them(window, path_of_page):
    floor = data()["floor"]
    assert (floor["normal"], floor["at"] <= -data()["radius"]) == ([0.0, 0.0, 1.0], True)
    open_fresh(window, path_of_page, "#crank=123&paths=off&names=off&joints=off")

    def shaded():
        """Count pixels of the stage between the sky, its grid and the links."""
        image = window.look().astype(int)[60:, :600]
        return ((np.ptp(image, axis=-1) <= 3) & (image.max(-1) > 190) & (image.max(-1) < 228)).sum()

    before = shaded()
    window.run("scene.children.find(part => part.material && part.material.isShadowMaterial).visible = false")
    window.run("draw()")
    assert before > shaded() + 1000


@in_browser
def test_keys_move_the_slider_and_switch_visibility(window, path_of_page):
    open_fresh(window, path_of_page, "#crank=40")
    window.run("slider0.focus()")
    window.press("ArrowRight")
    assert window.run("+slider0.value") == pytest.approx(41.0)
    window.press("p")
    assert window.run("pathLines.some(line => line.visible)") is False
    before = window.run("camera.position.x")
    window.run("stage.focus()")
    window.press("ArrowLeft")
    assert window.run("camera.position.x") != before
    window.press("0")
    assert window.run("camera.position.x") == pytest.approx(before)
    window.press(" ", 32)
    assert window.run("state.playing.size") == 1
    window.press(" ", 32)
    assert window.run("state.playing.size") == 0
    assert window.complaints == []


NAMES = "[...document.querySelectorAll('#labels text')].map(one => one.getBoundingClientRect().toJSON())"


@in_browser
@pytest.mark.parametrize(("width", "angles"), [(400, (0, 75)), (1280, (180, 200))])
def test_labels_do_not_overlap_or_leave_the_page(window, path_of_page, width, angles):
    ground = []
    for scheme, degrees in zip(("light", "dark"), angles, strict=True):
        open_fresh(window, path_of_page, f"#crank={degrees}", width, scheme)
        assert window.run("document.documentElement.scrollWidth") <= width
        ground.append(float(np.median(window.look())))
        assert window.complaints == []
        result = window.run(NAMES)
        assert len(result) >= 5  # three points, a pivot and the scale
        for i, a in enumerate(result):
            for b in result[:i]:
                apart = a["right"] <= b["left"] or b["right"] <= a["left"]
                assert apart or a["bottom"] <= b["top"] + 3 or b["bottom"] <= a["top"] + 3
    assert ground[0] > 200.0 > 60.0 > ground[1]


@in_browser
def test_the_message_without_webgl_persists(window, tmp_path):
    without_webgl = model_text("page_without_webgl.xml")
    path = tmp_path / "blind.html"
    path.write_text(
        text().replace('<script type="application/json"', f'{without_webgl}<script type="application/json"'),
        encoding="utf-8",
    )
    window.open(path, 400, "light")
    message = "(m => m.getClientRects().length ? m.textContent : '')(document.getElementById('nowebgl'))"
    assert "no WebGL" in window.run(message)
    window.run("setSlider(0, 1.0)")
    window.run("choose(0)")
    assert "no WebGL" in window.run(message)
    assert len(window.run(NAMES)) >= 5
    # the crank is drawn from its pivot to A, as in three dimensions
    window.run("setSlider(0, 0.0)")
    colour, a, pivot = window.run(
        "[`#${solids.crank.children[0].children[0].material.color.getHexString()}`, "
        "pixel(pointMarks[0].getWorldPosition(new THREE.Vector3())), pixel(new THREE.Vector3())]"
    )
    widths = window.run(
        f"[...document.querySelectorAll('#flat path[fill=\"{colour}\"]')].map(path => path.getBBox().width)"
    )
    assert max(widths) == pytest.approx(a[0] - pivot[0], rel=0.2)


@in_browser
def test_the_address_stores_and_restores_the_view(window, path_of_page):
    open_fresh(window, path_of_page)
    window.run("setSlider(0, 2.0)")
    window.run("flip('paths')")
    window.run("orbit(0.4, 0.2); zoom(1.5)")
    assert window.run("new Promise(done => setTimeout(() => done(true), 600))")
    shot = "[state.values[0], camera.zoom, ...camera.position.toArray()]"
    fragment, before = window.run(f"[location.hash, {shot}]")
    open_fresh(window, path_of_page, fragment)
    after = window.run(shot)
    assert after == pytest.approx(before, rel=1e-3, abs=1e-3)
    assert window.run("state.show.paths") is False
    assert window.complaints == []


@in_browser
def test_a_table_and_a_picture_can_be_saved(window, path_of_page):
    open_fresh(window, path_of_page, "#crank=30")
    rows = window.run("table()").split("\r\n")
    assert rows[0].startswith("crank [°],A.x [mm]")
    assert len(rows) > 120
    angle, x = (float(word) for word in rows[31].split(",")[:2])
    assert x == pytest.approx(1e3 * LINKAGE.positions([np.deg2rad(angle)])["A"][0, 0], abs=1e-3)
    data_url = window.run("picture().toDataURL('image/png')")
    assert len(data_url) > 20_000


@in_browser
def test_the_view_follows_a_fall(window, tmp_path):
    model = dynamic_model(ms.load(str(FOLDER / "falling_arm.xml"), still=True))
    path = tmp_path / "fall.html"
    path.write_text(page(release_view(Release(model=model), None)), encoding="utf-8")
    open_fresh(window, path)
    for time in (0.0, 0.5, 1.0):
        window.run(f"setSlider(0, {time})")
        # all of it falls by g t^2 / 2, and the arm of 420 mm fills more than a tenth of the width
        assert window.run("followed.toArray()") == pytest.approx([0.0, 0.0, -9.81 * time**2 / 2], abs=1e-6)
        shown = "bodies[link].position.clone().project(camera).toArray().slice(0, 2)"
        pixels = window.run(f"state.grid.links.map(link => {shown})")
        assert np.abs(pixels).max() < 1.0
    assert window.run("camera.right - camera.left") < 4.2
    assert not window.complaints
