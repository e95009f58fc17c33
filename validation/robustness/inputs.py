"""What was tried at the edges of the command line and came out: inputs, files, streams, signals, sizes.

    python validation/robustness/inputs.py [--only WORD]

Each case is a whole process in a folder of its own, and prints as a row of a table: how it ended, how long
it took, and what it said. The exit code is 1 if one ended otherwise than it should, took longer than
`PATIENCE`, said more than one line for a rejection, showed a traceback or left a file that was not asked for.
"""

import argparse
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

PATIENCE = 60.0
SCENE = "scene.xml --drive crank=600rpm --duration 0.1"
SWEEP = "sweep four_bar --vary rocker=70mm:78mm:4 --samples 12 --measure stroke:C"
MODELS = Path(__file__).resolve().parents[2] / "models"
LONG = "render rssr -o film.mp4 --frames-per-turn 2000 --size 640x480"


@dataclass(frozen=True)
class Tried:
    """One case: its class, what is typed to a shell after `mechsim`, and the exit code it should have."""

    kind: str
    words: str
    code: int
    sent: signal.Signals | None = None
    graphics: str = ""


CASES = [
    Tried("unit", "solve rssr --set 'crank=13mm!'", 2),
    Tried("unit", "solve rssr --set crank=13mm=1", 2),
    Tried("unit", "solve rssr --set 'crank=13 m**9**9**9'", 2),
    Tried("number", "dynamics four_bar --motor line:1e4,600rpm --method none", 0),
    Tried("number", "dynamics four_bar --motor dc:1,2,3 --method none", 0),
    Tried("number", "dynamics four_bar --motor constant:1e20 --method none", 0),
    Tried("number", "dynamics four_bar --flywheel 1e300", 2),
    Tried("number", "dynamics four_bar --turns 1e-308", 2),
    Tried("number", "render rssr -o a.png --size ²x²", 2),
    Tried("name", f"tradeoff {'n' * 304}", 2),
    Tried("name", f"solve rssr -o {'n' * 304}.csv", 2),
    Tried("name", "solve rssr -o link.csv", 0),
    Tried("file", "solve rssr -o read_only.csv", 2),
    Tried("file", "solve rssr -o full.csv", 2),
    Tried("file", "simulate rssr --profile pipe.csv", 2),
    Tried("file", "simulate rssr --profile bomb.npz", 2),
    Tried("file", "simulate rssr --profile mark.csv", 0),
    Tried("file", "export four_bar --format toml -o link.csv", 2),
    Tried("file", "export four_bar --format toml -o link.toml", 0),
    Tried("file", "export four_bar -o full.xml", 2),
    Tried("file", f"{SWEEP} -o /proc/out.csv", 2),
    Tried("file", f"{SWEEP} -o full.csv", 2),
    Tried("file", f"{SWEEP} -o link.csv", 0),
    Tried("file", "trace four_bar -o /proc/out.csv", 2),
    Tried("file", "trace four_bar -o full.csv", 2),
    Tried("file", "trace four_bar -o read_only.csv", 2),
    Tried("file", "fit four_bar --to pipe.csv --vary rocker", 2),
    Tried("file", "fit four_bar --to there --vary rocker", 2),
    Tried("file", f"tune {SCENE} --tolerance 1mm --budget 1s -o /proc/out.xml", 2),
    Tried("file", f"tune {SCENE} --tolerance 1mm --budget 1s -o full.xml", 2),
    Tried("file", f"tune {SCENE} --tolerance 1mm --budget 1s -o link.xml", 0),
    Tried("file", f"reduce {SCENE} --tolerance 1mm -o /proc/out.xml", 2),
    Tried("file", f"reduce {SCENE} --tolerance 1mm -o full.xml", 2),
    Tried("file", "view four_bar -o full.html", 2),
    Tried("file", "validate four_bar --report /proc/out", 2),
    Tried("file", "validate four_bar --report read_only.csv", 2),
    Tried("file", "sensitivity four_bar --of C --to rocker -o full.csv", 2),
    Tried("file", "show pipe.toml", 2),
    Tried("file", "show pipe.xml", 2),
    Tried("stream", "list >&-", 0),
    Tried("stream", f"tune {SCENE} --tolerance 1mm --budget 1s --json -o out.xml >/dev/full", 2),
    Tried("stream", f"{SWEEP} -o out.csv >&- 2>&-", 0),
    Tried("stream", "trace four_bar --json >/dev/full", 2),
    Tried("stream", "sensitivity four_bar --of C --to rocker --json >/dev/full", 2),
    Tried("stream", "schema 2>/dev/full >/dev/full", 2),
    Tried("stream", "trace four_bar --json | head -c 1 >/dev/null", 0),
    Tried("stream", "solve rsr 2>&-", 2),
    Tried("stream", "list >/dev/full", 2),
    Tried("stream", "validate four_bar <&- >&- 2>&-", 0),
    Tried("signal", LONG, 2, signal.SIGINT),
    Tried("signal", LONG, 143, signal.SIGTERM),
    Tried("signal", LONG, 129, signal.SIGHUP),
    Tried("size", "simulate rssr --turns 1e7", 2),
    Tried("size", "solve rssr --angles 0:3600:4e-4deg --json", 2),
    Tried("size", "dynamics rssr --samples 100000 --turns 100", 2),
    Tried("size", "dynamics four_bar --turns 50", 0),
    Tried("graphics", "simulate rssr", 0, graphics="osmesa"),
    Tried("graphics", "validate four_bar", 0, graphics="nonsense"),
    Tried("graphics", f"tune {SCENE} --tolerance 1mm --budget 1s -o out.xml", 0, graphics="nonsense"),
    Tried("graphics", "view four_bar -o out.html", 0, graphics="nonsense"),
    Tried("graphics", "trace four_bar --json", 0, graphics="osmesa"),
]


def prepared(place: Path, words: str) -> set[str]:
    """Put into a folder the files that cases name; return their names."""
    (place / "there").mkdir()
    for kind in ("csv", "toml", "xml"):
        (place / f"link.{kind}").symlink_to(place / "there" / f"real.{kind}")
        os.mkfifo(place / f"pipe.{kind}")
    for kind in ("csv", "xml", "html"):
        (place / f"full.{kind}").symlink_to("/dev/full")
    (place / "scene.xml").write_text((MODELS / "four_bar.xml").read_text())
    (place / "read_only.csv").write_text("mine")
    (place / "read_only.csv").chmod(0o444)
    # gigabytes of zero in megabytes; as numbers eight times that
    if "bomb" in words:
        np.savez_compressed(
            place / "bomb.npz", time=np.zeros(6), angle=np.zeros(2_500_000_000, dtype=np.int8)
        )
    rows = "".join(f"{0.01 * i},{0.03 * i}\n" for i in range(10))
    (place / "mark.csv").write_text("\ufefftime, angle\n" + rows, encoding="utf-8")
    return {path.name for path in place.iterdir()}


def _heard() -> None:
    """Let all signals through: a shell lets what runs in the background ignore Ctrl-C, nohup a hang-up."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)


def ended(case: Tried) -> tuple[int, float, str, list[str]]:
    """Run a case; return its exit code, seconds, last line said, and what was wrong."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        there = prepared(place, case.words)
        # in a group of its own, so that a signal reaches the encoder too
        began = time.perf_counter()
        process = subprocess.Popen(
            ["sh", "-c", f"exec {sys.executable} -m mechsim {case.words}"],
            cwd=place,
            env=os.environ | ({"MUJOCO_GL": case.graphics} if case.graphics else {}),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
            preexec_fn=_heard,
        )
        faults: list[str] = []
        if case.sent is not None:
            while process.poll() is None and not any(place.glob(".film*")):
                time.sleep(0.01)
            os.killpg(process.pid, case.sent)
        try:
            output = process.communicate(timeout=PATIENCE)[1]
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            output = process.communicate()[1]
            faults.append(f"over {PATIENCE:g} s")
        spent = time.perf_counter() - began
        if process.returncode != case.code:
            faults.append(f"ended with {process.returncode}, not {case.code}")
        # what takes long says how long
        lines = [item for item in output.splitlines() if not re.match(r"\w+: .* left$", item)]
        if "Traceback" in output or (case.code == 2 and case.sent is None and len(lines) > 1):
            faults.append("more than a line")
        # what a stream that takes nothing ends was whole before
        asked = process.returncode == 0 or case.kind == "stream"
        left = {path.name for path in place.iterdir()} - there
        faults += [f"left {name}" for name in sorted(left) if not (asked and f"-o {name}" in case.words)]
        if (place / "read_only.csv").read_text() != "mine":
            faults.append("a protected file was written")
        line = (output.splitlines() or [""])[-1]
    return process.returncode, spent, line, faults


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", default="", help="cases with a word in them")
    asked = parser.parse_args()
    cases = [case for case in CASES if asked.only in f"{case.kind} {case.words}"]
    wrong = 0
    print("| what | typed after `mechsim` | exit | s | said |\n|---|---|---|---|---|")
    for case in cases:
        code, spent, line, faults = ended(case)
        wrong += bool(faults)
        typed = case.words if len(case.words) < 70 else f"{case.words[:60]}..."
        sent = f", {case.sent.name}" if case.sent else ""
        given = f"`MUJOCO_GL={case.graphics}` " if case.graphics else ""
        output = line.removeprefix("mechsim: ").replace("|", "\\|")[:150]
        fault = f" **{'; '.join(faults)}**" if faults else ""
        print(
            f"| {case.kind} | {given}`{typed}`{sent} | {code} | {spent:.1f} | {output}{fault} |", flush=True
        )
    print(f"\n{len(cases)} cases, {wrong} ended otherwise than they should")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
