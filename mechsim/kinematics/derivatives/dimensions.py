"""Derivatives of the numbers of a mechanism by its dimensions."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cache, cached_property
from typing import Any

import numpy as np

from mechsim.errors import InputError, MechsimError
from mechsim.kinematics.designs import DesignFamily, Dimension
from mechsim.mechanism.coupling_functions import TabledFunction, WrittenFunction
from mechsim.mechanism.forces import Forces, Friction, JointSpring, Load, Spring
from mechsim.mechanism.joints import Coupling, End, Joint
from mechsim.mechanism.links import Inertia, Link
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.nonlinear_springs import Bushing, NonlinearSpring, SoftStop, SpringLaw
from mechsim.numerics.arrays import Array

# fields with numbers on which motions and forces depend, besides those of curves and cams (NUMBERS); load
# profiles over angle or time have none
NUMBER_FIELDS: Mapping[type, tuple[str, ...]] = {
    Joint: ("a", "b", "cross_angle", "length"),
    End: ("point", "axis", "reference"),
    Coupling: ("left", "right", "coefficients", "zeros", "pressure_angle", "function"),
    WrittenFunction: ("values",),
    TabledFunction: ("positions", "targets"),
    Link: ("inertia",),
    Inertia: ("mass", "centre", "moments"),
    Forces: (
        *("gravity", "flywheel", "friction", "springs", "joint_springs", "nonlinear_springs"),
        *("bushings", "loads"),
    ),
    Friction: ("viscous", "coulomb", "viscous_turn", "coulomb_turn"),
    Spring: ("a", "b", "stiffness", "rest", "damping"),
    JointSpring: ("stiffness", "rest"),
    NonlinearSpring: ("ends", "law"),
    SoftStop: ("limit", "stiffness", "damping", "exponent", "hysteresis"),
    SpringLaw: ("stiffness", "rest", "damping", "preload", "values", "table"),
    Bushing: ("a", "b", "stiffness", "damping"),
    Load: ("location",),
}


@dataclass(frozen=True)
class GivenMechanism(Mechanism):
    """A mechanism with given numbers and characteristic length, without checks: numbers can be complex.

    All couplings, with those of gears and screws, are `couplings`.
    """

    given_length: float = 1.0

    def __post_init__(self) -> None: ...

    @cached_property
    def characteristic_length(self) -> float:
        """Its given characteristic length, in [m]."""
        return self.given_length

    @property
    def laws(self) -> tuple[Coupling, ...]:
        """All couplings, with those of gears and screws."""
        return self.couplings


@cache
def _unchecked(kind: type) -> type:
    """Return a class of descriptions without its checks, because numbers can be complex."""
    members: dict[str, Any] = {"__slots__": (), "__post_init__": lambda _: None}
    if kind is End:
        # not cached: equal real and complex numbers are the same key of a cache
        members["frame"] = property(
            lambda end: np.column_stack([end.reference, np.cross(end.axis, end.reference), end.axis])
        )
    return type(kind.__name__, (kind,), members)


def _with_each(description: Any, number: Callable[[float], Any]) -> Any:
    """Return a description with each of its numbers replaced by a function of it."""
    if isinstance(description, int | float):
        return number(float(description))
    if isinstance(description, tuple):
        return tuple(_with_each(entry, number) for entry in description)
    if isinstance(description, Mapping):
        return {key: _with_each(entry, number) for key, entry in description.items()}
    kind = next((kind for kind in NUMBER_FIELDS if isinstance(description, kind)), None)
    names = getattr(description, "NUMBERS", ()) if kind is None else NUMBER_FIELDS[kind]
    if not names:
        return description
    kind = kind or type(description)
    copy: Any = object.__new__(_unchecked(kind))
    for name in (entry.name for entry in fields(kind)):
        value = getattr(description, name)
        object.__setattr__(copy, name, _with_each(value, number) if name in names else value)
    return copy


def numbers_in(description: object) -> Array:
    """Return the numbers in a description, such as forces, (k,) in SI; those of load profiles not."""
    numbers: list[float] = []

    def listed(number: float) -> float:
        numbers.append(number)
        return number

    _with_each(description, listed)
    return np.array(numbers)


def renumbered(description: Any, numbers: Array) -> Any:
    """Return a description with other numbers, (k,) in the order of `numbers_in`."""
    following = iter(numbers.tolist())
    return _with_each(description, lambda _: next(following))


def _described(mechanism: Mechanism) -> tuple[object, ...]:
    return mechanism.joints, mechanism.links, mechanism.points, mechanism.locked, mechanism.laws


def numbers_of(mechanism: Mechanism) -> Array:
    """Return all numbers on which the motion and the forces of a mechanism depend, (k,) in SI."""
    return numbers_in(_described(mechanism))


def with_numbers(mechanism: Mechanism, numbers: Array) -> GivenMechanism:
    """Return a mechanism with other numbers, (k,) in the order of `numbers_of`, complex or real.

    Its characteristic length stays that of the original.
    """
    joints, links, points, locked, laws = renumbered(_described(mechanism), numbers)
    own = {field.name: getattr(mechanism, field.name) for field in fields(mechanism)}
    own |= {"joints": joints, "links": links, "points": points, "locked": locked, "gears": ()}
    own |= {"couplings": laws, "given_length": mechanism.characteristic_length}
    return GivenMechanism(**own)


# weights of the values 1 to 4 steps ahead (and negative ones behind), divided by the step
EIGHTH = np.array([4.0 / 5.0, -1.0 / 5.0, 4.0 / 105.0, -1.0 / 280.0])
SIXTH = np.array([3.0 / 4.0, -3.0 / 20.0, 1.0 / 60.0, 0.0])
ONE_SIDED = np.array([4.0, -3.0, 4.0 / 3.0, -1.0 / 4.0])
# steps as powers of two times the scale of a dimension, which are exact in binary numbers
POWERS = (-7, -9, -11, -13, -15)
# largest relative disagreement of two orders of difference at which no other step is tried, at which the best
# step is accepted, and of the one-sided differences
CLOSE, ACCEPTED, KINK = 1e-11, 1e-7, 1e-3
# relative length below which the step of a length is based on the characteristic length
SMALL_LENGTH = 1e-3


def changes(
    designs: DesignFamily, names: Sequence[str], numbers: Callable[[Mapping[str, float]], Array] | None = None
) -> dict[str, Array]:
    """Return the derivatives of a mechanism's numbers by dimensions: name -> (k,), ordered as `numbers_of`.

    Args:
        designs: the parametric model.
        names: names of dimensions.
        numbers: changed dimensions, name -> value, to numbers; the default is the numbers of the description.

    Raises:
        InputError: where a description has a kink at a dimension, or fails for a perturbed value.

    Accuracy: a description is arithmetic. Differences of eighth order over binary steps give relative errors
        of about 1e-13, with the step at which a sixth order agrees best; a disagreement above 1e-7 is an
        error.
    """
    read_numbers = numbers or (lambda values: numbers_of(designs.describe(values)))
    length = designs.describe({}).characteristic_length

    def change(dimension: Dimension) -> Array:
        def perturbed_numbers(value: float) -> Array:
            return read_numbers({dimension.name: value})

        current = perturbed_numbers(dimension.value)
        best, apart = current, np.inf
        for step in _steps(dimension, length):
            try:
                perturbed = [
                    [perturbed_numbers(dimension.value + direction * k * step) - current for k in range(1, 5)]
                    for direction in (1.0, -1.0)
                ]
                derivative, off = _derivative(np.array(perturbed), step)
            except (MechsimError, ValueError):
                continue
            if off < apart:
                best, apart = derivative, off
            if apart <= CLOSE:
                return best
        if apart <= ACCEPTED:
            return best
        raise InputError(
            f"{designs.name}: the description has no derivative by {dimension.name} at "
            f"{dimension.value:.6g}: it has a kink or fails for a perturbed value; change the dimension a "
            "little"
        )

    return {name: change(designs.dimensions[name]) for name in names}


def _derivative(perturbed: Array, step: float) -> tuple[Array, float]:
    """Return derivatives from the changes of numbers (k,) on both sides, (2, 4, k), and their error estimate.

    The estimate is the disagreement of a lower order, relative to the largest change; infinite at a kink.
    """
    ahead, behind = (np.tensordot(ONE_SIDED, side, 1) / step for side in perturbed)
    eighth, sixth = (np.tensordot(order, perturbed[0] - perturbed[1], 1) / step for order in (EIGHTH, SIXTH))
    most = float(np.abs(perturbed).max(initial=0.0)) / (4.0 * step)
    if most == 0.0:
        return eighth, 0.0
    smooth = np.abs(ahead + behind).max() <= KINK * most
    return eighth, float(np.abs(eighth - sixth).max()) / most if smooth else np.inf


def _steps(dimension: Dimension, length: float) -> Iterator[float]:
    """Yield steps of a dimension in SI, exact in binary numbers, the most suitable first."""
    own, whole = abs(dimension.value), length if dimension.unit == "m" else 1.0
    scales = [own, whole] if own > SMALL_LENGTH * whole else [whole, own] if own else [whole]
    for scale in [1.0] if dimension.unit == "rad" else scales:
        for power in POWERS:
            yield float(2.0 ** (np.floor(np.log2(scale)) + power))
