"""Cost of the measures of a sweep and of the quantities of a solved motion, relative to positions.

A sweep measures `DESIGNS` designs at 72 angles; a motion has `INSTANTS` instants. The time is processor time,
without the import of libraries. Ends with 1 if a measure or quantity without a reason below costs more than
`LIMIT` times as much as the first one of its mechanism.

Run: OPENBLAS_NUM_THREADS=1 python validation/speed/quantity_costs.py
"""

import sys
import time
from collections.abc import Callable

import numpy as np

import mechsim as ms
from mechsim.model.motion import Motion
from mechsim.model.quantities import numeric_quantity
from mechsim.model.quantity import Quantity, record_columns

LIMIT, DESIGNS, INSTANTS, RUNS = 3.0, 200, 20_000, 2
# mechanism -> varied parameter, its lower and upper end in [m], and measures; the first is one of positions
MEASURES = {
    "four_bar": (
        ("crank", 0.029, 0.035),
        "range:rocker stroke:B max:B.v max:B.a max:rocker.a ripple:rocker at:90deg:rocker min:transmission "
        "crank_range dead_centres assemblies max:speed:B max:distance:A,B max:angle:coupler,rocker "
        "max:expr:B.x+B.y max:torque",
    ),
    "rssr": (("crank", 0.012, 0.014), "range:rocker max:rocker.a min:transmission max:angle:ground,rocker"),
    "slider_crank": (("crank", 0.012, 0.014), "max:B.x min:transmission max:angle:ground,rod"),
    "rrsrr": (("crank", 0.029, 0.035), "range:rocker min:transmission"),
    "looper": (("crank", 0.0059, 0.0061), "stroke:E max:E.a min:transmission max:angle:ground,rocker"),
    "warp_knitter": (("crank1", 0.0089, 0.0091), "range:rocker min:transmission"),
    "watt_six_bar": (("crank", 0.021, 0.029), "range:output max:output.a max:angle:ground,output"),
}
QUANTITIES = (
    "B.x",
    "B.v",
    "B.a",
    "rocker",
    "rocker.a",
    "distance:A,B",
    "angle:coupler,rocker",
    "expr:B.x+B.y",
)
# measures of forces: each design has its own equations of motion, which are set up and solved one at a time
REASONS = {"torque": "forces"}


def seconds(work: Callable[..., object], *arguments: object) -> float:
    """Return the least processor time of some calls in [s]."""
    times: list[float] = []
    for _ in range(RUNS):
        start = time.process_time()
        work(*arguments)
        times.append(time.process_time() - start)
    return min(times)


def row(title: str, name: str, cost: float, first: float, count: int) -> bool:
    """Print the cost of a measure or quantity; return whether it is allowed."""
    reason = next((reason for word, reason in REASONS.items() if word in name.split(":")), "")
    print(f"{title:<14} {name:<26} {1e6 * cost / count:9.2f} us {cost / first:7.2f} {reason}", flush=True)
    return bool(reason) or cost <= LIMIT * first


def evaluated(motion: Motion, quantity: Quantity) -> object:
    """Return a quantity of a motion."""
    return quantity.number(record_columns(motion, [quantity]))


def main() -> int:
    allowed = True
    for title, ((parameter, low, high), texts) in MEASURES.items():
        vary, names = {parameter: np.linspace(low, high, DESIGNS)}, texts.split()
        ms.sweep(title, vary, names[:1])
        first = seconds(ms.sweep, title, vary, names[:1])
        for name in names:
            allowed &= row(title, name, seconds(ms.sweep, title, vary, [name]), first, DESIGNS)
    solver = ms.load("four_bar")
    angles = np.linspace(0.0, 6.0, INSTANTS)
    first, motion = seconds(solver.solve, angles), solver.solve(angles)
    for name in QUANTITIES:
        cost = seconds(evaluated, motion, numeric_quantity(name, solver.mechanism))
        allowed &= row("solved motion", name, cost, first, INSTANTS)
    return 0 if allowed else 1


if __name__ == "__main__":
    sys.exit(main())
