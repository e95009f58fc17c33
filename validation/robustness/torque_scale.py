"""What the drive torque of a stepped run is off by, beside itself and beside the forces that balance in it.

For every mechanism of the catalogue and the gallery at 1,000 steps a turn: root mean square of the torque as
a part of the largest force times the size, and the largest error as a part of either; the verdict's bound is
1e-6 of the torque. Then for a parallelogram with a third crank 1 mm and 0.1 mm beside the line of pivots, and
the largest root mean square of a joint's force in [N].

With --cost instead: processor time of a run whose forces are read once and as often as they are, in turn.

Run: python validation/robustness/torque_scale.py [--cost] [NAME ...]
"""

import sys
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))
from mechanisms import three_cranks

from mechsim import load
from mechsim.analytic import catalog, dynamics
from mechsim.analytic.dynamics import prescribed
from mechsim.analytic.dynamics.model import DynamicModel
from mechsim.errors import MechsimError
from mechsim.model.forces import Forces
from mechsim.model.motion_laws import within_range
from mechsim.simulation.dynamics import applied_forces
from mechsim.simulation.dynamics.prescribed_motion import HARD, driven
from mechsim.studies.reference import weighing
from mechsim.subjects import gallery
from mechsim.verdict.quantities import force_scales

SPEED = 20.0 * np.pi
ROUNDS = 15


def main() -> None:
    """Print a line for each mechanism."""
    if "--cost" in sys.argv:
        for name in sys.argv[2:] or ["rssr"]:
            cost(name)
        return
    print(f"{'':20s}{'torque / F size':>16s}{'error / torque':>16s}{'error / F size':>16s}")
    for name in sys.argv[1:] or [*catalog.DRIVES, *gallery.files()]:
        form = load(name)
        moved: dict[str, Any] = {"motion_laws": form.motion_laws}
        if form.motion_laws.crank:
            moved = {"profile": within_range(form.mechanism, form.crank_range(), SPEED)}
        tell(name, weighing(form), moved)
    if sys.argv[1:]:
        return
    for aside in (1e-3, 1e-4):
        machine = dynamics.dynamic_model(
            three_cranks((0.047, aside), start=0.0), Forces(gravity=(0.4, -9.81, 0.0))
        )
        force = tell(f"cranks, {1e3 * aside:g} mm aside", machine, {"speed": SPEED})
        print(f"{'':20s}force {force:.3g} N")


def tell(name: str, machine: DynamicModel, moved: dict[str, Any]) -> float:
    """Print the line of a mechanism; return the scale of its forces in [N]."""
    try:
        run = driven(machine.mechanism, machine.forces, method="step", settings=HARD, **moved)
    except MechsimError as error:
        print(f"{name:20s}{error}")
        return np.nan
    motion = run.motion
    at = (motion.angle, motion.speed, motion.acceleration)
    exact = prescribed(machine, *at, time=motion.time, as_run=motion).forces
    scales = force_scales(exact)
    error = float(np.abs(np.where(exact.unbounded, 0.0, run.forces.torque - exact.torque)).max())
    parts = scales["torque"] / scales["moment"], error / scales["torque"], error / scales["moment"]
    print(f"{name:20s}" + "".join(f"{part:16.1e}" for part in parts))
    return float(scales["force"])


def cost(name: str) -> None:
    """Print what reading forces several times costs of a stepped turn, the best of rounds."""
    machine, usual = weighing(load(name)), applied_forces.PASSES
    best = dict.fromkeys((1, usual), np.inf)
    for _ in range(ROUNDS):
        for passes in best:
            applied_forces.PASSES = passes
            start = process_time()
            driven(machine.mechanism, machine.forces, speed=SPEED, method="step")
            best[passes] = min(best[passes], process_time() - start)
    print(f"{name}: " + ", ".join(f"read {n} times {1e3 * best[n]:.1f} ms" for n in best))


if __name__ == "__main__":
    main()
