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
from mechsim.numerics.angles import REVOLUTION
from mechsim.numerics.arrays import Array
from mechsim.studies.agreement.evaluation_points import EvaluationPoints
from mechsim.studies.agreement.misfit import DISCRETE, NAMED, Hypothesis, Misfit, Rows, Values

DEG = 180.0 / np.pi
# most samples of a delay
LATE = 12
# farthest that a driver under a program is taken off it, in [rad] or sizes
MAX_DISPLACEMENT = 2.5


def _driven(
    evaluation: EvaluationPoints, changes: Mapping[str, Callable[[State], State]]
) -> EvaluationPoints:
    """Return evaluation points with other motion laws: driver -> change of its law."""
    solver, motion_laws = evaluation.solver, evaluation.solver.motion_laws
    if motion_laws.crank:
        crank = solver.mechanism.crank.name
        steady = evaluation.angle, evaluation.speed, evaluation.acceleration
        if crank in changes:
            steady = changes[crank](lambda _, own=steady: own)(evaluation.angle)
        angle, speed, acceleration = steady
        return replace(
            evaluation, angle=_within_a_period(evaluation, angle), speed=speed, acceleration=acceleration
        )
    joints = dict(evaluation.motion.joints)
    time = motion_laws.instants(evaluation.angle)
    for name, state in motion_laws.by_name.items():
        if name in changes:
            value, rate, second = (
                np.broadcast_to(values, time.shape) for values in changes[name](state)(time)
            )
            unit = solver.mechanism.size if solver.mechanism.unit(name) == "m" else 1.0
            if not np.abs(value - joints[name].value).max() < MAX_DISPLACEMENT * unit:
                raise AssemblyError(f"{name} would go farther than a mechanism under programs is followed")
            joints[name] = replace(joints[name], value=value, rate=rate, acceleration=second)
    assert isinstance(solver, LoopForm)
    motion = solver.solve_as(replace(evaluation.motion, joints=joints))
    return replace(evaluation, solved=motion)


def _within_a_period(evaluation: EvaluationPoints, angle: Array) -> Array:
    """Return crank angles brought near the start by whole periods, where that changes nothing."""
    solver = evaluation.solver
    if not solver.crank_range().full:
        return angle
    displacement = angle - solver.mechanism.start
    return (
        angle
        if np.abs(displacement).max() < 2.5 * solver.period
        else solver.mechanism.start + displacement % solver.period
    )


def _linear(scale: float, offset: float) -> Callable[[State], State]:
    def make(state: State) -> State:
        def moved(time: Array) -> tuple[Array, Array, Array]:
            value, rate, second = state(time)
            return scale * value + offset, scale * rate, scale * second

        return moved

    return make


def _once(misfit: Misfit, driver: str, scale: float, offset: float) -> EvaluationPoints:
    """Return evaluation points with a changed driver, solved once for all candidates.

    Raises:
        AssemblyError: where it cannot go so.
    """
    key = f"{driver} {scale} {offset}"
    solved = misfit.evaluation.variant(
        key, lambda: _driven(misfit.evaluation, {driver: _linear(scale, offset)})
    )
    if solved is None:
        raise AssemblyError(f"{driver} cannot go so")
    return solved


def _late(lag: float) -> Callable[[State], State]:
    return lambda state: lambda time: state(time - lag)


def _unit(misfit: Misfit, driver: str) -> str:
    return "m" if misfit.evaluation.solver.mechanism.unit(driver) == "m" else "rad"


def driver_senses(misfit: Misfit) -> Iterator[Hypothesis]:
    """A driver counted in the opposite direction, from zero or from its start."""
    for driver, state in misfit.evaluation.drivers().items():
        first = float(state[0][0])
        for about in dict.fromkeys((0.0, 2.0 * first)):
            suffix = "" if about == 0.0 else f" about {first:.6g} {_unit(misfit, driver)}, where it starts"

            def reversed_driver(_: Array, driver: str = driver, about: float = about) -> Values:
                return misfit.predicted(_once(misfit, driver, -1.0, about))

            yield Hypothesis(
                "sense",
                driver,
                DISCRETE,
                reversed_driver,
                lambda _, d=driver, suffix=suffix: f"{d} goes in the reversed sense{suffix}",
                by=lambda _: -1.0,
            )


def driver_degrees(misfit: Misfit) -> Iterator[Hypothesis]:
    """A driver's angle taken for degrees, or turned into them."""
    for driver in misfit.evaluation.drivers():
        if _unit(misfit, driver) == "m":
            factors = {1e3: "taken in mm for m", 1e-3: "taken in m for mm"}
            kind = "units"
        else:
            factors = {1.0 / DEG: "taken for degrees", DEG: "turned into degrees, where radians are meant"}
            kind = "degrees"
        for factor, description in factors.items():

            def scaled(_: Array, driver: str = driver, factor: float = factor) -> Values:
                return misfit.predicted(_once(misfit, driver, factor, 0.0))

            yield Hypothesis(
                kind,
                driver,
                DISCRETE,
                scaled,
                lambda _, d=driver, s=description: f"the coordinate of {d} is {s}",
                by=lambda _, f=factor: f,
            )


def driver_offsets(misfit: Misfit) -> Iterator[Hypothesis]:
    """A driver that stands a constant farther on."""
    for driver in misfit.evaluation.drivers():
        unit = _unit(misfit, driver)
        extent = misfit.evaluation.solver.mechanism.size if unit == "m" else 1.0

        def moved(p: Array, driver: str = driver) -> Values:
            return misfit.predicted(_driven(misfit.evaluation, {driver: _linear(1.0, p[0])}))

        def text(p: Array, driver: str = driver, unit: str = unit) -> str:
            also = f" ({np.rad2deg(p[0]):.4g} deg)" if unit == "rad" else ""
            return f"{driver} stands {p[0]:.6g} {unit}{also} farther on throughout"

        starts = ((0.0,), *_rolled(misfit)) if unit == "rad" else ((0.0,),)
        yield Hypothesis("offset", driver, NAMED, moved, text, starts=starts, steps=(1e-5 * extent,))


def _rolled(misfit: Misfit) -> tuple[tuple[float], ...]:
    """Return the offset, in samples of a full turn, at which exact values look most like the claims."""
    evaluation = misfit.evaluation
    if not evaluation.solver.motion_laws.crank or not evaluation.solver.crank_range().full:
        return ()
    angle, n = evaluation.angle, len(evaluation) - 1
    if n < 8 or np.ptp(np.diff(angle)) > 1e-9 or abs(abs(angle[-1] - angle[0]) - REVOLUTION) > 1e-9:
        return ()
    sizes = [
        np.sqrt(np.mean(misfit.errors([_turned_on(values, k) for values in misfit.exact]) ** 2))
        for k in range(n)
    ]
    best = int(np.argmin(sizes))
    if best in (0, 1, n - 1):
        return ()
    away = (angle[1] - angle[0]) * best
    return ((float((away + np.pi) % REVOLUTION - np.pi),),)


def _turned_on(values: Array, k: int) -> Array:
    once = np.roll(values[:-1], -k, axis=0)
    return np.concatenate([once, once[:1]])


def delays(misfit: Misfit) -> Iterator[Hypothesis]:
    """All that is claimed late, by samples or by a time; one program of several late."""
    yield from _by_samples(misfit)
    evaluation, motion_laws = misfit.evaluation, misfit.evaluation.solver.motion_laws
    if evaluation.time is None or (misfit.function and motion_laws.crank):
        return
    step = float(np.median(np.diff(evaluation.time)))

    def late(p: Array) -> Values:
        rate = evaluation.speed if motion_laws.crank else motion_laws.rate
        return misfit.predicted(
            replace(evaluation, angle=evaluation.angle - rate * p[0], time=evaluation.time - p[0])
        )

    def text(p: Array) -> str:
        return f"all is late by {p[0]:.6g} s, {p[0] / step:.4g} samples"

    starts = tuple((k * step,) for k in (0.0, 3.0, -3.0))
    if _goes_on(motion_laws):
        yield Hypothesis("delay", "", NAMED, late, text, starts=starts, steps=(1e-3 * step,))
    if len(motion_laws.drivers) > 1:
        for driver in motion_laws.drivers:
            yield _out_of_phase(misfit, driver, motion_laws.duration)


def _goes_on(motion_laws: MotionLaws) -> bool:
    """Whether motion laws are defined before time zero."""
    with np.errstate(all="ignore"):
        try:
            return all(
                np.isfinite(values).all()
                for values in motion_laws.state(np.array([-1e-3 * motion_laws.duration]))
            )
        except Exception:
            return False


def _by_samples(misfit: Misfit) -> Iterator[Hypothesis]:
    n = len(misfit.evaluation)
    best: tuple[float, int] | None = None
    for k in [*range(-LATE, 0), *range(1, LATE + 1)]:
        if abs(k) > n // 3:
            continue
        remaining = float(np.sqrt(np.mean(misfit.errors(_shifted(misfit, k), _known_rows(n, k)) ** 2)))
        if best is None or remaining < best[0]:
            best = remaining, k
    if best is None:
        return
    k = best[1]
    late = "late" if k > 0 else "early"
    yield Hypothesis(
        "delay",
        "samples",
        NAMED,
        lambda _: _shifted(misfit, k),
        lambda _: f"all is {abs(k)} samples {late}",
        by=lambda _: float(k),
        rows=_known_rows(n, k),
    )


def _shifted(misfit: Misfit, k: int) -> Values:
    return [np.roll(values, k, axis=0) for values in misfit.exact]


def _known_rows(n: int, k: int) -> Rows:
    rows = np.arange(n)
    return (rows >= k) & (rows < n + k)


def _out_of_phase(misfit: Misfit, driver: str, duration: float) -> Hypothesis:
    def late(p: Array) -> Values:
        return misfit.predicted(_driven(misfit.evaluation, {driver: _late(p[0])}))

    return Hypothesis(
        "phase",
        driver,
        NAMED,
        late,
        lambda p: f"the program of {driver} is out of phase, late by {p[0]:.6g} s",
        starts=tuple((k * duration,) for k in (0.0, 0.1, -0.1, 0.25, -0.25, 0.5)),
        steps=(1e-4 * duration,),
    )


def drivers_swapped(misfit: Misfit) -> Iterator[Hypothesis]:
    """Two drivers taken for each other."""
    motion_laws = misfit.evaluation.solver.motion_laws
    for first_driver, other in combinations(motion_laws.drivers, 2):
        if _unit(misfit, first_driver) != _unit(misfit, other):
            continue
        first, second = motion_laws.by_name[first_driver], motion_laws.by_name[other]

        def exchanged(
            _: Array,
            first_driver: str = first_driver,
            other: str = other,
            a: State = first,
            b: State = second,
        ) -> Values:
            def made() -> EvaluationPoints:
                return _driven(misfit.evaluation, {first_driver: lambda _: b, other: lambda _: a})

            solved = misfit.evaluation.variant(f"{first_driver} {other}", made)
            if solved is None:
                raise AssemblyError(f"{first_driver} and {other} cannot go so")
            return misfit.predicted(solved)

        what = f"{first_driver}, {other}"
        yield Hypothesis(
            "swapped", what, DISCRETE, exchanged, lambda _, w=what: f"the drivers {w} are swapped"
        )


EARTH = 9.81


def _dynamic_model(misfit: Misfit) -> dynamics.DynamicModel:
    return misfit.evaluation.dynamic_model or dynamics.dynamic_model(
        misfit.evaluation.solver, misfit.evaluation.solver.forces
    )


def _needs_forces(misfit: Misfit) -> bool:
    return any(candidate.quantity.loaded for candidate in misfit.candidates)


def _under(misfit: Misfit, vector: Array) -> Values:
    model = _dynamic_model(misfit)
    forces = replace(model.forces, gravity=tuple(vector.tolist()))
    return misfit.predicted(replace(misfit.evaluation, dynamic_model=model.with_forces(forces)))


def _gravity(misfit: Misfit) -> tuple[Array, float]:
    own = np.asarray(_dynamic_model(misfit).forces.gravity)
    return own, float(np.linalg.norm(own))


def other_gravity(misfit: Misfit) -> Iterator[Hypothesis]:
    """Gravity left out, reversed or along another axis."""
    if not _needs_forces(misfit):
        return
    own, extent = _gravity(misfit)
    others = [sign * (extent or EARTH) * np.eye(3)[i] for i in range(3) for sign in (1.0, -1.0)]
    was = ", ".join(f"{component:g}" for component in own)
    for vector in [np.zeros(3), *others]:
        if np.allclose(vector, own):
            continue
        components = ", ".join(f"{component:g}" for component in vector)
        yield Hypothesis(
            "gravity",
            components,
            DISCRETE,
            lambda _, v=vector: _under(misfit, v),
            lambda _, s=components: f"gravity is ({s}) m/s2 instead of ({was})",
            by=lambda _, v=vector: float(np.linalg.norm(v)),
        )


def gravity_size(misfit: Misfit) -> Iterator[Hypothesis]:
    """Gravity of another size."""
    if not _needs_forces(misfit):
        return
    own, extent = _gravity(misfit)
    if extent:
        yield Hypothesis(
            "gravity",
            "",
            NAMED,
            lambda p: _under(misfit, (1.0 + p[0]) * own),
            lambda p: f"gravity is {(1 + p[0]) * extent:.6g} m/s2 instead of {extent:.6g}",
            starts=((0.0,),),
            steps=(1e-3,),
        )


def masses(misfit: Misfit) -> Iterator[Hypothesis]:
    """One link's mass, with its moments of inertia or without, or all of them."""
    if not _needs_forces(misfit):
        return
    model = _dynamic_model(misfit)
    links = model.mechanism.links

    def heavier(names: set[str], factor: float, moments: bool) -> Values:
        changed = tuple(
            replace(link, inertia=_scaled(link.inertia, factor, moments))
            if link.name in names and link.inertia is not None
            else link
            for link in links
        )
        mechanism = replace(model.mechanism, links=changed)
        other = replace(model, mechanism=mechanism)
        return misfit.predicted(replace(misfit.evaluation, dynamic_model=other))

    every = {link.name for link in links}
    for what, names in [("", every), *((name, {name}) for name in every)]:
        links_text = f"link {what}" if what else "all links"
        for moments in (True, False):
            moments_text = " and its moments" if moments else ", not its moments,"
            yield Hypothesis(
                "mass",
                what,
                NAMED + (0.0 if moments else 0.1),
                lambda p, n=names, m=moments: heavier(n, 1.0 + float(p[0]), m),
                lambda p, links_text=links_text, moments_text=moments_text: (
                    f"the mass of {links_text}{moments_text} is {100 * p[0]:+.4g} % different"
                ),
                starts=((0.0,),),
                steps=(1e-3,),
            )


def _scaled(inertia: Inertia, factor: float, moments: bool) -> Inertia:
    rows = (
        tuple(tuple(factor * value for value in row) for row in inertia.moments)
        if moments
        else inertia.moments
    )
    return replace(inertia, mass=factor * inertia.mass, moments=rows)
