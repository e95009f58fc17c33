"""Four-bars with change points, or nearly so: every method against a tangent-continuous solution.

    python validation/robustness/change_points.py [--count 200] [--seed 11]

The shortest and longest links of these random four-bars are together as long as the other two, so that all
links lie in line once or twice a revolution. The reference passes there as the product of two half-angle
roots, in 40 digits. Near ones miss a change point by 1e-3 to 1e-12 of a length and keep their assembly. Each
is solved over two revolutions, at the change points and close to them; linkages with change points also with
the policy "branch", which keeps the sign of that product. A result is silently wrong if it deviates by more
than 1e-6 of the longest link without an error.
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
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.motion import ChangePointPolicy
from mechsim.simulation.poses import follow
from mechsim.simulation.source import from_source

Array = NDArray[np.float64]
Lengths = tuple[float, float, float, float]
NAMES = ("ground", "crank", "coupler", "rocker")
ANGLES: Array = np.unique(
    [*np.linspace(-2 * np.pi, 2 * np.pi, 25), *(np.pi + np.array([-1e-3, 1e-6, 1e-9])), 1e-9, -1e-6, 1e-3]
)
ERROR_LIMIT = 1e-6
KINDS: tuple[tuple[str, bool, ChangePointPolicy], ...] = (
    ("change point", False, "smooth"),
    ("near change point", True, "smooth"),
    ("branch policy", False, "branch"),
)


@dataclass(frozen=True)
class Tally:
    """Results of many linkages by one method."""

    method: str
    correct: int
    rejected: int
    wrong: int
    worst: float


def random_linkages(count: int, close: bool, seed: int = 11) -> list[Lengths]:
    """Return linkages with change points, or nearly so, whose cranks rotate fully."""
    rng = np.random.default_rng(seed)
    result: list[Lengths] = []
    while len(result) < count:
        ground, crank, coupler = rng.uniform(0.03, 0.15, 3)
        kind = len(result) % 3
        coupler = ground if kind == 2 else coupler
        rocker = (ground + crank - coupler, coupler + abs(ground - crank), crank)[kind]
        if close:
            deviation = 10.0 ** rng.uniform(-12.0, -3.0) * ground
            rocker += -deviation if kind == 1 else deviation
        lengths = (float(ground), float(crank), float(coupler), float(rocker))
        rotates_fully = (
            min(lengths) > 0.01
            and catalog.make("four_bar", **dict(zip(NAMES, lengths, strict=True))).crank_range().full
        )
        # with equal crank and frame the coupler can rotate about both pivots
        if rotates_fully and abs(ground - crank) > 1e-3:
            result.append(lengths)
    return result


def exact_joint_b(lengths: Lengths, angle: float, sign: int, through: ChangePointPolicy) -> complex:
    """Return joint B in 40 digits, with the smooth or the sign-keeping root of the closure equation."""
    with mpmath.workdps(40):
        ground, crank, coupler, rocker = (mpmath.mpf(length) for length in lengths)
        crank_angle = mpmath.mpf(angle)
        a = crank * mpmath.expj(crank_angle)
        arm = ground - a
        scale = 2 * mpmath.sqrt(ground * crank)
        cosine_root, sine_root = scale * mpmath.cos(crank_angle / 2), scale * mpmath.sin(crank_angle / 2)
        outer = (coupler + rocker) ** 2 - (ground + crank) ** 2
        inner = (ground - crank) ** 2 - (coupler - rocker) ** 2
        # below the rounding of lengths in double precision the term is zero
        rounding = mpmath.mpf(10) ** -14 * (ground + crank) ** 2
        cosine_root = mpmath.sqrt(cosine_root**2 + outer) if abs(outer) > rounding else cosine_root
        sine_root = mpmath.sqrt(sine_root**2 + inner) if abs(inner) > rounding else sine_root
        root = abs(cosine_root * sine_root) if through == "branch" else cosine_root * sine_root
        along = (abs(arm) ** 2 + coupler**2 - rocker**2) / 2
        return complex(a + arm / abs(arm) ** 2 * (along + mpmath.mpc(0, 1) * sign * root / 2))


def closed_form(linkage: KinematicSolver) -> Array:
    """Return joint B at the angles, (n, 3) in [m]."""
    return linkage.positions(ANGLES)["B"]


def loop_equations(linkage: KinematicSolver) -> Array:
    """Return joint B at the angles, (n, 3) in [m]."""
    return loops.solve(linkage.mechanism, ANGLES, change_point=linkage.change_point).points["B"].position


def mujoco_poses(linkage: KinematicSolver) -> Array:
    """Return joint B at the angles, (n, 3) in [m]."""
    source = from_source(linkage)
    return source.point_positions(follow.follow(source.loops, source.qpos, ANGLES))[
        :, source.track.points.index("B")
    ]


METHODS: dict[str, Callable[[KinematicSolver], Array]] = {
    "closed form": closed_form,
    "loop equations": loop_equations,
    "MuJoCo, poses": mujoco_poses,
}


def tally(method: str, linkages: Sequence[Lengths], policy: ChangePointPolicy = "smooth") -> Tally:
    """Return how many linkages a method solves correctly, rejects, and solves silently wrong."""
    correct = rejected = wrong = 0
    worst = 0.0
    for lengths in linkages:
        linkage = catalog.make("four_bar", **dict(zip(NAMES, lengths, strict=True)), change_point=policy)
        try:
            result = METHODS[method](linkage)
        except MechsimError as error:
            print(f"rejected by {method}: {lengths}: {error}", file=sys.stderr)
            rejected += 1
            continue
        computed = result[:, 0] + 1j * result[:, 1]
        # the initial guess selects the assembly, which the method then has to keep
        errors = [
            np.abs(computed - [exact_joint_b(lengths, angle, sign, policy) for angle in ANGLES]).max()
            for sign in (1, -1)
        ]
        error = float(min(errors)) / max(lengths)
        if not error <= ERROR_LIMIT:
            print(f"wrong by {method}: {lengths}: {error:.2g} of the size", file=sys.stderr)
        worst = max(worst, error)
        correct, wrong = correct + (error <= ERROR_LIMIT), wrong + (not error <= ERROR_LIMIT)
    return Tally(method, correct, rejected, wrong, worst)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=11)
    options = parser.parse_args()
    print(f"{'linkages':<24}{'method':<18}{'correct':>8}{'rejected':>9}{'wrong':>7}   worst error / size")
    for kind, close, through in KINDS:
        linkages = random_linkages(options.count, close, options.seed)
        for method in METHODS:
            result = tally(method, linkages, through)
            counts = f"{result.correct:>8}{result.rejected:>9}{result.wrong:>7}"
            print(f"{len(linkages)} {kind:<20}{result.method:<18}{counts}   {result.worst:.1e}", flush=True)


if __name__ == "__main__":
    main()
