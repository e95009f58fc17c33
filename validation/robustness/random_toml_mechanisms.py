"""Random mechanisms through the command line, compared with a separate closure.

    python validation/robustness/random_toml_mechanisms.py [--count 120] [--seed 1] [--case N] [--keep DIR]

Problem: `random_mechanism_files.py` generates each as TOML around an assembled pose. `solve` and `simulate`
by poses run on each, every fourth is stepped, and every fourth with one driver is traced.
Reference: `maximal_coordinates.py` follows the assembly from the known pose, or from the reported one where
the guess of the file is ambiguous. The tolerance is 1e-9 of the size for positions, joint coordinates,
velocities and accelerations (rates relative to the largest of their kind). Stepped runs have a tolerance of
1e-5 plus their reported lag of the drivers. Every pose of a trace must close, and the known pose must lie on
a curve. Every eighth mechanism has a large motion, often to a singular pose: there a rejection is correct.
Uncertainty: the reference closes to 1e-12 where singular values are above 1e-4 of the largest.

Prints a table, and each fault with the number for `--case`; the exit code is 1 if there was any.
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
from maximal_coordinates import UNITS, MotionLaw, NearSingularError, point_motion, solve_path
from random_mechanism_files import PROBES, RandomMechanism, null_space, quaternion_of, random_mechanism

from mechsim import cli

TOLERANCE, STEP_TOLERANCE, SAMPLES, DURATION = 1e-9, 1e-5, 13, 0.5
# of a command: processor time in [s], memory in bytes
TIME_LIMIT, MEMORY_LIMIT = 60, 16 << 30
OUTCOMES = ("correct", "valid rejection", "ambiguous guess", "undecided", "rejected", "wrong", "traceback")


class WrongError(Exception):
    """A result deviates from the reference."""


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--count", type=int, default=120, help="number of mechanisms")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--case", type=int, help="one mechanism, with all details")
    parser.add_argument("--only", default="solve,simulate,step,trace", help="commands to run")
    parser.add_argument("--keep", default="", help="folder for the generated files")
    options = parser.parse_args()
    for name in cli.COMMANDS:
        cli.load_command(name)
    table: defaultdict[str, Counter[str]] = defaultdict(Counter)
    number, completed = 1000 * options.seed if options.case is None else options.case, 0
    while completed < options.count and options.case in (None, number):
        case = random_mechanism(number)
        if case is not None and (result := run_commands(case, number, options.keep, options.only.split(","))):
            completed += 1
            for command, outcome, detail in result:
                table[command][outcome] += 1
                if outcome in OUTCOMES[3:] or options.case is not None:
                    print(
                        f"{number} {command}: {outcome} ({case.label}, guess {case.guess}): {detail}",
                        flush=True,
                    )
        number += 1
        if sys.stderr.isatty() or completed % 10 == 0:
            print(f"{completed} of {options.count}", file=sys.stderr)
    print("\n| command | " + " | ".join(OUTCOMES) + " |\n|" + "---|" * (len(OUTCOMES) + 1))
    for command, counts in table.items():
        print(f"| {command} | " + " | ".join(str(counts[item]) for item in OUTCOMES) + " |")
    return 1 if any(counts[item] for counts in table.values() for item in OUTCOMES[4:]) else 0


def run_commands(
    case: RandomMechanism, number: int, keep: str, only: list[str]
) -> list[tuple[str, str, str]]:
    """Return command, outcome and detail, for each command on a mechanism."""
    large, times = number % 8 == 7, np.linspace(0.0, DURATION, SAMPLES)
    factor, exact = (4.0 if large else 1.0), None
    case.model.rank = int(np.linalg.matrix_rank(case.model.jacobian(case.pose, 0.0), 1e-9))
    for _ in range(1 if large else 5):
        texts = set_motion_laws(case, number, factor)
        try:
            exact = solve_path(case.model, case.pose, times)
            break
        except NearSingularError:
            factor /= 2.5
    if exact is None and not large:
        return []
    (folder := Path(tempfile.mkdtemp()) / "working").mkdir()
    text = case.text.replace("[parameters]", "[motion_laws]\n" + "\n".join(texts) + "\n[parameters]")
    (folder / "drawn.toml").write_text(text)
    if keep:
        Path(keep, f"{number}.toml").write_text(text)
    run = f"drawn.toml --duration {DURATION}s --samples {SAMPLES} -o"
    lines = {"solve": f"solve {run} solve.csv", "simulate": f"simulate {run} simulate.csv"}
    if number % 4 == 0 and not large:
        tolerance = STEP_TOLERANCE * case.model.length
        lines["step"] = f"simulate {run} stepped.csv --method step --tolerance {tolerance:.3g}m"
    if number % 4 == 2 and len(case.drivers) == 1:
        lines["trace"] = "trace drawn.toml -o trace.csv --starts 6"
    result = []
    for words in (line.split() for name, line in lines.items() if name in only):
        code, output, seconds = run_process(words, folder)
        command = words[0] + (" step" if "step" in words else "")
        try:
            outcome, detail = outcome_of(case, code, output, exact, words[0])
            if outcome == "correct":
                table = np.genfromtxt(
                    folder / words[words.index("-o") + 1], delimiter=",", names=True, deletechars=""
                )
                # runs with points that a passive rotation moves are stepped
                printed = (folder.parent / "out").read_text()
                was_stepped = "by step" in printed and not command.endswith("step")
                detail = compare(case, table, exact, times, command + " by step" * was_stepped, printed)
        except WrongError as error:
            outcome, detail = "wrong", str(error)
        except NearSingularError:
            outcome, detail = "undecided", "the reference comes near a singular pose"
        result.append((command, outcome, f"{detail} [{seconds:.0f} s]"))
    return result


def run_command(words: tuple[str, ...], working: Path, folder: Path) -> None:
    """Run a command in this process, then exit the process."""
    resource.setrlimit(resource.RLIMIT_CPU, (TIME_LIMIT, TIME_LIMIT + 2))
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_LIMIT, MEMORY_LIMIT))
    for name, stream in (("out", 1), ("err", 2)):
        number = os.open(folder / name, os.O_CREAT | os.O_WRONLY)
        os.dup2(number, stream)
        os.close(number)
    os.chdir(working)
    sys.argv = ["mechsim", *words]
    code = 99
    try:
        cli.main()
    except SystemExit as stop:
        code = stop.code if isinstance(stop.code, int) else 0
    except BaseException as error:
        print(f"{type(error).__name__} was not caught: {error}", file=sys.stderr)
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def set_motion_laws(case: RandomMechanism, number: int, factor: float) -> list[str]:
    """Give the drivers swings or constant rates, and return their texts."""
    chance, texts = np.random.default_rng(number), []
    for i, largest in zip(case.drivers, case.amplitudes, strict=True):
        start, unit = float(case.pose[7 * case.model.links + i]), "m" if largest != 1.0 else "rad"
        largest_value, frequency = (
            factor * largest * float(chance.uniform(0.4, 1) * chance.choice([-1, 1])),
            float(chance.uniform(2, 6)),
        )
        swinging = chance.random() < 0.7
        case.model.laws[i] = (
            swing(start, largest_value, frequency)
            if swinging
            else constant_rate(start, largest_value / DURATION)
        )
        text = (
            f"{start!r}{unit} + {largest_value!r}{unit}*sin({frequency!r}*t)"
            if swinging
            else f"{largest_value / DURATION!r}{unit}/s"
        )
        texts.append(f'"{case.names[i]}" = "{text}"')
    return texts


def swing(start: float, amplitude: float, frequency: float) -> MotionLaw:
    return lambda t: start + amplitude * np.sin(frequency * t)


def constant_rate(start: float, rate: float) -> MotionLaw:
    return lambda t: start + rate * t


def run_process(words: list[str], folder: Path) -> tuple[int, str, float]:
    """Return a forked command's exit code, output on stderr, and processor time."""
    start = resource.getrusage(resource.RUSAGE_CHILDREN)
    child = os.fork()
    if child == 0:
        for name in ("out", "err"):
            (folder.parent / name).unlink(missing_ok=True)
        run_command(tuple(words), folder, folder.parent)
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    end = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = end.ru_utime + end.ru_stime - start.ru_utime - start.ru_stime
    return code, (folder.parent / "err").read_text(errors="replace"), seconds


def outcome_of(
    case: RandomMechanism, code: int, output: str, exact: np.ndarray | None, command: str
) -> tuple[str, str]:
    """Return outcome and detail from the exit code and output of a command."""
    # a trace prints its progress first
    lines = [line for line in output.strip().splitlines() if not line.startswith("trace: ")]
    if code == -signal.SIGXCPU:
        return "undecided", f"over {TIME_LIMIT} s"
    if "Traceback" in output or code not in (0, 1, 2) or (code == 2 and len(lines) != 1):
        return "traceback", f"exit {code}: {output[-600:]}"
    detail = lines[-1][:400] if lines else "no output"
    if code == 0:
        return "correct", ""
    model = case.model
    points = model.length * PROBES[None]
    passive = [
        point_motion(model, case.pose, direction, 0 * direction, points)[1]
        for direction in null_space(model, case.pose)
    ]
    if "underdetermined" in detail and np.abs(passive).max(initial=0.0) > 1e-9 * model.length:
        return "valid rejection", detail
    if (exact is None and command != "trace") or "curve of assemblies never closes" in detail:
        return "valid rejection", detail
    return (
        "rejected" if case.guess == "complete" or code == 1 else "ambiguous guess"
    ), f"exit {code}: {detail}"


def compare(
    case: RandomMechanism,
    table: np.ndarray,
    exact: np.ndarray | None,
    times: np.ndarray,
    command: str,
    output: str,
) -> str:
    """Return the largest errors of a table of results, relative to their scales.

    Raises:
        WrongError: an error exceeds its tolerance.
        NearSingularError: the reference comes near a singular pose.
    """
    model = case.model
    if command == "trace":
        return check_trace(case, table)
    first = pose_of(case, table[0], case.pose)
    if command == "simulate":
        first = model.solve(first, 0.0)
    elif np.abs(model.residual(first, 0.0)).max() > (1e-3 if command.endswith("step") else TOLERANCE):
        raise WrongError(f"the first pose has a residual of {np.abs(model.residual(first, 0.0)).max():.1e}")
    difference = np.abs(model.poses(first)[0] - model.poses(case.pose)[0])[1:]
    for direction in null_space(model, case.pose):
        # a passive rotation leaves the origin undetermined
        moved = point_motion(model, case.pose, direction, 0 * direction, model.length * PROBES[None])[1][:, 0]
        difference[np.abs(moved).max(-1) > 1e-9 * model.length] = 0.0
    largest = exact is not None and difference.max()
    if exact is None or largest > 1e-3 * model.length:
        if case.guess == "complete":
            raise WrongError(
                "another assembly than that of the guess" if exact is not None else "passed a singular pose"
            )
        exact = solve_path(model, first, times)
    worst = {}
    tracks, free = reference_tracks(case, exact, times)
    for (kind, order), (columns, values) in tracks.items():
        # the scale of a resting quantity is that of the points
        point_scale = model.length if order == 0 else np.abs(tracks["point", order][1]).max()
        if order == 2:
            # the acceleration of a straight and steady motion is rounding
            point_scale = max(point_scale, np.abs(tracks["point", 1][1]).max() ** 2 / model.length)
        scale = max(point_scale / (model.length if kind == "r" else 1.0), np.abs(values).max(initial=0.0))
        read = np.array(
            [
                table[name] if name in table.dtype.names else v
                for name, v in zip(columns, values.T, strict=True)
            ]
        ).T
        if kind == "r" and order == 0:
            read = read - 2 * np.pi * np.round((read[0] - values[0]) / (2 * np.pi))
        error = np.where(free[kind], 0.0, np.abs(read - values)) / (scale or 1.0)
        worst[f"{kind} {'pva'[order]}"] = float(error.max(initial=0.0))
    limit = {"p": TOLERANCE, "v": TOLERANCE, "a": TOLERANCE}
    if command.endswith("step"):
        # the tolerance applies to positions at the actual driver positions, whose lag is reported
        lag = re.search(r"positions differ by up to (\S+) m from those of the motion laws", output)
        limit = {
            "p": STEP_TOLERANCE + (1.05 * float(lag[1]) / model.length if lag else 0.0),
            "v": np.inf,
            "a": np.inf,
        }
        worst = {name: error for name, error in worst.items() if name.startswith("point")}
    exceeded = [name for name, error in worst.items() if not error <= limit[name[-1]]]
    text = ", ".join(f"{name} {error:.1e}" for name, error in worst.items())
    if exceeded:
        raise WrongError(text)
    return text


def reference_tracks(case: RandomMechanism, exact: np.ndarray, times: np.ndarray):
    """Return (kind, order) -> columns and exact values, and which of each kind are undetermined."""
    model, n = case.model, case.model.links
    points = np.broadcast_to(model.length * PROBES, (n, 3, 3))
    rows, free_points, free_q = [], np.zeros((n, 3, 3), bool), np.zeros(model.count, bool)
    for x, t in zip(exact, times, strict=True):
        velocity, acceleration = model.rates(x, float(t))
        rows.append(
            (
                point_motion(model, x, velocity, acceleration, points),
                np.array([x, velocity, acceleration])[:, 7 * n :],
            )
        )
        for direction in model.pseudo_inverse(x, float(t))[1]:
            free_points |= (
                np.abs(point_motion(model, x, direction, 0 * direction, points)[1]) > 1e-9 * model.length
            )
            free_q |= np.abs(direction[7 * n :]) > 1e-9
    names = [f"{p}{k}" for k in range(1, n + 1) for p in "oxy"]
    tracks, free = {}, {"point": free_points.ravel()}
    units = "".join(UNITS[item.kind] for item in model.joints)
    for order, ending in enumerate(("", "v", "a")):
        columns = [f"{name}.{ending}{axis}" for name in names for axis in "xyz"]
        tracks["point", order] = columns, np.array([row[0][order].ravel() for row in rows])
        for unit in "mr":
            chosen = [i for i, item in enumerate(units) if item == unit]
            free[unit] = free_q[chosen]
            columns = [case.columns[i].replace("*", "qva"[order]) for i in chosen]
            tracks[unit, order] = columns, np.array([row[1][order][chosen] for row in rows])
    return tracks, free


def pose_of(case: RandomMechanism, row: np.void, guess: np.ndarray) -> np.ndarray:
    """Return the unknowns of a reported pose; joint angles are the closest to `guess`."""
    model, n = case.model, case.model.links
    positions, rotations = [], []
    for k in range(1, n + 1):
        o, x, y = (np.array([row[f"{p}{k}.{axis}"] for axis in "xyz"]) for p in "oxy")
        positions.append(o / model.length)
        ex, ey = (x - o) / model.length, (y - o) / model.length
        rotations.append(quaternion_of(np.column_stack([ex, ey, np.cross(ex, ey)])))
    columns = row.dtype.names or ()
    q = guess[7 * n :].copy()
    for i, name in enumerate(case.columns):
        if (column := name.replace("*", "q")) in columns:
            q[i] = row[column]
    for law in model.couplings:
        # reported angles start within -pi to pi; couplings determine their revolutions
        residual = float(law(q))
        for i in np.flatnonzero(np.array(case.units) == "r"):
            if abs(law(q + np.eye(len(q))[i]) - residual - 1.0) < 1e-9:
                q[i] -= 2 * np.pi * np.round(residual / (2 * np.pi))
                break
    return np.concatenate([*positions, *rotations, q])


def check_trace(case: RandomMechanism, table: np.ndarray) -> str:
    """Compare every pose of a trace with the equations; the known pose must lie on a curve."""
    model = case.model
    laws, model.laws = model.laws, {}
    poses = [pose_of(case, row, case.pose) for row in table]
    residuals = [float(np.abs(model.residual(x, 0.0)).max()) for x in poses]
    model.laws = laws
    if not max(residuals) <= TOLERANCE:
        raise WrongError(f"a pose of row {int(np.argmax(residuals))} has a residual of {max(residuals):.1e}")
    positions = np.array([model.poses(x)[0] for x in poses]) / model.length
    distances = np.abs(positions - model.poses(case.pose)[0] / model.length).max((-1, -2))
    steps = np.abs(np.diff(positions, axis=0)).max((-1, -2))[np.diff(table["component"]) == 0]
    if distances.min() > steps.max():
        raise WrongError(
            f"no curve passes the known pose: the nearest is {distances.min():.2f} of the size away"
        )
    return f"{max(residuals):.1e}, {len(set(table['component']))} curves"


if __name__ == "__main__":
    sys.exit(main())
