"""Random mechanisms that can be assembled somewhere, and crank angles where they can."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from hypothesis import assume
from hypothesis import strategies as st

from mechsim import catalog
from mechsim.errors import InputError
from mechsim.kinematics.solvers import KinematicSolver

Mirror = Callable[[KinematicSolver], tuple[KinematicSolver, float, np.ndarray]]
EPS = np.finfo(np.float64).eps
# allowed residual of a closed form relative to its longest length, frame distances included
CLOSED = 8 * EPS

# steps with an odd remainder: generic geometry only, no zeros, right angles or denormal numbers
lengths = st.integers(500, 6000).map(lambda value: (value + 0.37) * 1e-5)
offsets = st.integers(-6000, 6000).map(lambda value: (value + 0.29) * 1e-5)
turns = st.integers(-3140, 3140).map(lambda value: (value + 0.41) * 1e-3)
branches = st.sampled_from([1, -1])


# parameters that are distances with a sign, and those of a guide that is absent
SIGNED = ("offset", "axis_y", "axis_z")
GUIDE = ("psi1", "psi2", "beta1", "beta2")


@st.composite
def random_mechanisms(draw: st.DrawFn, name: str) -> KinematicSolver:
    """A mechanism of random dimensions and a random assembly mode that can be assembled somewhere."""
    usual = catalog.make(name)
    values = dict[str, Any]()
    for parameter, value in usual.parameters.items():
        unit = usual.dimensions.get(parameter, (0.0, ""))[1]
        if isinstance(value, tuple):
            values[parameter] = tuple(draw(offsets) for _ in value)
        elif parameter in ("branch", "side"):
            values[parameter] = draw(branches)
        elif unit == "m":
            values[parameter] = draw(offsets if parameter in SIGNED else lengths)
        elif unit == "rad" and parameter not in GUIDE:
            values[parameter] = draw(turns)
    # two equal links let a pin reach a pivot, where the rocker is undetermined; equal twists are no linkage
    sizes = sorted(abs(value) for value in values.values() if isinstance(value, float))
    assume(np.diff(sizes).min(initial=1.0) > 2e-5 and abs(np.sin(values.get("arm_angle", 1.0))) > 0.05)
    try:
        linkage = catalog.make(name, **values)
    except InputError:
        assume(False)
    assume(linkage.crank_range().arcs)
    return linkage


four_bars, slider_cranks, rssrs, rrsrrs, bennetts = (
    partial(random_mechanisms, name) for name in ("four_bar", "slider_crank", "rssr", "rrsrr", "bennett")
)


def random_knitter(seed: int, ratio: float = -2.0) -> KinematicSolver:
    """A warp knitter whose legs fit one random pose at crank angle 0, in a random assembly."""
    rng = np.random.default_rng(seed)
    legs, base = [0.0], [0.0]
    # the sextic is ill-conditioned for legs much shorter than the rest
    while min(legs) < 0.015 or min(base) < 0.01:
        cranks, phase = rng.uniform(0.003, 0.012, 2), float(rng.uniform(-3, 3))
        pivot2, pivot_rocker = rng.uniform(-0.08, 0.08, (2, 2))
        base_c, base_k = rng.uniform(-0.05, 0.05, (2, 2))
        pins = [cranks[0], complex(*pivot2) + cranks[1] * np.exp(1j * phase), complex(*pivot_rocker)]
        position, rotation = complex(*rng.uniform(-0.06, 0.06, 2)), np.exp(1j * rng.uniform(0, 2.0 * np.pi))
        ends = [position, position + rotation * complex(*base_c), position + rotation * complex(*base_k)]
        legs = [float(abs(end - pin)) for end, pin in zip(ends, pins, strict=True)]
        base = [np.hypot(*base_c), np.hypot(*base_k)]
    linkage = catalog.make(
        "warp_knitter",
        crank1=float(cranks[0]),
        crank2=float(cranks[1]),
        rod3=legs[0],
        rod5=legs[1],
        rocker=legs[2],
        pivot2=tuple(pivot2.tolist()),
        pivot_rocker=tuple(pivot_rocker.tolist()),
        base_c=tuple(base_c.tolist()),
        base_k=tuple(base_k.tolist()),
        phase=phase,
        gear_ratio=ratio,
        assembly=1,
    )
    return linkage.with_parameters(assembly=int(rng.integers(1, len(linkage.assemblies(0.0)) + 1)))


@st.composite
def warp_knitters(draw: st.DrawFn) -> KinematicSolver:
    """A warp knitter in one of its assemblies, its second crank geared twice as fast or 3 to 2."""
    return random_knitter(draw(st.integers(0, 10**6)), draw(st.sampled_from([-2.0, -1.5])))


def angles_of(linkage: KinematicSolver, count: int = 12, lowest_transmission: float = 0.0) -> np.ndarray:
    """Return crank angles spread over the range, ends left out; unfit examples are discarded."""
    arcs = linkage.crank_range().arcs
    assume(arcs and all(high - low > 1e-3 for low, high in arcs))
    fractions = (np.arange(count) + 0.37) / count
    angles = np.concatenate([low + (high - low) * fractions for low, high in arcs])
    if lowest_transmission:
        angles = angles[linkage.transmission_angle(angles) > lowest_transmission]
        assume(len(angles) > 0)
    return angles


def longest(linkage: KinematicSolver) -> float:
    """Return the longest length of a mechanism, frame distances included, in [m]."""
    lengths = [value for value, unit in linkage.dimensions.values() if unit == "m"]
    return max(
        linkage.mechanism.characteristic_length, *(float(np.linalg.norm(length)) for length in lengths)
    )


def flipped(axis: int, *changed: str, angle: float = 1.0) -> Mirror:
    """Return the mirror image across a plane: positions are mirrored, other parameters change sign."""
    image = np.ones(3)
    image[axis] = -1.0

    def mirror(linkage: KinematicSolver) -> tuple[KinematicSolver, float, np.ndarray]:
        values = {name: getattr(linkage, name) for name in changed}
        rotated = {
            name: tuple((image[: len(value)] * value).tolist()) if isinstance(value, tuple) else -value
            for name, value in values.items()
        }
        return linkage.with_parameters(**rotated), angle, image

    return mirror


@dataclass(frozen=True)
class Case:
    """Test data of a mechanism of the catalogue.

    Attributes:
        random: strategy of random mechanisms.
        mirror: the mirrored mechanism, the direction of its crank, and the image of a point.
        scaled: relative difference allowed for a motion scaled by a power of two: 0 except for roots found
            numerically.
        slack: allowed residual of the loops, in units of `CLOSED`.
    """

    random: st.SearchStrategy[KinematicSolver]
    mirror: Mirror | None
    scaled: float = 0.0
    slack: Callable[[KinematicSolver], float] = lambda _: 1.0


CASES = {
    "four_bar": Case(four_bars(), flipped(1, "branch", "arm_angle", angle=-1.0)),
    "slider_crank": Case(slider_cranks(), flipped(1, "offset", angle=-1.0)),
    "rssr": Case(rssrs(), flipped(0, "pivot", "gamma1", "branch")),
    "rrsrr": Case(rrsrrs(), flipped(0, "pivot", "gamma1", "branch")),
    "looper": Case(
        random_mechanisms("looper"),
        flipped(2, "axis_z", "side"),
        scaled=1e-12,
        # a long arm shows the rounding of a short coupler's direction
        slack=lambda solver: max(1.0, solver.arm / solver.coupler),
    ),
    "bennett": Case(bennetts(), flipped(2, "twist0", "twist1")),
    "warp_knitter": Case(warp_knitters(), None, scaled=1e-12),
}
