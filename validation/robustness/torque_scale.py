"""Error of the drive torque of a stepped run, relative to the torque and to the forces that balance in it.

The script prints for catalogue and gallery, at 1,000 steps a revolution: the root mean square of the torque
relative to the largest force times the size, and the largest error relative to each. The
tolerance of the verdict is 1e-6 of the torque. Then it prints the same for a parallelogram with a third crank
1 mm and 0.1 mm off the line of pivots, and the largest root mean square of a joint force in [N].

With --cost: processor time of a run whose forces are read once, and as often as by default.

Run: python validation/robustness/torque_scale.py [--cost] [NAME ...]
"""

import sys
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))
from mechanisms import three_cranks

from mechsim import catalog, dynamics, load
from mechsim.compare.quantities import force_scales
from mechsim.errors import MechsimError
from mechsim.io import gallery
from mechsim.kinetics import dynamic_model, prescribed
from mechsim.kinetics.model import DynamicModel
from mechsim.mechanism.forces import Forces
from mechsim.mechanism.motion_laws import within_range
from mechsim.simulation.dynamics import applied_forces
from mechsim.simulation.dynamics.prescribed_motion import HARD, driven

SPEED = 20.0 * np.pi
ROUNDS = 15


def main() -> None:
    """Print a row for each mechanism."""
    if "--cost" in sys.argv:
        for name in sys.argv[2:] or ["rssr"]:
            cost(name)
        return
    print(f"{'':20s}{'torque / F size':>16s}{'error / torque':>16s}{'error / F size':>16s}")
    for name in sys.argv[1:] or [*catalog.MECHANISMS, *gallery.files()]:
        solver = load(name)
        motion: dict[str, Any] = {"motion_laws": solver.motion_laws}
        if solver.motion_laws.crank:
            motion = {"profile": within_range(solver.mechanism, solver.crank_range(), SPEED)}
        print_row(name, dynamic_model(solver), motion)
    if sys.argv[1:]:
        return
    for offset in (1e-3, 1e-4):
        model = dynamics.dynamic_model(
            three_cranks((0.047, offset), start=0.0), Forces(gravity=(0.4, -9.81, 0.0))
        )
        force = print_row(f"cranks, {1e3 * offset:g} mm off", model, {"speed": SPEED})
        print(f"{'':20s}force {force:.3g} N")


def print_row(name: str, model: DynamicModel, motion_options: dict[str, Any]) -> float:
    """Print the row of a mechanism; return the scale of its forces in [N]."""
    try:
        run = driven(model.mechanism, model.forces, method="step", settings=HARD, **motion_options)
    except MechsimError as error:
        print(f"{name:20s}{error}")
        return np.nan
    motion = run.motion
    state = (motion.angle, motion.speed, motion.acceleration)
    exact = prescribed(model, *state, time=motion.time, as_run=motion).forces
    scales = force_scales(exact)
    error = float(np.abs(np.where(exact.unbounded, 0.0, run.forces.torque - exact.torque)).max())
    ratios = scales["torque"] / scales["moment"], error / scales["torque"], error / scales["moment"]
    print(f"{name:20s}" + "".join(f"{ratio:16.1e}" for ratio in ratios))
    return float(scales["force"])


def cost(name: str) -> None:
    """Print the processor time of a stepped revolution by number of readings, the best of several rounds."""
    model, default = dynamic_model(load(name)), applied_forces.PASSES
    best = dict.fromkeys((1, default), np.inf)
    for _ in range(ROUNDS):
        for passes in best:
            applied_forces.PASSES = passes
            start = process_time()
            driven(model.mechanism, model.forces, speed=SPEED, method="step")
            best[passes] = min(best[passes], process_time() - start)
    print(f"{name}: " + ", ".join(f"read {n} times {1e3 * best[n]:.1f} ms" for n in best))


if __name__ == "__main__":
    main()
