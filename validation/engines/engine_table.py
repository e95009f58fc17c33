"""The table of engines: mechanisms of `reference/` under each engine, at its defaults and at its best.

Each engine steps one turn, or one arc, of a mechanism with its crank at constant speed. Judged at the
instants of `reference/data/NAME.csv`, whose numbers have 30 digits: the largest position error of the tracked
points and the largest opening of a loop, in characteristic lengths of the mechanism, and the largest error of
the drive torque in its largest value. The search for the best setting tries all `SETTINGS` of an adapter and
takes the one whose larger error of position and torque is least. Time is the processor time of the steps for
a simulated second.

An adapter is a module `by_NAME.py` with the four names of `reference_problem.Engine`. Results are added to a
JSON file, so that engines may run in environments of their own:

    python validation/engines/engine_table.py --engine by_drake --results out/engines.json
    python validation/engines/engine_table.py --results out/engines.json --page
"""

import argparse
import importlib
import json
import platform
import statistics
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import date
from importlib.metadata import version
from pathlib import Path

import numpy as np
from reference_problem import Engine, Problem, Setting, Unsupported, names, problem

ENGINES = ("by_mujoco", "by_mjwarp", "by_mjx", "by_pinocchio", "by_drake", "by_exudyn", "by_pybullet")
DOCS = Path(__file__).parents[2] / "docs"


@dataclass(frozen=True)
class Row:
    """One run: errors in characteristic lengths and in largest torques, time in [ms] a simulated second."""

    mechanism: str
    engine: str
    version: str
    setting: str
    steps: int
    default: bool
    position: float | None = None
    gap: float | None = None
    torque: float | None = None
    ms: float | None = None
    failure: str | None = None

    @property
    def larger(self) -> float:
        """The larger error of position and torque."""
        errors = (self.position, self.torque)
        return np.inf if self.position is None else max(error for error in errors if error is not None)


def run(engine: Engine, solved: Problem, setting: Setting) -> Row:
    """Return the errors and the time of one engine, mechanism and setting; a failure is a result."""
    steps = setting.steps(solved.interval)
    default = setting is engine.SETTINGS[0]
    head = (solved.name, engine.NAME, version(engine.PACKAGE), setting.name, steps, default)
    try:
        poses = engine.run(solved, setting)
    except (Unsupported, ValueError, NotImplementedError, RuntimeError) as error:
        return Row(*head, failure=" ".join(str(error).split())[:80])
    errors = [float(error) if np.isfinite(error) else None for error in solved.errors(poses)]
    ms = 1e3 * poses.seconds / (solved.interval * solved.instants)
    return Row(*head, *errors, ms=ms, failure=None if errors[0] is not None else "it diverges")


def best(rows: Sequence[Row]) -> Row:
    """Return the run of least error."""
    return min(rows, key=lambda row: row.larger)


def written(rows: Sequence[Row]) -> str:
    """Return the page."""
    grouped: dict[str, dict[str, list[Row]]] = {}
    for row in rows:
        grouped.setdefault(row.engine, {}).setdefault(row.mechanism, []).append(row)
    mechanisms = sorted({row.mechanism for row in rows})
    failures = "\n".join(filter(None, (_failures(*group) for group in grouped.items())))
    text = HEAD.format(
        day=date.today(), machine=platform.machine(), count=len(mechanisms), failures=failures.strip()
    )
    for engine, cases in grouped.items():
        runs = [row for case in cases.values() for row in case]
        for label, chosen in (
            ("default", [next(row for row in case if row.default) for case in cases.values()]),
            ("best", [best(case) for case in cases.values()]),
        ):
            text += f"| {engine} {runs[0].version} | {label} | {_summary(chosen)} |\n"
    text += f"\n## Position error, default/best\n\n| mechanism | {' | '.join(grouped)} |\n"
    text += "|---" * (len(grouped) + 1) + "|\n"
    for mechanism in mechanisms:
        texts = (_text_of(cases.get(mechanism, [])) for cases in grouped.values())
        text += f"| {mechanism} | {' | '.join(texts)} |\n"
    return text


# lines of a page
HEAD = """# Table of engines

`python validation/engines/engine_table.py`, extra `[engines]`, steps {count} mechanisms of `reference/` whose
crank turns steadily, one turn each, and judges every engine by 30 digits. Measured on {day} ({machine}, two
cores, one used). A flywheel holds the speed; in Exudyn the joint does. *Default* is the engine's own step and
settings; where it has none, 1 ms. *Best* is the setting, of those that its adapter lists, whose larger error
of position and torque is least. Position errors and openings of loops are in characteristic lengths, torque
errors in the largest torque, times in ms for a simulated second: medians over the mechanisms that ran, and
the worst error in brackets.

float32 has a floor near 1e-6, which MuJoCo Warp cannot pass. Torques of Drake and PyBullet are differences of
velocities. Newton 1.8.0 lacks an adapter (its interface: `Engine` in `reference_problem.py`), Chrono a wheel.
MJX was not measured. Not run:

{failures}

![position error over time of each engine](../engines.svg)

| engine | setting | ran | position | opening of loops | torque | ms |
|---|---|---|---|---|---|---|
"""


def _failures(engine: str, cases: Mapping[str, Sequence[Row]]) -> str:
    """Return a line for each reason for which an engine has no result, with its mechanisms."""
    reasons: dict[str, list[str]] = {}
    for mechanism, rows in cases.items():
        if (least := best(rows)).position is None:
            reasons.setdefault(str(least.failure), []).append(mechanism)
    return "\n".join(f"- {engine}, {reason}: {', '.join(which)}." for reason, which in reasons.items())


def _summary(rows: Sequence[Row]) -> str:
    ran = [row for row in rows if row.failure is None]
    columns = [f"{len(ran)} of {len(rows)}"]
    for name in ("position", "gap", "torque"):
        values = [value for row in ran if (value := getattr(row, name)) is not None]
        columns.append(f"{statistics.median(values):.0e} ({max(values):.0e})" if values else "")
    columns.append(f"{statistics.median(row.ms for row in ran if row.ms is not None):.3g}" if ran else "")
    return " | ".join(columns)


def _text_of(rows: Sequence[Row]) -> str:
    if not rows:
        return ""
    default, least = next(row for row in rows if row.default), best(rows)
    if least.position is None:
        return "none"
    first = "fails" if default.position is None else f"{default.position:.0e}"
    return f"{first}/{least.position:.0e}"


def drawn(rows: Sequence[Row]) -> bytes:
    """Return the plot: the position error of each run over its time, median over the mechanisms."""
    from mechsim.pictures.plots.figure import COLOURS, blank, decades, styled
    from mechsim.pictures.plots.figure import drawn as image

    with styled():
        figure, axes = blank(1, 1, (7.2, 4.4))
        ax = axes[0, 0]
        ax.set_xscale("log")
        ax.set_yscale("log")
        for colour, engine in zip(COLOURS, dict.fromkeys(row.engine for row in rows), strict=False):
            groups: dict[tuple[str, int], list[Row]] = {}
            for row in rows:
                if row.engine == engine and row.position is not None:
                    groups.setdefault((row.setting, row.steps if not row.default else 0), []).append(row)
            x = [statistics.median(row.ms or 0.0 for row in group) for group in groups.values()]
            y = [statistics.median(row.position or 0.0 for row in group) for group in groups.values()]
            ax.plot(x, y, "o", color=colour, label=engine)
            default = [i for i, (setting, _) in enumerate(groups) if setting == "default"]
            ax.plot([x[i] for i in default], [y[i] for i in default], "o", color=colour, ms=11, mfc="none")
        decades(ax.yaxis)
        ax.minorticks_off()
        ax.xaxis.set_major_formatter("{x:g}")
        ax.set_xlabel("processor time for a simulated second [ms]; a ring marks the defaults")
        ax.set_ylabel("largest position error [characteristic lengths]")
        figure.legend(loc="outside right upper")
        return image(figure, "svg")


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--engine", action="append", choices=ENGINES, help="default: those installed")
    parser.add_argument("--mechanism", action="append", choices=names(), help="default: all")
    parser.add_argument("--results", type=Path, help="JSON file to which the runs are added")
    parser.add_argument("--page", action="store_true", help="write the page from --results, without runs")
    options = parser.parse_args(argv)
    earlier = options.results and options.results.exists()
    rows = [Row(**row) for row in json.loads(options.results.read_text())] if earlier else []
    if options.page:
        (DOCS / "explanation" / "engines.md").write_text(written(rows))
        (DOCS / "engines.svg").write_bytes(drawn(rows))
        return
    for name in options.mechanism or names():
        solved = problem(name)
        for module in options.engine or ENGINES:
            rows = _with_engine(rows, module, solved)
        if options.results:
            options.results.write_text(json.dumps([asdict(row) for row in rows], indent=0) + "\n")
    print(written(rows))


def _with_engine(rows: list[Row], module: str, solved: Problem) -> list[Row]:
    """Return rows with those of an engine for a mechanism in place of earlier ones."""
    try:
        engine: Engine = importlib.import_module(module)  # type: ignore[assignment]
    except ModuleNotFoundError as error:
        print(f"{module}: {error.name} is not installed; pip install -e '.[engines]'", file=sys.stderr)
        return rows
    kept = [row for row in rows if (row.engine, row.mechanism) != (engine.NAME, solved.name)]
    return kept + [run(engine, solved, setting) for setting in engine.SETTINGS]


if __name__ == "__main__":
    main()
