"""A user's scenes, as published and as tuned, under each engine that is installed, against the exact closure.

Problem: each scene starts in its first keyframe, or in its reference configuration if it has none. Each
actuator with a range gets a constant control, the same fraction of its range. Reference: the closure at the
driver coordinates of the run. The error is the largest distance of a body's origin or a loop's end. MuJoCo's
kinematics in float64 computes positions from the recorded coordinates, so the error is that of the stepping.

    python validation/engines/user_scenes.py FILE.xml ... [--duration 0.5] [--fraction 0.6] [--out DIR]
"""

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "choices"))

import study_table
from engines import Engine, installed

from mechsim.simulation import mjcf
from mechsim.studies.scene.run import SceneRun
from mechsim.studies.scene.scene import UserScene, scene_of
from mechsim.subjects.readers import load


def scene(path: Path, duration: float) -> UserScene:
    """Return the scene of a file, at its first keyframe if it has one."""
    subject = load(str(path))
    assert subject.source is not None
    model = subject.source.spec.copy().compile()
    key = (model.key(0).name or None) if model.nkey else None
    return scene_of(subject.source, subject.mechanism, duration=duration, key=key)


def row(path: Path, engine: str, run: Engine, options: argparse.Namespace) -> dict[str, Any]:
    """Return the error and the time of an engine for a scene."""
    user = scene(path, options.duration)
    model, (qpos, qvel) = user.model, user.start
    steps = round(options.duration / model.opt.timestep)
    low, high = model.actuator_ctrlrange.T
    ctrl = np.where(model.actuator_ctrllimited, low + options.fraction * (high - low), 0.0)
    columns = {"scene": path.stem, "engine": engine, "timestep [ms]": f"{1e3 * model.opt.timestep:.3g}"}
    try:
        states, seconds = run(model, qpos, qvel, steps, ctrl)
    except (ValueError, NotImplementedError, RuntimeError) as error:
        return columns | {
            "error [m]": np.nan,
            "moved [m]": np.nan,
            "ms/s": " ".join(str(error).split())[:60],
        }
    interval = max(1, steps // 400)
    time = model.opt.timestep * np.arange(1.0, steps + 1.0)[::interval]
    recorded = states[::interval]
    scene_run = SceneRun(user, model, time, recorded, np.zeros((len(recorded), model.nv)), seconds, steps)
    worst = moved = np.inf
    if np.isfinite(states).all():
        worst = float(user.closure.errors(recorded, scene_run.points).max())
        moved = float(np.linalg.norm(scene_run.points - scene_run.points[:1], axis=2).max())
    return columns | {
        "error [m]": worst,
        "moved [m]": moved,
        "ms/s": f"{1e3 * seconds / options.duration:.3g}",
    }


@mjcf.quiet()
def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="+", type=Path)
    parser.add_argument("--duration", type=float, default=0.5, help="of each run in [s]")
    parser.add_argument("--fraction", type=float, default=0.6, help="of its range, control of an actuator")
    parser.add_argument("--out", type=Path, default=None, help="folder for the table as CSV")
    options = parser.parse_args()
    engines, messages = installed()
    for message in messages:
        print(message)
    rows = [row(path, engine, run, options) for path in options.files for engine, run in engines.items()]
    if options.out is not None:
        options.out.mkdir(parents=True, exist_ok=True)
    study_table.show(rows, options.out, "user_scenes")


if __name__ == "__main__":
    main()
