"""What can be left out of public closed-loop scenes: `mechsim reduce` at T = 1e-4 of each scene's size.

Problem: the scenes and motions of reduced_cases.py; a part of each is tracked. Reference: the full scene as
published, in plain MuJoCo, over that motion, over a second one that chose nothing, and from outside over a
third, three quarters as far and at another pace: where actuators are fed both files are stepped by a loop of
`mj_step` that shares nothing with mechsim, at the instants that both have; where joints are prescribed by
mechsim's own steps.

    python validation/choices/reduced_scenes.py FOLDER [--only NAME,..]

FOLDER holds the files; one that is not there is skipped. None lies in this repository. Exits with 1 where a
tolerance is not kept.
"""

import argparse
import sys
import tempfile
from pathlib import Path
from time import process_time

import mujoco
import numpy as np
import study_table as sheet
from numpy.typing import NDArray
from reduced_cases import Case, prepared

from mechsim.simulation.mjcf.compiling import quiet
from mechsim.simulation.mjcf_reader.parsed_file import parse_file
from mechsim.studies.reduction.reduced_scene import ReducedSceneEvaluator, other_motion
from mechsim.studies.reduction.search import reduce_scene
from mechsim.studies.scene.scene import UserScene

Array = NDArray[np.float64]
FRACTION = 1e-4
# the motion from outside: its largest displacement, and how much its speed varies
REACH, UNEVEN = 0.75, 0.2


def outside(scene: UserScene, spec: mujoco.MjSpec, text: str) -> float:
    """Return the distance of a reduced scene from the full one over a third motion, in [m]."""
    evaluator = ReducedSceneEvaluator.from_scene(other_motion(scene, REACH, UNEVEN), spec)
    moved, named, tracked = evaluator.motion, evaluator.named, dict(evaluator.tracked)
    if scene.joint_laws:
        tilt = evaluator.scene(mujoco.MjSpec.from_string(text))
        return evaluator.errors(tilt, compare_forces=False).trajectory
    tilt = mujoco.MjModel.from_xml_string(text)
    step_ratio = round(float(tilt.opt.timestep / named.opt.timestep))
    full, reduced = (_looped(moved, model, tracked) for model in (named, tilt))
    full = full[:: max(1, step_ratio)]
    count = min(len(full), len(reduced))
    return float(np.linalg.norm(full[:count] - reduced[:count], axis=2).max())


def _looped(scene: UserScene, model: mujoco.MjModel, tracked: dict[str, tuple[str, Array]]) -> Array:
    """Return tracked points before each step of a loop that feeds actuators, (n, k, 3) in [m]."""
    data, result = mujoco.MjData(model), list[list[Array]]()
    for _ in range(int(np.ceil(scene.duration / model.opt.timestep - 1e-6))):
        for name, state in scene.ctrl.items():
            data.actuator(name).ctrl[0] = state(np.array([data.time]))[0][0]
        mujoco.mj_kinematics(model, data)
        bodies = [(data.body(body), position) for body, position in tracked.values()]
        result.append([body.xpos + body.xmat.reshape(3, 3) @ position for body, position in bodies])
        mujoco.mj_step(model, data)
    return np.array(result)


def row(name: str, case: Case, folder: Path) -> dict[str, object]:
    """Return what came of a scene."""
    scene, began = case.scene(folder), process_time()
    limit, spec = FRACTION * scene.characteristic_length, parse_file(scene.path)[0]
    result = reduce_scene(scene, spec, limit, keep=case.keep)
    first, second = result.errors
    third = outside(scene, spec, result.text)
    return {
        "scene": name,
        "T": limit,
        "error": first.trajectory,
        "second": second.trajectory,
        "outside": third,
        "effort": max(first.torque, second.torque),
        "ms/s": f"{1e3 * result.time:.3g}",
        "faster": f"{result.speedup:.2f}",
        "s": f"{process_time() - began:.0f}",
        "left out": "; ".join(item.candidate.what for item in result.left_out),
        "kept": "yes" if result.kept(limit) and third <= limit else "NO",
    }


@quiet()
def main() -> int:
    """Reduce every scene and judge it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", default="")
    options = parser.parse_args()
    only, rows = {name for name in options.only.split(",") if name}, list[dict[str, object]]()
    with tempfile.TemporaryDirectory() as path:
        for name, case, folder in prepared(options.folder, Path(path)):
            if not only or name in only:
                rows.append(row(name, case, folder))
                print({key: value for key, value in rows[-1].items() if key != "left out"}, flush=True)
    sheet.show(rows)
    return int(any(item["kept"] == "NO" for item in rows))


if __name__ == "__main__":
    sys.exit(main())
