"""What was tried at the edges of the command line and came out: inputs, files, streams, signals, sizes.

    python validation/robustness/inputs.py

Each case is a whole process in a folder of its own, and prints as a row of a table: how it ended, how long
it took, and what it said. The exit code is 1 if one ended otherwise than it should, took longer than
`PATIENCE`, said more than one line for a refusal, showed a traceback or left a file that was not asked for.
"""

import os
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

PATIENCE = 60.0
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
    Tried("stream", "list >&-", 0),
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
]


def prepared(place: Path, words: str) -> set[str]:
    """Put into a folder the files that cases name; return their names."""
    (place / "there").mkdir()
    (place / "link.csv").symlink_to(place / "there" / "real.csv")
    (place / "full.csv").symlink_to("/dev/full")
    (place / "read_only.csv").write_text("mine")
    (place / "read_only.csv").chmod(0o444)
    os.mkfifo(place / "pipe.csv")
    # gigabytes of nought in megabytes; as numbers eight times that
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
        there = prepared(place, case.words) if case.kind in ("file", "name") else set()
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
            said = process.communicate(timeout=PATIENCE)[1]
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            said = process.communicate()[1]
            faults.append(f"over {PATIENCE:g} s")
        spent = time.perf_counter() - began
        if process.returncode != case.code:
            faults.append(f"ended with {process.returncode}, not {case.code}")
        if "Traceback" in said or (case.code == 2 and case.sent is None and len(said.splitlines()) > 1):
            faults.append("more than a line")
        left = {path.name for path in place.iterdir()} - there
        faults += [f"left {name}" for name in sorted(left)]
        if case.kind == "file" and (place / "read_only.csv").read_text() != "mine":
            faults.append("a protected file was written")
        line = (said.splitlines() or [""])[-1]
    return process.returncode, spent, line, faults


def main() -> int:
    wrong = 0
    print("| what | typed after `mechsim` | exit | s | said |\n|---|---|---|---|---|")
    for case in CASES:
        code, spent, line, faults = ended(case)
        wrong += bool(faults)
        typed = case.words if len(case.words) < 70 else f"{case.words[:60]}..."
        sent = f", {case.sent.name}" if case.sent else ""
        given = f"`MUJOCO_GL={case.graphics}` " if case.graphics else ""
        said = line.removeprefix("mechsim: ").replace("|", "\\|")[:150]
        fault = f" **{'; '.join(faults)}**" if faults else ""
        print(f"| {case.kind} | {given}`{typed}`{sent} | {code} | {spent:.1f} | {said}{fault} |", flush=True)
    print(f"\n{len(CASES)} cases, {wrong} ended otherwise than they should")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
