"""Mistakes in what drives: sense, offset, degrees, delay, a program out of phase, drivers swapped."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from itertools import combinations

import numpy as np

from mechsim.analytic import dynamics
from mechsim.analytic.loops.loop_form import LoopForm
from mechsim.errors import AssemblyError
from mechsim.model.links import Inertia
from mechsim.model.motion_laws import MotionLaws, State
from mechsim.numerics.angles import TURN
from mechsim.numerics.arrays import Array
from mechsim.studies.agreement.discrepancy import DISCRETE, NAMED, Hypothesis, Miss, Rows, Values
from mechsim.studies.agreement.evaluation_points import Comparand

DEG = 180.0 / np.pi
# most samples of a delay
LATE = 12
# farthest that a driver under a program is taken off it, in [rad] or sizes
FAR = 2.5


def _driven(comparand: Comparand, changes: Mapping[str, Callable[[State], State]]) -> Comparand:
    """Return a comparand whose drivers go otherwise: name -> what makes a program of a program."""
    form, motion_laws = comparand.form, comparand.form.motion_laws
    if motion_laws is None:
        crank = form.mechanism.crank.name
        steady = comparand.angle, comparand.speed, comparand.acceleration
        if crank in changes:
            steady = changes[crank](lambda _, own=steady: own)(comparand.angle)
        angle, speed, acceleration = steady
        return replace(comparand, angle=_near(comparand, angle), speed=speed, acceleration=acceleration)
    joints = dict(comparand.motion.joints)
    time = comparand.angle / motion_laws.rate
    for name, state in motion_laws.by_name.items():
        if name in changes:
            value, rate, second = (np.broadcast_to(part, time.shape) for part in changes[name](state)(time))
            unit = form.mechanism.size if form.mechanism.unit(name) == "m" else 1.0
            if not np.abs(value - joints[name].value).max() < FAR * unit:
                raise AssemblyError(f"{name} would go farther than a mechanism under programs is followed")
            joints[name] = replace(joints[name], value=value, rate=rate, acceleration=second)
    assert isinstance(form, LoopForm)
    motion = form.solve_as(replace(comparand.motion, joints=joints))
    return replace(comparand, solved=motion)


def _near(comparand: Comparand, angle: Array) -> Array:
    """Return crank angles brought near the start by whole periods, where that changes nothing."""
    form = comparand.form
    if not form.crank_range().full:
        return angle
    gone = angle - form.mechanism.start
    return angle if np.abs(gone).max() < 2.5 * form.period else form.mechanism.start + gone % form.period


def _linear(scale: float, offset: float) -> Callable[[State], State]:
    def make(state: State) -> State:
        def moved(time: Array) -> tuple[Array, Array, Array]:
            value, rate, second = state(time)
            return scale * value + offset, scale * rate, scale * second

        return moved

    return make


def _once(miss: Miss, driver: str, scale: float, offset: float) -> Comparand:
    """Return a comparand with a driver that goes otherwise, solved once for all claims.

    Raises:
        AssemblyError: where it cannot go so.
    """
    key = f"{driver} {scale} {offset}"
    found = miss.comparand.variant(key, lambda: _driven(miss.comparand, {driver: _linear(scale, offset)}))
    if found is None:
        raise AssemblyError(f"{driver} cannot go so")
    return found


def _late(lag: float) -> Callable[[State], State]:
    return lambda state: lambda time: state(time - lag)


def _unit(miss: Miss, driver: str) -> str:
    return "m" if miss.comparand.form.mechanism.unit(driver) == "m" else "rad"


def driver_senses(miss: Miss) -> Iterator[Hypothesis]:
    """A driver counted the other way round, from nought or from where it starts."""
    for driver, state in miss.comparand.drivers().items():
        first = float(state[0][0])
        for about in dict.fromkeys((0.0, 2.0 * first)):
            of = "" if about == 0.0 else f" about {first:.6g} {_unit(miss, driver)}, where it starts"

            def turned(_: Array, driver: str = driver, about: float = about) -> Values:
                return miss.predicted(_once(miss, driver, -1.0, about))

            yield Hypothesis(
                "sense",
                driver,
                DISCRETE,
                turned,
                lambda _, d=driver, of=of: f"{d} goes in the reversed sense{of}",
                by=lambda _: -1.0,
            )


def driver_degrees(miss: Miss) -> Iterator[Hypothesis]:
    """A driver's angle taken for degrees, or turned into them."""
    for driver in miss.comparand.drivers():
        if _unit(miss, driver) == "m":
            factors = {1e3: "taken in mm for m", 1e-3: "taken in m for mm"}
            kind = "units"
        else:
            factors = {1.0 / DEG: "taken for degrees", DEG: "turned into degrees, where radians are meant"}
            kind = "degrees"
        for factor, said in factors.items():

            def scaled(_: Array, driver: str = driver, factor: float = factor) -> Values:
                return miss.predicted(_once(miss, driver, factor, 0.0))

            yield Hypothesis(
                kind,
                driver,
                DISCRETE,
                scaled,
                lambda _, d=driver, s=said: f"the coordinate of {d} is {s}",
                by=lambda _, f=factor: f,
            )


def driver_offsets(miss: Miss) -> Iterator[Hypothesis]:
    """A driver that stands a constant farther on."""
    for driver in miss.comparand.drivers():
        unit = _unit(miss, driver)
        size = miss.comparand.form.mechanism.size if unit == "m" else 1.0

        def moved(p: Array, driver: str = driver) -> Values:
            return miss.predicted(_driven(miss.comparand, {driver: _linear(1.0, p[0])}))

        def say(p: Array, driver: str = driver, unit: str = unit) -> str:
            also = f" ({np.rad2deg(p[0]):.4g} deg)" if unit == "rad" else ""
            return f"{driver} stands {p[0]:.6g} {unit}{also} farther on throughout"

        starts = ((0.0,), *_rolled(miss)) if unit == "rad" else ((0.0,),)
        yield Hypothesis("offset", driver, NAMED, moved, say, starts=starts, steps=(1e-5 * size,))


def _rolled(miss: Miss) -> tuple[tuple[float], ...]:
    """Return the offset, in samples of a full turn, at which exact values look most like the claims."""
    comparand = miss.comparand
    if comparand.form.motion_laws is not None or not comparand.form.crank_range().full:
        return ()
    angle, n = comparand.angle, len(comparand) - 1
    if n < 8 or np.ptp(np.diff(angle)) > 1e-9 or abs(abs(angle[-1] - angle[0]) - TURN) > 1e-9:
        return ()
    sizes = [
        np.sqrt(np.mean(miss.errors([_turned_on(values, k) for values in miss.exact]) ** 2)) for k in range(n)
    ]
    best = int(np.argmin(sizes))
    if best in (0, 1, n - 1):
        return ()
    away = (angle[1] - angle[0]) * best
    return ((float((away + np.pi) % TURN - np.pi),),)


def _turned_on(values: Array, k: int) -> Array:
    once = np.roll(values[:-1], -k, axis=0)
    return np.concatenate([once, once[:1]])


def delays(miss: Miss) -> Iterator[Hypothesis]:
    """All that is claimed late, by samples or by a time; one program of several late."""
    yield from _by_samples(miss)
    comparand, motion_laws = miss.comparand, miss.comparand.form.motion_laws
    if comparand.time is None or (miss.function and motion_laws is None):
        return
    step = float(np.median(np.diff(comparand.time)))

    def late(p: Array) -> Values:
        pace = comparand.speed if motion_laws is None else motion_laws.rate
        return miss.predicted(
            replace(comparand, angle=comparand.angle - pace * p[0], time=comparand.time - p[0])
        )

    def say(p: Array) -> str:
        return f"all is late by {p[0]:.6g} s, {p[0] / step:.4g} samples"

    starts = tuple((k * step,) for k in (0.0, 3.0, -3.0))
    if motion_laws is None or _goes_on(motion_laws):
        yield Hypothesis("delay", "", NAMED, late, say, starts=starts, steps=(1e-3 * step,))
    if motion_laws is not None and len(motion_laws.drivers) > 1:
        for driver in motion_laws.drivers:
            yield _out_of_phase(miss, driver, motion_laws.duration)


def _goes_on(motion_laws: MotionLaws) -> bool:
    """Whether programs tell of a time before they begin."""
    with np.errstate(all="ignore"):
        try:
            return all(
                np.isfinite(part).all()
                for part in motion_laws.state(np.array([-1e-3 * motion_laws.duration]))
            )
        except Exception:
            return False


def _by_samples(miss: Miss) -> Iterator[Hypothesis]:
    n = len(miss.comparand)
    best: tuple[float, int] | None = None
    for k in [*range(-LATE, 0), *range(1, LATE + 1)]:
        if abs(k) > n // 3:
            continue
        left = float(np.sqrt(np.mean(miss.errors(_shifted(miss, k), _known(n, k)) ** 2)))
        if best is None or left < best[0]:
            best = left, k
    if best is None:
        return
    k = best[1]
    late = "late" if k > 0 else "early"
    yield Hypothesis(
        "delay",
        "samples",
        NAMED,
        lambda _: _shifted(miss, k),
        lambda _: f"all is {abs(k)} samples {late}",
        by=lambda _: float(k),
        rows=_known(n, k),
    )


def _shifted(miss: Miss, k: int) -> Values:
    return [np.roll(values, k, axis=0) for values in miss.exact]


def _known(n: int, k: int) -> Rows:
    rows = np.arange(n)
    return (rows >= k) & (rows < n + k)


def _out_of_phase(miss: Miss, driver: str, duration: float) -> Hypothesis:
    def late(p: Array) -> Values:
        return miss.predicted(_driven(miss.comparand, {driver: _late(p[0])}))

    return Hypothesis(
        "phase",
        driver,
        NAMED,
        late,
        lambda p: f"the program of {driver} is out of phase, late by {p[0]:.6g} s",
        starts=tuple((k * duration,) for k in (0.0, 0.1, -0.1, 0.25, -0.25, 0.5)),
        steps=(1e-4 * duration,),
    )


def drivers_swapped(miss: Miss) -> Iterator[Hypothesis]:
    """Two drivers taken for each other."""
    motion_laws = miss.comparand.form.motion_laws
    if motion_laws is None:
        return
    for one, other in combinations(motion_laws.drivers, 2):
        if _unit(miss, one) != _unit(miss, other):
            continue
        first, second = motion_laws.by_name[one], motion_laws.by_name[other]

        def taken(
            _: Array, one: str = one, other: str = other, a: State = first, b: State = second
        ) -> Values:
            def made() -> Comparand:
                return _driven(miss.comparand, {one: lambda _: b, other: lambda _: a})

            found = miss.comparand.variant(f"{one} {other}", made)
            if found is None:
                raise AssemblyError(f"{one} and {other} cannot go so")
            return miss.predicted(found)

        what = f"{one}, {other}"
        yield Hypothesis("swapped", what, DISCRETE, taken, lambda _, w=what: f"the drivers {w} are swapped")


EARTH = 9.81


def _machine(miss: Miss) -> dynamics.Machine:
    return miss.comparand.machine or dynamics.machine(miss.comparand.form, miss.comparand.form.forces)


def _of_efforts(miss: Miss) -> bool:
    return any(claim.named.loaded for claim in miss.claims)


def _under(miss: Miss, vector: Array) -> Values:
    machine = _machine(miss)
    forces = replace(machine.forces, gravity=tuple(vector.tolist()))
    return miss.predicted(replace(miss.comparand, machine=machine.with_forces(forces)))


def _gravity(miss: Miss) -> tuple[Array, float]:
    own = np.asarray(_machine(miss).forces.gravity)
    return own, float(np.linalg.norm(own))


def other_gravity(miss: Miss) -> Iterator[Hypothesis]:
    """Gravity left out, reversed or along another axis."""
    if not _of_efforts(miss):
        return
    own, size = _gravity(miss)
    others = [sign * (size or EARTH) * np.eye(3)[i] for i in range(3) for sign in (1.0, -1.0)]
    was = ", ".join(f"{one:g}" for one in own)
    for vector in [np.zeros(3), *others]:
        if np.allclose(vector, own):
            continue
        said = ", ".join(f"{one:g}" for one in vector)
        yield Hypothesis(
            "gravity",
            said,
            DISCRETE,
            lambda _, v=vector: _under(miss, v),
            lambda _, s=said: f"gravity is ({s}) m/s2 instead of ({was})",
            by=lambda _, v=vector: float(np.linalg.norm(v)),
        )


def gravity_size(miss: Miss) -> Iterator[Hypothesis]:
    """Gravity of another size."""
    if not _of_efforts(miss):
        return
    own, size = _gravity(miss)
    if size:
        yield Hypothesis(
            "gravity",
            "",
            NAMED,
            lambda p: _under(miss, (1.0 + p[0]) * own),
            lambda p: f"gravity is {(1 + p[0]) * size:.6g} m/s2 instead of {size:.6g}",
            starts=((0.0,),),
            steps=(1e-3,),
        )


def masses(miss: Miss) -> Iterator[Hypothesis]:
    """One link's mass, with its moments of inertia or without, or all of them."""
    if not _of_efforts(miss):
        return
    machine = _machine(miss)
    links = machine.mechanism.links

    def heavier(names: set[str], factor: float, moments: bool) -> Values:
        changed = tuple(
            replace(link, inertia=_scaled(link.inertia, factor, moments))
            if link.name in names and link.inertia is not None
            else link
            for link in links
        )
        mechanism = replace(machine.mechanism, links=changed)
        other = replace(machine, mechanism=mechanism)
        return miss.predicted(replace(miss.comparand, machine=other))

    every = {link.name for link in links}
    for what, names in [("", every), *((name, {name}) for name in every)]:
        of = f"link {what}" if what else "all links"
        for moments in (True, False):
            also = " and its moments" if moments else ", not its moments,"
            yield Hypothesis(
                "mass",
                what,
                NAMED + (0.0 if moments else 0.1),
                lambda p, n=names, m=moments: heavier(n, 1.0 + float(p[0]), m),
                lambda p, of=of, also=also: f"the mass of {of}{also} is {100 * p[0]:+.4g} % different",
                starts=((0.0,),),
                steps=(1e-3,),
            )


def _scaled(inertia: Inertia, factor: float, moments: bool) -> Inertia:
    rows = (
        tuple(tuple(factor * one for one in row) for row in inertia.moments) if moments else inertia.moments
    )
    return replace(inertia, mass=factor * inertia.mass, moments=rows)
