"""Paper 004, synthesis: its own linkage found again, then straighter ones under its conditions.

For straight parts of 4 mm and 11 mm of C (12 mm and 33 mm of E) the study lists how far the spatial C of
the paper's linkage and of the improved ones leaves its line, and draws the error curves.

Run `python validation/papers/looper_synthesis.py [--out DIR]`; it takes about a minute.
"""

import argparse
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from looper_search import straighter

from mechsim.analytic.catalog.looper import Looper
from mechsim.theory.coupler_line import Synthesis, synthesize_looper

# the line of papers.md section 4, from which the paper's linkage follows
PAPER_LINE = ((12.8751e-3, 29.9574e-3), float(np.deg2rad(1.3905)), 4e-3)
STRAIGHT_PARTS = (4e-3, 11e-3)


@dataclass(frozen=True, slots=True)
class Improvement:
    """A straight part of C, what the paper's linkage leaves of it, and a straighter one; lengths in [m]."""

    length: float
    free_coupler: bool
    paper: float
    found: Synthesis
    seconds: float


def paper_again() -> Synthesis:
    """Return the paper's linkage, synthesised from its line."""
    return synthesize_looper(*PAPER_LINE, Looper())


def paper_deviation(length: float) -> float:
    """Return how far the paper's spatial C leaves a line over its straightest part of a length, in [m]."""
    turn = np.linspace(0.0, 2.0 * np.pi, 7201)
    c = Looper().positions(turn)["C"]
    lowest, highest = np.argmin(c[:, 1]), np.argmax(c[:, 1])
    rising = c[min(lowest, highest) : max(lowest, highest) + 1]
    rising = rising[np.argsort(rising[:, 1])]
    middles = np.arange(rising[0, 1] + length / 2.0, rising[-1, 1] - length / 2.0, 5e-5)
    nodes = np.cos(np.pi * np.arange(61) / 60)
    x, y = rising[:, 0], rising[:, 1]
    return min(_least_band(np.interp(m + length / 2.0 * nodes, y, x), nodes) for m in middles)


def _least_band(x: np.ndarray, nodes: np.ndarray) -> float:
    """Return the error of the best straight line through x over -1 to 1, by exchange of three points."""
    active = [0, len(x) // 2, len(x) - 1]
    level = 0.0
    for _ in range(30):
        square = np.column_stack([np.ones(3), nodes[active], [1.0, -1.0, 1.0]])
        height, gradient, level = np.linalg.solve(square, x[active])
        error = x - height - gradient * nodes
        worst = int(np.argmax(np.abs(error)))
        if abs(error[worst]) <= abs(level) * (1.0 + 1e-9):
            break
        tries = [sorted([*(active[:i] + active[i + 1 :]), worst]) for i in range(3)]
        active = max(tries, key=lambda three: _level(x, nodes, three))
    return float(abs(level))


def _level(x: np.ndarray, nodes: np.ndarray, three: list[int]) -> float:
    if len(set(three)) < 3:
        return -1.0
    square = np.column_stack([np.ones(3), nodes[three], [1.0, -1.0, 1.0]])
    return float(abs(np.linalg.solve(square, x[three])[2]))


def study() -> list[Improvement]:
    """Return the straighter linkages, with the paper's coupler and with a free one."""
    out: list[Improvement] = []
    for length in STRAIGHT_PARTS:
        before = paper_deviation(length)
        for free in (False, True):
            start = time.perf_counter()
            found = straighter(length, Looper(), free_coupler=free)
            out.append(Improvement(length, free, before, found, time.perf_counter() - start))
    return out


def plot(out: Path, improvements: list[Improvement]) -> Path:
    """Draw the equal-ripple error curves into a folder."""
    from matplotlib.figure import Figure

    out.mkdir(parents=True, exist_ok=True)
    figure = Figure(figsize=(4.0 * len(improvements), 4.0), layout="constrained")
    for axes, item in zip(figure.subplots(1, len(improvements)), improvements, strict=True):
        height, error = 1e3 * item.found.curve[:, 1], 1e6 * item.found.error
        held = list(item.found.alternation)
        axes.plot(height, error)
        axes.plot(height[held], error[held], "o")
        axes.set(
            title=f"{1e3 * item.length:g} mm, {'free' if item.free_coupler else 'given'} coupler",
            xlabel="y of C, mm",
            ylabel="distance from the line, um",
        )
    path = out / "looper_error_curves.svg"
    figure.savefig(path)
    return path


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, help="folder for the picture")
    chosen = parser.parse_args()
    again = paper_again()
    print(
        f"from the paper's line: d {1e3 * again.frame:.3f} mm, eta {np.rad2deg(again.frame_angle):.3f} deg, "
        f"c {1e3 * again.rocker:.3f} mm; C leaves the line by {1e6 * again.deviation:.2f} um"
    )
    improvements = study()
    for item in improvements:
        d = item.found.design
        print(
            f"{1e3 * item.length:4g} mm, {'free ' if item.free_coupler else 'given'} coupler: paper "
            f"{1e6 * item.paper:.3f} um, found {1e6 * item.found.deviation:.4f} um in {item.seconds:.1f} s; "
            f"b {1e3 * d.coupler:.4f} k {1e3 * d.arm:.4f} omega {np.rad2deg(d.arm_angle):.4f} deg "
            f"c {1e3 * d.rocker:.4f} d {1e3 * d.frame:.4f} eta {np.rad2deg(d.frame_angle):.4f} deg "
            f"q {1e3 * d.axis_y:.4f} mm"
        )
    if chosen.out:
        print(plot(chosen.out, improvements), file=sys.stderr)
    return 0 if all(item.found.deviation < item.paper for item in improvements) else 1


if __name__ == "__main__":
    sys.exit(main())
