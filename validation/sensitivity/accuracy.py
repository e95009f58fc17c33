"""Errors of exact derivatives by dimensions: against 50 digits, and against neighbouring mechanisms.

Prints, for each mechanism, the largest error of positions and of velocities by any dimension, relative to
the largest derivative by that dimension. Differences are of eighth order, with the step that agrees best.

Run: python validation/sensitivity/accuracy.py
"""

import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from mpmath import mp

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))
from exact_solutions import DIGITS, four_bar_b_place, rssr_p3_place, slider_crank_b_place

from mechsim.analytic import catalog
from mechsim.analytic.derivatives.dimensions import EIGHTH, changes, own_designs
from mechsim.analytic.derivatives.motion import followed_motion, motion_derivatives
from mechsim.errors import MechsimError
from mechsim.subjects import gallery
from mechsim.subjects.readers import parametric_model

EXACT = {
    "rssr": ("P3", rssr_p3_place),
    "four_bar": ("B", four_bar_b_place),
    "slider_crank": ("B", slider_crank_b_place),
}
ANGLES = np.array([0.3, 1.1, 2.9, 4.4, 5.6])
# largest derivative, in SI units, that counts as zero
NEGLIGIBLE = 1e-9
# steps of differences relative to the dimension, as powers of two
STEPS = (-9, -11, -13, -15)


def exact_derivatives(exact_position, mechanism, name, angle):
    """Return the derivatives of position and velocity by a dimension at unit speed, from 50 digits."""
    dimension, _, axis = name.partition(".")

    def position(value, angle_value):
        dimensions = {item: getattr(mechanism, item) for item in mechanism.__dataclass_fields__}
        dimensions[dimension] = value
        if axis:
            dimensions[dimension] = list(getattr(mechanism, dimension))
            dimensions[dimension]["xyz".index(axis)] = value
        return exact_position(SimpleNamespace(**dimensions), angle_value)

    with mp.workdps(DIGITS):
        initial = getattr(mechanism, dimension)
        point = mp.mpf(initial["xyz".index(axis)] if axis else initial), mp.mpf(float(angle))
        return [
            np.array([float(mp.diff(lambda v, t, i=i: position(v, t)[i], point, (1, k))) for i in range(3)])
            for k in (0, 1)
        ]


def compare_with_digits():
    """Print the errors against 50 digits."""
    for name, (point, exact_position) in EXACT.items():
        mechanism = catalog.make(name)
        designs = own_designs(mechanism)
        result = motion_derivatives(mechanism, changes(designs, [*designs.dimensions]), ANGLES)
        worst = [0.0, 0.0]
        for dimension, derivatives in result.by.items():
            computed = derivatives.points[point].position, derivatives.points[point].velocity
            exact = [exact_derivatives(exact_position, mechanism, dimension, angle) for angle in ANGLES]
            for k in (0, 1):
                reference = np.array([item[k] for item in exact])
                scale = np.abs(reference).max()
                if scale > NEGLIGIBLE:
                    worst[k] = max(worst[k], float(np.abs(computed[k] - reference).max() / scale))
        print(f"{name:22s} 50 digits   positions {worst[0]:.1e}  velocities {worst[1]:.1e}")


def difference_quotients(designs, motion, dimension, quantity):
    """Yield derivatives of points by differences of eighth order, with decreasing steps."""
    value = designs.dimensions[dimension].value
    for power in STEPS:
        step = 2.0**power * (abs(value) or 1.0)
        try:
            pairs = [
                [
                    motion.with_dimensions(designs.describe({dimension: value + s * k * step})).motion()
                    for s in (1, -1)
                ]
                for k in (1, 2, 3, 4)
            ]
        except MechsimError:
            continue
        yield {
            point: sum(
                weight * (getattr(a.points[point], quantity) - getattr(b.points[point], quantity))
                for weight, (a, b) in zip(EIGHTH, pairs, strict=True)
            )
            / step
            for point in motion.solver.mechanism.points
        }


def compare_with_neighbours(name):
    """Return the largest relative errors of positions and velocities against neighbouring mechanisms."""
    designs = parametric_model(name)
    solver = designs.make({})
    if not solver.mechanism.has_crank and solver.motion_laws.crank:
        amplitudes = {
            item: "5mm" if solver.mechanism.unit(item) == "m" else "5deg" for item in solver.mechanism.drivers
        }
        designs = parametric_model(
            name, drive={item: f"{amplitude}*sin(2*pi*t)" for item, amplitude in amplitudes.items()}
        )
        solver = designs.make({})
    motion_laws = solver.motion_laws
    angles = (
        solver.mechanism.start + 0.4 * ANGLES / ANGLES[-1]
        if motion_laws.crank
        else motion_laws.rate * ANGLES / 40.0
    )
    rate = 1.0 if motion_laws.crank else motion_laws.rate
    result = motion_derivatives(solver, changes(designs, [*designs.dimensions]), angles, rate)
    motion = followed_motion(solver, angles, rate)
    worst = [0.0, 0.0]
    for dimension, derivatives in result.by.items():
        for i, quantity in enumerate(("position", "velocity")):
            scale = max(np.abs(getattr(item, quantity)).max() for item in derivatives.points.values())
            if scale > NEGLIGIBLE:
                quotients = [
                    np.array([*item.values()])
                    for item in difference_quotients(designs, motion, dimension, quantity)
                ]
                computed = np.array([getattr(item, quantity) for item in derivatives.points.values()])
                # the step that agrees best with the next one
                closest = min(
                    range(len(quotients) - 1), key=lambda k: np.abs(quotients[k + 1] - quotients[k]).max()
                )
                worst[i] = max(worst[i], float(np.abs(computed - quotients[closest]).max() / scale))
    return len(result.by), worst


def main():
    compare_with_digits()
    all_names = (*catalog.MECHANISMS, *(item for item in gallery.files() if item not in catalog.MECHANISMS))
    for name in sys.argv[1:] or all_names:
        try:
            count, worst = compare_with_neighbours(name)
        except MechsimError as error:
            print(f"{name:22s} {error}")
            continue
        print(
            f"{name:22s} {count:2d} dimensions, neighbours   positions {worst[0]:.1e}  "
            f"velocities {worst[1]:.1e}"
        )


if __name__ == "__main__":
    main()
