"""How exact derivatives by dimensions are: against 50 digits, and against mechanisms solved next to.

Prints, for each mechanism, the largest error of positions and of velocities, by any dimension, relative to
the largest derivative by that dimension. Differences are of eighth order, over the step that agrees best.

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
from mechsim.analytic.derivatives.dimensions import EIGHTH, catalog_designs, changes
from mechsim.analytic.derivatives.motion import followed_motion, motion_derivatives
from mechsim.errors import MechsimError
from mechsim.subjects import gallery
from mechsim.subjects.readers import parametric_model

EXACT = {
    "rssr": ("P3", rssr_p3_place),
    "four_bar": ("B", four_bar_b_place),
    "slider_crank": ("B", slider_crank_b_place),
}
AT = np.array([0.3, 1.1, 2.9, 4.4, 5.6])
# a derivative this small next to the others is none
NONE = 1e-9
# steps of differences, as powers of two of a dimension
STEPS = (-9, -11, -13, -15)


def exactly(place, drive, name, angle):
    """Position's and velocity's derivative by a dimension at unit speed, from 50 digits."""
    whole, _, axis = name.partition(".")

    def places(value, at):
        own = {item: getattr(drive, item) for item in drive.__dataclass_fields__}
        own[whole] = value
        if axis:
            own[whole] = list(getattr(drive, whole))
            own[whole]["xyz".index(axis)] = value
        return place(SimpleNamespace(**own), at)

    with mp.workdps(DIGITS):
        begin = getattr(drive, whole)
        of = mp.mpf(begin["xyz".index(axis)] if axis else begin), mp.mpf(float(angle))
        return [
            np.array([float(mp.diff(lambda v, t, i=i: places(v, t)[i], of, (1, k))) for i in range(3)])
            for k in (0, 1)
        ]


def against_digits():
    """Print what 50 digits say."""
    for name, (point, place) in EXACT.items():
        drive = catalog.make(name)
        of = catalog_designs(drive)
        result = motion_derivatives(drive, changes(of, [*of.dimensions]), AT)
        worst = [0.0, 0.0]
        for dimension, moved in result.by.items():
            own = moved.points[point].position, moved.points[point].velocity
            exact = [exactly(place, drive, dimension, angle) for angle in AT]
            for k in (0, 1):
                reported = np.array([item[k] for item in exact])
                size = np.abs(reported).max()
                if size > NONE:
                    worst[k] = max(worst[k], float(np.abs(own[k] - reported).max() / size))
        print(f"{name:22s} 50 digits   places {worst[0]:.1e}  velocities {worst[1]:.1e}")


def differences(of, near, dimension, part):
    """Yield derivatives of points by differences of eighth order, over ever shorter steps."""
    value = of.dimensions[dimension].value
    for power in STEPS:
        step = 2.0**power * (abs(value) or 1.0)
        try:
            both = [
                [
                    near.with_dimensions(of.describe({dimension: value + s * k * step})).motion()
                    for s in (1, -1)
                ]
                for k in (1, 2, 3, 4)
            ]
        except MechsimError:
            continue
        yield {
            point: sum(
                weight * (getattr(a.points[point], part) - getattr(b.points[point], part))
                for weight, (a, b) in zip(EIGHTH, both, strict=True)
            )
            / step
            for point in near.solver.mechanism.points
        }


def beside(name):
    """Return the largest relative errors of positions and velocities against mechanisms solved next to."""
    of = parametric_model(name)
    form = of.make({})
    if not form.mechanism.has_crank and form.motion_laws.crank:
        units = {
            item: "5mm" if form.mechanism.unit(item) == "m" else "5deg" for item in form.mechanism.drivers
        }
        of = parametric_model(name, drive={item: f"{far}*sin(2*pi*t)" for item, far in units.items()})
        form = of.make({})
    motion_laws = form.motion_laws
    angles = form.mechanism.start + 0.4 * AT / AT[-1] if motion_laws.crank else motion_laws.rate * AT / 40.0
    rate = 1.0 if motion_laws.crank else motion_laws.rate
    result = motion_derivatives(form, changes(of, [*of.dimensions]), angles, rate)
    near = followed_motion(form, angles, rate)
    worst = [0.0, 0.0]
    for dimension, moved in result.by.items():
        for i, part in enumerate(("position", "velocity")):
            size = max(np.abs(getattr(item, part)).max() for item in moved.points.values())
            if size > NONE:
                reported = [np.array([*item.values()]) for item in differences(of, near, dimension, part)]
                own = np.array([getattr(item, part) for item in moved.points.values()])
                # that of the steps which agree best, as far as they do
                best = min(
                    range(len(reported) - 1), key=lambda k: np.abs(reported[k + 1] - reported[k]).max()
                )
                worst[i] = max(worst[i], float(np.abs(own - reported[best]).max() / size))
    return len(result.by), worst


def main():
    against_digits()
    every = (*catalog.DRIVES, *(item for item in gallery.files() if item not in catalog.DRIVES))
    for name in sys.argv[1:] or every:
        try:
            count, worst = beside(name)
        except MechsimError as error:
            print(f"{name:22s} {error}")
            continue
        print(
            f"{name:22s} {count:2d} dimensions, solved beside   places {worst[0]:.1e}  "
            f"velocities {worst[1]:.1e}"
        )


if __name__ == "__main__":
    main()
