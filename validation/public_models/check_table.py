"""`mechsim check` tried on public models with loops.

Problem: a linter is of use only if it takes every model that MuJoCo takes, says nothing false, and is quick.
The table states errors, warnings and notes of each model of `models.txt`, and seconds of `check` without its
imports. `confirm_findings.py` tries whether the findings are true.

    python validation/public_models/check_table.py FOLDER [--findings] [--only WORD]

FOLDER holds clones of the repositories; files that are not there are skipped. None lies in this repository.
Exits with 1 at an internal error or a model that only mechsim rejects.
"""

import argparse
import sys
import time
import traceback
from pathlib import Path

import mujoco

import mechsim as ms
from mechsim.errors import MechsimError
from mechsim.mechanism.finding import Finding

LISTED = Path(__file__).with_name("models.txt")
SLOW = 1.0


def lines(path: Path) -> list[str]:
    """Return the lines of a file without comments."""
    return [line for line in path.read_text().splitlines() if line.strip() and not line.startswith("#")]


def checked(path: str) -> tuple[list[Finding], str, bool, float]:
    """Return the violations of a file, why it is rejected, whether that is a fault, and the seconds."""
    wall, cpu = time.perf_counter(), time.process_time()
    violations, rejected, fault = [], "", False
    try:
        violations = ms.check(path)
    except MechsimError as error:
        rejected, fault = str(error), loads(path)
    except Exception:
        rejected, fault = traceback.format_exc(), True
    # other programs slow the one, threads the other
    return violations, rejected, fault, min(time.perf_counter() - wall, time.process_time() - cpu)


def loads(path: str) -> bool:
    """Whether MuJoCo alone loads a file."""
    try:
        mujoco.MjModel.from_xml_path(path)
    except ValueError:
        return False
    return True


def main() -> bool:
    """Print the table and return whether all is as it should be."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--findings", action="store_true")
    parser.add_argument("--only", default="")
    options = parser.parse_args()
    seconds, alarms, faults = [], 0, 0
    print(" n errors warnings notes seconds  model")
    for name in lines(LISTED):
        path = options.folder / name
        if options.only not in name or not path.exists():
            continue
        violations, rejected, fault, spent = checked(str(path))
        seconds.append(spent)
        faults += fault
        error, warning, note = (
            sum(item.severity == severity for item in violations) for severity in ("error", "warning", "note")
        )
        alarms += error + warning
        print(f"{len(seconds):2d} {error:6d} {warning:8d} {note:5d} {spent:7.2f}  {name}", flush=True)
        if rejected:
            print(f"     rejected: {rejected}")
        for item in violations if options.findings else []:
            if item.severity != "note":
                print(f"     {item.rule} {item.severity} [{item.object}]: {item.message}")
    seconds.sort()
    print(
        f"{len(seconds)} models, {alarms} errors and warnings; check took "
        f"{seconds[len(seconds) // 2]:.2f} s (median), {seconds[-1]:.2f} s (worst), "
        f"{sum(not second <= SLOW for second in seconds)} above {SLOW:g} s; "
        f"{faults} internal errors or rejections of what MuJoCo loads"
    )
    return not faults


if __name__ == "__main__":
    sys.exit(0 if main() else 1)
