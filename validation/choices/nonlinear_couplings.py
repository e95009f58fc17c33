"""Stepped runs with polynomial couplings: forces from stepped states and from closed ones; free cranks.

Prints the largest difference from the analytic dynamics over 20 instants, as a fraction of the scale of the
verdict, by steps a turn; and that of a free crank's angle in rad.

Run: python validation/choices/nonlinear_couplings.py
"""

import sys
from pathlib import Path
from unittest import mock

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))
import driven_mechanisms as machines
import numpy as np

from mechsim.analytic import dynamics
from mechsim.analytic.dynamics.model import DynamicModel
from mechsim.analytic.loops.loop_form import LoopForm
from mechsim.model.forces import Forces
from mechsim.model.motion_laws import make_motion_laws
from mechsim.simulation import Settings
from mechsim.simulation.dynamics import inverse_dynamics
from mechsim.simulation.dynamics.forward_run import stepped_run
from mechsim.simulation.dynamics.prescribed_motion import driven
from mechsim.studies.dynamics_check import crosscheck_driven

STEPS, FREE_STEPS = (250, 1000, 4000), (125, 250, 500, 1000)
ARMS = {"left": machines.sinusoidal(2.0, 0.3, 6.0, 0.2), "right": machines.sinusoidal(1.0, 0.4, 9.0, 1.0)}
CASES = {
    "rack on the driven pinion": (
        machines.nonlinear_rack(),
        {"crank": machines.sinusoidal(0.3, 1.0, 2.0)},
        2.0,
    ),
    "passive joint of a five-bar": (machines.five_bar_with_cam(), ARMS, 1.0),
}
# what is judged -> its quantities, and which fraction of the scale its bound is
KINDS = {
    "drive torque": (("drive torque",), 1e-6),
    "forces": (("driver effort", "gear torque", "force", "moment"), 1e-5),
    "energies": (("kinetic energy", "potential energy"), 1e-8),
}


def errors(model: DynamicModel, steps: int) -> dict[str, float]:
    """Return kind of effort -> its largest error, as a fraction of its scale."""
    run = driven(
        model.mechanism,
        model.forces,
        motion_laws=model.solver.motion_laws,
        method="step",
        settings=Settings(steps_per_turn=steps),
        samples=20,
    )
    checks = crosscheck_driven(run, model).checks
    return {
        what: max(component * check.worst / check.tolerance for check in checks if check.kind in kinds)
        for what, (kinds, component) in KINDS.items()
    }


def running_free(steps: int) -> float:
    """Return the largest error of a free crank's angle in [rad], of a four-bar whose rocker bends a slide."""
    model = dynamics.dynamic_model(machines.nonlinear_rocker(), Forces(gravity=(0.3, -9.81, 0.0)))
    name, duration = model.mechanism.crank.name, 0.08
    exact = dynamics.free_run(model, speed=40.0, duration=duration, samples=41)
    substeps = max(1, round(steps * 40.0 * duration / (2.0 * np.pi) / 40))
    start = {name: float(exact.angle[0])}, {name: 40.0}
    run = stepped_run(model.mechanism, model.forces, *start, exact.time, substeps)
    return float(np.abs(run.motion.angle - exact.angle).max())


def main() -> None:
    """Print the tables."""
    print(f"{'':56s}" + "".join(f"{steps:>12,}" for steps in FREE_STEPS))
    print(f"{'angle of a free crank':56s}" + "".join(f"{running_free(steps):12.1e}" for steps in FREE_STEPS))
    print(f"{'':30s}{'':16s}" + "".join(f"{steps:>12,}" for steps in STEPS))
    for name, (mechanism, states, duration) in CASES.items():
        solver = LoopForm(mechanism, motion_laws=make_motion_laws(mechanism, states, duration))
        model = dynamics.dynamic_model(solver, Forces(gravity=(0.0, -9.81, 0.0)))
        stepped = mock.patch.object(inverse_dynamics, "_straightened", lambda _, states: states)
        closed = {steps: errors(model, steps) for steps in STEPS}
        with stepped:
            open_ = {steps: errors(model, steps) for steps in STEPS}
        for route, result in (("closed", closed), ("as stepped", open_)):
            for what in KINDS:
                row = "".join(f"{result[steps][what]:12.1e}" for steps in STEPS)
                print(f"{name:30s}{route + ', ' + what:26s}{row}")


if __name__ == "__main__":
    main()
