"""Random mechanisms that can be assembled somewhere, and crank angles where they can."""

from dataclasses import replace

import numpy as np
from hypothesis import assume
from hypothesis import strategies as st

from mechsim.analytic.catalog.base import TwoBranchForm
from mechsim.analytic.catalog.four_bar import FourBar
from mechsim.analytic.catalog.rssr import Rssr
from mechsim.analytic.catalog.slider_crank import SliderCrank

EPS = np.finfo(np.float64).eps
# the loops of a closed form close to this part of the longest link, frame distances included
CLOSED = 8 * EPS

# steps with an odd remainder: generic geometry only, no zeros, right angles or denormal numbers
lengths = st.integers(500, 6000).map(lambda value: (value + 0.37) * 1e-5)
offsets = st.integers(-6000, 6000).map(lambda value: (value + 0.29) * 1e-5)
turns = st.integers(-3140, 3140).map(lambda value: (value + 0.41) * 1e-3)
branches = st.sampled_from([1, -1])


@st.composite
def rssrs(draw: st.DrawFn) -> Rssr:
    """A spatial four-bar whose coupler fits at one crank and rocker angle, so that it can be assembled."""
    rough = Rssr(
        crank=draw(lengths),
        rocker=draw(lengths),
        pivot=tuple(draw(offsets) for _ in range(3)),
        gamma1=draw(turns),
        gamma2=draw(turns),
        branch=draw(branches),
    )
    f, swing = draw(turns), draw(turns)
    x, y, _ = rough.rocker_frame.T
    p2 = rough.crank * np.array([0.0, np.cos(f), np.sin(f)])
    p3 = np.array(rough.pivot) + rough.rocker * (np.cos(swing) * x + np.sin(swing) * y)
    coupler = float(np.linalg.norm(p3 - p2))
    assume(coupler > 0.005)
    return replace(rough, coupler=coupler)


@st.composite
def four_bars(draw: st.DrawFn) -> FourBar:
    """A planar four-bar whose coupler fits at one crank and rocker angle."""
    crank, rocker, ground = (draw(lengths) for _ in range(3))
    f, swing = draw(turns), draw(turns)
    coupler = abs(crank * np.exp(1j * f) - ground - rocker * np.exp(1j * swing))
    # two equal links let the pin meet a pivot, where the rocker may point anywhere
    assume(coupler > 0.005 and np.diff(np.sort([ground, crank, coupler, rocker])).min() > 2e-5)
    return FourBar(
        ground=ground,
        crank=crank,
        coupler=float(coupler),
        rocker=rocker,
        branch=draw(branches),
        arm=draw(lengths),
        arm_angle=draw(turns),
    )


@st.composite
def slider_cranks(draw: st.DrawFn) -> SliderCrank:
    """A slider-crank whose rod is longer than the height of the slide above the pin at one crank angle."""
    crank, offset = draw(lengths), draw(offsets)
    height = abs(offset - crank * np.sin(draw(turns)))
    rod = float(np.hypot(height, draw(lengths)))
    return SliderCrank(crank=crank, rod=rod, offset=offset, branch=draw(branches))


def angles_of(drive: TwoBranchForm, count: int = 12, lowest_transmission: float = 0.0) -> np.ndarray:
    """Return crank angles spread over the range, ends left out; unfit examples are discarded."""
    arcs = drive.crank_range().arcs
    assume(arcs and all(high - low > 1e-3 for low, high in arcs))
    parts = (np.arange(count) + 0.37) / count
    angles = np.concatenate([low + (high - low) * parts for low, high in arcs])
    if lowest_transmission:
        angles = angles[drive.transmission_angle(angles) > lowest_transmission]
        assume(len(angles) > 0)
    return angles
