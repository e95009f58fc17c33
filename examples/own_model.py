"""Compare your own MJCF model with your own formula.

The MJCF file needs a hinge called "crank", and a site with the name of each point of the formula. The
formula is any function from crank angles, (n,), to points, name -> (n, 3).

Run: python examples/own_model.py
"""

from pathlib import Path

import numpy as np

import mechsim as ms

HEIGHT, GROUND, CRANK, COUPLER, ROCKER = 0.2, 0.1, 0.04, 0.1, 0.08


def formula(angle: np.ndarray) -> dict[str, np.ndarray]:
    """Return A and B of the four-bar: two circles about A and the rocker's pivot intersect in B."""
    a = CRANK * np.exp(1j * angle)
    to_pivot = GROUND - a
    reach = np.abs(to_pivot)
    at_a = np.arccos((reach**2 + COUPLER**2 - ROCKER**2) / (2.0 * reach * COUPLER))
    b = a + COUPLER * to_pivot / reach * np.exp(1j * at_a)

    def in_space(z: np.ndarray) -> np.ndarray:
        return np.stack([z.real, np.zeros(len(z)), HEIGHT + z.imag], axis=1)

    return {"A": in_space(a), "B": in_space(b)}


def main() -> None:
    path = Path(__file__).with_name("own_model.xml")
    print("against the exact loop closure:", ms.validate(path, against=formula))

    run = ms.simulate(path, speed=ms.units.rpm(300.0), turns=2.0, tolerance=1e-7)
    exact = formula(run.motion.angle)
    worst = max(float(np.abs(run.motion.points[name].position - exact[name]).max()) for name in exact)
    print(f"stepped, {run.steps} steps: points are off by at most {worst:.1e} m")
    assert worst < 1e-7


if __name__ == "__main__":
    main()
