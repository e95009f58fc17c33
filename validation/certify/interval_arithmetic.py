"""Arithmetics for certificates, by time and width: balls in numpy, intervals by nextafter, python-flint.

The task is the product of 6 rotations about two axes, at 500 boxes of half-width 1e-3 and at 500 points.
python-flint is optional: `pip install python-flint`.
"""

import time

import numpy as np

from mechsim.numerics.balls import Ball

BOXES, LINKS, REPEAT = 500, 6, 5
INCLINED = np.array([[1.0, 0.0, 0.0], [0.0, 0.6, -0.8], [0.0, 0.8, 0.6]])


def by_balls(angles, radius):
    """Return the midpoints and radii of products of rotations, (n, 3, 3)."""
    total = Ball(np.eye(3), np.zeros((3, 3)))
    for column in angles.T:
        sine, cosine = Ball(column, np.full(len(column), radius)).sin_cos()
        rotation = Ball(np.zeros((len(column), 3, 3)), np.zeros((len(column), 3, 3)))
        for (i, j), entry in {(0, 0): cosine, (0, 1): -sine, (1, 0): sine, (1, 1): cosine}.items():
            rotation.mid[:, i, j], rotation.rad[:, i, j] = entry.mid, entry.rad
        rotation.mid[:, 2, 2] = 1.0
        total = total @ rotation @ INCLINED
    return total.mid, total.rad


def widened(low, high):
    return np.nextafter(low, -np.inf), np.nextafter(high, np.inf)


def interval_product(a, b):
    """Return products of intervals from the four products of their bounds."""
    products = [x * y for x in a for y in b]
    return widened(np.minimum.reduce(products), np.maximum.reduce(products))


def matrix_product(a, b):
    low, high = interval_product(tuple(x[:, :, :, None] for x in a), tuple(y[:, None] for y in b))
    total = low[:, :, 0], high[:, :, 0]
    for k in (1, 2):
        total = widened(total[0] + low[:, :, k], total[1] + high[:, :, k])
    return total


def by_nextafter(angles, radius):
    """Return midpoints and radii by intervals with nextafter; sines come from the balls."""
    n = len(angles)
    inclined = (np.broadcast_to(INCLINED, (n, 3, 3)),) * 2
    total = (np.broadcast_to(np.eye(3), (n, 3, 3)),) * 2
    for column in angles.T:
        rotation = np.zeros((n, 3, 3)), np.zeros((n, 3, 3))
        sine, cosine = Ball(column, np.full(n, radius)).sin_cos()
        for (i, j), entry in {(0, 0): cosine, (0, 1): -sine, (1, 0): sine, (1, 1): cosine}.items():
            rotation[0][:, i, j], rotation[1][:, i, j] = widened(entry.mid - entry.rad, entry.mid + entry.rad)
        for limit in rotation:
            limit[:, 2, 2] = 1.0
        total = matrix_product(matrix_product(total, rotation), inclined)
    return 0.5 * (total[0] + total[1]), 0.5 * (total[1] - total[0])


def by_flint(angles, radius):
    """Return midpoints and radii by python-flint with 53 bits, box by box."""
    import flint

    inclined, mids, rads = flint.arb_mat(INCLINED.tolist()), [], []
    for row in angles.tolist():
        total = flint.arb_mat([[1, 0, 0], [0, 1, 0], [0, 0, 1]])
        for angle in row:
            sine, cosine = flint.arb(angle, radius).sin_cos()
            total = total * flint.arb_mat([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]]) * inclined
        mids.append([[float(x.mid()) for x in line] for line in total.tolist()])
        rads.append([[float(x.rad()) for x in line] for line in total.tolist()])
    return np.array(mids), np.array(rads)


def main():
    angles = np.random.default_rng(0).uniform(-np.pi, np.pi, (BOXES, LINKS))
    reference = by_balls(angles, 1e-3)
    for name, method in (("balls", by_balls), ("nextafter", by_nextafter), ("python-flint", by_flint)):
        try:
            best = np.inf
            for _ in range(REPEAT):
                start = time.perf_counter()
                mid, rad = method(angles, 1e-3)
                best = min(best, time.perf_counter() - start)
        except ImportError:
            print(f"{name:12s} is not installed")
            continue
        assert (np.abs(mid - reference[0]) <= rad + reference[1]).all()
        points = method(angles, 0.0)[1]
        print(
            f"{name:12s} {best / BOXES * 1e6:7.2f} us a box, mean radius {rad.mean():.3e} of boxes, "
            f"{points.mean():.1e} of points"
        )


if __name__ == "__main__":
    main()
