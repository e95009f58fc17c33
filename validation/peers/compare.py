"""mechsim and its peers on the same two problems: error against time.

The spatial and the planar four-bar of the catalogue, crank at 600 rpm, one turn. Error: the worst place of
any tracked point against the closed form, in units of the crank, at 20 instants of the turn (all poses
where poses are solved by themselves); the rocker's worst angle in rad. Time: processor time of the solver
alone, the median of interleaved rounds; each peer's file says what is inside it.

Run: pip install -e '.[peers]' && python validation/peers/compare.py [--out DIR] [--rounds N]
A peer that is not installed is named and left out.
"""

import argparse
import csv
import sys
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from statistics import median

import numpy as np
from problem import NAMES, Errors, Problem, judge, judge_torque, problem
from protocol import PEERS, Setting, Solver, load

from mechsim.errors import InputError
from mechsim.files import atomic_path

ROUNDS = 9
# steps or poses that the table on the page shows; 0 are the solver's own
SHOWN = (0, 20, 100, 1000, 10_000)
# runs shorter than this, in [s], find their code out of the cache after all others have run: once more
SHORT = 5e-3


@dataclass(frozen=True)
class Row:
    """One point of the plot.

    Attributes:
        problem, family, steps: what was solved, how, and in how many steps or poses (0: the solver chose).
        ms: time of a turn.
        place: worst place error in units of the crank; inf where the turn was not finished.
        rocker: worst angle error in [rad].
        torque: worst error of the drive torque in units of the largest; NaN where the solver gives none.
        note: the tolerance where one was set, or why the turn failed.
    """

    problem: str
    family: str
    steps: int
    ms: float
    place: float
    rocker: float
    torque: float
    note: str = ""


@dataclass
class Entry:
    """A setting under test: its solver and what is known so far."""

    problem: Problem
    setting: Setting
    solver: Solver
    errors: Errors
    torque: float
    times: list[float]

    def again(self) -> None:
        seconds, _ = self.solver.run()
        if seconds < SHORT:
            seconds, _ = self.solver.run()
        self.times.append(seconds)

    def row(self) -> Row:
        setting, errors = self.setting, self.errors
        tolerance = getattr(setting, "tolerance", None)
        note = "" if tolerance is None else f"tolerance {tolerance:g}"
        ms = 1e3 * median(self.times)
        named = self.problem.name, setting.family, setting.steps
        return Row(*named, ms, errors.place, errors.rocker, self.torque, note)


def measured(peers: Iterable[str], names: Sequence[str] = NAMES, rounds: int = ROUNDS) -> list[Row]:
    """Return a row for each setting of each peer that is installed; the others are named on stderr."""
    problems = [problem(name) for name in names]
    entries: list[Entry] = []
    for name in peers:
        try:
            peer = load(name)
        except InputError as error:
            print(error, file=sys.stderr)
            continue
        for asked in problems:
            for setting in peer.settings(asked):
                solver = peer.build(asked, setting)
                _, result = solver.run()
                angles = asked.angles(setting.samples)
                errors = judge(asked, angles, result)
                torque = judge_torque(asked, angles, solver.torque())
                entries.append(Entry(asked, setting, solver, errors, torque, []))
    for _ in range(rounds):
        for entry in entries:
            entry.again()
    return [entry.row() for entry in entries]


def write_table(rows: Sequence[Row], path: Path) -> None:
    """Write rows as CSV."""
    with atomic_path(path) as beside, beside.open("w", newline="") as file:
        writer = csv.DictWriter(file, [field.name for field in fields(Row)])
        writer.writeheader()
        writer.writerows(asdict(row) for row in rows)


def markdown(rows: Sequence[Row]) -> str:
    """Return rows as a table for a page, the problems side by side, with the `SHOWN` steps alone."""
    names = list(dict.fromkeys(row.problem for row in rows))
    result = {
        (row.family, row.note or str(row.steps), row.problem): row for row in rows if row.steps in SHOWN
    }
    head = ["solver", "steps or poses"]
    for name in names:
        head += [f"{name}: ms a turn", "place", "rocker", "torque"]
    lines = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    for family, steps in dict.fromkeys(key[:2] for key in result):
        cells = [cell for name in names for cell in _cells(result.get((family, steps, name)))]
        lines.append(f"| {' | '.join([family, steps, *cells])} |")
    return "\n".join(lines)


def _cells(row: Row | None) -> list[str]:
    if row is None:
        return [""] * 4
    return [f"{row.ms:.3g}", *(_error(value) for value in (row.place, row.rocker, row.torque))]


def _error(value: float) -> str:
    if np.isnan(value):
        return ""
    return "0" if value == 0.0 else f"{value:.1e}" if np.isfinite(value) else "failed"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, help="folder for peers.csv, peers.md and peers.png")
    parser.add_argument("--rounds", type=int, default=ROUNDS, help="how often each setting is timed")
    given = parser.parse_args()
    if not given.rounds >= 1:
        parser.error(f"--rounds is {given.rounds}; take at least 1")
    if given.out is not None:
        try:
            given.out.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            parser.error(f"--out {given.out}: {error.strerror}; name a folder that can be made")
    rows = measured(PEERS, rounds=given.rounds)
    print(markdown(rows))
    if given.out is not None:
        from picture import work_precision

        write_table(rows, given.out / "peers.csv")
        with atomic_path(given.out / "peers.md") as beside:
            beside.write_text(markdown(rows) + "\n")
        with atomic_path(given.out / "peers.png") as beside:
            beside.write_bytes(work_precision(rows))


if __name__ == "__main__":
    main()
