"""Random commands, parameters, files and options: each must end in a result or one clear line.

    python validation/robustness/fuzz.py [--examples 1000] [--interrupts 40] [--kills 30]

Commands run in this process, each in an empty folder, with a time limit. Faults are: an exception, an exit
code other than 0, 1 and 2, exit code 2 without exactly one line on stderr, a numpy warning, more than
`TIME_LIMIT` seconds of processor time, an incomplete file, and a file that the command did not name. Then
whole processes are stopped by Ctrl-C, SIGTERM or SIGHUP after a random time, and others are killed (SIGKILL)
while they write; their output file must be complete or absent. The exit code is 1 if there was any fault.
"""

import argparse
import contextlib
import io
import os
import signal
import sys
import tempfile
import warnings
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from command_outcomes import Case, file_faults, output_faults
from hypothesis import HealthCheck, Phase, given, settings
from stopped_processes import interrupts, kills
from typed_commands import cases

from mechsim.cli import main as command_line

# limit of processor time in [s]; limit of wall time as a multiple of it, for a machine that is shared
TIME_LIMIT, WALL_FACTOR = 60.0, 10.0


class TooLongError(Exception):
    """The command did not end in time."""


def run_case(case: Case) -> tuple[int | None, list[str]]:
    """Run a command in an empty folder; return its exit code and faults."""
    out, err = io.StringIO(), io.StringIO()
    faults: list[str] = []
    code: int | None = None
    arguments, start_folder, expired = sys.argv, os.getcwd(), list[int]()
    with tempfile.TemporaryDirectory() as folder:
        for name, content in case.files.items():
            Path(folder, name).write_bytes(content)
        os.chdir(folder)
        sys.argv = ["mechsim", *case.words]
        try:
            with (
                warnings.catch_warnings(record=True) as caught,
                contextlib.redirect_stdout(out),
                contextlib.redirect_stderr(err),
            ):
                warnings.simplefilter("always")
                with time_limit() as expired:
                    command_line()
        except SystemExit as stop:
            code = stop.code if isinstance(stop.code, int) else 0
        except BaseException as error:
            faults.append(f"{type(error).__name__} was not caught: {str(error)[:200]}")
        finally:
            sys.argv = arguments
            os.chdir(start_folder)
        if expired:
            # the command reports the exception as an internal error
            faults = [f"still running after {TIME_LIMIT:g} s"]
        output = err.getvalue()
        faults += [f"warning: {item.category.__name__}: {item.message}" for item in caught]
        faults += list(output_faults(code, output)) if not faults else []
        faults += list(file_faults(Path(folder), case, code))
    return code, faults


@contextlib.contextmanager
def time_limit() -> Iterator[list[int]]:
    """Stop a command that exceeds a time limit; the list that is yielded is then not empty."""
    expired: list[int] = []

    def expire(number: int, _: object) -> None:
        expired.append(number)
        raise TooLongError

    timers = (
        (signal.SIGPROF, signal.ITIMER_PROF, TIME_LIMIT),
        (signal.SIGALRM, signal.ITIMER_REAL, WALL_FACTOR * TIME_LIMIT),
    )
    handlers = [signal.signal(number, expire) for number, _, _ in timers]
    for _, timer, seconds in timers:
        signal.setitimer(timer, seconds)
    try:
        yield expired
    finally:
        for (number, timer, _), handler in zip(timers, handlers, strict=True):
            signal.setitimer(timer, 0.0)
            signal.signal(number, handler)


def fuzz(examples: int) -> tuple[Counter[int | None], list[str]]:
    """Run random commands; return how often each exit code occurred, and all faults."""
    codes: Counter[int | None] = Counter()
    result: list[str] = []

    @settings(
        max_examples=examples,
        derandomize=True,
        database=None,
        deadline=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(cases())
    def check_case(case: Case) -> None:
        code, faults = run_case(case)
        codes[code] += 1
        result.extend(f"{fault}  <-  {' '.join(map(repr, case.words))}" for fault in faults)

    check_case()
    return codes, result


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(description="Random commands: a result or one clear line.")
    parser.add_argument("--examples", type=int, default=1000)
    parser.add_argument("--interrupts", type=int, default=40)
    parser.add_argument("--kills", type=int, default=30)
    options = parser.parse_args(arguments)
    codes, result = fuzz(options.examples)
    print("exit codes: " + ", ".join(f"{code}: {count}" for code, count in sorted(codes.items(), key=str)))
    result += interrupts(options.interrupts)
    writing, killed = kills(options.kills)
    result += killed
    total = sum(codes.values())
    print(f"{total} commands, {options.interrupts} interrupted, {options.kills} killed ({writing} writing)")
    for text, count in Counter(result).most_common():
        print(f"FAULT x{count}: {text}")
    print(f"{len(result)} faults")
    return 1 if result else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
