"""Unusual inputs on the command line: units, names, files, streams, signals, sizes, graphics back ends.

    python validation/robustness/inputs.py [--only WORD]

Each case is a whole process in its own folder. The table lists exit code, seconds and last line of output.
The exit code is 1 if a case ended with another code than expected, took longer than `TIME_LIMIT`, printed
more than one line for a rejection, showed a traceback, or left a file that the command did not name.
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
from stopped_processes import default_signals

TIME_LIMIT = 60.0
SCENE = "scene.xml --drive crank=600rpm --duration 0.1"
SWEEP = "sweep four_bar --vary rocker=70mm:78mm:4 --samples 12 --measure stroke:C"
MODELS = Path(__file__).resolve().parents[2] / "models"
LONG_COMMAND = "render rssr -o video.mp4 --frames-per-turn 2000 --size 640x480"


@dataclass(frozen=True)
class ShellCase:
    """A class of cases, the shell text after `mechsim`, and the expected exit code."""

    kind: str
    command: str
    code: int
    signal_sent: signal.Signals | None = None
    graphics: str = ""


CASES = [
    ShellCase("unit", "solve rssr --set 'crank=13mm!'", 2),
    ShellCase("unit", "solve rssr --set crank=13mm=1", 2),
    ShellCase("unit", "solve rssr --set 'crank=13 m**9**9**9'", 2),
    ShellCase("number", "dynamics forward four_bar --motor line:1e4,600rpm --method none", 0),
    ShellCase("number", "dynamics forward four_bar --motor dc:1,2,3 --method none", 0),
    ShellCase("number", "dynamics forward four_bar --motor constant:1e20 --method none", 0),
    ShellCase("number", "dynamics inverse four_bar --flywheel 1e300", 2),
    ShellCase("number", "dynamics inverse four_bar --turns 1e-308", 2),
    ShellCase("number", "render rssr -o a.png --size ²x²", 2),
    ShellCase("name", f"tradeoff {'n' * 304}", 2),
    ShellCase("name", f"solve rssr -o {'n' * 304}.csv", 2),
    ShellCase("name", "solve rssr -o link.csv", 0),
    ShellCase("file", "solve rssr -o read_only.csv", 2),
    ShellCase("file", "solve rssr -o full.csv", 2),
    ShellCase("file", "simulate rssr --profile pipe.csv", 2),
    ShellCase("file", "simulate rssr --profile bomb.npz", 2),
    ShellCase("file", "simulate rssr --profile mark.csv", 0),
    ShellCase("file", "export four_bar --format toml -o link.csv", 2),
    ShellCase("file", "export four_bar --format toml -o link.toml", 0),
    ShellCase("file", "export four_bar -o full.xml", 2),
    ShellCase("file", f"{SWEEP} -o /proc/out.csv", 2),
    ShellCase("file", f"{SWEEP} -o full.csv", 2),
    ShellCase("file", f"{SWEEP} -o link.csv", 0),
    ShellCase("file", "trace four_bar -o /proc/out.csv", 2),
    ShellCase("file", "trace four_bar -o full.csv", 2),
    ShellCase("file", "trace four_bar -o read_only.csv", 2),
    ShellCase("file", "fit four_bar --to pipe.csv --vary rocker", 2),
    ShellCase("file", "fit four_bar --to subfolder --vary rocker", 2),
    ShellCase("file", f"tune {SCENE} --tolerance 1mm --budget 1s -o /proc/out.xml", 2),
    ShellCase("file", f"tune {SCENE} --tolerance 1mm --budget 1s -o full.xml", 2),
    ShellCase("file", f"tune {SCENE} --tolerance 1mm --budget 1s -o link.xml", 0),
    ShellCase("file", f"reduce {SCENE} --tolerance 1mm -o /proc/out.xml", 2),
    ShellCase("file", f"reduce {SCENE} --tolerance 1mm -o full.xml", 2),
    ShellCase("file", "view four_bar -o full.html", 2),
    ShellCase("file", "validate four_bar --report /proc/out", 2),
    ShellCase("file", "validate four_bar --report read_only.csv", 2),
    ShellCase("file", "sensitivity four_bar --of C --to rocker -o full.csv", 2),
    ShellCase("file", "show pipe.toml", 2),
    ShellCase("file", "show pipe.xml", 2),
    ShellCase("stream", "list >&-", 0),
    ShellCase("stream", f"tune {SCENE} --tolerance 1mm --budget 1s --json -o out.xml >/dev/full", 2),
    ShellCase("stream", f"{SWEEP} -o out.csv >&- 2>&-", 0),
    ShellCase("stream", "trace four_bar --json >/dev/full", 2),
    ShellCase("stream", "sensitivity four_bar --of C --to rocker --json >/dev/full", 2),
    ShellCase("stream", "schema 2>/dev/full >/dev/full", 2),
    ShellCase("stream", "trace four_bar --json | head -c 1 >/dev/null", 0),
    ShellCase("stream", "solve rsr 2>&-", 2),
    ShellCase("stream", "list >/dev/full", 2),
    ShellCase("stream", "validate four_bar <&- >&- 2>&-", 0),
    ShellCase("signal", LONG_COMMAND, 2, signal.SIGINT),
    ShellCase("signal", LONG_COMMAND, 143, signal.SIGTERM),
    ShellCase("signal", LONG_COMMAND, 129, signal.SIGHUP),
    ShellCase("size", "simulate rssr --turns 1e7", 2),
    ShellCase("size", "solve rssr --angles 0:3600:4e-4deg --json", 2),
    ShellCase("size", "dynamics inverse rssr --samples 10000000", 2),
    ShellCase("size", "dynamics inverse four_bar --turns 50", 0),
    ShellCase("graphics", "simulate rssr", 0, graphics="osmesa"),
    ShellCase("graphics", "validate four_bar", 0, graphics="nonsense"),
    ShellCase("graphics", f"tune {SCENE} --tolerance 1mm --budget 1s -o out.xml", 0, graphics="nonsense"),
    ShellCase("graphics", "view four_bar -o out.html", 0, graphics="nonsense"),
    ShellCase("graphics", "trace four_bar --json", 0, graphics="osmesa"),
]


def create_files(folder: Path, command: str) -> set[str]:
    """Create the files that the cases name; return their names."""
    (folder / "subfolder").mkdir()
    for kind in ("csv", "toml", "xml"):
        (folder / f"link.{kind}").symlink_to(folder / "subfolder" / f"real.{kind}")
        os.mkfifo(folder / f"pipe.{kind}")
    for kind in ("csv", "xml", "html"):
        (folder / f"full.{kind}").symlink_to("/dev/full")
    (folder / "scene.xml").write_text((MODELS / "four_bar.xml").read_text())
    (folder / "read_only.csv").write_text("protected")
    (folder / "read_only.csv").chmod(0o444)
    # a file of megabytes that unpacks to gigabytes
    if "bomb" in command:
        np.savez_compressed(
            folder / "bomb.npz", time=np.zeros(6), angle=np.zeros(2_500_000_000, dtype=np.int8)
        )
    rows = "".join(f"{0.01 * i},{0.03 * i}\n" for i in range(10))
    (folder / "mark.csv").write_text("\ufefftime, angle\n" + rows, encoding="utf-8")
    return {path.name for path in folder.iterdir()}


def run_case(case: ShellCase) -> tuple[int, float, str, list[str]]:
    """Run a case; return its exit code, seconds, last line of output, and faults."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        initial = create_files(folder, case.command)
        # in a new process group, so that a signal also reaches the encoder
        start = time.perf_counter()
        process = subprocess.Popen(
            ["sh", "-c", f"exec {sys.executable} -m mechsim {case.command}"],
            cwd=folder,
            env=os.environ | ({"MUJOCO_GL": case.graphics} if case.graphics else {}),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
            preexec_fn=default_signals,
        )
        faults: list[str] = []
        if case.signal_sent is not None:
            while process.poll() is None and not any(folder.glob(".video*")):
                time.sleep(0.01)
            os.killpg(process.pid, case.signal_sent)
        try:
            output = process.communicate(timeout=TIME_LIMIT)[1]
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            output = process.communicate()[1]
            faults.append(f"over {TIME_LIMIT:g} s")
        seconds = time.perf_counter() - start
        if process.returncode != case.code:
            faults.append(f"ended with {process.returncode}, not {case.code}")
        # long runs print their remaining time
        lines = [item for item in output.splitlines() if not re.match(r"\w+: .* left$", item)]
        if "Traceback" in output or (case.code == 2 and case.signal_sent is None and len(lines) > 1):
            faults.append("more than a line")
        # with a stream that fails, the output file is complete before
        writes = process.returncode == 0 or case.kind == "stream"
        new_files = {path.name for path in folder.iterdir()} - initial
        faults += [
            f"left {name}" for name in sorted(new_files) if not (writes and f"-o {name}" in case.command)
        ]
        if (folder / "read_only.csv").read_text() != "protected":
            faults.append("a protected file was written")
        line = (output.splitlines() or [""])[-1]
    return process.returncode, seconds, line, faults


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", default="", help="cases that contain this word")
    options = parser.parse_args()
    cases = [case for case in CASES if options.only in f"{case.kind} {case.command}"]
    failures = 0
    print("| class | after `mechsim` | exit | s | output |\n|---|---|---|---|---|")
    for case in cases:
        code, seconds, line, faults = run_case(case)
        failures += bool(faults)
        shown = case.command if len(case.command) < 70 else f"{case.command[:60]}..."
        suffix = f", {case.signal_sent.name}" if case.signal_sent else ""
        prefix = f"`MUJOCO_GL={case.graphics}` " if case.graphics else ""
        output = line.removeprefix("mechsim: ").replace("|", "\\|")[:150]
        fault = f" **{'; '.join(faults)}**" if faults else ""
        print(
            f"| {case.kind} | {prefix}`{shown}`{suffix} | {code} | {seconds:.1f} | {output}{fault} |",
            flush=True,
        )
    print(f"\n{len(cases)} cases, {failures} not as expected")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
