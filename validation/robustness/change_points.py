"""Linkages whose assemblies meet, or nearly do, on every route against a truth that is tangent-continuous.

    python validation/robustness/change_points.py [--count 200] [--seed 11]

Random four-bars whose shortest and longest links are together as long as the other two lie in line once or
twice a turn; the truth goes through there as the product of two half-angle roots does, in 40 digits. Near
ones miss that by 1e-3 to 1e-12 of a length, and keep their assembly round the bend. Each is asked for
over two turns, at the flat poses themselves and close to them; those that meet another assembly also to
fold, which keeps the sign of that product. A place farther off than 1e-6 of the size without a word is a
silent wrong.
"""

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import mpmath
import numpy as np
from numpy.typing import NDArray

from mechsim import catalog, loops
from mechsim.errors import MechsimError
from mechsim.model.motion import ChangePointPolicy
from mechsim.simulation.poses import follow
from mechsim.simulation.source import from_source

Array = NDArray[np.float64]
Lengths = tuple[float, float, float, float]
NAMES = ("ground", "crank", "coupler", "rocker")
ANGLES: Array = np.unique(
    [*np.linspace(-2 * np.pi, 2 * np.pi, 25), *(np.pi + np.array([-1e-3, 1e-6, 1e-9])), 1e-9, -1e-6, 1e-3]
)
WRONG = 1e-6
KINDS: tuple[tuple[str, bool, ChangePointPolicy], ...] = (
    ("change point", False, "smooth"),
    ("near change point", True, "smooth"),
    ("that fold", False, "branch"),
)


@dataclass(frozen=True)
class Tally:
    """What came of many linkages on one method."""

    route: str
    right: int
    refused: int
    wrong: int
    worst: float


def random_linkages(count: int, near: bool, seed: int = 11) -> list[Lengths]:
    """Return linkages with change points, or with nearly some, whose cranks turn fully."""
    rng = np.random.default_rng(seed)
    result: list[Lengths] = []
    while len(result) < count:
        ground, crank, coupler = rng.uniform(0.03, 0.15, 3)
        kind = len(result) % 3
        coupler = ground if kind == 2 else coupler
        rocker = (ground + crank - coupler, coupler + abs(ground - crank), crank)[kind]
        if near:
            away = 10.0 ** rng.uniform(-12.0, -3.0) * ground
            rocker += -away if kind == 1 else away
        lengths = (float(ground), float(crank), float(coupler), float(rocker))
        full = (
            min(lengths) > 0.01
            and catalog.make("four_bar", **dict(zip(NAMES, lengths, strict=True))).crank_range().full
        )
        # where crank and frame are alike the coupler turns about both
        if full and abs(ground - crank) > 1e-3:
            result.append(lengths)
    return result


def truth(lengths: Lengths, angle: float, sign: int, through: ChangePointPolicy) -> complex:
    """Return joint B, to 40 digits, where the root that tells the assemblies apart is smooth, or folds."""
    with mpmath.workdps(40):
        ground, crank, coupler, rocker = (mpmath.mpf(length) for length in lengths)
        at = mpmath.mpf(angle)
        a = crank * mpmath.expj(at)
        arm = ground - a
        reach = 2 * mpmath.sqrt(ground * crank)
        first, second = reach * mpmath.cos(at / 2), reach * mpmath.sin(at / 2)
        outer = (coupler + rocker) ** 2 - (ground + crank) ** 2
        inner = (ground - crank) ** 2 - (coupler - rocker) ** 2
        # what lengths kept to 16 digits leave open is nothing
        tiny = mpmath.mpf(10) ** -14 * (ground + crank) ** 2
        first = mpmath.sqrt(first**2 + outer) if abs(outer) > tiny else first
        second = mpmath.sqrt(second**2 + inner) if abs(inner) > tiny else second
        root = abs(first * second) if through == "branch" else first * second
        along = (abs(arm) ** 2 + coupler**2 - rocker**2) / 2
        return complex(a + arm / abs(arm) ** 2 * (along + mpmath.mpc(0, 1) * sign * root / 2))


def by_closed_form(drive: catalog.FourBar) -> Array:
    """Return joint B at the angles, (n, 3) in [m]."""
    return drive.positions(ANGLES)["B"]


def by_loop_equations(drive: catalog.FourBar) -> Array:
    """Return joint B at the angles, (n, 3) in [m]."""
    return loops.solve(drive.mechanism, ANGLES, change_point=drive.change_point).points["B"].position


def by_poses(drive: catalog.FourBar) -> Array:
    """Return joint B at the angles, (n, 3) in [m]."""
    closed = from_source(drive)
    return closed.point_positions(follow.follow(closed.loops, closed.qpos, ANGLES))[
        :, closed.track.points.index("B")
    ]


ROUTES: dict[str, Callable[[catalog.FourBar], Array]] = {
    "closed form": by_closed_form,
    "loop equations": by_loop_equations,
    "MuJoCo, poses": by_poses,
}


def tallied(route: str, linkages: Sequence[Lengths], through: ChangePointPolicy = "smooth") -> Tally:
    """Return how many linkages a method gets right, rejects, and gets wrong without a word."""
    right = refused = wrong = 0
    worst = 0.0
    for lengths in linkages:
        drive = catalog.FourBar(**dict(zip(NAMES, lengths, strict=True)), change_point=through)
        try:
            result = ROUTES[route](drive)
        except MechsimError as error:
            print(f"refused by {route}: {lengths}: {error}", file=sys.stderr)
            refused += 1
            continue
        flat = result[:, 0] + 1j * result[:, 1]
        # the assembly is chosen where the guess stands; from there on it has to be kept
        errors = [
            np.abs(flat - [truth(lengths, at, sign, through) for at in ANGLES]).max() for sign in (1, -1)
        ]
        error = float(min(errors)) / max(lengths)
        if not error <= WRONG:
            print(f"wrong by {route}: {lengths}: {error:.2g} of the size", file=sys.stderr)
        worst = max(worst, error)
        right, wrong = right + (error <= WRONG), wrong + (not error <= WRONG)
    return Tally(route, right, refused, wrong, worst)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=11)
    asked = parser.parse_args()
    print(f"{'linkages':<24}{'route':<18}{'right':>7}{'refused':>9}{'wrong':>7}   worst error / size")
    for kind, near, through in KINDS:
        linkages = random_linkages(asked.count, near, asked.seed)
        for route in ROUTES:
            item = tallied(route, linkages, through)
            counts = f"{item.right:>7}{item.refused:>9}{item.wrong:>7}"
            print(f"{len(linkages)} {kind:<20}{item.route:<18}{counts}   {item.worst:.1e}", flush=True)


if __name__ == "__main__":
    main()
