"""Balancing by counterweights: where two of them make a four-bar shake its frame least.

The shaking force of a four-bar can be made zero at every instant by counterweights on crank and rocker: the
centre of all masses then stands still (R. S. Berkof and G. G. Lowen, A new method for completely force
balancing simple linkages, ASME J. Eng. Ind. 91 (1969) 21-26). The search finds it from the force alone.

Run: python examples/design/counterweights.py
"""

from pathlib import Path

import numpy as np

import mechsim as ms
from mechsim.studies.optimise import Goal, Optimum

MODEL = str(Path(__file__).with_name("counterweights.toml"))
CRANK_ANGLES = np.linspace(0.0, 2.0 * np.pi, 13)
VARY = dict.fromkeys(("crank_x", "crank_y", "rocker_x", "rocker_y"), (-0.1, 0.1))
SHAKING = Goal(
    ("frame.fx", "frame.fy"), lambda values: np.concatenate([values["frame.fx"], values["frame.fy"]])
)


def search() -> Optimum:
    start = ms.moved(MODEL, angles=CRANK_ANGLES, speed=ms.units.rpm(600), forces=ms.Forces())
    return ms.optimise(start, VARY, SHAKING)


if __name__ == "__main__":
    best = search()
    print(
        f"{best.outcome}: {', '.join(f'{name} {1e3 * value:.3f} mm' for name, value in best.values.items())}"
    )
    print(f"shaking force {best.before:.3g} N before, {best.after:.3g} N now, root mean square")
