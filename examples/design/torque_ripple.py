"""Less torque ripple: lengths of a four-bar that even out what its drive needs at 600 rpm.

The rocker must swing as far as before, and the transmission angle, here that between coupler and rocker, must
stay 40 degrees away from zero and from half a turn: |cos| <= cos 40 deg.

Run: python examples/design/torque_ripple.py
"""

import numpy as np

import mechsim as ms
from mechsim.studies.optimise import Limit, MeasureLimit, Optimum

CRANK_ANGLES = np.linspace(0.0, 2.0 * np.pi, 25)
VARY = {"ground": (0.08, 0.13), "coupler": (0.07, 0.13), "rocker": (0.06, 0.1)}


def search() -> Optimum:
    start = ms.moved("four_bar", angles=CRANK_ANGLES, speed=ms.units.rpm(600))
    swing = float(np.ptp(start.values(["rocker.q"], {})["rocker.q"]))
    limits = [
        MeasureLimit("range:rocker", low=0.95 * swing),
        Limit(
            ("B.q",),
            lambda values: np.cos(values["B.q"]) ** 2,
            high=np.cos(np.deg2rad(40.0)) ** 2,
            name="transmission",
        ),
        Limit(
            (), lambda values: values["ground"] + values["coupler"] + values["rocker"], high=0.3, name="size"
        ),
    ]
    return ms.optimise(start, VARY, "ripple:torque", limits)


if __name__ == "__main__":
    best = search()
    print(
        f"{best.outcome}: {', '.join(f'{name} {1e3 * value:.2f} mm' for name, value in best.values.items())}"
    )
    print(f"ripple {best.before:.3g} N m before, {best.after:.3g} N m now, root mean square; {best.limits}")
