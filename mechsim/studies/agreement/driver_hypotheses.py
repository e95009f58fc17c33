"""Hypotheses on drivers and loads: direction, offset, degrees, delay, phase, swaps, gravity, masses."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import partial
from itertools import combinations

import numpy as np

from mechsim.errors import AssemblyError
from mechsim.mechanism.motion_laws import MotionLaws, State
from mechsim.numerics.arrays import REVOLUTION, Array, rms, wrapped
from mechsim.studies.agreement.evaluation_points import Values
from mechsim.studies.agreement.misfit import Hypothesis, Misfit
from mechsim.studies.motions import scaled_law

DEG = 180.0 / np.pi
# largest delay that is tried, in samples
MAX_DELAY = 12
# largest distance of a driver from its motion law, in [rad] or relative to the mechanism's size
MAX_DISPLACEMENT = 2.5
# standard gravity in [m/s2], used if the model has none
STANDARD_GRAVITY = 9.81


def _under_other_laws(misfit: Misfit, changes: Mapping[str, Callable[[State], State]]) -> Values:
    """Return predicted values under other motion laws: driver -> change of its law.

    Raises:
        AssemblyError: for a motion that cannot be assembled.
    """
    evaluation = misfit.evaluation
    solver, motion_laws = evaluation.solver, evaluation.solver.motion_laws
    if motion_laws.crank:
        crank = solver.mechanism.crank.name
        steady = evaluation.angle, evaluation.speed, evaluation.acceleration
        if crank in changes:
            steady = changes[crank](lambda _: steady)(evaluation.angle)
        angle, speed, acceleration = steady
        displacement = angle - solver.mechanism.start
        if solver.crank_range().full and not np.abs(displacement).max() < 2.5 * solver.period:
            # a periodic motion is moved to the start by whole periods
            angle = solver.mechanism.start + displacement % solver.period
        return misfit.predicted(replace(evaluation, angle=angle, speed=speed, acceleration=acceleration))
    joints = dict(evaluation.motion.joints)
    time = motion_laws.instants(evaluation.angle)
    for name, change in changes.items():
        state = change(motion_laws.by_name[name])(time)
        value, rate, second = (np.broadcast_to(values, time.shape) for values in state)
        unit = misfit.length if solver.mechanism.unit(name) == "m" else 1.0
        if not np.abs(value - joints[name].value).max() < MAX_DISPLACEMENT * unit:
            raise AssemblyError(f"{name} would leave the range in which motion laws are followed")
        joints[name] = replace(joints[name], value=value, rate=rate, acceleration=second)
    solved = solver.solve_as(replace(evaluation.motion, joints=joints))
    return misfit.predicted(replace(evaluation, solved=solved))


def _scaled_driver(misfit: Misfit, driver: str, scale: float, offset: float) -> Values:
    return _under_other_laws(misfit, {driver: lambda law: scaled_law(law, scale, offset)})


def driver_directions(misfit: Misfit) -> Iterator[Hypothesis]:
    """Yield hypotheses of a driver with the opposite direction, about zero or about its start."""
    unit = misfit.evaluation.solver.mechanism.unit
    for driver, state in misfit.evaluation.drivers().items():
        first = float(state[0][0])
        for about in dict.fromkeys((0.0, 2.0 * first)):
            suffix = "" if about == 0.0 else f" about its start, {first:.6g} {unit(driver)}"
            text = f"{driver} moves in the opposite direction{suffix}"
            yield Hypothesis(
                "sense", driver, partial(_scaled_driver, misfit, driver, -1.0, about), text, -1.0
            )


def driver_degrees(misfit: Misfit) -> Iterator[Hypothesis]:
    """Yield hypotheses of confused units of a driver: degrees and radians, or mm and m."""
    for driver in misfit.evaluation.drivers():
        kind = "degrees"
        factors = {1.0 / DEG: "taken for degrees", DEG: "converted to degrees instead of radians"}
        if misfit.evaluation.solver.mechanism.unit(driver) == "m":
            kind, factors = "units", {1e3: "taken in mm for m", 1e-3: "taken in m for mm"}
        for factor, description in factors.items():
            predict = partial(_scaled_driver, misfit, driver, factor, 0.0)
            yield Hypothesis(kind, driver, predict, f"the coordinate of {driver} is {description}", factor)


def driver_offsets(misfit: Misfit) -> Iterator[Hypothesis]:
    """Yield hypotheses of a constant offset of a driver."""
    for driver in misfit.evaluation.drivers():
        angle = misfit.evaluation.solver.mechanism.unit(driver) == "rad"

        def text(offset: float, driver: str = driver, angle: bool = angle) -> str:
            amount = f"{offset:.6g} rad ({np.rad2deg(offset):.4g} deg)" if angle else f"{offset:.6g} m"
            return f"{driver} has a constant offset of {amount}"

        predict = partial(_scaled_driver, misfit, driver, 1.0)
        step, starts = (1e-5, (0.0, *_best_roll(misfit))) if angle else (1e-5 * misfit.length, (0.0,))
        yield Hypothesis("offset", driver, predict, text, steps=(step,), starts=starts)


def _best_roll(misfit: Misfit) -> tuple[float, ...]:
    """Return the offset, in samples of a revolution, at which exact values match the candidates best."""
    evaluation = misfit.evaluation
    if not evaluation.solver.motion_laws.crank or not evaluation.solver.crank_range().full:
        return ()
    angle, n = evaluation.angle, len(evaluation) - 1
    if n < 8 or np.ptp(np.diff(angle)) > 1e-9 or abs(abs(angle[-1] - angle[0]) - REVOLUTION) > 1e-9:
        return ()

    rows = [(np.arange(n + 1) + k) % n for k in range(n)]
    sizes = [rms(misfit.errors([values[rolled] for values in misfit.exact])) for rolled in rows]
    best = int(np.argmin(sizes))
    return () if best in (0, 1, n - 1) else (float(wrapped((angle[1] - angle[0]) * best)),)


def delays(misfit: Misfit) -> Iterator[Hypothesis]:
    """Yield hypotheses of a delay of all candidates, by samples or by a time, or of one motion law."""
    yield from _by_samples(misfit)
    evaluation, motion_laws = misfit.evaluation, misfit.evaluation.solver.motion_laws
    if evaluation.time is None or (misfit.function and motion_laws.crank):
        return
    time, step = evaluation.time, float(np.median(np.diff(evaluation.time)))

    def late(lag: float) -> Values:
        rate = evaluation.speed if motion_laws.crank else motion_laws.rate
        return misfit.predicted(replace(evaluation, angle=evaluation.angle - rate * lag, time=time - lag))

    if _starts_earlier(motion_laws):
        yield Hypothesis(
            "delay",
            "",
            late,
            lambda lag: f"all is late by {lag:.6g} s, {lag / step:.4g} samples",
            steps=(1e-3 * step,),
            starts=(0.0, 3.0 * step, -3.0 * step),
        )
    if len(motion_laws.drivers) > 1:
        for driver in motion_laws.drivers:
            yield _out_of_phase(misfit, driver, motion_laws.duration)


def _starts_earlier(motion_laws: MotionLaws) -> bool:
    """Whether motion laws are defined before time zero."""
    with np.errstate(all="ignore"), suppress(Exception):
        states = motion_laws.state(np.array([-1e-3 * motion_laws.duration]))
        return all(np.isfinite(values).all() for values in states)
    return False


def _by_samples(misfit: Misfit) -> Iterator[Hypothesis]:
    """Yield the delay by whole samples that explains most; rows without data at the ends do not count."""
    n = len(misfit.evaluation)
    rows = np.arange(n)
    data = {k: (rows >= k) & (rows < n + k) for k in range(-MAX_DELAY, MAX_DELAY + 1) if 0 < abs(k) <= n // 3}
    if data:
        shifted = {k: [np.roll(values, k, axis=0) for values in misfit.exact] for k in data}
        best = min(data, key=lambda k: rms(misfit.errors(shifted[k], data[k])))
        text = f"all is {abs(best)} samples {'late' if best > 0 else 'early'}"
        yield Hypothesis(
            "delay", "samples", lambda: shifted[best], text, float(best), rows=data[best], rank=1.0
        )


def _out_of_phase(misfit: Misfit, driver: str, duration: float) -> Hypothesis:
    return Hypothesis(
        "phase",
        driver,
        lambda lag: _under_other_laws(misfit, {driver: lambda state: lambda time: state(time - lag)}),
        lambda lag: f"the motion law of {driver} is out of phase, late by {lag:.6g} s",
        steps=(1e-4 * duration,),
        starts=tuple(fraction * duration for fraction in (0.0, 0.1, -0.1, 0.25, -0.25, 0.5)),
    )


def drivers_swapped(misfit: Misfit) -> Iterator[Hypothesis]:
    """Yield hypotheses of two swapped drivers."""
    laws = misfit.evaluation.solver.motion_laws
    for first, second in combinations(laws.drivers, 2):
        units = {misfit.evaluation.solver.mechanism.unit(driver) for driver in (first, second)}
        if len(units) == 1:
            swapped = {first: lambda _, s=laws.by_name[second]: s, second: lambda _, s=laws.by_name[first]: s}
            predict = partial(_under_other_laws, misfit, swapped)
            what = f"{first}, {second}"
            yield Hypothesis("swapped", what, predict, f"the drivers {what} are swapped")


def _under_gravity(misfit: Misfit, vector: Array) -> Values:
    model = misfit.evaluation.loaded_model
    forces = replace(model.forces, gravity=tuple(vector.tolist()))
    return misfit.predicted(replace(misfit.evaluation, dynamic_model=model.with_forces(forces)))


def other_gravity(misfit: Misfit) -> Iterator[Hypothesis]:
    """Yield hypotheses of gravity left out, reversed or along another axis."""
    if not misfit.needs_forces:
        return
    own = np.asarray(misfit.evaluation.loaded_model.forces.gravity)
    magnitude = float(np.linalg.norm(own)) or STANDARD_GRAVITY
    axes = [sign * magnitude * axis for axis in np.eye(3) for sign in (1.0, -1.0)]
    was = ", ".join(f"{component:g}" for component in own)
    for vector in [np.zeros(3), *axes]:
        if not np.allclose(vector, own):
            components = ", ".join(f"{component:g}" for component in vector)
            text = f"gravity is ({components}) m/s2 instead of ({was})"
            predict = partial(_under_gravity, misfit, vector)
            yield Hypothesis("gravity", components, predict, text, float(np.linalg.norm(vector)))


def gravity_size(misfit: Misfit) -> Iterator[Hypothesis]:
    """Yield the hypothesis of another magnitude of gravity."""
    own = np.asarray(misfit.evaluation.loaded_model.forces.gravity) if misfit.needs_forces else np.zeros(3)
    if magnitude := float(np.linalg.norm(own)):
        yield Hypothesis(
            "gravity",
            "",
            lambda change: _under_gravity(misfit, (1.0 + change) * own),
            lambda change: f"gravity is {(1 + change) * magnitude:.6g} m/s2 instead of {magnitude:.6g}",
            steps=(1e-3,),
        )


def masses(misfit: Misfit) -> Iterator[Hypothesis]:
    """Yield hypotheses of another mass of one link or of all links, with or without moments of inertia."""
    if not misfit.needs_forces:
        return
    names = [link.name for link in misfit.evaluation.loaded_model.mechanism.links]
    for what in ("", *names):
        for moments in (True, False):
            yield _other_mass(misfit, what, {what} if what else {*names}, moments)


def _other_mass(misfit: Misfit, what: str, names: set[str], moments: bool) -> Hypothesis:
    model = misfit.evaluation.loaded_model

    def predict(change: float) -> Values:
        factor, links = 1.0 + change, list(model.mechanism.links)
        for i, link in enumerate(links):
            if link.name in names and (own := link.inertia) is not None:
                heavier = replace(own, mass=factor * own.mass)
                if moments:
                    rows = tuple(tuple(factor * value for value in row) for row in own.moments)
                    heavier = replace(heavier, moments=rows)
                links[i] = replace(link, inertia=heavier)
        loaded = replace(model, mechanism=replace(model.mechanism, links=tuple(links)))
        return misfit.predicted(replace(misfit.evaluation, dynamic_model=loaded))

    def text(change: float) -> str:
        of_links = f"link {what}" if what else "all links"
        also = " and its moments" if moments else ", not its moments,"
        return f"the mass of {of_links}{also} is {100 * change:+.4g} % different"

    return Hypothesis("mass", what, predict, text, steps=(1e-3,), rank=0.0 if moments else 0.1)
