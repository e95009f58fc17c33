"""mechsim and its peers on the same two problems: error against time.

The spatial and the planar four-bar of the catalogue, crank at 600 rpm, one revolution. Error: the largest
position error of a tracked point against the closed form, in units of the crank, at 20 instants, or at all
configurations that are solved by themselves; and the largest error of the rocker's angle in rad. Time:
processor time of the solver alone, the median of interleaved rounds; each peer's file states what it
includes.

Run: pip install -e '.[peers]' && python validation/peers/compare.py [--out DIR] [--rounds N]
The script names and skips a peer that is not installed.
"""

import argparse
import csv
import sys
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from statistics import median

import numpy as np
from problem import NAMES, Errors, Problem, make_problem, position_errors, torque_error
from protocol import PEERS, Setting, Solver, load

from mechsim.errors import InputError
from mechsim.files import atomic_path

ROUNDS = 9
# steps or configurations in the table of the page; 0: chosen by the solver
TABLE_STEPS = (0, 20, 100, 1000, 10_000)
# in [s]; a shorter run is repeated, because the other runs have displaced its code from the cache
MIN_SECONDS = 5e-3


@dataclass(frozen=True)
class Row:
    """One point of the plot.

    Attributes:
        problem, series: name of the problem, and of the curve.
        steps: or configurations; 0 if the solver chooses them.
        ms: time of a revolution.
        position: largest position error in units of the crank; inf for an incomplete revolution.
        rocker: largest angle error in [rad].
        torque: largest error of the drive torque relative to the largest torque; NaN without torque.
        note: the tolerance, if the solver has one.
    """

    problem: str
    series: str
    steps: int
    ms: float
    position: float
    rocker: float
    torque: float
    note: str = ""


@dataclass
class Entry:
    """A setting with its solver and its measurements."""

    problem: Problem
    setting: Setting
    solver: Solver
    errors: Errors
    torque: float
    times: list[float]

    def measure_time(self) -> None:
        seconds, _ = self.solver.run()
        if seconds < MIN_SECONDS:
            seconds, _ = self.solver.run()
        self.times.append(seconds)

    def row(self) -> Row:
        setting, errors = self.setting, self.errors
        tolerance = getattr(setting, "tolerance", None)
        note = "" if tolerance is None else f"tolerance {tolerance:g}"
        ms = 1e3 * median(self.times)
        names = self.problem.name, setting.series, setting.steps
        return Row(*names, ms, errors.position, errors.rocker, self.torque, note)


def measure(peers: Iterable[str], names: Sequence[str] = NAMES, rounds: int = ROUNDS) -> list[Row]:
    """Return a row for each setting of each installed peer; print the others to stderr."""
    problems = [make_problem(name) for name in names]
    entries: list[Entry] = []
    for name in peers:
        try:
            peer = load(name)
        except InputError as error:
            print(error, file=sys.stderr)
            continue
        for case in problems:
            for setting in peer.settings(case):
                solver = peer.build(case, setting)
                _, result = solver.run()
                angles = case.angles(setting.samples)
                errors = position_errors(case, angles, result)
                torque = torque_error(case, angles, solver.torque())
                entries.append(Entry(case, setting, solver, errors, torque, []))
    for _ in range(rounds):
        for entry in entries:
            entry.measure_time()
    return [entry.row() for entry in entries]


def write_table(rows: Sequence[Row], path: Path) -> None:
    """Write rows as CSV."""
    with atomic_path(path) as temporary, temporary.open("w", newline="") as file:
        writer = csv.DictWriter(file, [field.name for field in fields(Row)])
        writer.writeheader()
        writer.writerows(asdict(row) for row in rows)


def markdown(rows: Sequence[Row]) -> str:
    """Return a table for a page, the problems side by side, with the `TABLE_STEPS` only."""
    names = list(dict.fromkeys(row.problem for row in rows))
    result = {
        (row.series, row.note or str(row.steps), row.problem): row for row in rows if row.steps in TABLE_STEPS
    }
    header = ["solver", "steps"]
    for name in names:
        header += [f"{name}: ms a turn", "position", "rocker", "torque"]
    lines = [f"| {' | '.join(header)} |", "|---" * len(header) + "|"]
    for series, steps in dict.fromkeys(key[:2] for key in result):
        values = [text for name in names for text in _row_texts(result.get((series, steps, name)))]
        lines.append(f"| {' | '.join([series, steps, *values])} |")
    return "\n".join(lines)


def _row_texts(row: Row | None) -> list[str]:
    if row is None:
        return [""] * 4
    return [f"{row.ms:.3g}", *(_error_text(value) for value in (row.position, row.rocker, row.torque))]


def _error_text(value: float) -> str:
    if np.isnan(value):
        return ""
    return "0" if value == 0.0 else f"{value:.1e}" if np.isfinite(value) else "failed"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, help="folder for peers.csv, peers.md and peers.png")
    parser.add_argument("--rounds", type=int, default=ROUNDS, help="timings of each setting")
    options = parser.parse_args()
    if not options.rounds >= 1:
        parser.error(f"--rounds is {options.rounds}; use at least 1")
    if options.out is not None:
        try:
            options.out.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            parser.error(f"--out {options.out}: {error.strerror}; name a folder that can be created")
    rows = measure(PEERS, rounds=options.rounds)
    print(markdown(rows))
    if options.out is not None:
        from picture import work_precision

        write_table(rows, options.out / "peers.csv")
        with atomic_path(options.out / "peers.md") as temporary:
            temporary.write_text(markdown(rows) + "\n")
        with atomic_path(options.out / "peers.png") as temporary:
            temporary.write_bytes(work_precision(rows))


if __name__ == "__main__":
    main()
