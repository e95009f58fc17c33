"""Every command on files as subjects: sound ones are never rejected, broken ones end in a result or one line.

    python validation/robustness/invalid_models.py [--count 1000] [--seed 1] [--only CLASS] [--part K N]

A part of them is sound: commands with catalogue names, files of the gallery and models that `mechsim
export` wrote; none may be rejected, and `validate` may miss nothing. The others are such a command with a
strange value of any option it has, with a word lost, doubled or garbled, with its subject, its table or its
formula broken in up to three places, or with MJCF numbers of odd magnitudes; what is quick is drawn three
times as often.

Each runs in a forked process of its own, so that a crash in C is a fault like another.
Prints a table of classes, every fault, and what was missed, with the number to run it again by. The exit
code is 1 if there was any fault.
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

from command_outcomes import unclear, untidy
from invalid_commands import drawn
from valid_commands import Tried

from mechsim import cli

# processor time of a command, and memory that it may ask for
PATIENCE, ROOM = 60, 16 << 30


def run(item: Tried) -> tuple[int, str, list[str], float]:
    """Run a case in a forked process; return its exit code, last line said, what was wrong, and seconds."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder, "here")
        place.mkdir()
        for name, content in item.case.files.items():
            (place / name).write_bytes(content)
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        child = os.fork()
        if child == 0:
            typed(item.case.words, place, Path(folder))
        _, status = os.waitpid(child, 0)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        out, output = (Path(folder, name).read_text(errors="replace") for name in ("out", "err"))
        code = os.waitstatus_to_exitcode(status)
        faults = list(_wrong(item, code, out, output)) + list(untidy(place, item.case, code))
        faults += [
            f"left {path.name}" for path in Path(folder).iterdir() if path.name not in ("here", "out", "err")
        ]
    return code, (output.strip().splitlines() or [""])[-1], faults, spent


def typed(words: tuple[str, ...], place: Path, folder: Path) -> None:
    """Be the command, in this process, which ends with it."""
    resource.setrlimit(resource.RLIMIT_CPU, (PATIENCE, PATIENCE + 2))
    resource.setrlimit(resource.RLIMIT_AS, (ROOM, ROOM))
    for name, stream in (("out", 1), ("err", 2)):
        number = os.open(folder / name, os.O_CREAT | os.O_WRONLY)
        os.dup2(number, stream)
        os.close(number)
    os.chdir(place)
    os.environ["TMPDIR"], tempfile.tempdir = str(folder), str(folder)
    sys.argv = ["mechsim", *words]
    code = 99
    try:
        cli.main()
    except SystemExit as ended:
        code = ended.code if isinstance(ended.code, int) else 0
    except BaseException as error:
        print(f"{type(error).__name__} got through: {error}", file=sys.stderr)
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def _wrong(item: Tried, code: int, out: str, output: str) -> Iterator[str]:
    if code == -signal.SIGXCPU:
        yield f"over {PATIENCE} s"
        return
    yield from unclear(code, output)
    if "Warning:" in output:
        yield f"a warning: {output[:200]!r}"
    if item.sound and code == 2:
        yield f"refused: {output.strip()[:300]}"
    if item.missed_is_wrong and code == 1:
        yield "the roads disagree"
    if "--json" in item.case.words and code in (0, 1) and not {"-h", "--help"} & set(item.case.words):
        try:
            json.loads(out, parse_constant=lambda name: 1 / 0)
        except (ValueError, ZeroDivisionError):
            yield f"no JSON on stdout: {out[:80]!r}"


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--count", type=int, default=1000, help="of cases")
    parser.add_argument("--sound", type=float, default=0.3, help="part of them that is sound")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="cases of a class, or with a word in them")
    parser.add_argument(
        "--part", type=int, nargs=2, metavar=("K", "N"), default=(0, 1), help="each Nth from K on"
    )
    parser.add_argument("--case", type=int, help="one of them, with its message")
    asked = parser.parse_args()
    # a page that is made to be opened is not
    os.environ["BROWSER"] = "true"
    for name in cli.COMMANDS:
        cli.load_command(name)
    cases = drawn(random.Random(asked.seed), asked.count, asked.sound)
    ended: defaultdict[str, Counter[str]] = defaultdict(Counter)
    faulty, taken = 0, [0.0]
    for number, item in enumerate(cases):
        typed = " ".join(item.case.words)
        if asked.case not in (None, number) or (asked.only not in item.kind and asked.only not in typed):
            continue
        if number % asked.part[1] != asked.part[0]:
            continue
        if sys.stderr.isatty() or number % 50 == 0:
            print(f"{number} of {len(cases)}, {sum(taken):.0f} s", file=sys.stderr, flush=True)
        code, output, faults, spent = run(item)
        taken.append(spent)
        ended[item.kind][str(code)] += 1
        ended[item.kind]["faults"] += bool(faults)
        faulty += bool(faults)
        if code == 1 and not faults:
            print(f"missed {number} ({item.kind}): {output[:200]}  <-  {typed[:200]}", flush=True)
        for fault in faults:
            print(f"FAULT {number} ({item.kind}): {fault}  <-  {typed[:200]}", flush=True)
        if asked.case is not None:
            print(f"{code}: {output}")
            for name, content in item.case.files.items():
                Path(tempfile.gettempdir(), f"case-{number}-{name}").write_bytes(content)
    print("\n| class | run | a result | missed | refused in one line | faults |\n|---|---|---|---|---|---|")
    for kind, counts in ended.items():
        total = sum(counts.values()) - counts["faults"]
        print(f"| {kind} | {total} | {counts['0']} | {counts['1']} | {counts['2']} | {counts['faults']} |")
    print(f"\n{faulty} with faults; {sum(taken):.0f} s of processor time, the longest {max(taken):.0f} s")
    return 1 if faulty else 0


if __name__ == "__main__":
    sys.exit(main())
