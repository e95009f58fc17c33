"""Initial configuration and velocity of a mechanism from values of any of its joint coordinates."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mechsim.analytic.dynamics.equations_of_motion import EquationsOfMotion, with_locked_rows
from mechsim.analytic.loops.kinematics import Coordinates
from mechsim.analytic.loops.start import CLOSED, close_nearest
from mechsim.errors import AssemblyError, InputError
from mechsim.numerics.arrays import Array
from mechsim.numerics.rank import RANK_TOLERANCE

# largest step of a coordinate towards its initial value, in [rad] or characteristic lengths: the linear model
# of the loops is valid for several times that
STEP = 0.05
# relative error of rates above which their requested values contradict the loops
CONSISTENT = 1e-9


@dataclass(frozen=True, slots=True)
class InitialValues:
    """Requested coordinates in [m] or [rad], and rates per second, by coordinate name."""

    coordinates: Mapping[str, float]
    rates: Mapping[str, float]


def initial_state(equations: EquationsOfMotion, values: InitialValues) -> tuple[Coordinates, Array]:
    """Return coordinates and rates in units, (count, 1), that satisfy the loops and the requested values.

    The coordinates move to their values in short steps from the assembled configuration, within its assembly
    mode. Coordinates and rates that neither the values nor the loops determine change as little as possible.

    Raises:
        AssemblyError: where the loops do not close at the values.
        InputError: for values that contradict one another or the loops.
    """
    for name in equations.prescribed:
        if name in values.coordinates or name in values.rates:
            raise InputError(
                f"{equations.model.mechanism.name}: {name!r} follows its motion law; "
                "leave its initial value out"
            )
    value, rate, _ = equations.prescribed_motion(np.zeros(1))
    units = equations.loops.units[equations.prescribed_indices]
    first = dict(zip(equations.prescribed, (value[:, 0] * units).tolist(), strict=True))
    first_rates = dict(zip(equations.prescribed, (rate[:, 0] * units).tolist(), strict=True))
    q = _moved(equations, {**values.coordinates, **first})
    return q, _rates(equations, q, {**values.rates, **first_rates})


def projected(
    equations: EquationsOfMotion, q: Coordinates, rates: Array, times: Array
) -> tuple[Coordinates, Array]:
    """Return the n closed configurations and consistent rates nearest to given ones, at times (n,) in [s].

    Raises:
        AssemblyError: if Newton's method does not close the loops.
    """
    value, rate, _ = equations.prescribed_motion(times)
    q = _closed(equations, q, equations.prescribed_indices, value)
    loop_jacobian = equations.loops.linearise(q)[1][:, equations.free].transpose(2, 0, 1)
    jacobian = with_locked_rows(equations, loop_jacobian, equations.prescribed_indices)
    rates = rates.copy()
    violation = jacobian @ rates[equations.free].T[..., None]
    violation[:, loop_jacobian.shape[1] :, 0] -= rate.T
    rates[equations.free] -= (np.linalg.pinv(jacobian, rcond=RANK_TOLERANCE) @ violation)[..., 0].T
    return q, rates


def _moved(equations: EquationsOfMotion, coordinates: Mapping[str, float]) -> Coordinates:
    indices = [_index(equations, name) for name in coordinates]
    units = equations.loops.units[indices]
    target = np.array([*coordinates.values()]) / units
    q = equations.start
    begin = q.values[indices, 0] / units
    steps = max(1, int(np.ceil(np.abs(target - begin).max(initial=0.0) / STEP)))
    for k in range(1, steps + 1):
        q = _closed(equations, q, indices, (begin + (target - begin) * (k / steps))[:, None])
    return q


def _closed(
    equations: EquationsOfMotion, q: Coordinates, indices: Sequence[int] = (), values: Array | float = 0.0
) -> Coordinates:
    """Return coordinates with closed loops, some at values (k, n) in units; the others change least."""
    loops = equations.loops
    if len(indices):
        q = Coordinates(q.values.copy(), q.turns)
        q.values[list(indices)] = values * loops.units[list(indices)][:, None]
        loops = replace(loops, driven=(*loops.driven, *indices))
    q, gap = close_nearest(loops, q)
    if not (gap <= CLOSED).all():
        name = equations.model.mechanism.name
        raise AssemblyError(
            f"{name}: the loops do not close at the initial values (a gap of {gap.max():.3g} of the longest "
            "link is left); give values within the range of motion, of independent coordinates only"
        )
    return q


def _rates(equations: EquationsOfMotion, q: Coordinates, rates: Mapping[str, float]) -> Array:
    loops, free = equations.loops, equations.free
    indices = [_index(equations, name) for name in rates]
    requested = np.array([*rates.values()]) / loops.units[indices]
    rows = np.concatenate([loops.linearise(q)[1][:, :, 0], np.eye(loops.tree.count)[indices]])[:, free]
    right = np.concatenate([np.zeros(loops.rows), requested])
    result = np.zeros((loops.tree.count, 1))
    result[free, 0] = np.linalg.pinv(rows, rcond=RANK_TOLERANCE) @ right
    violation = np.abs(rows @ result[free, 0] - right).max(initial=0.0)
    if violation > CONSISTENT * max(np.abs(requested).max(initial=0.0), np.finfo(float).tiny):
        raise InputError(
            f"{equations.model.mechanism.name}: the initial rates of {', '.join(rates)} contradict the "
            "loops; give those of independent coordinates only"
        )
    return result


def _index(equations: EquationsOfMotion, name: str) -> int:
    index_of = equations.loops.tree.index_of
    mechanism = equations.model.mechanism
    if name in index_of and name not in mechanism.locked:
        return index_of[name]
    if name in mechanism.locked:
        raise InputError(f"{mechanism.name}: joint {name!r} is locked; leave its initial value out")
    names = ", ".join(coordinate for joint in mechanism.joints for coordinate in joint.coordinates)
    if name in names.split(", "):
        raise InputError(
            f"{mechanism.name}: {name!r} and the other coordinates with initial values close a loop among "
            "themselves; leave one of them out"
        )
    raise InputError(f"{mechanism.name} has no joint coordinate {name!r}; it has {names}")
