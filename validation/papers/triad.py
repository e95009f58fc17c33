"""None missed, none invented: 10,000 random class III triads by the sextic and by coupler curves.

The second method shares nothing with the first. It takes the third leg away; what is left is a
four-bar A-B-C-D, whose coupler point K runs along closed curves; the triad closes where K is at leg
length from the third pivot. The curves are sampled densely, sign changes bisected and every extremum
between samples refined, so that pairs of near roots are seen. Where the two disagree, the roots of
the sextic in 60 digits (mpmath) decide.

Run: python validation/papers/triad.py [count] (exit code 1 if an assembly is missed or
invented by the sextic).
"""

import sys
import time

import mpmath as mp
import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.vector_method import triad

Array = NDArray[np.float64]
SAMPLES = 720
# a pose by bisection is known to the square root of rounding near the ends of a coupler curve
MATCH = 1e-6


def random_triads(count: int, seed: int = 20) -> tuple[Array, Array, Array]:
    """Return pivots (n, 3, 2), platform points (n, 3, 2) and legs (n, 3) of order one.

    Half of them get legs that fit a pose of the platform, for legs drawn blindly close less often.
    """
    rng = np.random.default_rng(seed)
    pivots, platform = rng.uniform(-1.0, 1.0, (2, count, 3, 2))
    legs = rng.uniform(0.05, 1.5, (count, 3))
    place, theta = rng.uniform(-0.5, 0.5, (count, 2)), rng.uniform(0.0, 2.0 * np.pi, count)
    turn = np.stack([np.cos(theta), -np.sin(theta), np.sin(theta), np.cos(theta)], -1).reshape(-1, 2, 2)
    fitting = place[:, None] + platform @ np.swapaxes(turn, 1, 2) - pivots
    legs[::2] = np.sqrt((fitting**2).sum(-1))[::2]
    return pivots, platform, legs


class CouplerCurves:
    """The coupler curves of the four-bars left when the third legs are taken away; two a triad.

    A curve is run through by a parameter t in [0, 2 pi). Where the first leg turns fully, t is its
    angle and the two curves are the two assemblies. Else the leg swings as t's sine and the
    assembly is the sign of t's cosine, so that the curve passes its ends smoothly.
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
        item = self.full | (high >= 1.0) | (low <= -1.0)
        around_zero, around_pi = (high >= 1.0) & (low > -1.0), (low <= -1.0) & (high < 1.0)
        self.middle = np.select([around_zero, around_pi], [0.0, np.pi], (inner + outer) / 2.0)
        self.half = np.select([around_zero, around_pi], [outer, np.pi - inner], (outer - inner) / 2.0)
        self.curves = np.where(self.exists, np.where(item & ~self.full, 1, 2), 0)

    def pose(self, i: NDArray[np.intp], curve: NDArray[np.intp], t: Array) -> tuple[Array, Array]:
        """Return place of B and turn of the platform for problem i on a curve at parameter t."""
        side = np.where(curve == 0, 1.0, -1.0)
        swing = np.where(self.full[i], t, side * (self.middle[i] + self.half[i] * np.sin(t)))
        branch = np.where(self.full[i], side, np.where(np.cos(t) >= 0.0, 1.0, -1.0))
        back = self.a[i] - self.d[i]
        b = self.a[i] + self.r1[i] * back / abs(back) * np.exp(1j * swing)
        gap = self.d[i] - b
        coupler, reach = abs(self.c[i]), abs(gap)
        cosine = (coupler**2 + reach**2 - self.r2[i] ** 2) / (2.0 * coupler * reach)
        sine = branch * np.sqrt(np.maximum((1.0 - cosine) * (1.0 + cosine), 0.0))
        turn = coupler * gap / reach * (cosine + 1j * sine) / self.c[i]
        return b, turn

    def miss(self, i: NDArray[np.intp], curve: NDArray[np.intp], t: Array) -> Array:
        """Return by how much the squared distance of K from the third pivot is too long."""
        b, turn = self.pose(i, curve, t)
        return abs(b + turn * self.k[i] - self.e[i]) ** 2 - self.r3[i] ** 2

    def roots(self, samples: int = SAMPLES) -> list[Array]:
        """Return the poses (x, y, theta) of each triad, a list of (m, 3)."""
        n = len(self.a)
        t = 2.0 * np.pi * np.arange(samples) / samples
        result: list[list[Array]] = [[] for _ in range(n)]
        for start in range(0, n, 250):
            i, curve = (x.ravel() for x in np.meshgrid(np.arange(start, min(start + 250, n)), [0, 1]))
            real = curve < self.curves[i]
            i, curve = i[real], curve[real]
            value = self.miss(i[:, None], curve[:, None], t)
            after, before = np.roll(value, -1, 1), np.roll(value, 1, 1)
            row, column = np.nonzero((value < 0.0) != (after < 0.0))
            brackets = [(row, t[column], t[column] + t[1])]
            turning = (abs(value) <= abs(after)) & (abs(value) <= abs(before))
            turning &= ((value < 0.0) == (after < 0.0)) & ((value < 0.0) == (before < 0.0))
            row, column = np.nonzero(turning)
            tip = self._extremum(i[row], curve[row], t[column] - t[1], t[column] + t[1])
            crossed = (self.miss(i[row], curve[row], tip) < 0.0) != (value[row, column] < 0.0)
            row, column, tip = row[crossed], column[crossed], tip[crossed]
            brackets += [(row, t[column] - t[1], tip), (row, tip, t[column] + t[1])]
            row, low, high = (np.concatenate(part) for part in zip(*brackets, strict=True))
            place, turn = self.pose(i[row], curve[row], self._bisect(i[row], curve[row], low, high))
            place = place - turn * self.b0[i[row]]
            for j, x, z in zip(i[row], place, turn, strict=True):
                result[j].append(np.array([x.real, x.imag, np.angle(z)]))
        return [np.array(poses).reshape(-1, 3) for poses in result]

    def _bisect(self, i: NDArray[np.intp], curve: NDArray[np.intp], low: Array, high: Array) -> Array:
        below = self.miss(i, curve, low) < 0.0
        for _ in range(52):
            middle = (low + high) / 2.0
            same = (self.miss(i, curve, middle) < 0.0) == below
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        return (low + high) / 2.0

    def _extremum(self, i: NDArray[np.intp], curve: NDArray[np.intp], low: Array, high: Array) -> Array:
        """Golden section for the least |miss| on one side of zero; a value beyond zero counts as less."""
        sign = np.where(self.miss(i, curve, (low + high) / 2.0) < 0.0, -1.0, 1.0)
        golden = (np.sqrt(5.0) - 1.0) / 2.0
        for _ in range(40):
            left, right = high - golden * (high - low), low + golden * (high - low)
            lower = sign * self.miss(i, curve, left) < sign * self.miss(i, curve, right)
            low, high = np.where(lower, low, left), np.where(lower, right, high)
        return (low + high) / 2.0


def exact_count(pivots: Array, platform: Array, legs: Array) -> int:
    """Return how many roots of the sextic lie on the unit circle, by 60 digits."""
    with mp.workdps(60):
        a, b = ([mp.mpc(*map(float, p)) for p in points] for points in (pivots, platform))
        r = [mp.mpf(float(x)) for x in legs]

        def value(z: mp.mpc) -> mp.mpf:
            u, w = z * (b[1] - b[0]) - (a[1] - a[0]), z * (b[2] - b[0]) - (a[2] - a[0])
            e = r[1] ** 2 - r[0] ** 2 - abs(u) ** 2
            f = r[2] ** 2 - r[0] ** 2 - abs(w) ** 2
            return abs(f * u - e * w) ** 2 - 4 * r[0] ** 2 * mp.im(mp.conj(u) * w) ** 2

        at = [value(mp.expjpi(mp.mpf(2 * k) / 7)) for k in range(7)]
        rising = [sum(at[k] * mp.expjpi(mp.mpf(-2 * k * h) / 7) for k in range(7)) / 7 for h in range(-3, 4)]
        companion = mp.matrix(6)
        for row in range(6):
            companion[row, 5] = -rising[row] / rising[6]
            if row:
                companion[row, row - 1] = 1
        roots = mp.eig(companion, left=False, right=False)
        return sum(abs(abs(z) - 1) < mp.mpf(10) ** -25 for z in roots)


def disagreements(poses: Array, others: list[Array], bound: float = MATCH) -> NDArray[np.intp]:
    """Return the triads for which the two methods do not give the same poses."""
    bad = []
    for j, other in enumerate(others):
        mine = poses[j][np.isfinite(poses[j, :, 0])]
        if len(mine) == len(other):
            gap = abs(mine[:, None, :2] - other[None, :, :2]).max(-1)
            gap = np.maximum(gap, abs(np.exp(1j * mine[:, None, 2]) - np.exp(1j * other[None, :, 2])))
            if len(mine) == 0 or (gap.min(0).max() < bound and gap.min(1).max() < bound):
                continue
        bad.append(j)
    return np.array(bad, dtype=np.intp)


def main(count: int) -> int:
    pivots, platform, legs = random_triads(count)
    clock = time.perf_counter()
    poses = triad.triad_modes(pivots, platform, legs)
    mine = time.perf_counter() - clock
    others = CouplerCurves(pivots, platform, legs).roots()
    second = time.perf_counter() - clock - mine
    numbers = np.isfinite(poses[..., 0]).sum(1)
    print(f"{count} triads; sextic {mine:.2f} s, coupler curves {second:.2f} s")
    for number, many in enumerate(np.bincount(numbers, minlength=7)):
        print(f"  {number} assemblies: {many}")
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
