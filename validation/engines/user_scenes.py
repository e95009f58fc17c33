"""A user's scenes, as published and as tuned, under each engine that is installed, against the exact closure.

Problem: each scene starts as its first keyframe has it, or as its file has it where there is none, and each
actuator with a range is fed the same constant control: a part of its range. Reference: the closure at the
run's own driver coordinates, from which the worst distance of a body's origin or a loop's end is measured.
They follow from the recorded coordinates by MuJoCo's kinematics in float64: the error is that of stepping.

    python validation/engines/user_scenes.py FILE.xml ... [--duration 0.5] [--part 0.6] [--out DIR]
"""

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "choices"))

import study_table as sheet
from engines import Engine, installed

from mechsim.simulation import mjcf
from mechsim.studies.scene.run import SceneRun
from mechsim.studies.scene.scene import UserScene, scene_of
from mechsim.subjects.mjcf_source import MjcfForm
from mechsim.subjects.readers import load


def scene(path: Path, duration: float) -> UserScene:
    """Return the scene of a file, from its keyframe where it has one."""
    form = load(str(path))
    assert isinstance(form, MjcfForm)
    assert form.source is not None
    model = form.source.spec.copy().compile()
    key = (model.key(0).name or None) if model.nkey else None
    return scene_of(form.source, form.mechanism, duration=duration, key=key)


def row(path: Path, engine: str, run: Engine, asked: argparse.Namespace) -> dict[str, Any]:
    """Return what an engine makes of a scene."""
    here = scene(path, asked.duration)
    model, (qpos, qvel) = here.model, here.start
    steps = round(asked.duration / model.opt.timestep)
    low, high = model.actuator_ctrlrange.T
    ctrl = np.where(model.actuator_ctrllimited, low + asked.part * (high - low), 0.0)
    reported = {"scene": path.stem, "engine": engine, "timestep [ms]": f"{1e3 * model.opt.timestep:.3g}"}
    try:
        states, seconds = run(model, qpos, qvel, steps, ctrl)
    except (ValueError, NotImplementedError, RuntimeError) as error:
        return reported | {
            "error [m]": np.nan,
            "moved [m]": np.nan,
            "ms/s": " ".join(str(error).split())[:60],
        }
    every = max(1, steps // 400)
    time = model.opt.timestep * np.arange(1.0, steps + 1.0)[::every]
    kept = states[::every]
    observed = SceneRun(here, model, time, kept, np.zeros((len(kept), model.nv)), seconds, steps)
    worst = moved = np.inf
    if np.isfinite(states).all():
        worst = float(here.closure.errors(kept, observed.points).max())
        moved = float(np.linalg.norm(observed.points - observed.points[:1], axis=2).max())
    return reported | {
        "error [m]": worst,
        "moved [m]": moved,
        "ms/s": f"{1e3 * seconds / asked.duration:.3g}",
    }


@mjcf.quiet()
def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="+", type=Path)
    parser.add_argument("--duration", type=float, default=0.5, help="of each run in [s]")
    parser.add_argument("--part", type=float, default=0.6, help="of its range that each actuator is fed")
    parser.add_argument("--out", type=Path, default=None, help="folder for the table as CSV")
    asked = parser.parse_args()
    there, missing = installed()
    for line in missing:
        print(line)
    rows = [row(path, engine, run, asked) for path in asked.files for engine, run in there.items()]
    if asked.out is not None:
        asked.out.mkdir(parents=True, exist_ok=True)
    sheet.show(rows, asked.out, "user_scenes")


if __name__ == "__main__":
    main()
