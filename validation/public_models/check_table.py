"""`mechsim check`, `show`, `sample` and `validate` tried on public models with loops.

Problem: a linter is of use only if it takes every model that MuJoCo takes, says nothing false, and is quick.
Each model of `models.txt` is checked in a process of its own; the table states errors, warnings and notes,
seconds of `check` (its imports are loaded), and the exit codes of the four commands (70 is a fault of
mechsim). `judged.txt` lists the errors and warnings that are false, judged by reading model and finding; all
others were judged to be true.

    python validation/public_models/check_table.py FOLDER [--findings] [--only WORD]

FOLDER holds clones of the repositories; files that are not there are skipped. None lies in this repository.
Exits with 1 at an internal error, a model that only mechsim rejects, or more than 1 % of false findings.
"""

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path

LISTED = Path(__file__).with_name("models.txt")
JUDGED = Path(__file__).with_name("judged.txt")
LIMIT = 120.0
FALSE_ALARMS = 0.01
SLOW = 1.0
COMMANDS = (("show",), ("validate", "--fix-base", "--lock-others"), ("sample", "-n", "16", "-o", "{out}"))


def lines(path: Path) -> list[str]:
    """Return the lines of a file that say something."""
    if not path.exists():
        return []
    return [line for line in path.read_text().splitlines() if line.strip() and not line.startswith("#")]


def checked(path: str) -> dict:
    """Return what `check` reports of one file, and its seconds after the imports."""
    import mechsim as ms
    from mechsim.errors import MechsimError

    warm = "<mujoco><worldbody><body><joint/><geom size='.1'/></body></worldbody></mujoco>"
    import mujoco

    ms.check(mujoco.MjSpec.from_string(warm))
    began, cpu = time.perf_counter(), time.process_time()
    found, rejected = [], None
    try:
        found = ms.check(path)
    except MechsimError as error:
        rejected = str(error)
    wall, cpu = time.perf_counter() - began, time.process_time() - cpu
    rows = [[v.rule, v.severity, v.object, v.message] for v in found]
    return {"found": rows, "rejected": rejected, "seconds": min(wall, cpu)}


def run(words: list[str]) -> tuple[int, str]:
    """Return exit code and output of a process; -1 where it takes too long."""
    try:
        done = subprocess.run(words, capture_output=True, text=True, timeout=LIMIT)
    except subprocess.TimeoutExpired:
        return -1, "too long"
    return done.returncode, done.stdout + done.stderr


def loads(path: Path) -> bool:
    """Whether MuJoCo alone loads a file."""
    code = "import sys, mujoco; mujoco.MjModel.from_xml_path(sys.argv[1])"
    return run([sys.executable, "-c", code, str(path)])[0] == 0


def tried(path: Path, out: str, *, only_check: bool) -> dict:
    """Return what became of one model under the four commands."""
    code, text = run([sys.executable, __file__, "--one", str(path)])
    row = (
        json.loads(text.splitlines()[-1])
        if code == 0
        else {"found": [], "rejected": text.strip()[-800:], "seconds": float("nan")}
    )
    row["codes"], row["said"] = [70 if code else 2 if row["rejected"] else 0], []
    for command, *options in () if only_check else COMMANDS:
        words = [option.format(out=out) for option in options]
        code, text = run([sys.executable, "-m", "mechsim", command, str(path), *words])
        row["codes"].append(code)
        row["said"].append(f"{command}: {' '.join(text.split())[-300:]}")
        if code in (70, -1) or "Traceback" in text:
            row["said"][-1] = f"{command}: {text[-1500:]}"
    row["loads"] = row["rejected"] is None or loads(path)
    return row


def main() -> bool:
    """Print the table and return whether all is as it should be."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder")
    parser.add_argument("--one", action="store_true")
    parser.add_argument("--findings", action="store_true")
    parser.add_argument("--said", action="store_true")
    parser.add_argument("--check", action="store_true", help="no other command")
    parser.add_argument("--only", default="")
    options = parser.parse_args()
    if options.one:
        print(json.dumps(checked(options.folder)))
        return True
    false = {tuple(line.split(" | ")[:3]) for line in lines(JUDGED)}
    seconds, alarms, wrong, faults, count = [], 0, 0, 0, 0
    print(" n errors warnings notes seconds  check show validate sample  model")
    for name in lines(LISTED):
        path = Path(options.folder) / name
        if options.only not in name or not path.exists():
            continue
        row = tried(path, "/tmp/models60/states.npz", only_check=options.check)
        count += 1
        number = {s: sum(f[1] == s for f in row["found"]) for s in ("error", "warning", "note")}
        raised = [f for f in row["found"] if f[1] != "note"]
        alarms += len(raised)
        wrong += sum((name, f[0], f[2]) in false for f in raised)
        faults += any(code in (70, -1) for code in row["codes"])
        faults += row["rejected"] is not None and row["loads"]
        seconds.append(row["seconds"])
        codes = "  ".join(f"{code:4d}" for code in row["codes"])
        columns = f"{number['error']:6d} {number['warning']:8d} {number['note']:5d} {row['seconds']:7.2f}"
        print(f"{count:2d} {columns}  {codes}  {name}", flush=True)
        if row["rejected"]:
            print(f"     rejected: {row['rejected']}")
        for rule, severity, of, message in row["found"] if options.findings else []:
            flag = " FALSE" if (name, rule, of) in false else ""
            if severity != "note":
                print(f"     {rule} {severity}{flag} [{of}]: {message}")
        for text in row["said"]:
            if options.said or "Traceback" in text or "too long" in text:
                print(f"     {text}")
    seconds.sort()
    slow = sum(not second <= SLOW for second in seconds)
    print(
        f"{count} models, {alarms} errors and warnings, {wrong} of them false; check took "
        f"{seconds[len(seconds) // 2]:.2f} s (median), {seconds[-1]:.2f} s (worst), {slow} above {SLOW:g} s; "
        f"{faults} internal errors or rejections of what MuJoCo loads"
    )
    return not faults and wrong <= FALSE_ALARMS * max(alarms, 1)


if __name__ == "__main__":
    sys.exit(0 if main() else 1)
