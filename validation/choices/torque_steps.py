"""Error of torque and reactions against processor time, by steps a turn and by solved poses.

Catalogue mechanisms at 60 rad/s, weight included. The true error is the worst of any instant against the
closed form's dynamics at the angle, speed and acceleration reached.

Run: python validation/choices/torque_steps.py
"""

import argparse
from collections.abc import Iterator
from typing import Any

import numpy as np
import study_table as sheet

from mechsim import catalog, dynamics
from mechsim.kinetics import DynamicModel
from mechsim.mechanism.forces import Forces
from mechsim.simulation import Settings
from mechsim.simulation.dynamics.prescribed_motion import driven
from mechsim.simulation.result import Driven
from mechsim.studies.dynamics_check import crosscheck_driven

STEPS = (48, 72, 96, 144, 192, 288, 384, 576, 768, 1152, 1536, 2304, 3072, 4608, 6144, 9216)
WEIGHT = (0.3, -9.81, 0.5)
TIMED = 5


def true_error(run: Driven, model: DynamicModel) -> float:
    """Return the worst error of torque and reactions, relative to the scale of its check."""
    kinds = {"drive torque", "force", "moment", "gear torque"}
    checks = [check for check in crosscheck_driven(run, model).checks if check.kind in kinds]
    return max(check.worst / _scale(check.reason) for check in checks)


def _scale(reason: str) -> float:
    """Return what a check's relative bound was a fraction of: '1e-06 of 0.0123 N; ...'."""
    return float(reason.split(" of ")[1].split()[0])


def ladder() -> Iterator[dict[str, Any]]:
    """Yield torque error against processor time, steps and poses, for each mechanism of the catalogue."""
    for name in catalog.MECHANISMS:
        model = dynamics.dynamic_model(catalog.make(name), Forces(gravity=WEIGHT))
        for steps in (None, *STEPS[::2]):
            options: dict[str, Any] = {"method": "pose", "samples": 72}
            if steps is not None:
                options = {"method": "step", "settings": Settings(steps_per_turn=steps)}
            runs = [driven(model.mechanism, model.forces, speed=60.0, **options) for _ in range(TIMED)]
            exact = dynamics.prescribed(
                model, runs[0].motion.angle, runs[0].motion.speed, runs[0].motion.acceleration
            ).forces
            gap, scale = runs[0].forces.torque - exact.torque, np.sqrt(np.mean(exact.torque**2))
            yield {
                "mechanism": name,
                "steps a turn": steps or "72 poses",
                "ms a turn": 1e3 * float(np.median([run.seconds for run in runs])),
                "torque, RMS": float(np.sqrt(np.mean(gap**2)) / scale),
                "torque, worst": float(np.abs(gap).max() / scale),
                "with reactions": true_error(runs[0], model),
            }


def main() -> None:
    argparse.ArgumentParser(description=__doc__).parse_args()
    sheet.show(list(ladder()))


if __name__ == "__main__":
    main()
