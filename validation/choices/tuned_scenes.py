"""`mechsim tune` on twenty scenes and more: does a run from outside keep the tolerance, and for how long?

Problem: models of the catalogue and the gallery as `mechsim export` writes them, and public closed-loop
files, each with the motions, measures and tolerances of tuned_cases.py.
Reference: the file that was written and the lines of Python that run it, checked by plain MuJoCo alone
(check_in_mujoco.py): loop closure over a motion half as long again. For the time: the best of an exhaustive
grid (tuned_grid.py) that keeps it, timed side by side, in the first case of each scene.

    python validation/choices/tuned_scenes.py [FOLDER] [--only NAME,..] [--cases N,..] [--exhaustive]

FOLDER holds clones of the repositories named in tuned_cases.py; a file that is not there is skipped. Exits
with 1 where a tolerance is not kept, or the time is more than 1.5 times the best.
"""

import argparse
import sys
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from time import process_time

import numpy as np
from check_in_mujoco import closure_error, script_of, trajectory_error
from tuned_cases import CASES, SceneFile, scene_files
from tuned_grid import quickest_kept

from mechsim.cli.load_options import user_scene
from mechsim.errors import MechsimError
from mechsim.simulation.mjcf.compiling import quiet
from mechsim.studies.budget import Budget
from mechsim.studies.scene.errors import start_error
from mechsim.studies.scene.open_scene import python_laws
from mechsim.studies.scene.run import step_times
from mechsim.studies.scene.scene import UserScene, with_assembled_start
from mechsim.studies.scene.tune import AIMED_FRACTION, SECONDS, SceneTrial, Tuned, tuned
from mechsim.studies.scene.write_tuned import python_of, tuned_text, write_scene

# how much longer the run from outside is; the most that is paid over the best, and a search may take, in [s]
LONGER, DEARER, SLOWEST = 1.5, 1.5, 60.0
HEAD = ("by", "T in m", "published", "ms/s", "outside", "+-", "ms/s", "/best", "s", "tried")
WIDTHS = (10, 8, 9, 8, 9, 8, 8, 6, 6, 5)


@dataclass
class Count:
    """What was counted: tolerances promised, kept, said to be out of reach; slow searches, ratios of time."""

    promised: int = 0
    kept: int = 0
    unreached: int = 0
    slow: int = 0
    ratios: tuple[float, ...] = ()


def outside(scene: UserScene, result: Tuned, best: SceneTrial, work: Path) -> tuple[float, float]:
    """Write what was found, run it from outside; return its worst error and the reference's own, in [m]."""
    stem = f"tuned-{scene.mechanism.name}".replace(" ", "-")
    file, script = work / f"{stem}.xml", work / f"{stem}.py"
    in_file = replace(best.settings, compliance=None)
    read = write_scene(scene, in_file, tuned_text(scene, in_file, [], work).after, file)
    stands = replace(read, model=best.settings.applied(read.model))
    changed = {} if best.settings.in_file else {"compliance": best.settings.compliance}
    script.write_text(python_of(stands, file, python_laws(scene), changed=changed))
    if result.by == "trajectory":
        return trajectory_error(script_of(script), scene.duration, scene.tracked)
    drivers = scene.closure.drivers
    return closure_error(script_of(script), LONGER * scene.duration, scene.tracked, drivers), 0.0


def judged(
    item: SceneFile, number: int, work: Path, count: Count, budget: float, exhaustive: bool
) -> list[object]:
    """Tune one scene for one of its cases, run what was written from outside, count and return the row."""
    by, part, rate = CASES[number]
    scene = user_scene(str(item.path), *item.motion(rate))
    tolerance = float(f"{part * scene.characteristic_length:.2g}")
    if by == "closure" and start_error(scene) > AIMED_FRACTION * tolerance:
        scene = with_assembled_start(scene)
    result = tuned(
        scene, tolerance, by, budget=Budget(budget, now=process_time)
    )  # independent of other programs
    count.slow += result.seconds > SLOWEST
    before = result.published
    row = [by, tolerance, before.errors.by(by), 1e3 * before.seconds]
    best = result.chosen or result.beyond
    if best is None:
        count.unreached += 1
        return [
            *row,
            result.closest.errors.by(by),
            0.0,
            0.0,
            0.0,
            result.seconds,
            len(result.tried),
            "is said",
        ]
    error, bar = outside(scene, result, best, work)
    ratio = np.nan
    if exhaustive and number == 0 and (grid := quickest_kept(scene, tolerance)):
        own, other = step_times([(scene, each.applied(scene.model)) for each in (best.settings, grid[0])])
        ratio = own / other
        count.ratios = (*count.ratios, ratio)
        print(f"    {best.settings.as_dict()}\n    {grid[0].as_dict()}")
    kept = error <= tolerance
    count.promised, count.kept = count.promised + 1, count.kept + kept
    output = ("" if best.settings.in_file else "by Python") if kept else "NOT KEPT"
    return [*row, error, bar, 1e3 * best.seconds, ratio, result.seconds, len(result.tried), output]


@quiet()
def main() -> int:
    """Tune every scene and count."""
    asked = argparse.ArgumentParser()
    asked.add_argument("folder", nargs="?", type=Path)
    asked.add_argument("--only", default="")
    asked.add_argument("--cases", default=",".join(str(i) for i in range(len(CASES))))
    asked.add_argument("--budget", type=float, default=SECONDS)
    asked.add_argument("--exhaustive", action="store_true")
    reported = asked.parse_args()
    print("scene".ljust(20), *(name.rjust(width) for name, width in zip(HEAD, WIDTHS, strict=True)))
    count = Count()
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        for item in scene_files(reported.folder, work, {name for name in reported.only.split(",") if name}):
            for number in map(int, reported.cases.split(",")):
                try:
                    row = judged(item, number, work, count, reported.budget, reported.exhaustive)
                except MechsimError as error:
                    count.promised += 1
                    row = [f"NOT TUNED: {error}"]
                cells = (f"{value:.3g}" if isinstance(value, float) else str(value) for value in row)
                print(
                    item.name.ljust(20),
                    *(f"{c:>{w}}" for c, w in zip(cells, (*WIDTHS, 0), strict=False)),
                    flush=True,
                )
    print(f"kept: {count.kept} of {count.promised}; said to be out of reach: {count.unreached}")
    print(f"searches over {SLOWEST:g} s: {count.slow}")
    if count.ratios:
        print(f"time over the best of the grid: {np.median(count.ratios):.2f}, worst {max(count.ratios):.2f}")
    dear = max(count.ratios, default=0.0) > DEARER
    return int(count.kept < count.promised or bool(count.slow) or dear)


if __name__ == "__main__":
    sys.exit(main())
