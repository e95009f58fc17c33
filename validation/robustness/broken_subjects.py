"""Every command on files as subjects: sound ones are never refused, broken ones end in a result or one line.

    python validation/robustness/broken_subjects.py [--count 1000] [--sound 0.3] [--seed 1] [--only CLASS]

A part of them is sound: commands with catalogue names, files of the gallery and models that `mechsim
export` wrote; none may be refused, and `validate` may miss nothing. The others are such a command with a
strange value of any option it has, with a word lost, doubled or garbled, or with its subject, its table or
its formula broken in up to three places; what is quick is drawn three times as often.

Each runs in a forked process of its own, so that a crash in C is a fault like
another. Prints a table of classes, and every fault with the number to run it again by. The exit code is 1 if
there was any.
"""

import argparse
import json
import os
import random
import re
import resource
import signal
import sys
import tempfile
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

from fuzz import Case, unclear, untidy

from mechsim import catalog, cli

ROOT = Path(__file__).resolve().parents[2]
GALLERY = ROOT / "models" / "gallery"
SWINGS = "peaucellier_lipkin.toml"
SCENES = ("four_bar", "slider_crank", "rssr", "rrsrr", "looper", "bennett")
SLOW = ("tune", "reduce", "tradeoff", "trace", "validate", "view", "render", "fit")
# processor time of a command, and memory that it may ask for
PATIENCE, ROOM = 60, 16 << 30
# catalogue name -> a point, a dimension of its own, and what it may be
VARIED = {
    "four_bar": ("C", "rocker", "70mm:78mm"),
    "slider_crank": ("B", "rod", "0.19:0.21"),
    "rssr": ("P3", "rocker", "26mm:28mm"),
    "rrsrr": ("C", "link", "38.5mm:39.5mm"),
    "looper": ("E", "rocker", "31.5mm:32.5mm"),
    "bennett": ("A", "twist0", "33deg:35deg"),
}
FORMULA = """import numpy as np

def law(angle):
    return {"A": np.stack([0.032 * np.cos(angle), 0.032 * np.sin(angle), 0 * angle], 1)}
"""
VALUES = """
0 -1 nan inf 1e300 1e-300 1e999 -0 x é ٣ 1,5 0x10 13mm 1;2 1:2 0:1:0.1 0:360:0deg a:b:c :: 1=2 = A A,B
A,,B crank crank= crank= crank=1 crank=nan crank=600rpm crank=t/0 crank=1/t crank=sin( crank=FILE.csv
crank=crank.csv crank=1e300rpm crank=t**t**t crank=__import__('os') crank=1:2:3 all . no/out.csv out.csv
out.xml out.json out.nc crank.csv law.py:law law.py:none law.py no.py:law max:C.x range: range:crank
at:1:C.x at:x:C.x max: max: sobol:4 sobol:0 sobol:x latin:-1 normal uniform smooth fold step pose
trajectory torque closure 1um 1deg 1e-6 1s 0.1s -1s 600rpm 0rpm 5deg 0rpm 5deg 0,-9.81,0 0,0 constant:1
dc:1,0,1 line:1 A:B=1,0 crank=1,2 crank=-1,0
"""
STRANGE = ["", " ", "n" * 300, "\ud83d", *VALUES.split()]
NUMBERS = re.compile(r"(?<![A-Za-z_])-?\d+\.?\d*(?:[eE]-?\d+)?")
WORDS = re.compile(r"[A-Za-z_]{2,}")
ODD_NUMBERS = ["0", "-1", "nan", "inf", "1e300", "1e-300", "1e999", '""', "abc", "1e9", "10", "0.1", "3x"]
ODD_TEXT = ["\x00", "\ufeff", "\t", "\r", *"é#\"'[]{}=<>&,"]


@dataclass(frozen=True)
class Tried:
    """A case, its class, which of its files may be broken, and whether a refusal of it is a fault."""

    kind: str
    case: Case
    breakable: tuple[str, ...] = ()
    sound: bool = False
    missed_is_wrong: bool = False


def subjects() -> Iterator[tuple[str, dict[str, bytes]]]:
    """Yield sound subjects: what is typed, and the files it needs."""
    for name in catalog.DRIVES:
        yield name, {}
    laws = {path.name: path.read_bytes() for path in GALLERY.glob("*.py")}
    for path in sorted(GALLERY.glob("*.toml")):
        yield path.name, {path.name: path.read_bytes(), **laws}
    for name in SCENES:
        yield f"{name}.xml", {f"{name}.xml": (ROOT / "models" / f"{name}.xml").read_bytes()}


def lines(model: str) -> Iterator[str]:
    """Yield the commands that a sound subject has to stand."""
    # a whole turn of a crank that only swings is refused, and rightly so
    far = " --angles -60deg:60deg:5deg" if model == SWINGS else ""
    yield from (f"show {model} --json", f"solve {model}{far} -o out.csv", f"solve {model}{far} --json")
    yield f"view {model} -o out.html"
    if not far:
        yield f"simulate {model} -o out.npz"
    yield from (f"plot {model} -o out.svg", f"render {model} -o out.png --size 64x48")
    if not model.endswith(".xml"):
        yield from (f"export {model} -o out.xml", f"export {model} --format toml -o out.toml")
        yield from (f"dynamics {model} --json", f"validate {model} --json")
    else:
        run = f"{model} --drive crank=600rpm --duration 0.1"
        yield from (
            f"simulate {run} -o out.csv",
            f"validate {run} --json",
            f"trace {model} --starts 9 --json",
        )
    if model == "four_bar.xml":
        run = f"{model} --drive crank=600rpm --duration 0.1 --tolerance 1mm -o out.xml --json"
        yield from (f"tune {run} --budget 1s", f"reduce {run}")
    if model in VARIED:
        point, dimension, values = VARIED[model]
        yield f"sweep {model} --vary {dimension}={values}:4 --measure stroke:{point} -o out.csv --samples 12"
        yield f"sweep {model} --vary {dimension}={values} --sample sobol:4 --measure max:{point}.x -o out.nc"
        yield f"sensitivity {model} --of {point} --to {dimension} -o out.csv"
        little = "0.01deg" if values.endswith("deg") else "1um"
        yield f"sensitivity {model} --of {point}.v --tolerances {dimension}={little} --samples 100 --json"
        yield f"fit {model} --to measured.csv --vary {dimension} -o out.json --json"
        yield f"trace {model} -o out.csv --starts 9"
        yield f"validate {model} --against measured.csv --json"
        yield f"simulate {model} --profile crank.csv -o out.csv"
        yield f"tradeoff {model} --budget 1s --json"
    if model == "four_bar":
        yield f"validate {model} --against law.py:law --json"
        yield f"sweep {model} --design designs.csv --measure range:rocker -o out.csv"


def sound_cases() -> list[Tried]:
    """Return every command with every sound subject."""
    rows = "".join(f"{0.01 * i},{0.03 * i}\n" for i in range(12))
    beside = {"crank.csv": f"time,angle\n{rows}".encode(), "law.py": FORMULA.encode()}
    beside["designs.csv"] = b"crank,rocker\n0.03,0.07\n0.032,0.075\n"
    found: list[Tried] = []
    for model, needed in subjects():
        mine = dict(beside)
        if model in VARIED:
            mine["measured.csv"] = measured(model)
        for line in lines(model):
            words = tuple(line.split())
            files = needed | {
                name: text for name, text in mine.items() if any(name in word for word in words)
            }
            breakable = tuple(name for name in files if name in line)
            judged = words[0] == "validate"
            found.append(Tried("sound", Case(words, files), breakable, True, missed_is_wrong=judged))
    return found


def measured(name: str) -> bytes:
    """Return a table of the motion of a mechanism of the catalogue."""
    point = VARIED[name][0]
    drive = catalog.make(name)
    low, high = drive.crank_range().interval if not drive.crank_range().full else (0.0, 6.0)
    angles = [low + (high - low) * (0.1 + 0.04 * i) for i in range(20)]
    places = drive.positions(angles)[point]
    head = f"angle,{point}.x,{point}.y,{point}.z"
    body = [",".join(repr(float(v)) for v in (a, *place)) for a, place in zip(angles, places, strict=True)]
    return "\n".join([head, *body]).encode()


def drawn(chance: random.Random, count: int, sound: float) -> list[Tried]:
    """Return cases, a part of them sound, the rest with something wrong."""
    every, by_command = sound_cases(), defaultdict[str, list[Tried]](list)
    for one in every:
        by_command[one.case.words[0]].append(one)
    often = [command for command in sorted(by_command) for _ in range(1 if command in SLOW else 3)]
    whole = chance.sample(every, min(len(every), round(sound * count)))
    wrong = (spoilt(chance, chance.choice(by_command[chance.choice(often)])) for _ in range(count))
    return [*whole, *islice(wrong, count - len(whole))]


def spoilt(chance: random.Random, one: Tried) -> Tried:
    """Return a sound case with something wrong."""
    words = list(one.case.words)
    kinds = ["value", "value", "word", *["file"] * (3 if one.breakable else 0)]
    kind = chance.choice(kinds)
    if kind == "file":
        name = chance.choice(one.breakable)
        text = one.case.files[name]
        for _ in range(chance.randint(1, 3)):
            text = broken(chance, text)
        made = Case(one.case.words, {**one.case.files, name: text})
        kind = {"toml": "broken TOML", "xml": "broken MJCF", "csv": "broken table", "py": "broken formula"}[
            name.rpartition(".")[2]
        ]
        return replace(one, kind=kind, case=made, sound=False, missed_is_wrong=False)
    if kind == "value":
        for option in chance.sample(options_of(words[0]), k=chance.randint(1, 2)):
            words += [option, chance.choice(STRANGE)]
    else:
        at = chance.randrange(1, len(words))
        change = chance.randrange(4)
        if change == 0:
            del words[at]
        elif change == 1:
            words.insert(at, words[at])
        elif change == 2:
            words[at] = chance.choice(STRANGE)
        else:
            cut = chance.randrange(len(words[at]) + 1)
            words[at] = words[at][:cut] + chance.choice(ODD_TEXT[1:]) + words[at][cut:]
    kind = "strange value" if kind == "value" else "garbled word"
    return replace(
        one, kind=kind, case=Case(tuple(words), one.case.files), sound=False, missed_is_wrong=False
    )


def broken(chance: random.Random, content: bytes) -> bytes:
    """Return a text with one thing wrong with it."""
    text = content.decode(errors="replace")
    rows = text.splitlines(keepends=True) or [""]
    at = chance.randrange(len(rows))
    change = chance.randrange(9)
    if change == 0:
        del rows[at]
    elif change == 1:
        rows.insert(at, rows[at])
    elif change == 2:
        return content[: chance.randrange(len(content) + 1)]
    elif change == 3:
        other = chance.randrange(len(rows))
        rows[at], rows[other] = rows[other], rows[at]
    elif change == 4:
        cut = chance.randrange(len(rows[at]) + 1)
        rows[at] = rows[at][:cut] + chance.choice(ODD_TEXT) + rows[at][cut:]
    elif change == 5:
        return content + bytes(chance.randrange(256) for _ in range(9))
    else:
        # half of all: a number, or a word, for another
        found = list((NUMBERS if change < 8 else WORDS).finditer(text))
        if found:
            place = chance.choice(found)
            new = chance.choice(ODD_NUMBERS) if change < 8 else chance.choice(WORDS.findall(text))
            return (text[: place.start()] + new + text[place.end() :]).encode(errors="replace")
    return "".join(rows).encode(errors="replace")


def run(one: Tried) -> tuple[int, str, list[str], float]:
    """Run a case in a forked process; return its exit code, last line said, what was wrong, and seconds."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder, "here")
        place.mkdir()
        for name, content in one.case.files.items():
            (place / name).write_bytes(content)
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        child = os.fork()
        if child == 0:
            _typed(one.case.words, place, Path(folder))
        _, status = os.waitpid(child, 0)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        out, said = (Path(folder, name).read_text(errors="replace") for name in ("out", "err"))
        code = os.waitstatus_to_exitcode(status)
        faults = list(_wrong(one, code, out, said)) + list(untidy(place, one.case, code))
        faults += [
            f"left {path.name}" for path in Path(folder).iterdir() if path.name not in ("here", "out", "err")
        ]
    return code, (said.strip().splitlines() or [""])[-1], faults, spent


def _typed(words: tuple[str, ...], place: Path, folder: Path) -> None:
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


def _wrong(one: Tried, code: int, out: str, said: str) -> Iterator[str]:
    if code == -signal.SIGXCPU:
        yield f"over {PATIENCE} s"
        return
    yield from unclear(code, said)
    if "Warning:" in said:
        yield f"a warning: {said[:200]!r}"
    if one.sound and code == 2:
        yield f"refused: {said.strip()[:300]}"
    if one.missed_is_wrong and code == 1:
        yield "the roads disagree"
    if "--json" in one.case.words and code in (0, 1) and not {"-h", "--help"} & set(one.case.words):
        try:
            json.loads(out, parse_constant=lambda name: 1 / 0)
        except (ValueError, ZeroDivisionError):
            yield f"no JSON on stdout: {out[:80]!r}"


def options_of(command: str) -> list[str]:
    """Return the options of a command that take a value."""
    if command not in cli.COMMANDS:
        return ["--set"]
    made = cli.loaded(command).params
    return [one.opts[0] for one in made if one.opts[0].startswith("-") and not getattr(one, "is_flag", True)]


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--count", type=int, default=1000, help="of cases")
    parser.add_argument("--sound", type=float, default=0.3, help="part of them that is sound")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="cases of a class, or with a word in them")
    parser.add_argument(
        "--part", type=int, nargs=2, metavar=("K", "N"), default=(0, 1), help="each Nth from K on"
    )
    parser.add_argument("--case", type=int, help="one of them, told what it said")
    asked = parser.parse_args()
    # a page that is made to be opened is not
    os.environ["BROWSER"] = "true"
    for name in cli.COMMANDS:
        cli.loaded(name)
    cases = drawn(random.Random(asked.seed), asked.count, asked.sound)
    ended: defaultdict[str, Counter[str]] = defaultdict(Counter)
    faulty, taken = 0, [0.0]
    for number, one in enumerate(cases):
        typed = " ".join(one.case.words)
        if asked.case not in (None, number) or (asked.only not in one.kind and asked.only not in typed):
            continue
        if number % asked.part[1] != asked.part[0]:
            continue
        if sys.stderr.isatty() or number % 50 == 0:
            print(f"{number} of {len(cases)}, {sum(taken):.0f} s", file=sys.stderr, flush=True)
        code, said, faults, spent = run(one)
        taken.append(spent)
        ended[one.kind][str(code)] += 1
        ended[one.kind]["faults"] += bool(faults)
        faulty += bool(faults)
        if code == 1 and not faults:
            print(f"missed {number} ({one.kind}): {said[:200]}  <-  {typed[:200]}", flush=True)
        for fault in faults:
            print(f"FAULT {number} ({one.kind}): {fault}  <-  {typed[:200]}", flush=True)
        if asked.case is not None:
            print(f"{code}: {said}")
            for name, content in one.case.files.items():
                Path(tempfile.gettempdir(), f"case-{number}-{name}").write_bytes(content)
    print("\n| class | run | a result | missed | refused in one line | faults |\n|---|---|---|---|---|---|")
    for kind, counts in ended.items():
        total = sum(counts.values()) - counts["faults"]
        print(f"| {kind} | {total} | {counts['0']} | {counts['1']} | {counts['2']} | {counts['faults']} |")
    print(f"\n{faulty} with faults; {sum(taken):.0f} s of processor time, the longest {max(taken):.0f} s")
    return 1 if faulty else 0


if __name__ == "__main__":
    sys.exit(main())
