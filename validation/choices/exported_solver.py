"""Error and cost of the solver settings of exported models, compared with a tolerance of 0.

Problem: every mechanism of the catalogue and the gallery as `mechsim export` writes it, its drivers moved as
in tuned_cases.py; and at level dynamics, falling, without and with dry friction in the crank.
Reference: of errors the loop equations at the run's own drivers; of time the same model with tolerance 0,
with which MuJoCo makes all hundred iterations of a step unless nothing at all changes.

    python validation/choices/exported_solver.py [--only NAME,...]

Exits with 1 where the model as it is exported errs more, or takes longer, than with tolerance 0.
"""

import argparse
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from tuned_cases import scene_files

from mechsim.cli.control_options import ControlOptions, user_scene
from mechsim.cli.options import DriveOptions
from mechsim.model.forces import Forces, Friction
from mechsim.model.scene import Scene
from mechsim.simulation import mjcf
from mechsim.simulation.mjcf.compiling import quiet
from mechsim.simulation.plain_settings import PlainSettings
from mechsim.studies.export import exported
from mechsim.studies.scene.errors import SceneEvaluator
from mechsim.studies.scene.run import run_scene, step_times
from mechsim.subjects.readers import load

SETTINGS = {
    "100, 0": PlainSettings(iterations=100, tolerance=0.0),
    "as exported": PlainSettings(),
    "1, 0": PlainSettings(iterations=1, tolerance=0.0),
    "100, 1e-8": PlainSettings(iterations=100, tolerance=1e-8),
}
# of a run in [s]; rounding relative to the size; significant ratio of times
DURATION, ROUNDING, LONGER = 0.2, 1e-11, 1.1
FALLING = ("four_bar", "rssr", "jansen")


def scenes(work):
    """Yield name and scene."""
    for item in scene_files(None, work, set()):
        yield item.name, user_scene(str(item.path), *item.motion(1.0))
    for name in FALLING:
        mechanism = load(name).mechanism
        for label, friction in (
            ("falling", ()),
            ("dry friction", (Friction(joint=mechanism.crank.name, coulomb=0.1),)),
        ):
            forces = Forces(gravity=(0.0, -9.81, 0.0), friction=friction)
            path = work / f"{name}-{label}.xml"
            path.write_text(mjcf.to_xml(exported(mechanism, Scene(level="dynamics", forces=forces))))
            yield f"{name} {label}", user_scene(str(path), DriveOptions(), ControlOptions())


@quiet()
def main():
    """Print errors and times of every scene."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--only", default="")
    only = {item for item in parser.parse_args().only.split(",") if item}
    print(f"{'iterations, tolerance':22}", *(f"{name:>17}" for name in SETTINGS))
    worse, ratios = [], []
    with tempfile.TemporaryDirectory() as folder:
        for name, scene in scenes(Path(folder)):
            if only and name not in only:
                continue
            scene = replace(scene, duration=DURATION)
            models = [item.applied(scene.model) for item in SETTINGS.values()]
            errors = [SceneEvaluator().errors(run_scene(scene, model)).closure for model in models]
            times = step_times([(scene, model) for model in models])
            ratios.append(times / times[0])
            columns = (f"{error:9.2g} {ratio:7.3f}" for error, ratio in zip(errors, ratios[-1], strict=True))
            print(f"{name:22}", *columns, flush=True)
            exact, own = errors[:2]
            worse += (
                [name]
                if own > exact + ROUNDING * scene.characteristic_length or ratios[-1][1] > LONGER
                else []
            )
    for name, ratio in zip(SETTINGS, np.median(ratios, axis=0), strict=True):
        print(f"time over that of tolerance 0, {name}: {ratio:.3f} in the median")
    print(f"errs more or takes longer: {', '.join(worse) or 'none'}")
    return int(bool(worse))


if __name__ == "__main__":
    sys.exit(main())
