"""Assembly modes of 10,000 random class III triads, by the sextic and by coupler curves.

The second method is independent of the first. Without the third leg the triad is a four-bar A-B-C-D,
whose coupler point K moves on closed curves; the triad closes where the distance of K from the third pivot
is the leg length. The script samples the curves densely, bisects sign changes and refines every extremum
between samples, which detects pairs of close roots. If the methods disagree, the roots of the sextic in 60
digits (mpmath) decide.

Run: python validation/papers/triad.py [count] (exit code 1 if an assembly is missed or
invented by the sextic).
"""

import sys
import time

import mpmath as mp
import numpy as np
from numpy.typing import NDArray

from mechsim.kinematics.vector_method import triad

Array = NDArray[np.float64]
SAMPLES = 720
# error of a pose by bisection near the ends of a coupler curve: square root of rounding
POSE_TOLERANCE = 1e-6


def random_triads(count: int, seed: int = 20) -> tuple[Array, Array, Array]:
    """Return pivots (n, 3, 2), platform points (n, 3, 2) and legs (n, 3) of order one.

    Half of them have legs that fit a pose of the platform, because random legs rarely close.
    """
    rng = np.random.default_rng(seed)
    pivots, platform = rng.uniform(-1.0, 1.0, (2, count, 3, 2))
    legs = rng.uniform(0.05, 1.5, (count, 3))
    position, theta = rng.uniform(-0.5, 0.5, (count, 2)), rng.uniform(0.0, 2.0 * np.pi, count)
    rotation = np.stack([np.cos(theta), -np.sin(theta), np.sin(theta), np.cos(theta)], -1).reshape(-1, 2, 2)
    fitting = position[:, None] + platform @ np.swapaxes(rotation, 1, 2) - pivots
    legs[::2] = np.sqrt((fitting**2).sum(-1))[::2]
    return pivots, platform, legs


class CouplerCurves:
    """The coupler curves of the four-bars without the third legs; two per triad.

    The parameter of a curve is t in [0, 2 pi). If the first leg rotates fully, t is its angle, and the two
    curves are the two assembly modes. Otherwise the leg swings with sin t, and the sign of cos t is the
    assembly mode, so that the curve is smooth at its ends.
    """

    def __init__(self, pivots: Array, platform: Array, legs: Array):
        """Take n triads."""
        self.a, self.d, self.e = (pivots @ np.array([1.0, 1j])).T
        b, c, k = (platform @ np.array([1.0, 1j])).T
        self.c, self.k = c - b, k - b
        self.b0 = b
        self.r1, self.r2, self.r3 = legs.T
        base, coupler = abs(self.a - self.d), abs(self.c)
        low = ((coupler - self.r2) ** 2 - base**2 - self.r1**2) / (2.0 * self.r1 * base)
        high = ((coupler + self.r2) ** 2 - base**2 - self.r1**2) / (2.0 * self.r1 * base)
        self.exists = (low <= 1.0) & (high >= -1.0)
        inner, outer = (np.arccos(np.clip(x, -1.0, 1.0)) for x in (high, low))
        self.full = (high >= 1.0) & (low <= -1.0)
        one_end_free = self.full | (high >= 1.0) | (low <= -1.0)
        around_zero, around_pi = (high >= 1.0) & (low > -1.0), (low <= -1.0) & (high < 1.0)
        self.middle = np.select([around_zero, around_pi], [0.0, np.pi], (inner + outer) / 2.0)
        self.half_swing = np.select([around_zero, around_pi], [outer, np.pi - inner], (outer - inner) / 2.0)
        self.curves = np.where(self.exists, np.where(one_end_free & ~self.full, 1, 2), 0)

    def pose(self, i: NDArray[np.intp], curve: NDArray[np.intp], t: Array) -> tuple[Array, Array]:
        """Return the position of B and the rotation of the platform for triad i on a curve at parameter t."""
        side = np.where(curve == 0, 1.0, -1.0)
        swing = np.where(self.full[i], t, side * (self.middle[i] + self.half_swing[i] * np.sin(t)))
        branch = np.where(self.full[i], side, np.where(np.cos(t) >= 0.0, 1.0, -1.0))
        back = self.a[i] - self.d[i]
        b = self.a[i] + self.r1[i] * back / abs(back) * np.exp(1j * swing)
        gap = self.d[i] - b
        coupler, reach = abs(self.c[i]), abs(gap)
        cosine = (coupler**2 + reach**2 - self.r2[i] ** 2) / (2.0 * coupler * reach)
        sine = branch * np.sqrt(np.maximum((1.0 - cosine) * (1.0 + cosine), 0.0))
        rotation = coupler * gap / reach * (cosine + 1j * sine) / self.c[i]
        return b, rotation

    def length_error(self, i: NDArray[np.intp], curve: NDArray[np.intp], t: Array) -> Array:
        """Return the squared distance of K from the third pivot, less the squared length of the leg."""
        b, rotation = self.pose(i, curve, t)
        return abs(b + rotation * self.k[i] - self.e[i]) ** 2 - self.r3[i] ** 2

    def roots(self, samples: int = SAMPLES) -> list[Array]:
        """Return the poses (x, y, theta) of each triad, a list of (m, 3)."""
        n = len(self.a)
        t = 2.0 * np.pi * np.arange(samples) / samples
        result: list[list[Array]] = [[] for _ in range(n)]
        for start in range(0, n, 250):
            i, curve = (x.ravel() for x in np.meshgrid(np.arange(start, min(start + 250, n)), [0, 1]))
            real = curve < self.curves[i]
            i, curve = i[real], curve[real]
            value = self.length_error(i[:, None], curve[:, None], t)
            after, before = np.roll(value, -1, 1), np.roll(value, 1, 1)
            row, column = np.nonzero((value < 0.0) != (after < 0.0))
            brackets = [(row, t[column], t[column] + t[1])]
            turning = (abs(value) <= abs(after)) & (abs(value) <= abs(before))
            turning &= ((value < 0.0) == (after < 0.0)) & ((value < 0.0) == (before < 0.0))
            row, column = np.nonzero(turning)
            extremum = self._extremum(i[row], curve[row], t[column] - t[1], t[column] + t[1])
            crossed = (self.length_error(i[row], curve[row], extremum) < 0.0) != (value[row, column] < 0.0)
            row, column, extremum = row[crossed], column[crossed], extremum[crossed]
            brackets += [(row, t[column] - t[1], extremum), (row, extremum, t[column] + t[1])]
            row, low, high = (np.concatenate(item) for item in zip(*brackets, strict=True))
            position, rotation = self.pose(i[row], curve[row], self._bisect(i[row], curve[row], low, high))
            position = position - rotation * self.b0[i[row]]
            for j, x, z in zip(i[row], position, rotation, strict=True):
                result[j].append(np.array([x.real, x.imag, np.angle(z)]))
        return [np.array(poses).reshape(-1, 3) for poses in result]

    def _bisect(self, i: NDArray[np.intp], curve: NDArray[np.intp], low: Array, high: Array) -> Array:
        below = self.length_error(i, curve, low) < 0.0
        for _ in range(52):
            middle = (low + high) / 2.0
            same = (self.length_error(i, curve, middle) < 0.0) == below
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        return (low + high) / 2.0

    def _extremum(self, i: NDArray[np.intp], curve: NDArray[np.intp], low: Array, high: Array) -> Array:
        """Return the minimum of |length error| by golden section; a change of sign counts as smaller."""
        sign = np.where(self.length_error(i, curve, (low + high) / 2.0) < 0.0, -1.0, 1.0)
        golden = (np.sqrt(5.0) - 1.0) / 2.0
        for _ in range(40):
            lower_point, upper_point = high - golden * (high - low), low + golden * (high - low)
            lower = sign * self.length_error(i, curve, lower_point) < sign * self.length_error(
                i, curve, upper_point
            )
            low, high = np.where(lower, low, lower_point), np.where(lower, upper_point, high)
        return (low + high) / 2.0


def exact_count(pivots: Array, platform: Array, legs: Array) -> int:
    """Return the number of roots of the sextic on the unit circle, with 60 digits."""
    with mp.workdps(60):
        a, b = ([mp.mpc(*map(float, p)) for p in points] for points in (pivots, platform))
        r = [mp.mpf(float(x)) for x in legs]

        def value(z: mp.mpc) -> mp.mpf:
            u, w = z * (b[1] - b[0]) - (a[1] - a[0]), z * (b[2] - b[0]) - (a[2] - a[0])
            e = r[1] ** 2 - r[0] ** 2 - abs(u) ** 2
            f = r[2] ** 2 - r[0] ** 2 - abs(w) ** 2
            return abs(f * u - e * w) ** 2 - 4 * r[0] ** 2 * mp.im(mp.conj(u) * w) ** 2

        values = [value(mp.expjpi(mp.mpf(2 * k) / 7)) for k in range(7)]
        coefficients = [
            sum(values[k] * mp.expjpi(mp.mpf(-2 * k * h) / 7) for k in range(7)) / 7 for h in range(-3, 4)
        ]
        companion = mp.matrix(6)
        for row in range(6):
            companion[row, 5] = -coefficients[row] / coefficients[6]
            if row:
                companion[row, row - 1] = 1
        roots = mp.eig(companion, left=False, right=False)
        return sum(abs(abs(z) - 1) < mp.mpf(10) ** -25 for z in roots)


def disagreements(poses: Array, others: list[Array], limit: float = POSE_TOLERANCE) -> NDArray[np.intp]:
    """Return the triads for which the two methods give different poses."""
    different = []
    for j, other in enumerate(others):
        own_poses = poses[j][np.isfinite(poses[j, :, 0])]
        if len(own_poses) == len(other):
            gap = abs(own_poses[:, None, :2] - other[None, :, :2]).max(-1)
            gap = np.maximum(gap, abs(np.exp(1j * own_poses[:, None, 2]) - np.exp(1j * other[None, :, 2])))
            if len(own_poses) == 0 or (gap.min(0).max() < limit and gap.min(1).max() < limit):
                continue
        different.append(j)
    return np.array(different, dtype=np.intp)


def main(count: int) -> int:
    pivots, platform, legs = random_triads(count)
    start = time.perf_counter()
    poses = triad.triad_modes(pivots, platform, legs)
    own_poses = time.perf_counter() - start
    others = CouplerCurves(pivots, platform, legs).roots()
    curve_seconds = time.perf_counter() - start - own_poses
    numbers = np.isfinite(poses[..., 0]).sum(1)
    print(f"{count} triads; sextic {own_poses:.2f} s, coupler curves {curve_seconds:.2f} s")
    for number, frequency in enumerate(np.bincount(numbers, minlength=7)):
        print(f"  {number} assemblies: {frequency}")
    disputed = disagreements(poses, others)
    wrong = 0
    for j in disputed:
        exact = exact_count(pivots[j], platform[j], legs[j])
        wrong += exact != numbers[j]
        print(f"  triad {j}: sextic {numbers[j]}, coupler curves {len(others[j])}, 60 digits {exact}")
    print(f"disagreements: {len(disputed)}; of these missed or invented by the sextic: {wrong}")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 10_000))
