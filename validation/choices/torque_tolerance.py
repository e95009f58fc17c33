"""Is the tolerance of `--tolerance` kept for torque and reactions, and at what price?

Random sound dimensions of all catalogue mechanisms, weight included, 1 to 20,000 rpm, ten turns.

T = 1e-2 to 1e-8 of torque and reactions. The true error is the worst of any instant against the closed form's
dynamics at the angle, speed and acceleration reached.

The price is that of all steps, trials included, over the fewest steps of a ladder that keep T, which a user
could know only by the closed form.

With --ladder instead: torque error against processor time over that ladder, and by solved poses.

Run: python validation/choices/torque_tolerance.py [--count N] [--seed N] [--ladder]
"""

import argparse
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
import study_table as sheet
from random_mechanisms import drives

from mechsim import catalog, dynamics, units
from mechsim.analytic.dynamics import DynamicModel
from mechsim.analytic.solvers import KinematicSolver
from mechsim.model.forces import Forces
from mechsim.simulation import Settings
from mechsim.simulation.dynamics.prescribed_motion import driven
from mechsim.simulation.result import Driven
from mechsim.studies.dynamics_check import crosscheck_driven

TURNS = 10.0
RPM, FRACTION = (1.0, 20_000.0), (1e-2, 1e-8)
STEPS = (48, 72, 96, 144, 192, 288, 384, 576, 768, 1152, 1536, 2304, 3072, 4608, 6144, 9216)
WEIGHT = (0.3, -9.81, 0.5)
TIMED = 5


def true_error(run: Driven, model: DynamicModel) -> float:
    """Return the worst error of torque and reactions, relative as `tolerance` is."""
    kinds = {"drive torque", "force", "moment", "gear torque"}
    checks = [check for check in crosscheck_driven(run, model).checks if check.kind in kinds]
    return max(check.worst / _scale(check.reason) for check in checks)


def _scale(reason: str) -> float:
    """Return what a check's relative bound was a fraction of: '1e-06 of 0.0123 N; ...'."""
    return float(reason.split(" of ")[1].split()[0])


def fewest_steps(satisfies: Callable[[int], bool]) -> int | None:
    """Return the fewest steps of the ladder that keep a tolerance; None if none does."""
    return next((steps for steps in STEPS if satisfies(steps)), None)


def prescribed(closed_form: KinematicSolver, speed: float, fraction: float) -> dict[str, Any]:
    """Return one prescribed run's error, estimate and price."""
    model = dynamics.dynamic_model(closed_form, Forces(gravity=WEIGHT))

    def satisfies(steps: int) -> bool:
        settings = Settings(steps_per_turn=steps)
        run = driven(model.mechanism, model.forces, speed=speed, method="step", settings=settings)
        return true_error(run, model) <= fraction

    run = driven(model.mechanism, model.forces, speed=speed, turns=TURNS, tolerance=fraction)
    assert run.tolerance_report is not None
    least = fewest_steps(satisfies) if run.outcome == "passed" else None
    return _row(closed_form, speed, fraction, run, true_error(run, model), least)


def _row(
    closed_form: KinematicSolver, speed: float, fraction: float, run: Any, error: float, least: int | None
) -> dict[str, Any]:
    return {
        "mechanism": closed_form.name,
        "rpm": speed / units.rpm(1.0),
        "T": fraction,
        "met": run.tolerance_report.satisfied,
        "error/T": error / fraction,
        "estimate/error": run.tolerance_report.estimate / error,
        "order": float(run.tolerance_report.order),
        "steps a turn": run.settings.steps_per_turn,
        "price": (run.steps + run.tolerance_report.trials) / (TURNS * least) if least else float("nan"),
    }


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


def fractions(rows: Sequence[sheet.Row]) -> Iterator[str]:
    """Yield the results of the study, a sentence a line."""
    passed = [row for row in rows if row["met"]]
    error, ratio, price = (
        np.array([row[key] for row in passed]) for key in ("error/T", "estimate/error", "price")
    )
    price = price[np.isfinite(price)]
    yield (
        f"{len(rows)} runs, {len(passed)} report that they met T; of these "
        f"{100.0 * (error <= 1.0).mean():.1f} % are within T, worst {error.max():.2g} T"
    )
    yield (
        f"  estimate over true error: median {np.median(ratio):.3g}, {ratio.min():.3g} to {ratio.max():.3g}"
    )
    yield (
        f"  price: median {np.median(price):.2f}, nine of ten below {np.quantile(price, 0.9):.2f}, "
        f"worst {price.max():.2f}"
    )
    for row in rows:
        if not row["met"]:
            yield f"  missed: {row['mechanism']} T = {row['T']:.1e}, error {row['error/T']:.2g} T"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=35, help="runs")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--ladder", action="store_true")
    options = parser.parse_args()
    if options.ladder:
        sheet.show(list(ladder()))
        return
    rows, begin = [], time.perf_counter()
    random = np.random.default_rng(options.seed)
    for closed_form in drives(random, options.count):
        speed, fraction = (float(np.exp(random.uniform(*np.log(sorted(ends))))) for ends in (RPM, FRACTION))
        rows.append(prescribed(closed_form, units.rpm(speed), fraction))
    sheet.show(rows)
    print(*fractions(rows), f"{time.perf_counter() - begin:.0f} s", sep="\n")


if __name__ == "__main__":
    main()
