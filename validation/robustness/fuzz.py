"""Random commands, parameters, files and option combinations: each ends in a result or one clear line.

    python validation/robustness/fuzz.py [--examples 1000] [--interrupts 40] [--kills 30]

Commands run in this process, in a folder of their own, against a clock. What counts as a fault: an
exception that gets through, an exit code other than 0, 1 and 2, such as that of a fault of the program, a
code 2 without exactly one line on stderr, a warning of numpy's, more than `PATIENCE` seconds of processor
time, a file left that is not whole or that was not asked for. Then the same with an interrupt
(Ctrl-C), SIGTERM or SIGHUP after a random time, and whole processes killed (SIGKILL) in the middle of
writing, after which the file asked for must be whole or absent. The exit code is 1 if there was any fault.
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

from command_outcomes import Case, unclear, untidy
from hypothesis import HealthCheck, Phase, given, settings
from stopped_processes import interrupts, kills
from typed_commands import cases

from mechsim.cli import main as command_line

# processor time that a command may take, and times as much on the clock of a machine that others use too
PATIENCE, CROWDED = 60.0, 10.0


class TooLongError(Exception):
    """The command did not end in time."""


def tried(case: Case) -> tuple[int | None, list[str]]:
    """Run a command in an empty folder; return its exit code and what was wrong with how it ended."""
    out, err = io.StringIO(), io.StringIO()
    faults: list[str] = []
    code: int | None = None
    before, old, rang = sys.argv, os.getcwd(), list[int]()
    with tempfile.TemporaryDirectory() as place:
        for name, content in case.files.items():
            Path(place, name).write_bytes(content)
        os.chdir(place)
        sys.argv = ["mechsim", *case.words]
        try:
            with (
                warnings.catch_warnings(record=True) as caught,
                contextlib.redirect_stdout(out),
                contextlib.redirect_stderr(err),
            ):
                warnings.simplefilter("always")
                with _clock() as rang:
                    command_line()
        except SystemExit as ended:
            code = ended.code if isinstance(ended.code, int) else 0
        except BaseException as error:
            faults.append(f"{type(error).__name__} got through: {str(error)[:200]}")
        finally:
            sys.argv = before
            os.chdir(old)
        if rang:
            # the command takes it for a fault of its own
            faults = [f"still running after {PATIENCE:g} s"]
        output = err.getvalue()
        faults += [f"warning: {one.category.__name__}: {one.message}" for one in caught]
        faults += list(unclear(code, output)) if not faults else []
        faults += list(untidy(Path(place), case, code))
    return code, faults


@contextlib.contextmanager
def _clock() -> Iterator[list[int]]:
    """Give a list that holds something once a command took too long and was stopped."""
    rang: list[int] = []

    def ring(number: int, _: object) -> None:
        rang.append(number)
        raise TooLongError

    timers = (
        (signal.SIGPROF, signal.ITIMER_PROF, PATIENCE),
        (signal.SIGALRM, signal.ITIMER_REAL, CROWDED * PATIENCE),
    )
    before = [signal.signal(number, ring) for number, _, _ in timers]
    for _, timer, seconds in timers:
        signal.setitimer(timer, seconds)
    try:
        yield rang
    finally:
        for (number, timer, _), old in zip(timers, before, strict=True):
            signal.setitimer(timer, 0.0)
            signal.signal(number, old)


def fuzz(examples: int) -> tuple[Counter[int | None], list[str]]:
    """Try random commands; return how often each exit code came and every fault."""
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
    def one(case: Case) -> None:
        code, faults = tried(case)
        codes[code] += 1
        result.extend(f"{fault}  <-  {' '.join(map(repr, case.words))}" for fault in faults)

    one()
    return codes, result


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(description="Random commands: a result or one clear line.")
    parser.add_argument("--examples", type=int, default=1000)
    parser.add_argument("--interrupts", type=int, default=40)
    parser.add_argument("--kills", type=int, default=30)
    asked = parser.parse_args(arguments)
    codes, result = fuzz(asked.examples)
    print("exit codes: " + ", ".join(f"{code}: {count}" for code, count in sorted(codes.items(), key=str)))
    result += interrupts(asked.interrupts)
    hit, killed = kills(asked.kills)
    result += killed
    run = sum(codes.values())
    print(f"{run} commands, {asked.interrupts} interrupted, {asked.kills} killed ({hit} writing)")
    for text, count in Counter(result).most_common():
        print(f"FAULT x{count}: {text}")
    print(f"{len(result)} faults")
    return 1 if result else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
