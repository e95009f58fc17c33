"""Which joint of a loop is best cut: every possible choice in every catalogue mechanism.

Two turns at 600 rpm, 300 steps a turn. Error: worst distance of a tracked point from the solved pose,
in units of the mechanism's size. Time is that of stepping alone, the least of three runs in turn.

Run: python validation/choices/cut_joint.py [--out DIR]
"""

from pathlib import Path
from typing import Any

import numpy as np
import study_table as sheet

from mechsim import catalog
from mechsim.errors import AssemblyError
from mechsim.model.scene import Scene
from mechsim.simulation import Settings, simulate
from mechsim.simulation.mjcf.loop_cuts import cut_loops
from mechsim.simulation.source import assembled
from mechsim.studies.tradeoff.methods import possible_cuts

SPEED = 20.0 * np.pi
TURNS = 2.0
STEPS = 300
REPEATS = 3


def measured(name: str) -> list[dict[str, Any]]:
    """Return a row for each cut of a mechanism."""
    mechanism = catalog.make(name).mechanism
    chosen = {joint.name for joint in cut_loops(mechanism).cuts}
    rows: list[dict[str, Any]] = []
    for cut in possible_cuts(mechanism):
        scene = Scene(cut=cut)
        model = assembled(mechanism, scene).compile()
        row: dict[str, Any] = {
            "mechanism": name,
            "cut": " ".join(cut),
            "chosen": "*" if set(cut) == chosen else "",
            "freedoms": int(model.nv),
            "rows": 3 * int(model.neq),
            "error": np.inf,
            "ms/turn": np.inf,
        }
        rows.append(row)
    for _ in range(REPEATS):
        for row in rows:
            try:
                run = simulate(
                    mechanism,
                    speed=SPEED,
                    turns=TURNS,
                    settings=Settings(steps_per_turn=STEPS),
                    scene=Scene(cut=tuple(row["cut"].split())),
                )
            except AssemblyError:
                continue
            row["error"] = run.estimate / mechanism.characteristic_length
            row["ms/turn"] = min(row["ms/turn"], 1e3 * run.seconds / TURNS)
    return rows


def plot(rows: list[dict[str, Any]], out: Path) -> None:
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    figure, axis = plt.subplots(figsize=(7, 4.5), layout="constrained")
    for name in dict.fromkeys(row["mechanism"] for row in rows):
        mine = [row for row in rows if row["mechanism"] == name]
        (line,) = axis.loglog([r["ms/turn"] for r in mine], [r["error"] for r in mine], "o", label=name)
        best = [row for row in mine if row["chosen"]]
        axis.loglog(
            [r["ms/turn"] for r in best],
            [r["error"] for r in best],
            "s",
            ms=11,
            mfc="none",
            mec=line.get_color(),
        )
    axis.set(
        xlabel="time for a turn [ms]", ylabel="worst place error [size]", title="squares: the choice made"
    )
    axis.legend(fontsize=8)
    axis.grid(alpha=0.3)
    figure.savefig(out / "cut_joint.png", dpi=150)


def main() -> None:
    out = sheet.folder(__doc__ or "")
    rows = [row for name in catalog.MECHANISMS for row in measured(name)]
    sheet.show(rows, out, "cut_joint")
    if out is not None:
        plot(rows, out)


if __name__ == "__main__":
    main()
