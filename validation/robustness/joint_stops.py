"""Random mechanisms that hit joint stops, each compared with an independent integration.

Planar chains of two and three joints, four-bars and five-bars under gravity with damping have two or three
stops and a coefficient of restitution of 0 to 1; some start on a stop or have both stops of a joint close to
each other. The reference integrates Lagrange's equations, whose mass matrix is differentiated by complex
steps, with scipy's DOP853 (tolerance 1e-12) between impacts. Its impacts and contacts are complementarity
problems over all closed gaps, solved by trying every subset. The script prints, for each kind of mechanism,
the runs, impacts, the largest distance beyond a stop, the difference from the reference in [rad] or [m], and
the largest energy error relative to the exchanged energy.

Run: python validation/robustness/joint_stops.py [NUMBER [FIRST]]
"""

import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path

import numpy as np
from scipy.integrate import DOP853
from scipy.optimize import brentq

import mechsim as ms

DURATION, GRAVITY = 0.3, 9.81
# complex step; gap that is closed, and one that is open; rate of a closed gap at rest; force that is rounding
STEP, CLOSED, OPEN, SLOW, ROUNDING = 1e-30, 1e-9, 1e-12, 1e-7, 1e-9
# instants within a step at which gaps are looked at, relative to its duration
INSTANTS = np.concatenate([np.geomspace(1e-9, 1e-2, 20), np.linspace(0.0, 1.0, 41)[1:]])


@dataclass
class Chain:
    """A planar chain of hinges "h" and slides "s" (along the link before), pinned at its tip if closed."""

    kinds: str
    lengths: np.ndarray
    offsets: np.ndarray
    centres: np.ndarray
    masses: np.ndarray
    moments: np.ndarray
    damping: np.ndarray
    closed: bool
    restitution: float = 0.0
    # (joint, limit, side)
    stops: list[tuple[int, float, float]] = field(default_factory=list)
    rates: np.ndarray = field(default_factory=lambda: np.zeros(0))

    @property
    def mobility(self) -> int:
        return len(self.kinds) - (2 if self.closed else 0)

    def points(self, q):
        """Return the origins of the joints and the tip, the centres of mass, and the directions before links.

        q is (joints, ...), the results (2, ...).
        """
        angle, origin = 0.0, np.zeros((2, *q.shape[1:]), dtype=q.dtype)
        origins, centres, directions = [], [], []
        before = np.zeros_like(origin)
        before[0] = 1.0
        for i, kind in enumerate(self.kinds):
            angle = angle + self.offsets[i] + (q[i] if kind == "h" else 0.0 * q[i])
            if kind == "s":
                origin = origin + before * q[i]
            along = np.array([np.cos(angle), np.sin(angle)])
            origins.append(origin)
            directions.append(before)
            centres.append(origin + self.centres[i] * along)
            origin, before = origin + self.lengths[i] * along, along
        return [*origins, origin], centres, directions

    def _jacobian(self, point, last, origins, directions):
        rows = np.zeros((len(self.kinds), *point.shape), dtype=point.dtype)
        for j in range(last + 1):
            arm = point - origins[j]
            rows[j] = np.array([-arm[1], arm[0]]) if self.kinds[j] == "h" else directions[j]
        return np.moveaxis(rows, 0, 1)

    def mass(self, q):
        """Return the mass matrix, (joints, joints, ...)."""
        origins, centres, directions = self.points(q)
        turning = np.array([kind == "h" for kind in self.kinds], float)
        total = np.zeros((len(q), *q.shape), dtype=q.dtype)
        for i, centre in enumerate(centres):
            rows, spin = self._jacobian(centre, i, origins, directions), turning * (np.arange(len(q)) <= i)
            total += self.masses[i] * (rows[0][:, None] * rows[0] + rows[1][:, None] * rows[1])
            total += self.moments[i] * np.outer(spin, spin).reshape(len(q), -1, *[1] * (q.ndim - 1))
        return total

    def tip_jacobian(self, q):
        if not self.closed:
            return np.zeros((0, len(q)))
        origins, _, directions = self.points(q)
        return self._jacobian(origins[-1], len(q) - 1, origins, directions)

    def weight(self, q):
        origins, centres, directions = self.points(q)
        return sum(
            -GRAVITY * self.masses[i] * self._jacobian(centre, i, origins, directions)[1]
            for i, centre in enumerate(centres)
        )

    def equations(self, q, v):
        """Return mass matrix, force, tip Jacobian and its velocity-product term."""
        n = len(q)
        masses = self.mass(q[:, None] + 1j * STEP * np.eye(n, n + 1))
        # derivative of the mass matrix by each coordinate; the last column is undisturbed
        change = np.moveaxis(masses[..., :n].imag / STEP, -1, 0)
        coriolis = np.einsum("kij,k,j->i", change, v, v) - 0.5 * np.einsum("ijk,j,k->i", change, v, v)
        product = np.zeros(0)
        if self.closed:
            product = self.tip_jacobian(q + 1j * STEP * v).imag @ v / STEP
        force = self.weight(q) - self.damping * v - coriolis
        return masses[..., n].real, force, self.tip_jacobian(q), product

    def gaps(self, q):
        return np.array([side * (limit - q[joint]) for joint, limit, side in self.stops])

    def directions(self):
        return np.array([-side * np.eye(len(self.kinds))[joint] for joint, _, side in self.stops])

    def ranges(self) -> dict[int, tuple[float, float]]:
        ranges: dict[int, tuple[float, float]] = {}
        for joint, limit, side in self.stops:
            low, high = ranges.get(joint, (-20.0, 20.0))
            ranges[joint] = (low, limit) if side > 0.0 else (limit, high)
        return ranges

    def xml(self) -> str:
        ranges, body, end = self.ranges(), "", ""
        for i, kind in enumerate(self.kinds):
            origin = self.lengths[i - 1] if i else 0.0
            axis = "0 0 1" if kind == "h" else f"{np.cos(-self.offsets[i])!r} {np.sin(-self.offsets[i])!r} 0"
            limits = f'limited="true" range="{ranges[i][0]!r} {ranges[i][1]!r}"' if i in ranges else ""
            body += (
                f'<body name="b{i}" pos="{origin!r} 0 0" euler="0 0 {self.offsets[i]!r}">'
                f'<inertial pos="{self.centres[i]!r} 0 0" mass="{self.masses[i]!r}" '
                f'diaginertia="{self.moments[i]!r} {self.moments[i]!r} {self.moments[i]!r}"/>'
                f'<joint name="j{i}" type="{"hinge" if kind == "h" else "slide"}" axis="{axis}" '
                f'damping="{self.damping[i]!r}" {limits}/>'
            )
            end += "</body>"
        last, length = len(self.kinds) - 1, float(self.lengths[-1])
        pin = f'<equality><connect body1="b{last}" anchor="{length!r} 0 0"/></equality>'
        text = (
            f'<mujoco model="chain"><compiler angle="radian"/><option gravity="0 {-GRAVITY} 0"/><worldbody>'
            f'{body}<site name="tip" pos="{length!r} 0 0"/>{end}</worldbody>'
            f"{pin if self.closed else ''}</mujoco>"
        )
        return text.replace("np.float64(", "").replace(")", "")


def complementary(matrix, constant):
    """Return the subset of contacts that solves the complementarity problem, by trying every one."""
    best, chosen = np.inf, ()
    count = len(constant)
    for number in range(count + 1):
        for subset in combinations(range(count), number):
            s, z = list(subset), np.zeros(count)
            if s:
                z[s] = np.linalg.lstsq(matrix[np.ix_(s, s)], -constant[s], rcond=1e-11)[0]
            w = matrix @ z + constant
            scale = 1.0 + np.abs(constant).max()
            wrong = max(-w.min(), -(z * np.diag(matrix)).min(), np.abs(w[s]).max(initial=0.0)) / scale
            if wrong < 0.5 * best:
                best, chosen = wrong, subset
        if best < 1e-12:
            break
    return list(chosen)


class Reference:
    """Event-driven integration of a chain from q = 0; `samples` holds times and coordinates."""

    def __init__(self, chain: Chain, rates: np.ndarray) -> None:
        self.chain, self.time, self.impacts = chain, 0.0, 0
        self.q, self.v = np.zeros(len(rates)), self._on_loops(np.zeros(len(rates)), rates)
        self.fastest = max(np.abs(self.v).max(), 1e-9)
        self.rows = chain.directions()
        self.pieces: list[tuple[float, float, Callable]] = []

    def _on_loops(self, q, v):
        rows = self.chain.tip_jacobian(q)
        return v - np.linalg.pinv(rows) @ rows @ v if len(rows) else v

    def _projected(self, matrix, rows):
        inverse = np.linalg.inv(matrix)
        if not len(rows):
            return inverse
        across = inverse @ rows.T
        return inverse - across @ np.linalg.solve(rows @ across, across.T)

    def _impact(self) -> None:
        for _ in range(200):
            closed = np.flatnonzero(self.chain.gaps(self.q) <= CLOSED)
            before = self.rows[closed] @ self.v
            if not (before < -1e-11 * self.fastest).any():
                return
            approaching = closed[before <= 1e-11 * self.fastest]
            before = self.rows[approaching] @ self.v
            target = self.chain.restitution * np.maximum(-before, 0.0)
            matrix, force, tip, product = self.chain.equations(self.q, self.v)
            # flights that would rise less than 1e-12 end at once
            largest = np.abs(self._acceleration(matrix, force, tip, product)[0]).max()
            target[target <= max(SLOW * self.fastest, np.sqrt(2e-12 * largest))] = 0.0
            free = self._projected(matrix, tip)
            delassus = self.rows[approaching] @ free @ self.rows[approaching].T
            s = complementary(delassus, before - target)
            impulse = np.linalg.lstsq(delassus[np.ix_(s, s)], (target - before)[s], rcond=1e-11)[0]
            self.v = self.v + free @ self.rows[approaching][s].T @ impulse
            self.impacts += 1

    def _contacts(self) -> list[int]:
        gaps, rates = self.chain.gaps(self.q), self.rows @ self.v
        resting = np.flatnonzero((gaps <= CLOSED) & (np.abs(rates) <= SLOW * self.fastest))
        if not len(resting):
            return []
        matrix, force, tip, product = self.chain.equations(self.q, self.v)
        free = self._projected(matrix, tip)
        acceleration = self._acceleration(matrix, force, tip, product)[0]
        rows = self.rows[resting]
        return [int(resting[k]) for k in complementary(rows @ free @ rows.T, rows @ acceleration)]

    def _acceleration(self, matrix, force, rows, product):
        n, m = len(force), len(rows)
        system = np.block([[matrix, -rows.T], [rows, np.zeros((m, m))]])
        solution = np.linalg.lstsq(system, np.concatenate([force, -product]), rcond=1e-13)[0]
        return solution[:n], solution[n:]

    def _all(self, q, v, contacts):
        matrix, force, tip, product = self.chain.equations(q, v)
        rows = np.concatenate([tip, self.rows[contacts]])
        return self._acceleration(matrix, force, rows, np.concatenate([product, np.zeros(len(contacts))]))

    def run(self, duration: float) -> None:
        while self.time < duration and self.impacts < 2000:
            self._impact()
            contacts = self._contacts()
            rows = np.concatenate([self.chain.tip_jacobian(self.q), self.rows[contacts]])
            if contacts:
                self.v = self.v - np.linalg.pinv(rows) @ rows @ self.v
            self._smooth(contacts, duration)

    def _smooth(self, contacts: list[int], duration: float) -> None:
        """Integrate until a gap closes, a contact releases, or the duration."""
        n, start = len(self.q), np.concatenate([self.q, self.v])

        def right(_, state):
            return np.concatenate([state[n:], self._all(state[:n], state[n:], contacts)[0]])

        solver = DOP853(right, self.time, start, duration, rtol=1e-12, atol=1e-13, max_step=1e-2)
        gaps = self.chain.gaps(self.q)
        # a gap that is closed at the start closes again below this offset, or once it was open
        offsets = np.where(gaps < OPEN, 0.1 * OPEN - np.minimum(gaps, 0.0), 0.0)
        while solver.status == "running":
            solver.step()
            dense, first, last = solver.dense_output(), solver.t_old, solver.t
            hits = self._closings(dense, first, last, contacts, offsets)
            hits += self._releases(dense, first, last, contacts)
            end = min(hits, default=last)
            self.pieces.append((first, end, dense))
            self.time, state = end, dense(end)
            self.q, self.v = state[:n], self._on_loops(state[:n], state[n:])
            self.fastest = max(self.fastest, np.abs(self.v).max())
            if hits:
                return

    def _closings(self, dense, first, last, contacts, offsets) -> list[float]:
        """Return the instants at which gaps close, and clear the offsets of gaps that have opened."""
        n, times, hits = len(self.q), first + (last - first) * INSTANTS, []
        gaps = np.array([self.chain.gaps(q) for q in dense(times)[:n].T])
        for k in set(range(gaps.shape[1])) - set(contacts):
            opened = np.maximum.accumulate(gaps[:, k]) > OPEN
            offset = np.where(opened, 0.0, offsets[k])
            values = gaps[:, k] + offset
            crosses = np.flatnonzero((values[:-1] > 0.0) & (values[1:] <= 0.0))
            if len(crosses):
                i = crosses[0]

                def gap(time, k=k, more=offset[i]):
                    return self.chain.gaps(dense(time)[:n])[k] + more

                hits.append(brentq(gap, times[i], times[i + 1], xtol=1e-15))
            offsets[k] = offset[-1]
        return hits

    def _releases(self, dense, first, last, contacts) -> list[float]:
        """Return the instants at which forces of contacts become tensile."""
        n, hits = len(self.q), []
        for k in range(len(contacts)):

            def force(time, k=k):
                state = dense(time)
                return self._all(state[:n], state[n:], contacts)[1][k - len(contacts)] + ROUNDING

            if force(last) <= 0.0:
                hits.append(brentq(force, first, last, xtol=1e-15) if force(first) > 0.0 else last)
        return hits

    def coordinates(self, times):
        ends = np.array([last for _, last, _ in self.pieces])
        numbers = np.minimum(np.searchsorted(ends, times), len(ends) - 1)
        states = [self.pieces[k][2](time) for k, time in zip(numbers, times, strict=True)]
        return np.array(states)[:, : len(self.q)]


def random_chain(number: int) -> tuple[str, Chain]:
    """Return kind and mechanism of a random run."""
    rng = np.random.default_rng(number)
    kind = ("hh", "hs", "hhh", "shh", "four-bar", "five-bar")[number % 6]
    kinds = {"four-bar": "hhh", "five-bar": "hhhh"}.get(kind, kind)
    n, closed = len(kinds), kind.endswith("bar")
    lengths = rng.uniform(0.2, 0.6, n)
    offsets = rng.uniform(-np.pi, np.pi, n)
    if closed:
        offsets[1:] = -rng.uniform(0.5, 1.6, n - 1)
    chain = Chain(
        kinds=kinds,
        lengths=lengths,
        offsets=np.where([k == "s" for k in kinds], rng.choice([0.0, 0.7], n), offsets),
        centres=lengths * rng.uniform(0.3, 0.7, n),
        masses=rng.uniform(0.3, 2.0, n),
        moments=rng.uniform(0.005, 0.04, n),
        damping=rng.uniform(0.0, 0.15, n),
        closed=closed,
        restitution=float(rng.choice([0.0, 1.0, round(rng.uniform(0.05, 0.95), 3)], p=[0.2, 0.15, 0.65])),
    )
    rates = np.zeros(n)
    rates[: chain.mobility] = rng.uniform(-4.0, 4.0, chain.mobility)
    limits = [(joint, side) for joint in range(n) for side in (-1.0, 1.0)]
    for k in rng.choice(len(limits), int(rng.integers(2, 4)), replace=False):
        joint, side = limits[k]
        # on the stop, close to it, or far
        distance = rng.choice([0.0, 10.0 ** rng.uniform(-3, -2), rng.uniform(0.02, 0.3)], p=[0.15, 0.1, 0.75])
        chain.stops.append((joint, float(side * distance), side))
    widths = {j: high - low for j, (low, high) in chain.ranges().items()}
    if min(widths.values()) <= 0.0:
        return random_chain(number + 1_000_003)
    chain.rates = rates
    return kind, chain


@dataclass
class Comparison:
    """A run and its reference."""

    outcome: str
    beyond: float
    difference: float
    impacts: int
    energy: float


def compared(chain: Chain, folder: Path) -> Comparison:
    """Run a mechanism in mechsim and in the reference."""
    path = folder / "chain.xml"
    path.write_text(chain.xml())
    initial = {f"j{i}.v": float(chain.rates[i]) for i in range(chain.mobility)}
    run = ms.dynamics.run(
        ms.load(str(path), still=True),
        initial=initial,
        duration=DURATION,
        restitution=chain.restitution,
        samples=400,
    )
    values = np.array([run.motion.joints[f"j{i}"].value for i in range(len(chain.kinds))]).T
    reference = Reference(chain, closing_rates(chain))
    reference.run(DURATION)
    until = min(float(run.time[-1]), reference.time)
    rows = run.time <= until
    difference = np.abs(values[rows] - reference.coordinates(run.time[rows])).max()
    beyond = max(float(-chain.gaps(q).min()) for q in values)
    return Comparison(run.outcome, beyond, float(difference), len(run.events), run.energy_error)


def closing_rates(chain: Chain) -> np.ndarray:
    """Return the requested rates, those of other joints by the loop."""
    n, free = len(chain.kinds), chain.mobility
    rates = chain.rates.copy()
    if chain.closed:
        rows = chain.tip_jacobian(np.zeros(n))
        rates[free:] = -np.linalg.solve(rows[:, free:], rows[:, :free] @ rates[:free])
    return rates


def main(count: int, first: int = 0) -> list[Comparison]:
    """Compare random runs, print one row for each kind, and return them all."""
    results: dict[str, list[Comparison]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for number in range(first, first + count):
            kind, chain = random_chain(number)
            result = compared(chain, Path(folder))
            results.setdefault(kind, []).append(result)
            if result.outcome not in ("done", "stopped") or not result.difference <= 1e-6:
                print(f"run {number}, {kind}, e = {chain.restitution}: {result}", file=sys.stderr, flush=True)
    print("| mechanism | runs | events | beyond a stop | difference, median | largest | energy error |")
    print("|---|---|---|---|---|---|---|")
    for kind, rows in results.items():
        differences = [row.difference for row in rows]
        print(
            f"| {kind} | {len(rows)} | {sum(row.impacts for row in rows)} "
            f"| {max(row.beyond for row in rows):.1e} | {np.median(differences):.1e} "
            f"| {max(differences):.1e} | {max(row.energy for row in rows):.1e} |"
        )
    return [row for rows in results.values() for row in rows]


if __name__ == "__main__":
    main(*map(int, sys.argv[1:] or ["500"]))
