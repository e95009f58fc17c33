"""Random mechanisms that can be assembled somewhere, and crank angles where they can."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from hypothesis import assume
from hypothesis import strategies as st

from mechsim import catalog
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


@st.composite
def rssrs(draw: st.DrawFn) -> KinematicSolver:
    """A spatial four-bar whose coupler fits at one crank and rocker angle, so that it can be assembled."""
    base = catalog.make(
        "rssr",
        crank=draw(lengths),
        rocker=draw(lengths),
        pivot=tuple(draw(offsets) for _ in range(3)),
        gamma1=draw(turns),
        gamma2=draw(turns),
        branch=draw(branches),
    )
    f, swing = draw(turns), draw(turns)
    x, y, _ = base.closed_form.rocker_frame.T
    p2 = base.crank * np.array([0.0, np.cos(f), np.sin(f)])
    p3 = np.array(base.pivot) + base.rocker * (np.cos(swing) * x + np.sin(swing) * y)
    coupler = float(np.linalg.norm(p3 - p2))
    assume(coupler > 0.005)
    return base.with_parameters(coupler=coupler)


@st.composite
def four_bars(draw: st.DrawFn) -> KinematicSolver:
    """A planar four-bar whose coupler fits at one crank and rocker angle."""
    crank, rocker, ground = (draw(lengths) for _ in range(3))
    f, swing = draw(turns), draw(turns)
    coupler = abs(crank * np.exp(1j * f) - ground - rocker * np.exp(1j * swing))
    # two equal links let the pin reach a pivot, where the rocker is undetermined
    assume(coupler > 0.005 and np.diff(np.sort([ground, crank, coupler, rocker])).min() > 2e-5)
    return catalog.make(
        "four_bar",
        ground=ground,
        crank=crank,
        coupler=float(coupler),
        rocker=rocker,
        branch=draw(branches),
        arm=draw(lengths),
        arm_angle=draw(turns),
    )


@st.composite
def slider_cranks(draw: st.DrawFn) -> KinematicSolver:
    """A slider-crank whose rod is longer than the height of the slide above the pin at one crank angle."""
    crank, offset = draw(lengths), draw(offsets)
    height = abs(offset - crank * np.sin(draw(turns)))
    rod = float(np.hypot(height, draw(lengths)))
    return catalog.make("slider_crank", crank=crank, rod=rod, offset=offset, branch=draw(branches))


@st.composite
def rrsrrs(draw: st.DrawFn) -> KinematicSolver:
    """A five-link whose connecting link fits at one crank and one coupler angle."""
    f, v = draw(turns), draw(turns)
    crank, coupler, pivot = draw(lengths), draw(lengths), tuple(draw(offsets) for _ in range(3))
    reach = crank + coupler * np.cos(v)
    s = np.array([coupler * np.sin(v), reach * np.cos(f), reach * np.sin(f)])
    link = float(np.linalg.norm(s - pivot))
    assume(link > 0.005)
    axis = {"gamma1": draw(turns), "gamma2": draw(turns)}
    return catalog.make(
        "rrsrr", crank=crank, coupler=coupler, link=link, pivot=pivot, branch=draw(branches), **axis
    )


@st.composite
def loopers(draw: st.DrawFn) -> KinematicSolver:
    """A looper that fits at one crank angle, one rocker angle and one swing of the follower."""
    base = catalog.make(
        "looper",
        crank=draw(lengths),
        rocker=draw(lengths),
        frame=draw(lengths),
        frame_angle=draw(turns),
        arm=draw(lengths),
        arm_angle=draw(turns),
        follower=draw(lengths),
        branch=draw(branches),
        side=draw(branches),
    )
    f, swing, cone, tilt = (draw(turns) for _ in range(4))
    a = base.crank * np.exp(1j * f)
    b = base.frame * np.exp(1j * base.frame_angle) + base.rocker * np.exp(1j * swing)
    sides = np.sort([abs(b - a), base.crank, base.rocker, base.frame])
    assume(abs(b - a) > 0.005 and abs(np.sin(base.arm_angle)) > 0.05 and np.diff(sides).min() > 2e-5)
    along = (b - a) / abs(b - a)
    out = base.arm * np.sin(base.arm_angle)
    y = (a + along * (base.arm * np.cos(base.arm_angle) + 1j * out * np.cos(cone))).imag
    return base.with_parameters(
        coupler=float(abs(b - a)),
        axis_y=float(y - base.follower * np.cos(tilt)),
        axis_z=float(out * np.sin(cone) - base.follower * np.sin(tilt)),
    )


@st.composite
def bennetts(draw: st.DrawFn) -> KinematicSolver:
    twists = st.integers(60, 3080).map(lambda value: (value + 0.41) * 1e-3)
    first, second = draw(twists), draw(twists)
    assume(abs(first - second) > 0.02)
    sign = draw(st.sampled_from([1, -1]))
    return catalog.make("bennett", length0=draw(lengths), twist0=sign * first, twist1=sign * second)


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
        loopers(),
        flipped(2, "axis_z", "side"),
        scaled=1e-12,
        # a long arm shows the rounding of a short coupler's direction
        slack=lambda solver: max(1.0, solver.arm / solver.coupler),
    ),
    "bennett": Case(bennetts(), flipped(2, "twist0", "twist1")),
    "warp_knitter": Case(warp_knitters(), None, scaled=1e-12),
}
