"""Mechanisms that nobody has seen, through the command line, against a closure solved apart.

    python validation/robustness/random_toml_mechanisms.py [--count 120] [--seed 1] [--case N] [--keep DIR]

Problem: `random_mechanism_files.py` draws each around an assembled pose, as TOML. `solve` and `simulate`
by poses run on each, every fourth is stepped, and every fourth with one driver is traced.
Reference: `maximal_coordinates.py`, which follows the assembly from the known pose, and from the reported
pose where the file's guess is ambiguous. The tolerance is 1e-9 of the size for positions, joint coordinates,
velocities and accelerations (rates over the largest of their kind), and 1e-5 for positions of stepped runs,
without the reported lag of the drivers. Every pose of a trace must close, and the known pose must lie on a
curve. Every eighth mechanism is driven far, often to a singular pose, where an error is the right answer.
Uncertainty: the reference closes to 1e-12 where its equations' singular values keep 1e-4 of the largest.

Prints a table, and each fault with the number to run it again by; exit code 1 if there was any.
"""

import argparse
import os
import re
import resource
import signal
import sys
import tempfile
from collections import Counter, defaultdict
from pathlib import Path

import numpy as np
from invalid_models import PATIENCE, typed
from maximal_coordinates import UNITS, Program, TooNearError, followed, point_motion
from random_mechanism_files import PROBES, Drawn, drawn, null, quaternion

from mechsim import cli

BOUND, STEPPED, SAMPLES, DURATION = 1e-9, 1e-5, 13, 0.5
OUTCOMES = ("right", "rightful refusal", "refused, guess open", "undecided", "refused", "wrong", "traceback")


class WrongError(Exception):
    """What was reported is not so."""


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--count", type=int, default=120, help="of mechanisms")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--case", type=int, help="one of them, printed in full")
    parser.add_argument("--only", default="solve,simulate,step,trace", help="of these")
    parser.add_argument("--keep", default="", help="folder for the files of those that fall")
    asked = parser.parse_args()
    for name in cli.COMMANDS:
        cli.load_command(name)
    table: defaultdict[str, Counter[str]] = defaultdict(Counter)
    number, done = 1000 * asked.seed if asked.case is None else asked.case, 0
    while done < asked.count and asked.case in (None, number):
        made = drawn(number)
        if made is not None and (result := judged(made, number, asked.keep, asked.only.split(","))):
            done += 1
            for command, outcome, why in result:
                table[command][outcome] += 1
                if outcome in OUTCOMES[3:] or asked.case is not None:
                    print(
                        f"{number} {command}: {outcome} ({made.what}, guess {made.guess}): {why}", flush=True
                    )
        number += 1
        if sys.stderr.isatty() or done % 10 == 0:
            print(f"{done} of {asked.count}", file=sys.stderr)
    print("\n| command | " + " | ".join(OUTCOMES) + " |\n|" + "---|" * (len(OUTCOMES) + 1))
    for command, counts in table.items():
        print(f"| {command} | " + " | ".join(str(counts[item]) for item in OUTCOMES) + " |")
    return 1 if any(counts[item] for counts in table.values() for item in OUTCOMES[4:]) else 0


def judged(made: Drawn, number: int, keep: str, only: list[str]) -> list[tuple[str, str, str]]:
    """Return command, outcome and reason, for each command on a mechanism that can be driven."""
    far, times = number % 8 == 7, np.linspace(0.0, DURATION, SAMPLES)
    reach, truth = (4.0 if far else 1.0), None
    made.machine.rank = int(np.linalg.matrix_rank(made.machine.jacobian(made.pose, 0.0), 1e-9))
    for _ in range(1 if far else 5):
        texts = programmed(made, number, reach)
        try:
            truth = followed(made.machine, made.pose, times)
            break
        except TooNearError:
            reach /= 2.5
    if truth is None and not far:
        return []
    (place := Path(tempfile.mkdtemp()) / "here").mkdir()
    text = made.text.replace("[parameters]", "[motion_laws]\n" + "\n".join(texts) + "\n[parameters]")
    (place / "drawn.toml").write_text(text)
    if keep:
        Path(keep, f"{number}.toml").write_text(text)
    run = f"drawn.toml --duration {DURATION}s --samples {SAMPLES} -o"
    lines = {"solve": f"solve {run} solve.csv", "simulate": f"simulate {run} simulate.csv"}
    if number % 4 == 0 and not far:
        tolerance = STEPPED * made.machine.size
        lines["step"] = f"simulate {run} stepped.csv --method step --tolerance {tolerance:.3g}m"
    if number % 4 == 2 and len(made.drivers) == 1:
        lines["trace"] = "trace drawn.toml -o trace.csv --starts 6 --samples 60"
    result = []
    for words in (line.split() for name, line in lines.items() if name in only):
        code, output, spent = ran(words, place)
        command = words[0] + (" step" if "step" in words else "")
        try:
            outcome, why = ended(made, code, output, truth, words[0])
            if outcome == "right":
                table = np.genfromtxt(
                    place / words[words.index("-o") + 1], delimiter=",", names=True, deletechars=""
                )
                # of points that a rod's idle spin moves no pose tells: such runs are stepped
                printed = (place.parent / "out").read_text()
                stepped = "by step" in printed and not command.endswith("step")
                why = compared(made, table, truth, times, command + " by step" * stepped, printed)
        except WrongError as error:
            outcome, why = "wrong", str(error)
        except TooNearError:
            outcome, why = "undecided", "the reported pose leads near a singular one, by the reference"
        result.append((command, outcome, f"{why} [{spent:.0f} s]"))
    return result


def programmed(made: Drawn, number: int, reach: float) -> list[str]:
    """Drive a mechanism by swings or evenly, and return the programs' texts."""
    chance, texts = np.random.default_rng(number), []
    for i, full in zip(made.drivers, made.swings, strict=True):
        start, unit = float(made.pose[7 * made.machine.links + i]), "m" if full != 1.0 else "rad"
        far, w = (
            reach * full * float(chance.uniform(0.4, 1) * chance.choice([-1, 1])),
            float(chance.uniform(2, 6)),
        )
        swings = chance.random() < 0.7
        made.machine.driven[i] = swing(start, far, w) if swings else evenly(start, far / DURATION)
        text = f"{start!r}{unit} + {far!r}{unit}*sin({w!r}*t)" if swings else f"{far / DURATION!r}{unit}/s"
        texts.append(f'"{made.names[i]}" = "{text}"')
    return texts


def swing(start: float, far: float, w: float) -> Program:
    return lambda t: start + far * np.sin(w * t)


def evenly(start: float, pace: float) -> Program:
    return lambda t: start + pace * t


def ran(words: list[str], place: Path) -> tuple[int, str, float]:
    """Return a forked command's exit code, what it said on stderr, and its processor time."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    child = os.fork()
    if child == 0:
        for name in ("out", "err"):
            (place.parent / name).unlink(missing_ok=True)
        typed(tuple(words), place, place.parent)
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return code, (place.parent / "err").read_text(errors="replace"), spent


def ended(made: Drawn, code: int, output: str, truth: np.ndarray | None, command: str) -> tuple[str, str]:
    """Return the outcome by the way a command ended, and what it said."""
    # how far a trace has come is said before what it says
    lines = [line for line in output.strip().splitlines() if not line.startswith("trace: ")]
    if code == -signal.SIGXCPU:
        return "undecided", f"over {PATIENCE} s"
    if "Traceback" in output or code not in (0, 1, 2) or (code == 2 and len(lines) != 1):
        return "traceback", f"exit {code}: {output[-600:]}"
    why = lines[-1][:400] if lines else "nothing said"
    if code == 0:
        return "right", ""
    machine = made.machine
    points = machine.size * PROBES[None]
    spun = [
        point_motion(machine, made.pose, direction, 0 * direction, points)[1]
        for direction in null(machine, made.pose)
    ]
    if "underdetermined" in why and np.abs(spun).max(initial=0.0) > 1e-9 * machine.size:
        return "rightful refusal", why
    if (truth is None and command != "trace") or "curve of assemblies never closes" in why:
        return "rightful refusal", why
    return ("refused" if made.guess == "whole" or code == 1 else "refused, guess open"), f"exit {code}: {why}"


def compared(
    made: Drawn, table: np.ndarray, truth: np.ndarray | None, times: np.ndarray, command: str, output: str
) -> str:
    """Return by how much a table of a command, which said something, is off the truth, of the size.

    Raises:
        WrongError: where it is off by more than the bound.
        TooNearError: where the reference cannot say.
    """
    machine = made.machine
    if command == "trace":
        return traced(made, table)
    first = pose_of(made, table[0], made.pose)
    if command == "simulate":
        first = machine.solved(first, 0.0)
    elif np.abs(machine.residual(first, 0.0)).max() > (1e-3 if command.endswith("step") else BOUND):
        raise WrongError(f"the first pose stands open by {np.abs(machine.residual(first, 0.0)).max():.1e}")
    apart = np.abs(machine.poses(first)[0] - machine.poses(made.pose)[0])[1:]
    for direction in null(machine, made.pose):
        # where a link spins idly its origin says nothing
        moved = point_motion(machine, made.pose, direction, 0 * direction, machine.size * PROBES[None])[1][
            :, 0
        ]
        apart[np.abs(moved).max(-1) > 1e-9 * machine.size] = 0.0
    known = truth is not None and apart.max()
    if truth is None or known > 1e-3 * machine.size:
        if made.guess == "whole":
            raise WrongError(
                "another assembly than the guess means" if truth is not None else "passed a singular pose"
            )
        truth = followed(machine, first, times)
    worst = {}
    tracks, loose = reference(made, truth, times)
    for (kind, order), (columns, values) in tracks.items():
        # what stands still is checked by how fast the points go
        of_points = machine.size if order == 0 else np.abs(tracks["point", order][1]).max()
        if order == 2:
            # what moves straight and steadily has an acceleration of rounding
            of_points = max(of_points, np.abs(tracks["point", 1][1]).max() ** 2 / machine.size)
        scale = max(of_points / (machine.size if kind == "r" else 1.0), np.abs(values).max(initial=0.0))
        got = np.array(
            [
                table[name] if name in table.dtype.names else v
                for name, v in zip(columns, values.T, strict=True)
            ]
        ).T
        if kind == "r" and order == 0:
            got = got - 2 * np.pi * np.round((got[0] - values[0]) / (2 * np.pi))
        off = np.where(loose[kind], 0.0, np.abs(got - values)) / (scale or 1.0)
        worst[f"{kind} {'pva'[order]}"] = float(off.max(initial=0.0))
    bound = {"p": BOUND, "v": BOUND, "a": BOUND}
    if command.endswith("step"):
        # the tolerance is of places where the drivers were; how far these lag is reported
        lag = re.search(r"places are up to (\S+) m from where programs", output)
        bound = {
            "p": STEPPED + (1.05 * float(lag[1]) / machine.size if lag else 0.0),
            "v": np.inf,
            "a": np.inf,
        }
        worst = {name: off for name, off in worst.items() if name.startswith("point")}
    over = [name for name, off in worst.items() if not off <= bound[name[-1]]]
    text = ", ".join(f"{name} {off:.1e}" for name, off in worst.items())
    if over:
        raise WrongError(text)
    return text


def reference(made: Drawn, truth: np.ndarray, times: np.ndarray):
    """Return (kind, order) -> columns and what they should hold, and which of each kind nothing holds."""
    machine, n = made.machine, made.machine.links
    points = np.broadcast_to(machine.size * PROBES, (n, 3, 3))
    rows, free_points, free_q = [], np.zeros((n, 3, 3), bool), np.zeros(machine.count, bool)
    for x, t in zip(truth, times, strict=True):
        pace, bend = machine.rates(x, float(t))
        rows.append((point_motion(machine, x, pace, bend, points), np.array([x, pace, bend])[:, 7 * n :]))
        for direction in machine.split(x, float(t))[1]:
            free_points |= (
                np.abs(point_motion(machine, x, direction, 0 * direction, points)[1]) > 1e-9 * machine.size
            )
            free_q |= np.abs(direction[7 * n :]) > 1e-9
    names = [f"{p}{k}" for k in range(1, n + 1) for p in "oxy"]
    tracks, loose = {}, {"point": free_points.ravel()}
    units = "".join(UNITS[item.kind] for item in machine.joints)
    for order, ending in enumerate(("", "v", "a")):
        columns = [f"{name}.{ending}{axis}" for name in names for axis in "xyz"]
        tracks["point", order] = columns, np.array([row[0][order].ravel() for row in rows])
        for unit in "mr":
            of = [i for i, item in enumerate(units) if item == unit]
            loose[unit] = free_q[of]
            columns = [made.columns[i].replace("*", "qva"[order]) for i in of]
            tracks[unit, order] = columns, np.array([row[1][order][of] for row in rows])
    return tracks, loose


def pose_of(made: Drawn, row: np.void, near: np.ndarray) -> np.ndarray:
    """Return the unknowns of a pose reported by points and coordinates; turns of joints as near as can be."""
    machine, n = made.machine, made.machine.links
    places, turns = [], []
    for k in range(1, n + 1):
        o, x, y = (np.array([row[f"{p}{k}.{axis}"] for axis in "xyz"]) for p in "oxy")
        places.append(o / machine.size)
        ex, ey = (x - o) / machine.size, (y - o) / machine.size
        turns.append(quaternion(np.column_stack([ex, ey, np.cross(ex, ey)])))
    told_of = row.dtype.names or ()
    q = near[7 * n :].copy()
    for i, name in enumerate(made.columns):
        if (column := name.replace("*", "q")) in told_of:
            q[i] = row[column]
    for law in machine.couplings:
        # an angle is reported from -pi to pi at first; here with the turns that its coupling means
        gap = float(law(q))
        for i in np.flatnonzero(np.array(made.units) == "r"):
            if abs(law(q + np.eye(len(q))[i]) - gap - 1.0) < 1e-9:
                q[i] -= 2 * np.pi * np.round(gap / (2 * np.pi))
                break
    return np.concatenate([*places, *turns, q])


def traced(made: Drawn, table: np.ndarray) -> str:
    """Hold every pose of a trace against the equations; the known pose must lie on a curve."""
    machine = made.machine
    driven, machine.driven = machine.driven, {}
    poses = [pose_of(made, row, made.pose) for row in table]
    gaps = [float(np.abs(machine.residual(x, 0.0)).max()) for x in poses]
    machine.driven = driven
    if not max(gaps) <= BOUND:
        raise WrongError(f"a pose of row {int(np.argmax(gaps))} stands open by {max(gaps):.1e}")
    places = np.array([machine.poses(x)[0] for x in poses]) / machine.size
    apart = np.abs(places - machine.poses(made.pose)[0] / machine.size).max((-1, -2))
    steps = np.abs(np.diff(places, axis=0)).max((-1, -2))[np.diff(table["component"]) == 0]
    if apart.min() > steps.max():
        raise WrongError(f"no curve passes the known pose: the nearest is {apart.min():.2f} of the size away")
    return f"{max(gaps):.1e}, {len(set(table['component']))} curves"


if __name__ == "__main__":
    sys.exit(main())
