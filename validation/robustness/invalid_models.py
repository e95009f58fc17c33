"""Every command on valid and corrupted models: a result or one line, and no rejection of a valid model.

    python validation/robustness/invalid_models.py [--count 1000] [--seed 1] [--only CLASS] [--part K N]

Valid cases are commands with catalogue names, gallery files and exported models; none may be rejected, and
`validate` may not fail. The others have an unusual value of any option, a word removed, duplicated or
garbled, up to three faults in the model, table or formula, or MJCF numbers of extreme magnitude. Fast
commands are chosen three times as often. Each case runs in a forked process, so that a
crash in C counts as a fault.

The script prints a table of classes, and every fault and failed verdict with the number for `--case`. The
exit code is 1 if there was any fault.
"""

import argparse
import json
import os
import random
import resource
import signal
import sys
import tempfile
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path

from command_outcomes import file_faults, output_faults
from invalid_commands import random_cases
from valid_commands import CommandCase

from mechsim import cli

# limits of a command: processor time in [s], memory in bytes
TIME_LIMIT, MEMORY_LIMIT = 60, 16 << 30


def run(item: CommandCase) -> tuple[int, str, list[str], float]:
    """Run a case in a forked process; return its exit code, last line of output, faults and seconds."""
    with tempfile.TemporaryDirectory() as folder:
        working = Path(folder, "working")
        working.mkdir()
        for name, content in item.case.files.items():
            (working / name).write_bytes(content)
        start = resource.getrusage(resource.RUSAGE_CHILDREN)
        child = os.fork()
        if child == 0:
            run_command(item.case.words, working, Path(folder))
        _, status = os.waitpid(child, 0)
        end = resource.getrusage(resource.RUSAGE_CHILDREN)
        seconds = end.ru_utime + end.ru_stime - start.ru_utime - start.ru_stime
        stdout, stderr = (Path(folder, name).read_text(errors="replace") for name in ("out", "err"))
        code = os.waitstatus_to_exitcode(status)
        faults = list(case_faults(item, code, stdout, stderr)) + list(file_faults(working, item.case, code))
        faults += [
            f"left {path.name}"
            for path in Path(folder).iterdir()
            if path.name not in ("working", "out", "err")
        ]
    return code, (stderr.strip().splitlines() or [""])[-1], faults, seconds


def run_command(words: tuple[str, ...], working: Path, folder: Path) -> None:
    """Run a command in this process, then exit the process."""
    resource.setrlimit(resource.RLIMIT_CPU, (TIME_LIMIT, TIME_LIMIT + 2))
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_LIMIT, MEMORY_LIMIT))
    for name, stream in (("out", 1), ("err", 2)):
        number = os.open(folder / name, os.O_CREAT | os.O_WRONLY)
        os.dup2(number, stream)
        os.close(number)
    os.chdir(working)
    os.environ["TMPDIR"], tempfile.tempdir = str(folder), str(folder)
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


def case_faults(item: CommandCase, code: int, stdout: str, stderr: str) -> Iterator[str]:
    if code == -signal.SIGXCPU:
        yield f"over {TIME_LIMIT} s"
        return
    yield from output_faults(code, stderr)
    if "Warning:" in stderr:
        yield f"a warning: {stderr[:200]!r}"
    if item.valid and code == 2:
        yield f"rejected: {stderr.strip()[:300]}"
    if item.must_agree and code == 1:
        yield "the two methods disagree"
    if "--json" in item.case.words and code in (0, 1) and not {"-h", "--help"} & set(item.case.words):
        try:
            json.loads(stdout, parse_constant=lambda name: 1 / 0)
        except (ValueError, ZeroDivisionError):
            yield f"no JSON on stdout: {stdout[:80]!r}"


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--count", type=int, default=1000, help="number of cases")
    parser.add_argument("--valid", type=float, default=0.3, help="fraction of valid cases")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="cases whose class or command contains this")
    parser.add_argument(
        "--part", type=int, nargs=2, metavar=("K", "N"), default=(0, 1), help="every Nth case from K on"
    )
    parser.add_argument("--case", type=int, help="one case, with its output")
    options = parser.parse_args()
    # commands that open a page do not start a browser
    os.environ["BROWSER"] = "true"
    for name in cli.COMMANDS:
        cli.load_command(name)
    cases = random_cases(random.Random(options.seed), options.count, options.valid)
    outcomes: defaultdict[str, Counter[str]] = defaultdict(Counter)
    failures, times = 0, [0.0]
    for number, item in enumerate(cases):
        text = " ".join(item.case.words)
        if options.case not in (None, number) or (options.only not in item.kind and options.only not in text):
            continue
        if number % options.part[1] != options.part[0]:
            continue
        if sys.stderr.isatty() or number % 50 == 0:
            print(f"{number} of {len(cases)}, {sum(times):.0f} s", file=sys.stderr, flush=True)
        code, output, faults, seconds = run(item)
        times.append(seconds)
        outcomes[item.kind][str(code)] += 1
        outcomes[item.kind]["faults"] += bool(faults)
        failures += bool(faults)
        if code == 1 and not faults:
            print(f"failed {number} ({item.kind}): {output[:200]}  <-  {text[:200]}", flush=True)
        for fault in faults:
            print(f"FAULT {number} ({item.kind}): {fault}  <-  {text[:200]}", flush=True)
        if options.case is not None:
            print(f"{code}: {output}")
            for name, content in item.case.files.items():
                Path(tempfile.gettempdir(), f"case-{number}-{name}").write_bytes(content)
    print("\n| class | run | result | failed | rejected in one line | faults |\n|---|---|---|---|---|---|")
    for kind, counts in outcomes.items():
        total = sum(counts.values()) - counts["faults"]
        print(f"| {kind} | {total} | {counts['0']} | {counts['1']} | {counts['2']} | {counts['faults']} |")
    print(f"\n{failures} with faults; {sum(times):.0f} s of processor time, the longest {max(times):.0f} s")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
