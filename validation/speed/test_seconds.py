"""Processor time of the tests in seconds, subprocesses included.

`python validation/speed/test_seconds.py [PATH ...] [-m MARKS] [--top 20] [--csv FILE]`: every directory of
tests/, or every PATH, runs in its own process. Without `-m` the tests are those of the Test line of README.
Wall time depends on the load of the machine; processor time does so much less.
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
    """Return the processor time of this process and its finished children, in [s]."""
    return sum(os.times()[:4])


class SecondsRecorder:
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


def seconds_of_path(path: str, marker: str | None, table: str) -> tuple[int, list[tuple[str, float]]]:
    """Run the tests of one path in a process and return pytest's exit code and the seconds of each."""
    command = [sys.executable, __file__, path, "--into", table, *(["-m", marker] if marker else [])]
    Path(table).write_text("")
    code = subprocess.run(command, cwd=ROOT, stdout=subprocess.DEVNULL).returncode
    with open(table, newline="") as file:
        return code, [(name, float(seconds)) for name, seconds in csv.reader(file)]


def main() -> int:
    """Print a row for each path and the most expensive tests."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("path", nargs="*")
    parser.add_argument("-m", dest="marks", help="markers as for pytest; default as in README")
    parser.add_argument("--top", type=int, default=20, help="number of most expensive tests to print")
    parser.add_argument("--csv", help="file for the seconds of every test")
    parser.add_argument("--into", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.into:
        selection = ["-m", options.marks] if options.marks else []
        arguments = ["-q", "-p", "no:cacheprovider", *selection, *options.path]
        return int(pytest.main(arguments, [SecondsRecorder(options.into)]))
    folders = sorted(path.name for path in (ROOT / "tests").iterdir() if any(path.glob("**/test_*.py")))
    all_tests: list[tuple[str, float]] = []
    totals, start, failed = [0, 0.0, 0.0], time.time(), 0
    print("| path | tests | collection (s) | tests (s) |\n|---|---|---|---|")
    with tempfile.TemporaryDirectory() as scratch:
        for path in options.path or [f"tests/{name}" for name in folders]:
            code, rows = seconds_of_path(path, options.marks, f"{scratch}/seconds.csv")
            collection, tests = rows[0][1] if rows else 0.0, rows[1:]
            seconds_of_tests = sum(seconds for _, seconds in tests)
            note = "" if code in (0, 5) else f" pytest ended with {code}"
            print(f"| {path} | {len(tests)} | {collection:.1f} | {seconds_of_tests:.1f} |{note}", flush=True)
            totals = [totals[0] + len(tests), totals[1] + collection, totals[2] + seconds_of_tests]
            failed += code not in (0, 5)
            all_tests += tests
    print(f"| all | {totals[0]} | {totals[1]:.1f} | {totals[2]:.1f} | wall {time.time() - start:.0f} s")
    if options.csv:
        with open(options.csv, "w", newline="") as file:
            csv.writer(file).writerows(all_tests)
    for name, seconds in sorted(all_tests, key=lambda row: -row[1])[: options.top]:
        print(f"{seconds:8.2f} {name}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
