"""Limits of the accuracy of a run, their cost and cause, and the cheapest run within 1 %.

Every catalogue mechanism, one revolution at 600 rpm, against its closed form at the crank angle reached:
largest errors of a tracked point in strokes, of a joint angle in rad, and of an acceleration in strokes times
the squared crank speed. Methods: RK4 with low compliance and more and more steps; Richardson's extrapolation
of two such runs, one with twice the steps of the other; the recorded states of a coarse run with closed
loops; configurations solved one by one. Of each method the most accurate point, and the cheapest one within a
factor of two of it. The cheapest run: of several settings, over ten revolutions, within 1 % of the stroke.

Run: python validation/choices/frontier.py [--out DIR]
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import study_table as sheet

from mechsim import catalog
from mechsim.analytic.catalog.base import ClosedForm
from mechsim.model.motion import Motion
from mechsim.model.motion_laws import within_range
from mechsim.numerics.arrays import worst
from mechsim.numerics.convergence import richardson
from mechsim.simulation import Settings, loop_jacobian, mjcf
from mechsim.simulation.model_loops import read_loops
from mechsim.simulation.poses import follow
from mechsim.simulation.recording import States, evaluate
from mechsim.studies.tradeoff.methods import MAX_SAMPLES_PER_TURN, build_model, stepping_methods
from mechsim.studies.tradeoff.subject import Subject, subject_of

SPEED = 20.0 * np.pi
STEPS = (72, 144, 288, 720, 1440, 2880, 5760, 11520, 23040)
# steps of the run whose records are projected: the cheapest that is in the right assembly
COARSE = 72
ORDER, ROUNDS = 4.0, 5
# fast end: numbers of steps, turns, part of the stroke
FEW, TURNS, FRACTION = (6, 9, 12, 18, 24, 36, 72, 144, 360, 720), 10.0, 0.01
COLOURS = {"RK4": "#0072b2", "Richardson": "#d55e00", "projected": "#009e73", "poses": "#cc79a7"}


@dataclass(frozen=True)
class Point:
    """A method at a number of steps: its errors, and what does it once more and returns its time in [s]."""

    method: str
    steps: int
    errors: dict[str, float]
    again: Callable[[], float]


def stepped(subject: Subject, steps: int) -> Point:
    settings = Settings(steps_per_turn=steps)
    motion, _ = subject.built.motion(settings)
    return Point("RK4", steps, subject.errors(motion), lambda: subject.built.stepped(settings)[1].processor)


def extrapolated(subject: Subject, steps: int) -> Point:
    """Extrapolate places and angles of runs of so many and of half as many steps."""
    both = [Settings(steps_per_turn=n) for n in (steps // 2, steps)]
    coarse, fine = (subject.built.motion(settings)[0] for settings in both)
    assert coarse is not None
    assert fine is not None
    exact = subject.reference.exact(fine)

    def apart(kind: str) -> float:
        gaps = (
            _limit(coarse, fine, "points", name, kind) - getattr(point, kind)
            for name, point in exact.points.items()
        )
        return max(worst(np.linalg.norm(gap, axis=1)) for gap in gaps)

    gaps = [
        _limit(coarse, fine, "joints", name, "value") - joint.value
        for name, joint in exact.joints.items()
        if joint.unit == "rad" and name in fine.joints and name != "crank"
    ]
    revolution = 2.0 * np.pi
    angle = max((worst(gap - revolution * np.round(gap / revolution)) for gap in gaps), default=0.0)
    errors = {
        "position": apart("position") / subject.stroke,
        "angle": angle,
        "acceleration": apart("acceleration") / (subject.stroke * SPEED**2),
    }
    return Point(
        "Richardson",
        steps,
        errors,
        lambda: sum(subject.built.stepped(settings)[1].processor for settings in both),
    )


def _limit(coarse: Motion, fine: Motion, kind: str, name: str, field: str) -> np.ndarray:
    """Return where two runs point to; both recorded the same crank angles."""
    before, after = (getattr(getattr(motion, kind)[name], field) for motion in (coarse, fine))
    return richardson(before, after, 2.0, ORDER)[0]


def projected(subject: Subject) -> Point:
    """Close the loops of the states that a coarse run recorded."""
    settings = Settings(steps_per_turn=COARSE)
    loops, steps = subject.built.stepped(settings)
    qpos = loop_jacobian.close(loops, steps.states.qpos)

    def again() -> float:
        _, steps = subject.built.stepped(settings)
        begin = time.process_time()
        loop_jacobian.close(read_loops(subject.built.closed.model), steps.states.qpos)
        return steps.processor + time.process_time() - begin

    return Point("projected", COARSE, subject.errors(_evaluated(subject, steps.states.time, qpos)), again)


def solved(subject: Subject) -> Point:
    """Solve every pose by itself."""
    built = subject.built
    instants = np.linspace(0.0, built.profile.duration, MAX_SAMPLES_PER_TURN + 1)
    angles = built.profile.state(instants)[0]

    def poses() -> np.ndarray:
        return follow.follow(read_loops(built.closed.model), built.start[0], angles)

    def again() -> float:
        begin = time.process_time()
        poses()
        return time.process_time() - begin

    return Point("poses", 0, subject.errors(_evaluated(subject, instants, poses())), again)


def _evaluated(subject: Subject, instants: np.ndarray, qpos: np.ndarray) -> Motion:
    """Return the motion at closed states: rates and accelerations are those that keep the loops closed."""
    loops = read_loops(subject.built.closed.model)
    _, speed, acceleration = subject.built.profile.state(instants)
    rates = loop_jacobian.tangent(loops, loops.linearise(qpos)[1]) * speed[:, None]
    states = States(instants, qpos, rates)
    return evaluate(loops, subject.built.closed.track, states, "pose", crank_acceleration=acceleration)


def frontier(linkage: ClosedForm) -> list[dict[str, Any]]:
    """Return the most accurate point of each method, and the cheapest as accurate."""
    subject = subject_of(linkage, SPEED)
    methods = [
        [stepped(subject, n) for n in STEPS],
        [extrapolated(subject, n) for n in STEPS[1:]],
        [projected(subject)],
        [solved(subject)],
    ]
    chosen: list[Point] = []
    for method in methods:
        least = min(point.errors["position"] for point in method)
        chosen.append(next(point for point in method if point.errors["position"] <= 2.0 * least))
    times = np.array([[point.again() for point in chosen] for _ in range(ROUNDS)])
    rows = [_row(linkage, point, float(ms)) for point, ms in zip(chosen, np.median(times, 0), strict=True)]
    quick = cheapest(linkage, subject)
    return [*rows, _row(linkage, quick, quick.again())]


def cheapest(linkage: ClosedForm, subject: Subject) -> Point:
    """Return the cheapest run that stays within a part of the stroke over ten turns."""
    built = build_model(
        linkage.mechanism, within_range(linkage.mechanism, linkage.crank_range(), SPEED, TURNS), SPEED
    )
    valid: list[tuple[float, str, Settings, dict[str, float]]] = []
    for method in stepping_methods():
        if method.build != built.build:
            continue
        for steps in FEW:
            settings = method.settings(steps, SPEED)
            motion, seconds = built.motion(settings)
            errors = subject.errors(motion)
            if errors["position"] <= FRACTION:
                valid.append((seconds, method.name, settings, errors))
                break
    valid.sort(key=lambda item: item[0])
    fastest = valid[:6]
    times = np.median([[built.stepped(item[2])[1].processor for item in fastest] for _ in range(ROUNDS)], 0)
    best = int(np.argmin(times))
    _, name, settings, errors = fastest[best]
    return Point(f"1 %: {name}", settings.steps_per_turn, errors, lambda: float(times[best]) / TURNS)


def _row(linkage: ClosedForm, point: Point, seconds: float) -> dict[str, Any]:
    return {
        "mechanism": linkage.name,
        "method": point.method,
        "steps": point.steps or "",
        "ms/turn": f"{1e3 * seconds:.2f}",
        **{kind: point.errors[kind] for kind in ("position", "angle", "acceleration")},
    }


def every(linkage: ClosedForm) -> list[Point]:
    """Return all points of the two methods that have steps, for the plot."""
    subject = subject_of(linkage, SPEED)
    return [stepped(subject, n) for n in STEPS] + [extrapolated(subject, n) for n in STEPS[1:]]


def plot(rows: list[dict[str, Any]], out: Path) -> None:
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    names = list(dict.fromkeys(row["mechanism"] for row in rows))
    figure, axes = plt.subplots(2, 4, figsize=(13, 6), layout="constrained", sharex=True, sharey=True)
    for axis, name in zip(axes.flat, names, strict=False):
        points = every(catalog.make(name))
        for method in ("RK4", "Richardson"):
            mine = [(p.again(), p.errors["position"]) for p in points if p.method == method]
            axis.loglog([1e3 * t for t, _ in mine], [e for _, e in mine], "o-", ms=3, color=COLOURS[method])
        for row in rows:
            if row["mechanism"] == name and not row["method"].startswith("RK4"):
                quick = row["method"].startswith("1 %")
                axis.loglog(
                    float(row["ms/turn"]),
                    row["position"],
                    "x" if quick else "P",
                    ms=8,
                    color="#222831" if quick else COLOURS[row["method"]],
                    label="within 1 % of the stroke" if quick else row["method"],
                )
        axis.set(title=name)
        axis.grid(alpha=0.3)
    axes.flat[0].plot([], [], "o-", ms=3, color=COLOURS["RK4"], label="RK4, hard loops")
    for spare in axes.flat[len(names) :]:
        spare.axis("off")
    handles, labels = axes.flat[0].get_legend_handles_labels()
    axes.flat[-1].legend(handles, labels, loc="center")
    figure.supxlabel("processor time of one revolution [ms]")
    figure.supylabel("worst place error [stroke]")
    figure.savefig(out / "frontier.png", dpi=110)


@mjcf.quiet()
def main() -> None:
    out = sheet.folder(__doc__ or "")
    rows = [row for name in catalog.MECHANISMS for row in frontier(catalog.make(name))]
    sheet.show(rows, out, "frontier")
    if out is not None:
        plot(rows, out)


if __name__ == "__main__":
    main()
