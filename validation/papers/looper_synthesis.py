"""Paper 004, synthesis: the linkage of the paper, then straighter ones under its conditions.

For straight parts of 4 mm and 11 mm of C (12 mm and 33 mm of E) the study lists the deviation of the spatial
C from its line, for the paper's linkage and the improved ones, and draws the error curves.

Run `python validation/papers/looper_synthesis.py [--out DIR]`; it takes about a minute.
"""

import argparse
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from looper_search import straighter_looper

from mechsim.analytic.catalog.looper import Looper
from mechsim.theory.coupler_line import Synthesis, synthesize_looper

# the line of docs/explanation/sources.md, from which the paper's linkage follows
PAPER_LINE = ((12.8751e-3, 29.9574e-3), float(np.deg2rad(1.3905)), 4e-3)
STRAIGHT_PARTS = (4e-3, 11e-3)


@dataclass(frozen=True, slots=True)
class Improvement:
    """Length of a straight part of C, deviation of the paper's linkage, and a straighter linkage; in [m]."""

    length: float
    free_coupler: bool
    paper: float
    result: Synthesis
    seconds: float


def paper_linkage() -> Synthesis:
    """Return the paper's linkage, synthesised from its line."""
    return synthesize_looper(*PAPER_LINE, Looper())


def paper_deviation(length: float) -> float:
    """Return the deviation of the paper's spatial C from a line over its straightest part, in [m]."""
    angles = np.linspace(0.0, 2.0 * np.pi, 7201)
    c = Looper().positions(angles)["C"]
    lowest, highest = np.argmin(c[:, 1]), np.argmax(c[:, 1])
    rising = c[min(lowest, highest) : max(lowest, highest) + 1]
    rising = rising[np.argsort(rising[:, 1])]
    middles = np.arange(rising[0, 1] + length / 2.0, rising[-1, 1] - length / 2.0, 5e-5)
    nodes = np.cos(np.pi * np.arange(61) / 60)
    x, y = rising[:, 0], rising[:, 1]
    return min(_least_band(np.interp(m + length / 2.0 * nodes, y, x), nodes) for m in middles)


def _least_band(x: np.ndarray, nodes: np.ndarray) -> float:
    """Return the error of the best line through x over -1 to 1, by exchange of three points."""
    active = [0, len(x) // 2, len(x) - 1]
    deviation = 0.0
    for _ in range(30):
        square = np.column_stack([np.ones(3), nodes[active], [1.0, -1.0, 1.0]])
        height, gradient, deviation = np.linalg.solve(square, x[active])
        error = x - height - gradient * nodes
        worst = int(np.argmax(np.abs(error)))
        if abs(error[worst]) <= abs(deviation) * (1.0 + 1e-9):
            break
        tries = [sorted([*(active[:i] + active[i + 1 :]), worst]) for i in range(3)]
        active = max(tries, key=lambda indices: _exchange_deviation(x, nodes, indices))
    return float(abs(deviation))


def _exchange_deviation(x: np.ndarray, nodes: np.ndarray, indices: list[int]) -> float:
    if len(set(indices)) < 3:
        return -1.0
    square = np.column_stack([np.ones(3), nodes[indices], [1.0, -1.0, 1.0]])
    return float(abs(np.linalg.solve(square, x[indices])[2]))


def study() -> list[Improvement]:
    """Return the straighter linkages, with the paper's coupler and with a free one."""
    out: list[Improvement] = []
    for length in STRAIGHT_PARTS:
        paper_value = paper_deviation(length)
        for free_coupler in (False, True):
            start = time.perf_counter()
            result = straighter_looper(length, Looper(), free_coupler=free_coupler)
            out.append(Improvement(length, free_coupler, paper_value, result, time.perf_counter() - start))
    return out


def plot(out: Path, improvements: list[Improvement]) -> Path:
    """Draw the equal-ripple error curves into a folder."""
    from matplotlib.figure import Figure

    out.mkdir(parents=True, exist_ok=True)
    figure = Figure(figsize=(4.0 * len(improvements), 4.0), layout="constrained")
    for axes, item in zip(figure.subplots(1, len(improvements)), improvements, strict=True):
        height, error = 1e3 * item.result.curve[:, 1], 1e6 * item.result.error
        extrema = list(item.result.alternation)
        axes.plot(height, error)
        axes.plot(height[extrema], error[extrema], "o")
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
    options = parser.parse_args()
    paper = paper_linkage()
    print(
        f"from the paper's line: d {1e3 * paper.frame:.3f} mm, eta {np.rad2deg(paper.frame_angle):.3f} deg, "
        f"c {1e3 * paper.rocker:.3f} mm; deviation of C {1e6 * paper.deviation:.2f} um"
    )
    improvements = study()
    for item in improvements:
        d = item.result.design
        print(
            f"{1e3 * item.length:4g} mm, {'free ' if item.free_coupler else 'given'} coupler: paper "
            f"{1e6 * item.paper:.3f} um, new {1e6 * item.result.deviation:.4f} um in {item.seconds:.1f} s; "
            f"b {1e3 * d.coupler:.4f} k {1e3 * d.arm:.4f} omega {np.rad2deg(d.arm_angle):.4f} deg "
            f"c {1e3 * d.rocker:.4f} d {1e3 * d.frame:.4f} eta {np.rad2deg(d.frame_angle):.4f} deg "
            f"q {1e3 * d.axis_y:.4f} mm"
        )
    if options.out:
        print(plot(options.out, improvements), file=sys.stderr)
    return 0 if all(item.result.deviation < item.paper for item in improvements) else 1


if __name__ == "__main__":
    sys.exit(main())
