"""Statics of any mechanism: equilibria under its loads, and drive forces that hold a configuration."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import combinations, islice
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim.errors import AssemblyError, FrictionError, InputError
from mechsim.kinematics.loops.kinematics import Coordinates
from mechsim.kinetics.contacts import CLOSED_GAP
from mechsim.kinetics.curve_equilibria import (
    NO_LIMITS,
    EquilibriumCurve,
    curve_through,
    equal_forces,
    equilibria_on,
)
from mechsim.kinetics.dynamic_run import Initial, initial_values, require_regular
from mechsim.kinetics.equations_of_motion import EquationsOfMotion, equations_of_motion
from mechsim.kinetics.equilibrium_search import RestingState, all_at_rest, distinct, newton_equilibria, same
from mechsim.kinetics.gaps import GAP, gap_of, gaps_of, with_gaps
from mechsim.kinetics.initial_state import initial_state, projected
from mechsim.kinetics.linearization import (
    LinearModel,
    Mode,
    gradient,
    independent_rates,
    linear_model,
    reduced_forces,
)
from mechsim.kinetics.model import REPEATED, DynamicModel, dynamic_model
from mechsim.kinetics.passive_rotation import with_determined_motion
from mechsim.kinetics.state_quantities import (
    change_from,
    displacement_of,
    joined_configurations,
    load_displacement,
)
from mechsim.mechanism.actuators import Actuator
from mechsim.mechanism.forces import Forces
from mechsim.mechanism.joints import Coupling
from mechsim.mechanism.limits import Ranges, require_count
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.quantity import Quantity
from mechsim.numerics.arrays import EPS, REVOLUTION, Array, wrapped
from mechsim.numerics.newton import root

# components of initial rates of coordinates, displacements and ball joints
RATES = ("v", "vx", "vy", "vz", "w")
# default number of starts, reached by random steps along the motion of the mechanism
STARTS = 20
# largest number of starts: a four-bar takes some 5 ms for each
MAX_STARTS = 100_000
# number of additional random configurations for mechanisms without loops
RANDOM_CONFIGURATIONS = 10
# largest number of sets of stops that are tried for a mechanism with several degrees of freedom: three joints
# with two stops each have 26 sets, four have 80
STOP_SETS = 60
# largest number of sets of contacts and ropes that are open or slack while the others are closed: all sets of
# six; those to which forces and gaps of other sets lead are tried first
OPEN_SETS = 64
# tensile force of a contact, relative to the largest force of the contacts and ropes, that is rounding
NO_TENSION = 1e-9
# length of one of these random steps, in [rad] or characteristic lengths
RANDOM_STEP = 0.7
# rate of a driver that gives an impending motion its direction, in [rad/s] or [m/s]: its square is rounding
IMPENDING = 1e-10
# rate of drivers, relative to that of all coordinates, at a dead centre: loops close to 1e-14, and so
# determine a configuration there to 1e-7
DEAD_CENTRE = 1e-6


@dataclass(frozen=True, slots=True)
class Equilibrium:
    """A configuration at rest under the loads.

    Attributes:
        q: joint coordinate -> value in [m] or [rad]; angles within (-pi, pi], unless springs, gears or ropes
            count their revolutions.
        stable: whether small motions about it do not grow; None if rounding does not let it be decided.
        potential: potential energy of gravity and springs, in [J].
        modes: modes of small motions about it; none at a singular configuration.
        linear: the linear model about it.
        reached: whether the search along the motion from the initial configuration reaches it; otherwise it
            may be in another assembly mode.
        dimension: 0 for an isolated equilibrium; of a family, such as those of a table that turns freely, the
            number of independent directions along which it continues.
        everywhere: whether every configuration of the search is an equilibrium, as without loads.
        singular: whether the mechanism has more degrees of freedom there than next to it: small motions about
            it are not linear, and it is neither stable nor unstable by its linear model.
        stops: coordinate at a limit -> force of its stop on it, in [N m] or [N], which is part of the linear
            model; empty for an equilibrium without a stop. Modes leave these coordinates at rest.
        contacts: closed contact or taut rope -> force with which it pushes or pulls, in [N m] or [N].
        open: contacts that have lifted off, and slack ropes.
    """

    q: Mapping[str, float]
    stable: bool | None
    potential: float
    modes: tuple[Mode, ...]
    linear: LinearModel
    reached: bool = True
    dimension: int = 0
    everywhere: bool = False
    singular: bool = False
    stops: Mapping[str, float] = field(default_factory=dict[str, float])
    contacts: Mapping[str, float] = field(default_factory=dict[str, float])
    open: tuple[str, ...] = ()


def equilibria(
    source: Any,
    forces: Forces | None = None,
    *,
    initial: Mapping[str, Initial] | None = None,
    starts: int = STARTS,
    assemblies: int = 0,
    seed: int = 0,
) -> tuple[Equilibrium, ...]:
    """Return the equilibria of a mechanism, one of each family, by increasing potential.

    With one degree of freedom, all equilibria on the curve of assemblies through the initial configuration
    are found, as roots of the generalised force. Otherwise Newton's method starts at the initial
    configuration, and at `starts` others, each a random step along the motion from the one before; without
    loops also at ten random configurations. Both also start at `assemblies` random configurations that close
    the loops in any assembly mode. Coulomb friction is ignored; loads over time have their value at time
    zero. If every configuration of the search is an equilibrium, the initial one is returned. Equilibria
    beyond limits of joints are left out, and those at stops that press are added. With several degrees of
    freedom, the same search runs with coordinates locked at their limits: each alone, those together beyond
    which another equilibrium lies or that press, and more where there is none, in `STOP_SETS` sets at most.
    Contacts only push and ropes only pull: the search is repeated with those open or slack that would pull,
    push or overlap, and with each set of them, in `OPEN_SETS` sets at most.

    Args:
        source: a mechanism, or an object that has one.
        forces: applied forces; the default is those of the source.
        initial: coordinates `J.q` of the initial configuration.
        starts: number of random steps; 0, with `assemblies` 0, leaves only the initial configuration.
        assemblies: number of random configurations in any assembly mode.
        seed: seed of the random numbers.

    Raises:
        InputError: for invalid values, and for a singular initial configuration without loads.
        AssemblyError: where the loops do not close at the initial values.

    Accuracy: coordinates to about 1e-11 at a regular equilibrium.
    """
    model: DynamicModel = source if isinstance(source, DynamicModel) else dynamic_model(source, forces)
    for name, count in (("starts", starts), ("assemblies", assemblies)):
        require_count(f"{name} of the search", count, MAX_STARTS, "give fewer", least=0)
    search = starts, assemblies, seed
    laws, result, tried = _one_sided_laws(model.mechanism), list[Equilibrium](), list[set[str]]()
    every = (set(each) for count in range(len(laws) + 1) for each in combinations(laws, count))
    waiting = [next(every)]
    while waiting and len(tried) < OPEN_SETS:
        opened = waiting.pop()
        if opened not in tried:
            tried.append(opened)
            for each, wrong in _with_open(model, opened, initial or {}, search):
                if wrong:
                    waiting.append(opened ^ wrong)
                else:
                    result.append(replace(each, open=tuple(name for name in laws if name in opened)))
        waiting = waiting or [*islice(every, 1)]
    return tuple(sorted(result, key=lambda equilibrium: equilibrium.potential))


def _with_open(
    model: DynamicModel, opened: set[str], initial: Mapping[str, Initial], search: tuple[int, int, int]
) -> Iterator[tuple[Equilibrium, set[str]]]:
    """Yield equilibria with open contacts and slack ropes, all others closed and taut, and which are wrong.

    Those are wrong that would have to pull, or to push as a rope, and open ones that overlap.
    """
    laws = [law for name, law in _one_sided_laws(model.mechanism).items() if name in opened]
    couplings = tuple(law for law in model.mechanism.couplings if law not in laws)
    loops = prepared_equations(model, None, initial)[0].loops
    rows = [(i, row.coupling) for i, row in enumerate(loops.couplings) if row.coupling in laws]
    try:
        results = _with_closed_contacts(
            replace(model, mechanism=replace(model.mechanism, couplings=couplings)), initial, search
        )
    except (AssemblyError, InputError):
        # a link without mass moves freely
        if not opened:
            raise
        return
    for each in results:
        errors = loops.coupled(each.linear.q.values)[0][:, 0]
        gaps = [-errors[i] if law.rope else errors[i] for i, law in rows]
        names = [gap_of(model.mechanism, law).removesuffix(GAP) for _, law in rows]
        overlapping = {name for name, gap in zip(names, gaps, strict=True) if gap <= CLOSED_GAP}
        yield each, overlapping.union(_pulling(each.contacts))


def _with_closed_contacts(
    model: DynamicModel, initial: Mapping[str, Initial], search: tuple[int, int, int]
) -> list[Equilibrium]:
    """Return the equilibria with closed contacts and taut ropes, whatever the signs of their forces.

    `search` are the numbers of starts and assemblies, and the seed.
    """
    equations, initial_q = prepared_equations(model, None, initial)
    starts, assemblies, seed = search
    ranges = getattr(model.solver, "ranges", {})
    solutions = _searched(equations, initial_q, ranges, starts, assemblies, np.random.default_rng(seed))
    if solutions is None:
        require_regular(equations.kinematics(initial_q, np.zeros_like(initial_q.values)))
        dof = independent_rates(equations, initial_q).shape[1]
        return [_described(equations, RestingState(initial_q, True, dof, False), everywhere=dof > 0)]
    described = [_described(equations, each) for each in distinct(equations, solutions)]
    if ranges and independent_rates(equations, initial_q).shape[1] == 1:
        described += _at_stops(model, equations, initial_q, ranges)
    elif ranges:
        described += _at_several_stops(model, equations, search, described)
    return [each for each in described if not _beyond(model, each.q, ranges)]


def _one_sided_laws(mechanism: Mechanism) -> dict[str, Coupling]:
    """Return the laws of contacts that can only push, and of ropes, by their names."""
    gaps = {gap_of(mechanism, law): law for law in mechanism.couplings}
    return {gap.removesuffix(GAP): law for gap, law in gaps.items() if gap and not law.backlash}


def _pulling(contacts: Mapping[str, float]) -> list[str]:
    """Return the closed contacts, with their forces, that would have to pull, and the ropes to push."""
    largest = max(map(abs, contacts.values()), default=0.0)
    return [name for name, force in contacts.items() if force < -NO_TENSION * largest]


def _contact_forces(
    equations: EquationsOfMotion, q: Coordinates, drivers: Sequence[str] = ()
) -> dict[str, float]:
    """Return the forces of closed contacts and taut ropes that, with drivers, hold a configuration."""
    gaps = {name: name + GAP for name in _one_sided_laws(equations.model.mechanism)}
    forces = _holding_forces(*_opened(equations, q), [*gaps.values(), *drivers]) if gaps else {}
    return {name: forces[gap] for name, gap in gaps.items()}


@lru_cache(maxsize=REPEATED)
def _opening(model: DynamicModel) -> DynamicModel:
    return replace(model, mechanism=with_gaps(model.mechanism))


def _opened(equations: EquationsOfMotion, q: Coordinates) -> tuple[EquationsOfMotion, Coordinates]:
    """Return equations with the gaps of contacts and ropes as coordinates, and a configuration of both."""
    index_of, opened = equations.loops.tree.index_of, equations_of_motion(_opening(equations.model), {})
    names = opened.loops.tree.index_of
    values = [q.values[index_of[name]] if name in index_of else np.zeros(1) for name in names]
    return opened, Coordinates(np.array(values), q.turns)


def pulls_under(equations: EquationsOfMotion, q: Coordinates, load: Quantity) -> bool:
    """Whether a contact would have to pull, or a rope to push, where a load balances one degree of freedom.

    N' Q + (N' d) f + (N' g) F = 0 along the independent rates N of the opened mechanism, with the gradients
    of the load's displacement d and of the gaps g.
    """
    gaps = [name + GAP for name in _one_sided_laws(equations.model.mechanism)]
    if not gaps:
        return False
    opened, q = _opened(equations, q)
    basis, index_of = independent_rates(opened, q), opened.loops.tree.index_of
    rows = [np.searchsorted(opened.free, index_of[gap]) for gap in gaps]
    displacement = change_from(opened, opened.kinematics(q), load)
    along = np.vstack([gradient(opened, q, basis, displacement), basis[rows]])
    balance = reduced_forces(opened, q, basis[None]).force[0]
    forces = np.linalg.lstsq(along.T, -balance, rcond=None)[0][1:]
    return bool(_pulling(dict(zip(gaps, forces.tolist(), strict=True))))


def _beyond(model: DynamicModel, q: Mapping[str, float], ranges: Ranges) -> dict[str, float]:
    """Return coordinates beyond the ranges that they have, and their nearest limits.

    Angles count up to whole revolutions, unless the equilibrium differs by them.
    """
    limits: dict[str, float] = {}
    for name, (low, high) in ranges.items():
        if name in q:
            slides = model.mechanism.unit(name) == "m"
            slack = CLOSED_GAP * (model.mechanism.characteristic_length if slides else 1.0)
            # an angle beyond half a revolution differs from that before
            counted = slides or abs(q[name]) > np.pi
            value = q[name] if counted else low - slack + (q[name] - low + slack) % REVOLUTION
            if not low - slack <= value <= high + slack and np.isfinite(value):
                past, before = value - high, low - value + (0.0 if slides else REVOLUTION)
                limits[name] = high if value > high and (past <= before or slides) else low
    return limits


def _at_several_stops(
    model: DynamicModel,
    equations: EquationsOfMotion,
    search: tuple[int, int, int],
    beyond: Sequence[Equilibrium],
) -> Iterator[Equilibrium]:
    """Yield the equilibria at stops that press, of a mechanism with several degrees of freedom.

    Args:
        model: the model.
        equations: its equations of motion.
        search: numbers of starts and assemblies, and the seed.
        beyond: equilibria without stops.
    """
    (starts, assemblies, seed), ranges, tree = search, model.solver.ranges, equations.loops.tree
    limited = [name for name in ranges if name in tree.index_of]
    ends = [(name, end) for name in limited for end in ranges[name] if abs(end) < np.inf]
    first = equations.start.values[:, 0]
    at_start = {name: end for name, end in ends if abs(first[tree.index_of[name]] - end) <= CLOSED_GAP}
    waiting = [_beyond(model, each.q, ranges) for each in beyond]
    waiting += [at_start, *({name: end} for name, end in ends)]
    tried, resting = [dict[str, float]()], list[Coordinates]()
    while waiting and len(tried) <= STOP_SETS:
        limits = waiting.pop(0)
        if limits in tried:
            continue
        tried.append(limits)
        try:
            closed, start = prepared_equations(
                model, None, {f"{name}.q": limit for name, limit in limits.items()}
            )
        except (AssemblyError, InputError):
            # the loops do not close there
            continue
        locked = [closed.loops.tree.index_of[name] for name in limits]
        loops = replace(closed.loops, driven=(*closed.loops.driven, *locked))
        at_limits = replace(closed, loops=loops, start=start)
        moving = independent_rates(at_limits, start).shape[1] > 0
        random = np.random.default_rng(seed)
        solutions = _searched(at_limits, start, {}, starts, assemblies, random) if moving else None
        states = [RestingState(start, True, 0, False)]
        if moving:
            # everything is at rest, or nothing may be
            states = distinct(at_limits, [(start, True)] if solutions is None else solutions)
        if not states:
            waiting += [limits | {name: end} for name, end in ends if name not in limits]
        for state in states:
            further = _beyond(model, _coordinates(at_limits, state.q), ranges)
            if further:
                waiting.append(limits | further)
                continue
            stops = _holding_forces(equations, state.q, [*limits])
            sides = {name: 1.0 if end == ranges[name][0] else -1.0 for name, end in limits.items()}
            pressing = {name: end for name, end in limits.items() if stops[name] * sides[name] > 0.0}
            waiting.append(pressing)
            # coupled coordinates reach their limits together
            if pressing == limits and not any(same(equations, state.q, each) for each in resting):
                resting.append(state.q)
                stable = not moving or _described(at_limits, state).stable
                yield _at_rest_on(equations, state, stops, limits, stable)


def _holding_forces(equations: EquationsOfMotion, q: Coordinates, names: Sequence[str]) -> dict[str, float]:
    """Return the forces along coordinates that together hold a configuration at rest, in [N m] or [N]."""
    indices = [equations.loops.tree.index_of[name] for name in names]
    state = equations.kinematics(q, np.zeros((equations.loops.tree.count, 1)))
    none = np.zeros(len(equations.frictions))
    forces = equations.accelerate(state, np.zeros(1), none, (), indices).contact[:, 0]
    return dict(zip(names, (forces / equations.loops.units[indices]).tolist(), strict=True))


def _at_stops(
    model: DynamicModel, equations: EquationsOfMotion, start: Coordinates, ranges: Ranges
) -> Iterator[Equilibrium]:
    """Yield the equilibria on the curve of assemblies through a start at limits whose stop presses."""
    tree, limits = equations.loops.tree, limits_next_to(equations, start, ranges)
    curve = curve_through(equations, start, limits)
    intervals = np.arange(len(curve.lengths))
    ends = curve.configurations(intervals, curve.lengths)
    sides = [(name, *end) for name, own in ranges.items() for end in zip(own, (-1.0, 1.0), strict=True)]
    for name, limit, side in sides:
        index = tree.index_of.get(name)
        if index is None or not abs(limit) < np.inf:
            continue
        edge = float(limits[int(side > 0.0), index])
        target, counted = (edge, True) if abs(edge) < np.inf else (limit, bool(tree.slides[index]))

        def beyond(
            q: Coordinates, index: int = index, target: float = target, counted: bool = counted
        ) -> Array:
            away = q.values[index] - target
            return away if counted else wrapped(away)

        first, last = beyond(curve.q), beyond(ends)
        # an angle jumps by a revolution opposite the limit
        for k in np.flatnonzero(((first > 0.0) != (last > 0.0)) & (np.abs(first - last) < np.pi)):
            interval = intervals[k : k + 1]
            length = root(
                lambda u, interval=interval: float(beyond(curve.configurations(interval, np.array([u])))[0]),
                0.0,
                float(curve.lengths[k]),
            )
            q = curve.configurations(interval, np.array([length]))
            stops = _holding_forces(equations, q, [name])
            if stops[name] * side < 0.0:
                yield _at_rest_on(equations, RestingState(q, True, 0, False), stops, {name: limit}, True)


def _at_rest_on(
    equations: EquationsOfMotion,
    state: RestingState,
    stops: Mapping[str, float],
    limits: Mapping[str, float],
    stable: bool | None,
) -> Equilibrium:
    """Return an equilibrium with the forces of stops, and the limits of their coordinates."""
    model = equations.model
    balanced = replace(equations, model=model.with_forces(with_stops(model.forces, stops)))
    at_stop = _described(balanced, state)
    modes = () if state.singular else at_stop.linear.without(stops).modes
    return replace(at_stop, q={**at_stop.q, **limits}, stable=stable, modes=modes, stops=stops)


def limits_next_to(equations: EquationsOfMotion, q: Coordinates, ranges: Ranges) -> Array:
    """Return the limits of all coordinates in the revolutions of a configuration, (2, count).

    A coordinate that is beyond its limits in each revolution has none.
    """
    tree = equations.loops.tree
    limits = np.tile(NO_LIMITS, tree.count)
    for name, (low, high) in ranges.items():
        index = tree.index_of.get(name)
        if index is None:
            continue
        value, slack = float(q.values[index, 0]), CLOSED_GAP * float(equations.loops.units[index])
        away = np.clip(value, low - slack, high + slack) - value
        whole = 0.0 if tree.slides[index] else REVOLUTION * np.sign(away) * np.ceil(abs(away) / REVOLUTION)
        if low - slack <= value + whole <= high + slack:
            limits[:, index] = low - whole, high - whole
    return limits


def with_stops(forces: Forces, stops: Mapping[str, float]) -> Forces:
    """Return forces with those of stops, coordinate -> force in [N m] or [N]."""
    pressing = [
        Actuator(f"stop of {name}", {name: 1.0}, bias=(force, 0.0, 0.0)) for name, force in stops.items()
    ]
    return replace(forces, actuators=(*forces.actuators, *pressing))


def _searched(
    equations: EquationsOfMotion,
    q: Coordinates,
    ranges: Ranges,
    starts: int,
    assemblies: int,
    random: np.random.Generator,
) -> list[tuple[Coordinates, bool]] | None:
    """Return equilibria, and whether they are reached along the motion; None if everything is at rest.

    Curves of one degree of freedom end at the limits of `ranges`.
    """
    dof = independent_rates(equations, q).shape[1]
    if not dof:
        return None
    on_curve = starts > 0 and dof == 1
    # the curve leads through all steps: they only show whether everything is at rest
    alone = on_curve and equations.loops.rows and not assemblies and not all_at_rest(equations, q)
    starting = [*_starts(equations, q, 0 if alone else starts, assemblies, random)]
    if all_at_rest(equations, joined_configurations([each for each, _ in starting])):
        return None
    if on_curve:
        others = [] if alone else starting[starts + 1 :]
        starting = _on_curves(equations, ranges, [starting[0], *others])
    if not starting:
        return []
    downhill = np.repeat([False, True], len(starting))
    configurations = joined_configurations([each for each, _ in starting]).repeated(2)
    ends = newton_equilibria(equations, configurations, downhill)
    # those along the motion first
    order = np.arange(len(ends)).reshape(2, -1).T.ravel().tolist()
    return [(end, starting[k % len(starting)][1]) for k in order if (end := ends[k]) is not None]


def _on_curves(
    equations: EquationsOfMotion, ranges: Ranges, starting: Sequence[tuple[Coordinates, bool]]
) -> list[tuple[Coordinates, bool]]:
    """Return the equilibria on the curves of assemblies through configurations."""
    curves: list[EquilibriumCurve] = []
    solutions: list[tuple[Coordinates, bool]] = []
    for q, reached in starting:
        if any(curve.contains(q) for curve in curves) or independent_rates(equations, q).shape[1] != 1:
            continue
        curves.append(curve_through(equations, q, limits_next_to(equations, q, ranges)))
        on_curve = equilibria_on(curves[-1])
        count = 0 if on_curve is None else len(on_curve)
        solutions += [(on_curve.select(np.array([k])), reached) for k in range(count) if on_curve is not None]
    return solutions


def _starts(
    equations: EquationsOfMotion, q: Coordinates, starts: int, assemblies: int, random: np.random.Generator
) -> Iterator[tuple[Coordinates, bool]]:
    """Yield configurations, and whether they are reached along the motion from the first."""
    yield q, True
    for _ in range(starts):
        q = _random_step(equations, q, random)
        yield q, True
    for _ in range(assemblies if equations.loops.rows else RANDOM_CONFIGURATIONS if starts else 0):
        closed = _random_configuration(equations, q, random)
        if closed is not None:
            # without loops there is only one assembly mode
            yield closed, not equations.loops.rows


def modes(
    source: Any, forces: Forces | None = None, *, initial: Mapping[str, Initial] | None = None
) -> tuple[Mode, ...]:
    """Return the modes of small vibrations about an equilibrium; see `nearest_equilibrium`.

    Raises:
        AssemblyError: if there is no equilibrium.

    Accuracy: frequencies to about 1e-11 of their value at a regular equilibrium.
    """
    return nearest_equilibrium(source, forces, initial=initial).modes


def nearest_equilibrium(
    source: Any, forces: Forces | None = None, *, initial: Mapping[str, Initial] | None = None
) -> Equilibrium:
    """Return the equilibrium that Newton's method reaches from the initial configuration.

    If that is beyond limits, return the stable one of least potential energy that `equilibria` finds. Without
    `initial`, return that one also if it reaches none, an unstable one elsewhere, or one where a contact
    would have to pull or a rope to push.

    Raises:
        AssemblyError: if there is no such equilibrium.
    """
    equations, q = prepared_equations(source, forces, initial or {})
    (solution,), within = newton_equilibria(equations, q), True
    if solution is not None:
        nearest = _described(equations, distinct(equations, [(solution, True)])[0])
        requested = initial or nearest.stable is not False or same(equations, q, solution)
        within = not _beyond(equations.model, nearest.q, getattr(equations.model.solver, "ranges", {}))
        if requested and within and not _pulling(nearest.contacts):
            return nearest
    searched = () if initial and within else equilibria(source, forces, initial=initial)
    stable = [each for each in searched if each.stable]
    if not stable:
        raise AssemblyError(
            f"{equations.model.mechanism.name}: no equilibrium is found from the initial configuration; "
            "give another one (--initial J.q=VALUE), or list all with mechsim dynamics statics"
        )
    return stable[0]


def response(
    source: Any,
    load: str,
    output: str,
    frequencies: ArrayLike,
    forces: Forces | None = None,
    *,
    initial: Mapping[str, Initial] | None = None,
) -> NDArray[np.complex128]:
    """Return the frequency response from a unit load to a quantity about the nearest equilibrium, (n,).

    Args:
        source: a mechanism, or an object that has one.
        load: displacement on which the load does work: a joint coordinate "J" (torque or force in the
            joint), a component "P.x" of a point (force on it in that direction), or "distance:P,Q" (forces
            that push both points apart).
        output: quantity of the response: a displacement, its velocity or its acceleration, such as P.x or
            J.v.
        frequencies: (n,) in [Hz].
        forces: other applied forces; the default is those of the source.
        initial: coordinates `J.q` near the equilibrium.

    Returns:
        Output in SI per [N] or [N m].

    Raises:
        InputError: for an unknown name.
        AssemblyError: if there is no equilibrium.
    """
    nearest = nearest_equilibrium(source, forces, initial=initial)
    return response_about(nearest, load, output, frequencies)


def response_about(
    nearest: Equilibrium, load: str, output: str, frequencies: ArrayLike
) -> NDArray[np.complex128]:
    """Return the frequency response about an equilibrium as `response`, (n,)."""
    linear = nearest.linear.without(nearest.stops)
    equations = linear.equations
    mechanism = equations.model.mechanism
    displacement = load_displacement(load, mechanism)
    quantity, order = displacement_of(output, mechanism)
    at_rest = equations.kinematics(linear.q, np.zeros((equations.loops.tree.count, 1)))
    entry, reading = (change_from(equations, at_rest, each) for each in (displacement, quantity))
    frequencies = np.atleast_1d(np.asarray(frequencies, dtype=np.float64))
    derivative = np.asarray((2j * np.pi * frequencies) ** order, dtype=np.complex128)
    return derivative * linear.response(entry, reading, frequencies)


def holding(
    source: Any, forces: Forces | None = None, *, initial: Mapping[str, Initial] | None = None
) -> dict[str, float]:
    """Return the drive force of each driver that holds the initial configuration at rest, in [N m] or [N].

    For redundant drivers it is the minimum-norm solution.

    Raises:
        InputError: at a dead centre at which forces move the mechanism whatever the drivers' force, and where
            a contact would have to pull, or a rope to push.
    """
    equations, q = prepared_equations(source, forces, initial or {})
    drivers, index_of = equations.model.mechanism.drivers, equations.loops.tree.index_of
    basis, driven = (
        independent_rates(equations, q),
        np.isin(equations.free, [index_of[name] for name in drivers]),
    )
    _, rates, directions = np.linalg.svd(basis[driven], full_matrices=False)
    still = directions[rates < DEAD_CENTRE]
    along = reduced_forces(equations, q, basis[None]) if len(still) else None
    if along is not None and (np.abs(still @ along.force[0]) > along.rounding).any():
        raise InputError(
            f"{equations.model.mechanism.name}: no force in {', '.join(drivers)} holds the initial "
            "configuration, a dead centre; give another one"
        )
    if pulling := _pulling(_contact_forces(equations, q, drivers)):
        raise InputError(
            f"{equations.model.mechanism.name}: nothing holds the initial configuration, where "
            f"{', '.join(pulling)} would have to pull as a contact, or to push as a rope; give another one"
        )
    return _holding_forces(equations, q, drivers)


def holding_range(
    source: Any, forces: Forces | None = None, *, initial: Mapping[str, Initial] | None = None
) -> dict[str, tuple[float, float]]:
    """Return the least and largest drive force under which friction holds the configuration at rest.

    They are the forces by which motion is impending in both directions, with friction at rest: the driver
    moves forwards under more than the largest, and backwards under less than the least. If zero is between
    them, the mechanism is self-locking. A limit is infinite if friction jams the mechanism in its direction.

    Args:
        source: as for `holding`; it has one driver, and one degree of freedom.
        forces: as for `holding`.
        initial: initial coordinates of the configuration.

    Returns:
        Driver -> both forces, in [N m] or [N]; empty without Coulomb friction, or with several drivers.

    Raises:
        FrictionError: if friction at rest is undetermined.
        InputError: where a contact would have to pull, or a rope to push, in impending motion.
    """
    model: DynamicModel = source if isinstance(source, DynamicModel) else dynamic_model(source, forces)
    drivers, frictions = model.mechanism.drivers, model.forces.friction
    if len(drivers) != 1 or not any(friction.dry for friction in frictions):
        return {}
    (driver,) = drivers
    at_rest = tuple(friction.at_rest for friction in frictions)
    opened, gaps = with_gaps(model.mechanism), [name + GAP for name in _one_sided_laws(model.mechanism)]
    still = {f"{gap}.{letter}": 0.0 for gap in gaps_of(opened) for letter in "qv"}
    model = replace(model, mechanism=opened).with_forces(replace(model.forces, friction=at_rest))
    limits: list[float] = []
    for sign in (-1.0, 1.0):
        values = initial_values(model, {**(initial or {}), **still, f"{driver}.v": sign * IMPENDING})
        equations = equations_of_motion(model, {**values.coordinates, driver: 0.0})
        q, rates = initial_state(equations, values)
        state = with_determined_motion(equations.kinematics(q, rates))
        equations, index_of = state.equations, state.equations.loops.tree.index_of
        index = index_of[driver]
        sliding = np.sign(equations.friction_rates(state)[:, 0])
        try:
            closed = [index, *(index_of[gap] for gap in gaps_of(opened))]
            force, *contacts = (
                equations.accelerate(state, np.zeros(1), sliding, (), closed).contact[:, 0].tolist()
            )
        except FrictionError as error:
            if error.outcome != "jammed":
                raise
            force = sign * np.inf * equations.loops.units[index]
            contacts = []
        acting = dict(zip(gaps_of(opened), contacts, strict=False))
        if pulling := _pulling({gap.removesuffix(GAP): acting[gap] for gap in gaps if acting}):
            raise InputError(
                f"{model.mechanism.name}: where motion of {driver} is impending, {', '.join(pulling)} would "
                "have to pull as a contact, or to push as a rope, so that the range does not end there; give "
                "another configuration"
            )
        limits.append(float(force / equations.loops.units[index]))
    return {driver: (limits[0], limits[1])}


def prepared_equations(
    source: Any, forces: Forces | None, initial: Mapping[str, Initial]
) -> tuple[EquationsOfMotion, Coordinates]:
    """Return the equations of motion of a mechanism and its initial configuration.

    Raises:
        InputError: for an initial rate, which a mechanism at rest does not have.
    """
    for name in initial:
        if name.rpartition(".")[2] in RATES:
            raise InputError(
                f"initial rate {name} has no effect, since equilibria and small motions are about rest; "
                "leave it out, or run the mechanism (mechsim dynamics forward)"
            )
    model: DynamicModel = source if isinstance(source, DynamicModel) else dynamic_model(source, forces)
    values = initial_values(model, initial)
    limited = dict.fromkeys(getattr(model.solver, "ranges", {}), 0.0)
    equations = equations_of_motion(model, {**limited, **values.coordinates})
    q, rates = initial_state(equations, values)
    if _one_sided_laws(model.mechanism) and not independent_rates(equations, q).size:
        # only contacts and ropes hold it
        return equations, q
    return with_determined_motion(equations.kinematics(q, rates)).equations, q


def _described(equations: EquationsOfMotion, state: RestingState, everywhere: bool = False) -> Equilibrium:
    linear = linear_model(equations, state.q, isolated=not state.dimension)
    at_rest = np.zeros((equations.loops.tree.count, 1))
    _, potential = equations.energy(equations.kinematics(state.q, at_rest))
    # of the energy that stiffness stores over a radian or the size of the mechanism
    rounding = EPS * float(np.abs(linear.stiffness).max(initial=0.0))
    return Equilibrium(
        q=_coordinates(equations, state.q),
        stable=None if state.singular else linear.stable(in_family=state.dimension > 0),
        potential=potential if abs(potential) > rounding else 0.0,
        modes=() if state.singular else linear.modes,
        linear=linear,
        reached=state.reached,
        dimension=state.dimension,
        everywhere=everywhere,
        singular=state.singular,
        contacts=_contact_forces(equations, state.q),
    )


def _coordinates(equations: EquationsOfMotion, q: Coordinates) -> dict[str, float]:
    """Return joint coordinates in [m] and [rad].

    Angles are within (-pi, pi], unless springs, servos, stops or gears distinguish them after revolutions.
    """
    tree, loops, values = equations.loops.tree, equations.loops, q.values
    angles = np.flatnonzero(~tree.slides & (np.abs(values[:, 0]) > np.pi))
    basis = independent_rates(equations, q) if len(angles) else values
    for i in angles:
        wound = values.copy()
        wound[i] = wrapped(wound[i])
        free = [row.has_revolutions for row in loops.couplings]
        change = loops.coupled(wound)[0] - loops.coupled(values)[0]
        change[free] = wrapped(change[free])
        if np.abs(change).max(initial=0.0) < CLOSED_GAP and equal_forces(equations, q, wound, basis):
            values = wound
    return {name: float(values[i, 0]) for name, i in tree.index_of.items()}


def _random_configuration(
    equations: EquationsOfMotion, q: Coordinates, random: np.random.Generator
) -> Coordinates | None:
    """Return a configuration in any assembly mode: random coordinates closed by Newton's method; or None."""
    from scipy.spatial.transform import Rotation

    tree = equations.loops.tree
    values = (np.where(tree.slides, tree.length, np.pi) * random.uniform(-1.0, 1.0, tree.count))[:, None]
    turns = q.turns.copy()
    for k in range(len(turns)):
        turns[k, ..., 0] = Rotation.random(rng=random).as_matrix()
    try:
        return projected(equations, Coordinates(values, turns), 0.0 * values, np.zeros(1))[0]
    except (AssemblyError, np.linalg.LinAlgError):
        return None


def _random_step(equations: EquationsOfMotion, q: Coordinates, random: np.random.Generator) -> Coordinates:
    """Return a configuration after a random step along the motion; shorter if the loops do not close."""
    basis = independent_rates(equations, q)
    direction = random.normal(size=basis.shape[1])
    step = np.zeros((equations.loops.tree.count, 1))
    step[equations.free, 0] = basis @ (RANDOM_STEP * direction / max(float(np.linalg.norm(direction)), 1e-12))
    try:
        for _ in range(4):
            q, _ = projected(equations, equations.loops.displaced(q, 0.25 * step), 0.0 * step, np.zeros(1))
    except AssemblyError:
        return q
    return q
