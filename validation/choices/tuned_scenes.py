"""`mechsim tune` on twenty scenes and more: does an external run satisfy the tolerance, and at what time?

Problem: models of the catalogue and the gallery as `mechsim export` writes them, and public closed-loop
files, each with the motions, measures and tolerances of tuned_cases.py. Reference: plain MuJoCo
(check_in_mujoco.py) runs the written file by the written Python script and computes the loop closure over a
motion 1.5 times as long.

    python validation/choices/tuned_scenes.py [FOLDER] [--only NAME,..] [--cases N,..]

FOLDER holds clones of the repositories named in tuned_cases.py; missing files are skipped. Exits
with 1 if a tolerance is exceeded or a search takes more than a minute.
"""

import argparse
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from time import process_time

from check_in_mujoco import closure_error, script_of, trajectory_error
from tuned_cases import CASES, SceneFile, scene_files

from mechsim.cli.scene_run import user_scene
from mechsim.errors import MechsimError
from mechsim.numerics.resources import Budget
from mechsim.simulation.mjcf.compiling import quiet
from mechsim.studies.scene.errors import start_error
from mechsim.studies.scene.scene import UserScene, python_laws, with_assembled_start
from mechsim.studies.scene.tune import AIMED_FRACTION, SECONDS, SceneTrial, Tuned, tuned
from mechsim.studies.scene.write_tuned import python_of, tuned_text, write_scene

# factor of the duration of the external run; longest search in [s]
DURATION_FACTOR, MAX_SECONDS = 1.5, 60.0
HEAD = ("by", "T in m", "published", "ms/s", "external", "+-", "ms/s", "s", "tested")
WIDTHS = (10, 8, 9, 8, 9, 8, 8, 6, 5)


@dataclass
class Counts:
    """Numbers of tolerances promised, satisfied and reported unreachable; slow searches."""

    promised: int = 0
    satisfied: int = 0
    unreachable: int = 0
    slow: int = 0


def external_error(scene: UserScene, result: Tuned, best: SceneTrial, work: Path) -> tuple[float, float]:
    """Run the written files externally; return the largest error and that of the reference, in [m]."""
    stem = f"tuned-{scene.mechanism.name}".replace(" ", "-")
    file, script = work / f"{stem}.xml", work / f"{stem}.py"
    settings = best.settings
    written = write_scene(scene, settings, tuned_text(scene, settings, [], work).after, file)
    script.write_text(python_of(written, file, python_laws(scene)))
    if result.by == "trajectory":
        return trajectory_error(script_of(script), scene.duration, scene.tracked)
    drivers = scene.closure.drivers
    return closure_error(script_of(script), DURATION_FACTOR * scene.duration, scene.tracked, drivers), 0.0


def checked_row(item: SceneFile, number: int, work: Path, count: Counts, budget: float) -> list[object]:
    """Tune a scene for a case, run the written files externally, count, and return the row."""
    by, fraction, rate = CASES[number]
    scene = user_scene(str(item.path), *item.motion(rate))
    tolerance = float(f"{fraction * scene.characteristic_length:.2g}")
    if by == "closure" and start_error(scene) > AIMED_FRACTION * tolerance:
        scene = with_assembled_start(scene)
    result = tuned(
        scene, tolerance, by, budget=Budget(budget, now=process_time)
    )  # independent of other programs
    count.slow += result.seconds > MAX_SECONDS
    published = result.published
    row = [by, tolerance, published.errors.by(by), 1e3 * published.seconds]
    best = result.chosen
    if best is None:
        count.unreachable += 1
        return [
            *row,
            result.closest.errors.by(by),
            0.0,
            0.0,
            result.seconds,
            len(result.tried),
            "unreachable",
        ]
    error, reference_error = external_error(scene, result, best, work)
    satisfied = error <= tolerance
    count.promised, count.satisfied = count.promised + 1, count.satisfied + satisfied
    note = "" if satisfied else "EXCEEDED"
    return [*row, error, reference_error, 1e3 * best.seconds, result.seconds, len(result.tried), note]


@quiet()
def main() -> int:
    """Tune every scene and count."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", nargs="?", type=Path)
    parser.add_argument("--only", default="")
    parser.add_argument("--cases", default=",".join(str(i) for i in range(len(CASES))))
    parser.add_argument("--budget", type=float, default=SECONDS)
    options = parser.parse_args()
    print("scene".ljust(20), *(name.rjust(width) for name, width in zip(HEAD, WIDTHS, strict=True)))
    count = Counts()
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        for item in scene_files(options.folder, work, {name for name in options.only.split(",") if name}):
            for number in map(int, options.cases.split(",")):
                try:
                    row = checked_row(item, number, work, count, options.budget)
                except MechsimError as error:
                    count.promised += 1
                    row = [f"NOT TUNED: {error}"]
                columns = (f"{value:.3g}" if isinstance(value, float) else str(value) for value in row)
                entries = (f"{c:>{w}}" for c, w in zip(columns, (*WIDTHS, 0), strict=False))
                print(item.name.ljust(20), *entries, flush=True)
    print(f"satisfied: {count.satisfied} of {count.promised}; unreachable: {count.unreachable}")
    print(f"searches over {MAX_SECONDS:g} s: {count.slow}")
    return int(count.satisfied < count.promised or bool(count.slow))


if __name__ == "__main__":
    sys.exit(main())
