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
import csv
import io
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
import warnings
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from mechsim import catalog
from mechsim import files as tables
from mechsim.cli import main as command_line

# processor time that a command may take, and times as much on the clock of a machine that others use too
PATIENCE, CROWDED = 60.0, 10.0
PIPES: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
CODE = "from mechsim.cli import main; import sys; sys.argv = ['mechsim', *sys.argv[1:]]; main()"

# the same, with a line as soon as the command line has taken over
LISTENING = CODE.replace("main()", "print('here', flush=True); main()")


@dataclass(frozen=True)
class Case:
    """What is typed, and the files that lie there."""

    words: tuple[str, ...]
    files: dict[str, bytes] = field(default_factory=dict)


# values people type: sound, strange, wrong
numbers = st.one_of(
    st.floats(-1e3, 1e3).map(repr),
    st.floats(allow_nan=True, allow_infinity=True).map(repr),
    st.sampled_from(["0", "-0", "1e-300", "1e300", "nan", "inf", "", "1e999", "0x10", "1,5", "5e-324", "٣"]),
)
units = st.sampled_from(
    [
        *("", "mm", "m", "deg", "rad", "rpm", "s", "ms", "um", " mm", "parrots", "kg", "%", "1/m"),
        *("mm!", "mm=1", "mm#x", "m**9**9**9", "m**2", "(m)"),
    ]
)
quantities = st.builds(lambda number, unit: f"{number}{unit}", numbers, units)
lengths = st.integers(1, 400).map(lambda value: f"{0.5 * value}mm")
texts = st.one_of(quantities, st.text(max_size=8), st.sampled_from(["on", "off", "1", "-1", "+1", "2,3,4mm"]))
names = st.one_of(
    st.sampled_from(list(catalog.DRIVES)),
    st.sampled_from(["rsr", "", "four-bar", "RSSR", "--", "n" * 304, "."]),
    st.text(max_size=6),
)


@st.composite
def sets(draw: st.DrawFn, name: str) -> list[str]:
    known = list(catalog.parameters(name)) if name in catalog.DRIVES else ["crank"]
    words: list[str] = []
    for _ in range(draw(st.integers(0, 3))):
        parameter = draw(st.one_of(st.sampled_from(known), st.sampled_from(known), st.text(max_size=5)))
        equals = draw(st.sampled_from(["=", "=", "=", "=", "", "=="]))
        words += ["--set", f"{parameter}{equals}{draw(st.one_of(lengths, texts))}"]
    return words


outputs = st.sampled_from(
    [
        "out.csv",
        "out.npz",
        "out.xml",
        "out.svg",
        "out.png",
        "out.pdf",
        "out",
        ".csv",
        "no/out.csv",
        ".",
        "out.CSV",
        "ä b.csv",
        "n" * 300 + ".csv",
    ]
)
amounts = st.sampled_from(["1", "0.1", "0", "-1", "nan", "1e300", "1e29", "1e-308", "x", ""])
angles = st.one_of(
    st.sampled_from(
        ["0:360:5deg", "0:1:0.1", "30deg", "0:360:0deg", "360:0:-30deg", "a:b:c", "0:1e9:1", "::", "1:2"]
    ),
    st.builds(lambda a, b, c: f"{a}:{b}:{c}", quantities, quantities, quantities),
    quantities,
)
speeds = st.one_of(st.sampled_from(["600rpm", "-1rpm", "1e5rpm", "0", "3mm"]), quantities)
small = st.integers(-3, 400).map(str)

# option -> values; every command takes a few of its own
OPTIONS: dict[str, dict[str, st.SearchStrategy[str]]] = {
    "list": {},
    "show": {
        "--angle": quantities,
        "--driver": st.one_of(st.sampled_from(["crank", "rocker", "rod3"]), texts),
    },
    "solve": {"--angles": angles, "--speed": speeds, "-o": outputs},
    "export": {
        "--scene": st.sampled_from(["pose", "motion", "dynamics", "picture", "sea", ""]),
        "--cut": st.one_of(st.sampled_from(["A", "B", "P3", "A,B", "crank", ""]), st.text(max_size=4)),
        "-o": outputs,
    },
    "simulate": {
        "--speed": speeds,
        "--turns": st.one_of(
            st.sampled_from(["1", "0.3", "0", "-1", "nan", "inf"]), numbers.filter(lambda n: len(n) < 4)
        ),
        "--tolerance": st.sampled_from(["1um", "1e-3", "0", "-1", "nan", "1deg", "1mm"]),
        "--timestep": st.sampled_from(["1ms", "0.1ms", "0", "1s", "-1", "nan", "1mm"]),
        "--steps-per-turn": small,
        "--integrator": st.sampled_from(["RK4", "Euler", "implicitfast", "discrete", "verlet", ""]),
        "--solref": st.sampled_from(["0.02,1", "-1e4,-100", "0,0", "nan,1", "1", "a,b"]),
        "--solimp": st.sampled_from(["0.9,0.95,0.001", "0,0", "2,2", "nan,1", "0.9,0.9,0,0,0"]),
        "--hardness": st.sampled_from(["1", "1e-8", "0", "nan", "1e300", "x"]),
        "--method": st.sampled_from(["step", "pose", "guess"]),
        "--profile": st.sampled_from(["crank.csv", "crank.npz", "no.csv", "."]),
        "--every": quantities,
        "--scene": st.sampled_from(["motion", "dynamics", "picture", "pose", "sea"]),
        "-o": outputs,
    },
    "plot": {
        "--kind": st.sampled_from(["motion", "curve", "space", "transmission", "plan", "x"]),
        "--points": st.one_of(st.sampled_from(["A", "B", "P3", "A,B"]), st.text(max_size=4)),
        "--angle": quantities,
        "-o": outputs,
    },
    "synthesize": {
        "--through": st.one_of(st.just("12.8751,29.9574mm"), texts),
        "--tilt": st.one_of(st.just("1.3905deg"), quantities),
        "--length": st.one_of(st.just("4mm"), quantities),
    },
    "validate": {"--speed": speeds},
    "render": {
        "-o": st.sampled_from(["out.bmp", "no/out.png", "no/" + "n" * 304]),
        "--size": st.sampled_from(["big", "1x1", "²x²", "1x" + "9" * 5000, "640x480x3"]),
    },
    "dynamics": {
        "--motor": st.sampled_from(
            ["constant:1e20", "line:1e4,600rpm", "dc:12,1,0.05", "constant:0", "line:1", "dc:1,0,1", "x:1"]
        ),
        "--gear": amounts,
        "--flywheel": amounts,
        "--density": amounts,
        "--diameter": amounts,
        "--turns": st.sampled_from(["1", "0.01", "1e-308", "0", "nan", "9999"]),
        "--samples": st.sampled_from(["36", "1", "0", "100000"]),
        "--gravity": st.sampled_from(["0,-9.81,0", "1e300,0,0", "0,0", "nan,0,0"]),
        "--friction": amounts.map("crank={}".format),
        "--coefficient": amounts,
        "--method": st.sampled_from(["pose", "none", "none", "x"]),
        "--csv": outputs,
    },
    "tradeoff": {"--budget": st.sampled_from(["0", "-1s", "nan", "x"]), "--by": st.just("colour")},
    "extremes": {"--report": st.sampled_from(["no/out", "n" * 304])},
}
FREQUENT = ["show", "solve", "solve", "export", "export", "simulate", "simulate", "simulate", "plot", "list"]
SCARCE = ["synthesize", "validate", "render", "dynamics", "dynamics", "dynamics"]
# which take long; only refusals of theirs are tried
REFUSED = {"tradeoff": "--budget", "extremes": "--report", "render": "-o"}


# values that are right by themselves; together they may still be refused
SOUND: dict[str, list[str]] = {
    "--angle": ["30deg", "1", "-400deg"],
    "--angles": ["0:360:5deg", "0:1:0.1", "30deg", "-10:10:3"],
    "--speed": ["600rpm", "-1rpm", "1e5rpm", "1e-3"],
    "--scene": ["pose", "motion", "dynamics", "picture"],
    "--turns": ["1", "0.3", "3"],
    "--tolerance": ["1um", "1e-3", "1mm", "1e-9"],
    "--timestep": ["1ms", "0.1ms"],
    "--steps-per-turn": ["4", "17", "100", "1000"],
    "--integrator": ["RK4", "Euler", "implicitfast", "implicit", "discrete"],
    "--solref": ["0.02,1", "-1e4,-100"],
    "--solimp": ["0.9,0.95,0.001", "0.5,0.6"],
    "--hardness": ["1", "1e-8", "1e-2", "1e3"],
    "--method": ["step", "pose"],
    "--every": ["5deg", "0.1", "77deg"],
    "--kind": ["motion", "curve", "space", "transmission"],
    "--motor": ["constant:1", "line:2,600rpm", "dc:12,1,0.05"],
    "--flywheel": ["0", "1e-3", "1e3"],
    "--density": ["7850", "1", "1e6"],
    "--samples": ["36", "1", "200"],
    "--csv": ["out.csv", "out.npz"],
}


FILES: dict[str, list[str]] = {"render": [], "export": ["out.xml"], "plot": ["out.svg", "out.png", "out.pdf"]}
NEEDED: dict[str, tuple[str, ...]] = {
    "plot": ("-o", "out.svg"),
    "synthesize": ("--through", "12.8751,29.9574mm", "--tilt", "1.3905deg", "--length", "4mm"),
}
WITH_JSON = ("list", "show", "solve", "simulate", "validate", "synthesize")


@st.composite
def cases(draw: st.DrawFn) -> Case:
    """What someone may type: a third of it strange, the rest made of sound parts."""
    sound = draw(st.integers(0, 2)) > 0
    command = draw(st.sampled_from(FREQUENT * 3 + SCARCE + ["tradeoff", "extremes"]))
    sound = sound and command not in REFUSED
    words = [command]
    if command != "list":
        name = draw(st.sampled_from(list(catalog.DRIVES)) if sound else names)
        words.append(name)
        words += draw(stretched(name) if sound else sets(name))
    known = OPTIONS[command]
    for option in draw(st.lists(st.sampled_from(sorted(known)), max_size=4, unique=True)) if known else []:
        values = FILES.get(command, ["out.csv", "out.npz"]) if option == "-o" else SOUND.get(option, [])
        if not sound or values:
            words += [option, draw(st.sampled_from(values) if sound else known[option])]
    if command in REFUSED and REFUSED[command] not in words:
        words += [REFUSED[command], draw(known[REFUSED[command]])]
    if sound and not set(NEEDED.get(command, ())) & set(words):
        words += NEEDED.get(command, ())
    if (not sound or command in WITH_JSON) and draw(st.integers(0, 3)) == 0:
        words.append("--json")
    if not sound and draw(st.integers(0, 9)) == 0:
        words.append(draw(st.text(max_size=6)))
    return Case(tuple(words), draw(profiles()) if "--profile" in words else {})


@st.composite
def stretched(draw: st.DrawFn, name: str) -> list[str]:
    """Some parameters of a mechanism changed by up to a half, or to far beyond sense."""
    words: list[str] = []
    for parameter, kind in catalog.parameters(name).items():
        if not isinstance(kind.default, float) or draw(st.integers(0, 2)):
            continue
        wide = st.sampled_from([1e-9, 1e-3, 30.0, 1e6, -1.0])
        factor = draw(st.one_of(st.floats(0.7, 1.4), st.floats(0.5, 1.5), st.floats(0.9, 1.1), wide))
        words += ["--set", f"{parameter}={float(kind.default * factor)!r}"]
    return words


@st.composite
def profiles(draw: st.DrawFn) -> dict[str, bytes]:
    rows = draw(
        st.lists(st.tuples(st.floats(-1, 1), st.floats(-10, 10)), max_size=12)
        | st.integers(6, 30).map(lambda n: [(0.01 * i, 0.03 * i) for i in range(n)])
    )
    head = draw(st.sampled_from(["time,angle", "time, angle", "\ufefftime,angle", "angle,time", "t,a", ""]))
    text = "\n".join([head, *(f"{t!r},{a!r}" for t, a in rows)])
    made = draw(
        st.sampled_from([text.encode(), text.encode()[:-3], b"\xff\xfe\x00", b"", text.encode("utf-16")])
    )
    return {"crank.csv": made, "crank.npz": draw(st.binary(max_size=40))}


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
        said = err.getvalue()
        faults += [f"warning: {one.category.__name__}: {one.message}" for one in caught]
        faults += list(unclear(code, said)) if not faults else []
        faults += list(untidy(Path(place), case, code))
    return code, faults


def unclear(code: int | None, said: str) -> Iterator[str]:
    if code not in (0, 1, 2):
        yield f"exit code {code}"
    if "Traceback" in said:
        yield f"a traceback on stderr: {said[-300:]!r}"
    # that code is run is said before it is
    lines = [line for line in said.splitlines() if line.strip() and not line.endswith("a formula is code")]
    if code == 2 and (len(lines) != 1 or not lines[0].startswith("mechsim: ")):
        yield f"exit code 2 with {len(lines)} lines: {said[:300]!r}"


def untidy(place: Path, case: Case, code: int | None) -> Iterator[str]:
    """Yield what is wrong with the files left in a folder."""
    for path in place.rglob("*"):
        # the parts of a sweep that was stopped are there to go on with
        if path.name in case.files or any(part.endswith(".parts") for part in path.parts):
            continue
        # a report is a folder of files
        if not any(part in word for part in path.relative_to(place).parts for word in case.words):
            yield f"left {path.name}"
        elif code == 2:
            yield f"refused, but wrote {path.name}"
        elif (why := broken(path)) is not None:
            yield f"{path.name} is not whole: {why}"


def broken(path: Path) -> str | None:
    """Return why a file is not a whole one of its kind; None if it is."""
    try:
        if path.suffix.lower() == ".csv":
            text = path.read_text()
            widths = {len(row) for row in csv.reader(text.splitlines())}
            return None if len(widths) == 1 and text.endswith("\n") else "rows of several lengths"
        if path.suffix.lower() == ".npz":
            tables.read(path)
        elif path.suffix.lower() in (".xml", ".svg"):
            ET.parse(path)
        elif path.suffix.lower() == ".pdf" and not path.read_bytes().rstrip().endswith(b"%%EOF"):
            return "no end of file"
        elif path.suffix.lower() == ".png" and b"IEND" not in path.read_bytes()[-16:]:
            return "no end of image"
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    return None


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
    found: list[str] = []

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
        found.extend(f"{fault}  <-  {' '.join(map(repr, case.words))}" for fault in faults)

    one()
    return codes, found


# what is long enough to be interrupted, and writes
SCENE = Path(__file__).resolve().parents[2] / "models" / "four_bar.xml"
RUN = f"{SCENE} --drive crank=600rpm --duration 0.2 --tolerance 1um"
LONG = tuple(
    tuple(line.split())
    for line in (
        "solve rssr --angles 0:3600:0.05deg -o out.csv",
        "solve rssr --angles 0:3600:0.05deg -o out.npz",
        "simulate four_bar --turns 20 -o out.npz",
        "export looper -o out.xml",
        "plot rssr -o out.svg",
        "sweep four_bar --vary rocker=70mm:78mm:9000 --measure stroke:C -o out.csv",
        f"tune {RUN} -o out.xml",
        f"reduce {RUN} -o out.xml",
        "view rssr -o out.html",
        "trace looper --starts 3000 -o out.csv",
        "sensitivity rssr --of P3 --tolerances crank=10um --samples 3000000 -o out.csv",
        f"validate {SCENE} --drive crank=600rpm --duration 2 --plot out.svg",
    )
)

# so many of them are done within two seconds or so
SHORT = 5
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def _heard() -> None:
    for number in SIGNALS:
        signal.signal(number, signal.SIG_DFL)


def interrupts(count: int, seed: int = 1) -> list[str]:
    """End whole processes by Ctrl-C, SIGTERM or SIGHUP after random times; return every fault."""
    chance, found = random.Random(seed), []
    for i in range(count):
        words, number = LONG[i % len(LONG)], SIGNALS[(i + i // len(LONG)) % len(SIGNALS)]
        with tempfile.TemporaryDirectory() as place:
            # what runs in the background ignores Ctrl-C, and nohup a hang-up
            process = subprocess.Popen(
                [sys.executable, "-c", LISTENING, *words], cwd=place, text=True, preexec_fn=_heard, **PIPES
            )
            assert process.stdout is not None
            process.stdout.readline()
            time.sleep(chance.uniform(0.0, 5.0 if i % len(LONG) >= SHORT else 1.5))
            process.send_signal(number)
            said = process.communicate()[1]
            # as if by Ctrl-C, whose exit code is that of a refusal
            ended = 2 if process.returncode == 128 + number else process.returncode
            # before a command listens and after it is done the system ends the process, and nothing is said
            last = (said.splitlines() or [""])[-1]
            wrong = [] if process.returncode == -number else unclear(ended, last)
            faults = [*wrong, *untidy(Path(place), Case(words), process.returncode)]
        found += [f"ended by {number.name}: {fault}  <-  {' '.join(words)}" for fault in faults]
    return found


def kills(count: int, seed: int = 1) -> tuple[int, list[str]]:
    """Kill whole processes while they write; return in how many a file was being written, and every fault."""
    chance, found, hit = random.Random(seed), [], 0
    for i in range(count):
        words = LONG[i % 2]
        with tempfile.TemporaryDirectory() as place:
            process = subprocess.Popen(
                [sys.executable, "-c", CODE, *words], cwd=place, stdout=subprocess.DEVNULL
            )
            while process.poll() is None and not any(Path(place).iterdir()):
                time.sleep(0.002)
            time.sleep(chance.uniform(0.0, 0.3))
            process.kill()
            process.wait()
            left = [path.name for path in Path(place).iterdir()]
            hit += any(name.startswith(".out") for name in left)
            asked = Path(place, words[-1])
            if asked.exists() and (why := broken(asked)) is not None:
                found.append(f"killed: {asked.name} is not whole: {why}")
            # what was being written keeps its hidden name
            found += [f"killed: left {name}" for name in left if not name.startswith((".out-", "out."))]
    return hit, found


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(description="Random commands: a result or one clear line.")
    parser.add_argument("--examples", type=int, default=1000)
    parser.add_argument("--interrupts", type=int, default=40)
    parser.add_argument("--kills", type=int, default=30)
    asked = parser.parse_args(arguments)
    codes, found = fuzz(asked.examples)
    print("exit codes: " + ", ".join(f"{code}: {count}" for code, count in sorted(codes.items(), key=str)))
    found += interrupts(asked.interrupts)
    hit, killed = kills(asked.kills)
    found += killed
    run = sum(codes.values())
    print(f"{run} commands, {asked.interrupts} interrupted, {asked.kills} killed ({hit} writing)")
    for text, count in Counter(found).most_common():
        print(f"FAULT x{count}: {text}")
    print(f"{len(found)} faults")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
