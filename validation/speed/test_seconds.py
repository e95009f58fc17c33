"""What the tests cost, in seconds of a processor, their subprocesses included.

`python validation/speed/test_seconds.py [PATH ...] [-m MARKS] [--top 20] [--csv FILE]`: every directory of
tests/ (or every PATH) in a process of its own, as README's Test line chooses the tests unless `-m` says
otherwise. Wall time depends on what else runs; processor time does so far less.
"""

import argparse
import csv
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


def processor_seconds() -> float:
    """Return what this process and those it has waited for have taken."""
    return sum(os.times()[:4])


class Clock:
    """Writes the processor seconds of the collection and of each test, with set-up and clean-up."""

    def __init__(self, path: str):
        self.file = open(path, "a", newline="")  # noqa: SIM115 - closed with the process
        self.rows = csv.writer(self.file)

    @pytest.hookimpl(wrapper=True)
    def pytest_collection(self):
        result = yield
        self.rows.writerow(["collection", f"{processor_seconds():.4f}"])
        return result

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item):
        start = processor_seconds()
        result = yield
        self.rows.writerow([item.nodeid, f"{processor_seconds() - start:.4f}"])
        self.file.flush()
        return result


def measured(path: str, marks: str | None, table: str) -> tuple[int, list[tuple[str, float]]]:
    """Run the tests of one path in a process and return pytest's exit code and the seconds of each."""
    command = [sys.executable, __file__, path, "--into", table, *(["-m", marks] if marks else [])]
    Path(table).write_text("")
    code = subprocess.run(command, cwd=ROOT, stdout=subprocess.DEVNULL).returncode
    with open(table, newline="") as file:
        return code, [(name, float(seconds)) for name, seconds in csv.reader(file)]


def main() -> int:
    """Print a row for each path and the most expensive tests."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("path", nargs="*")
    parser.add_argument("-m", dest="marks", help="as pytest's; README's line if left out")
    parser.add_argument("--top", type=int, default=20, help="how many of the dearest tests to print")
    parser.add_argument("--csv", help="where to write the seconds of every test")
    parser.add_argument("--into", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.into:
        chosen = ["-m", asked.marks] if asked.marks else []
        return int(pytest.main(["-q", "-p", "no:cacheprovider", *chosen, *asked.path], [Clock(asked.into)]))
    folders = sorted(
        element.name for element in (ROOT / "tests").iterdir() if any(element.glob("**/test_*.py"))
    )
    every: list[tuple[str, float]] = []
    totals, start, failed = [0, 0.0, 0.0], time.time(), 0
    print("| path | tests | collection (s) | tests (s) |\n|---|---|---|---|")
    with tempfile.TemporaryDirectory() as scratch:
        for path in asked.path or [f"tests/{element}" for element in folders]:
            code, rows = measured(path, asked.marks, f"{scratch}/seconds.csv")
            collection, tests = rows[0][1] if rows else 0.0, rows[1:]
            taken = sum(seconds for _, seconds in tests)
            note = "" if code in (0, 5) else f" pytest ended with {code}"
            print(f"| {path} | {len(tests)} | {collection:.1f} | {taken:.1f} |{note}", flush=True)
            totals = [totals[0] + len(tests), totals[1] + collection, totals[2] + taken]
            failed += code not in (0, 5)
            every += tests
    print(f"| all | {totals[0]} | {totals[1]:.1f} | {totals[2]:.1f} | wall {time.time() - start:.0f} s")
    if asked.csv:
        with open(asked.csv, "w", newline="") as file:
            csv.writer(file).writerows(every)
    for name, seconds in sorted(every, key=lambda row: -row[1])[: asked.top]:
        print(f"{seconds:8.2f} {name}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
