"""Live pages of all mechanisms: error against Python at random dimensions, size, and time of an update.

    python validation/speed/live_page.py [NAME ...]

Each page is opened in headless Chromium. Drivers and dimensions are set at random within 3 percent; positions
and drive torques are compared with those of the compiled solver of the changed model.
"""

import contextlib
import io
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import mechsim as ms
from mechsim.cli import main
from mechsim.io import gallery as listing
from mechsim.io.readers import as_text
from mechsim.numerics.arrays import Array

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))

from browser import Browser

SETTINGS = 10
# random change of dimensions, and of driver angles in [rad] or driver lengths relative to the size
CHANGE, DRIVEN = 0.03, 0.2
# JavaScript: median time of 20 updates in ms, a slider moved by a small step
UPDATE_TIME = """(() => {{
  const times = [];
  for (let i = 0; i < 20; i++) {{
    const before = performance.now();
    setSlider({slider}, state.values[{slider}] + {step});
    times.push(performance.now() - before);
  }}
  return times.sort((a, b) => a - b)[10];
}})()"""


def settings(window: Browser, random: np.random.Generator) -> list[float]:
    """Return a random value of each slider."""
    values: list[float] = []
    length = window.run("DATA.live.size")
    for driver in window.run("DATA.live.drivers"):
        scale = 1.0 if driver["unit"] == "rad" else length
        values.append(driver["start"] + DRIVEN * scale * random.uniform(-1.0, 1.0))
    for dimension in window.run("DATA.live.dimensions"):
        scale = 1.0 if dimension["unit"] == "rad" else abs(dimension["value"]) or length
        values.append(dimension["value"] + CHANGE * scale * random.uniform(-1.0, 1.0))
    return values


def set_values(window: Browser, values: list[float]) -> dict[str, Any]:
    """Set all sliders; return positions, torques, and whether the page reached the values."""
    for i, value in enumerate(values):
        window.run(f"placeSlider({i}, {value!r})")
    return dict(
        window.run(
            "(() => { update(); const s = state.grid.solutionAt(state.values); return { values: "
            "state.values, reached: s.reached, points: s.points, torques: Array.from(s.torques) }; })()"
        )
    )


def python_values(name: str, window: Browser, values: list[float]) -> tuple[dict[str, Array], Array]:
    """Return positions and torques of the compiled solver at the same drivers and dimensions."""
    drivers, dimensions = window.run("DATA.live.drivers"), window.run("DATA.live.dimensions")
    changed: dict[str, str] = {}
    for dimension, value in zip(dimensions, values[len(drivers) :], strict=True):
        parameter, dot, _ = dimension["name"].partition(".")
        before = f"{changed[parameter].removesuffix(' m')}," if parameter in changed else ""
        changed[parameter] = f"{before}{value!r} m" if dot else as_text(value, dimension["unit"])
    solver = ms.compile(name, set=changed)
    single = len(drivers) == 1 and drivers[0]["unit"] == "rad"
    rates = [[window.run("DATA.live.speed")] if single else [0.0] * len(drivers)]
    solved = solver.solve_drivers([values[: len(drivers)]], rates)
    points: dict[str, Array] = {}
    links = list(solver.code.formulas.links)
    for point, (link, local) in solver.code.assembly.source.mechanism.points.items():
        if link in links:
            numbers = solved.links[0, links.index(link)]
            points[point] = numbers[:3] + numbers[3:12].reshape(3, 3) @ np.array(local)
    return points, np.ravel(solved.torques)


def table_row(name: str, window: Browser, folder: Path, count: int) -> str:
    """Return a row of the table."""
    path = folder / f"{name}.html"
    sys.argv = ["mechsim", "view", name, "--live", "-o", str(path)]
    with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):
        main()
    window.open(path, 1280, "light")
    assert window.run("document.documentElement.dataset.ready") == "yes", window.complaints
    random, scale = np.random.default_rng(1), window.run("DATA.live.size")
    worst, torque, compared = 0.0, 0.0, 0
    for _ in range(count):
        page = set_values(window, settings(window, random))
        if not page["reached"]:
            continue
        try:
            points, torques = python_values(name, window, page["values"])
        except ms.MechsimError:
            continue
        compared += 1
        errors = [np.abs(points[name] - point["position"]).max() for name, point in page["points"].items()]
        worst = max(worst, max(errors, default=0.0) / scale)
        if len(torques) and np.abs(torques).max() > 1e-9:
            torque = max(torque, float(np.abs(torques - page["torques"]).max() / np.abs(torques).max()))
    driver = window.run(UPDATE_TIME.format(slider=0, step=1e-3 * scale))
    dimension = float("nan")
    if window.run("DATA.live.dimensions.length"):
        dimension = window.run(UPDATE_TIME.format(slider="DATA.live.drivers.length", step=1e-4 * scale))
    megabytes = path.stat().st_size / 1e6
    return (
        f"{name:20s} {compared:3d}/{count} {worst:9.1e} {torque:9.1e} {megabytes:6.2f} MB "
        f"{driver:6.1f} ms {dimension:6.1f} ms"
    )


if __name__ == "__main__":
    print("mechanism            compared  position    torque    size    driver dimension")
    with tempfile.TemporaryDirectory() as scratch, Browser(Path(scratch) / "profile") as browser:
        for mechanism in sys.argv[1:] or [*listing.list()["mechanisms"], *listing.list()["gallery"]]:
            print(table_row(mechanism, browser, Path(scratch), SETTINGS), flush=True)
