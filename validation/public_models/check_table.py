"""`mechsim check`, `show`, `sample` and `validate` tried on public models with loops.

Problem: a linter is of use only if it takes every model that MuJoCo takes, says nothing false, and is quick.
The table states errors, warnings and notes of each model of `models.txt`, seconds of `check` without its
imports, and the exit codes of the four commands (70 is a fault of mechsim, -1 takes more than a minute of
processor time).
`confirm_findings.py` tries whether the findings are true.

    python validation/public_models/check_table.py FOLDER [--findings] [--only WORD]

FOLDER holds clones of the repositories; files that are not there are skipped. None lies in this repository.
Exits with 1 at an internal error or a model that only mechsim rejects.
"""

import argparse
import contextlib
import io
import signal
import sys
import tempfile
import time
import traceback
from pathlib import Path

import mujoco

import mechsim as ms
from mechsim import cli
from mechsim.errors import MechsimError

LISTED = Path(__file__).with_name("models.txt")
# processor seconds of a command
LIMIT = 60
SLOW = 1.0
COMMANDS = (("show",), ("validate", "--lock-others"), ("sample", "-n", "16", "-o", "{out}"))


def lines(path: Path) -> list[str]:
    """Return the lines of a file without comments."""
    return [line for line in path.read_text().splitlines() if line.strip() and not line.startswith("#")]


class TooLongError(BaseException):
    """A command takes longer than LIMIT."""


def stopped(*_):
    signal.setitimer(signal.ITIMER_PROF, 5)  # what catches everything may catch this
    raise TooLongError


def checked(path: str) -> dict:
    """Return what `check` reports of one file, and its seconds."""
    wall, cpu = time.perf_counter(), time.process_time()
    findings, rejected, code = [], None, 0
    try:
        findings = ms.check(path)
    except MechsimError as error:
        rejected, code = str(error), 2
    except Exception:
        rejected, code = traceback.format_exc(), 70
    # other programs slow the one, threads the other
    seconds = min(time.perf_counter() - wall, time.process_time() - cpu)
    rows = [[v.rule, v.severity, v.object, v.message] for v in findings]
    return {"found": rows, "rejected": rejected, "seconds": seconds, "codes": [code]}


def run(words: list[str]) -> tuple[int, str]:
    """Return exit code and output of a command line; -1 where it takes too long."""
    sys.argv = ["mechsim", *words]
    text = io.StringIO()
    with contextlib.redirect_stdout(text), contextlib.redirect_stderr(text):
        try:
            signal.setitimer(signal.ITIMER_PROF, LIMIT)
            began = time.process_time()
            cli.main()
        except SystemExit as ended:
            late = time.process_time() - began >= LIMIT
            return (-1, "too long") if late else (int(ended.code or 0), text.getvalue())
        except TooLongError:
            return -1, "too long"
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0)
    return 0, text.getvalue()


def loads(path: Path) -> bool:
    """Whether MuJoCo alone loads a file."""
    try:
        mujoco.MjModel.from_xml_path(str(path))
    except ValueError:
        return False
    return True


def tried(path: Path, out: str, *, only_check: bool) -> dict:
    """Return what became of one model under the four commands."""
    row = checked(str(path))
    row["said"] = []
    for command, *options in () if only_check else COMMANDS:
        code, text = run([command, str(path), *(option.format(out=out) for option in options)])
        row["codes"].append(code)
        row["said"].append(
            f"{command}: {text[-1500:] if code in (70, -1) else ' '.join(text.split())[-300:]}"
        )
    row["loads"] = row["rejected"] is None or loads(path)
    return row


def main() -> bool:
    """Print the table and return whether all is as it should be."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder")
    parser.add_argument("--findings", action="store_true")
    parser.add_argument("--said", action="store_true")
    parser.add_argument("--check", action="store_true", help="no other command")
    parser.add_argument("--only", default="")
    options = parser.parse_args()
    signal.signal(signal.SIGPROF, stopped)
    out = str(Path(tempfile.mkdtemp()) / "states.npz")
    seconds, alarms, faults, count = [], 0, 0, 0
    print(" n errors warnings notes seconds  check show validate sample  model")
    for name in lines(LISTED):
        path = Path(options.folder) / name
        if options.only not in name or not path.exists():
            continue
        row = tried(path, out, only_check=options.check)
        count += 1
        number = {s: sum(f[1] == s for f in row["found"]) for s in ("error", "warning", "note")}
        raised = [f for f in row["found"] if f[1] != "note"]
        alarms += len(raised)
        faults += any(code in (70, -1) for code in row["codes"])
        faults += row["rejected"] is not None and row["loads"]
        seconds.append(row["seconds"])
        codes = "  ".join(f"{code:4d}" for code in row["codes"])
        columns = f"{number['error']:6d} {number['warning']:8d} {number['note']:5d} {row['seconds']:7.2f}"
        print(f"{count:2d} {columns}  {codes}  {name}", flush=True)
        if row["rejected"]:
            print(f"     rejected: {row['rejected']}")
        for rule, severity, element, message in row["found"] if options.findings else []:
            if severity != "note":
                print(f"     {rule} {severity} [{element}]: {message}")
        for text in row["said"]:
            if options.said or "Traceback" in text or "too long" in text:
                print(f"     {text}")
    seconds.sort()
    slow = sum(not second <= SLOW for second in seconds)
    print(
        f"{count} models, {alarms} errors and warnings; check took "
        f"{seconds[len(seconds) // 2]:.2f} s (median), {seconds[-1]:.2f} s (worst), {slow} above {SLOW:g} s; "
        f"{faults} internal errors or rejections of what MuJoCo loads"
    )
    return not faults


if __name__ == "__main__":
    sys.exit(0 if main() else 1)
