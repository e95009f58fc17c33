"""Mutation tests: change one operator, sign or number of a core file at a time and check that a test fails.

`python validation/mutation.py [PATTERN ...] [--most 40] [--seed 0] [--all] [--lines 150:]`: files
whose path contains a PATTERN.

No file is written. The tests of a file are collected once. For each mutant (`mutants.py`) a forked process
replaces the imported module and runs the tests, quickest first, up to the first failure. A surviving mutant
is tested again in a process that imports the changed file before it collects the tests. A mutant that takes
more than three times the processor time of the unchanged file counts as killed. Other tools do not fit:
mutmut 3 changes nothing outside functions, where the tolerances are; cosmic-ray starts a new interpreter for
each mutant and writes into the sources.
"""

import argparse
import importlib
import importlib.abc
import importlib.util
import os
import random
import resource
import sys
import time
import tomllib
from collections import Counter
from itertools import zip_longest
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path

import hypothesis
import pytest
from mutants import Mutant, mutants, unchanged

ROOT = Path(__file__).resolve().parents[1]
# file of mechsim/ -> tests that reject its mutants, quickest first
TESTS: dict[str, list[str]] = tomllib.loads(
    (Path(__file__).parent / "mutation_tests.toml").read_text(encoding="utf-8")
)
# hypothesis is loaded before pytest can rewrite it
IGNORED = ["-W", "ignore:Module already imported:pytest.PytestAssertRewriteWarning"]
# plain asserts: rewriting them needs an import hook that would precede `Mutated`
OPTIONS = ["-x", "-q", "--assert=plain", "-p", "no:cacheprovider", "-p", "no:xdist", "--tb=no", *IGNORED]
# those that take long, too
OPTIONS += ["-m", "not slow and not browser"]
# imported once for all mutants
SHARED = ("mujoco", "mujoco.batch", "networkx", "scipy.linalg", "scipy.optimize")


class Mutated(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Imports the changed version of one module."""

    def __init__(self, mutant: Mutant):
        self.mutant = mutant

    def find_spec(self, fullname, path=None, target=None):
        if fullname == self.mutant.module:
            origin = str(ROOT / "mechsim" / self.mutant.file)
            return importlib.util.spec_from_file_location(fullname, origin, loader=self)
        return None

    def exec_module(self, module):
        self.mutant.run(module.__dict__)


def replace_module(mutant: Mutant) -> None:
    """Replace an imported module by its changed version, in all modules that import its names."""
    sys.meta_path.insert(0, Mutated(mutant))
    if mutant.module not in sys.modules:
        return
    new = sys.modules[mutant.module].__dict__
    old = dict(new)
    mutant.run(new)
    new_names = {id(value): name for name, value in old.items() if value is not new[name]}
    modules = list(sys.modules.values())
    for module in [module for module in modules if str(ROOT) in str(getattr(module, "__file__", ""))]:
        for alias, value in list(vars(module).items()):
            name = new_names.get(id(value))
            # a small integer is the same object everywhere
            if name is not None and (alias == name or not isinstance(value, int)):
                setattr(module, alias, new[name])


class WithoutShrinking:
    """Lets hypothesis stop at the first failing example."""

    def pytest_sessionstart(self):
        profile = hypothesis.settings.get_profile("mechsim")
        phases = (hypothesis.Phase.explicit, hypothesis.Phase.generate)
        hypothesis.settings.register_profile("mutant", profile, phases=phases, database=None)
        hypothesis.settings.load_profile("mutant")


class MutantRunner:
    """Runs the collected tests for each received mutant in a forked process."""

    def __init__(self, connection: Connection):
        self.connection = connection

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        while not session.testsfailed and (request := self.connection.recv()):
            durations = self.durations(session, *request)
            self.connection.send(None if durations is None else sum(durations.values()))
            if durations:
                files = Counter[Path]()
                for item in session.items:
                    files[item.path] += durations[item.nodeid]
                session.items.sort(key=lambda item: (files[item.path], durations[item.nodeid]))
        return True

    @staticmethod
    def durations(session: pytest.Session, mutant: Mutant, seconds: float) -> dict[str, float] | None:
        """Return the processor time of each test in [s]; None if one fails or takes too long."""
        reader, writer = Pipe(duplex=False)
        child = os.fork()
        if child == 0:
            limit_resources(seconds)
            replace_module(mutant)
            durations = {}
            for item, next_item in zip_longest(session.items, session.items[1:]):
                before = sum(os.times()[:4])
                item.config.hook.pytest_runtest_protocol(item=item, nextitem=next_item)
                durations[item.nodeid] = sum(os.times()[:4]) - before
                if session.shouldfail:
                    os._exit(1)
            writer.send(durations)
            os._exit(0)
        writer.close()
        try:
            return reader.recv()
        except EOFError:
            return None
        finally:
            os.waitpid(child, 0)


def limit_resources(seconds: float) -> None:
    """Limit the processor time of this process, and its memory to 16 GiB."""
    resource.setrlimit(resource.RLIMIT_CPU, (int(seconds) + 1, int(seconds) + 2))
    resource.setrlimit(resource.RLIMIT_AS, (16 << 30, 16 << 30))


def run_pytest(tests: list[str], *plugins: object) -> int:
    """Run pytest on files of tests without output; return its exit code."""
    null_device = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null_device, 1)
    os.dup2(null_device, 2)
    return int(
        pytest.main([*OPTIONS, *(f"tests/{test}" for test in tests)], plugins=[WithoutShrinking(), *plugins])
    )


def collecting_process(tests: list[str]) -> Connection:
    """Start a process that collects tests and waits for mutants; return the connection to it."""
    parent_end, child_end = Pipe()
    if os.fork() == 0:
        parent_end.close()
        os._exit(run_pytest(tests, MutantRunner(child_end)))
    child_end.close()
    return parent_end


def passes_in_new_process(tests: list[str], mutant: Mutant, seconds: float) -> bool:
    """Return whether tests pass in a process that imports the changed file before it collects them."""
    child = os.fork()
    if child == 0:
        limit_resources(seconds)
        sys.meta_path.insert(0, Mutated(mutant))
        os._exit(run_pytest(tests))
    return os.waitpid(child, 0)[1] == 0


def surviving_mutants(tests: list[str], candidates: list[Mutant], *, print_all: bool) -> list[Mutant]:
    """Return the mutants that no test rejects, and print them; with `print_all` print every outcome."""
    file, connection, result = candidates[0].file, collecting_process(tests), []
    connection.send((unchanged(file), 600.0))
    try:
        seconds = connection.recv()
    except EOFError:
        seconds = None
    if seconds is None:
        raise SystemExit(f"{', '.join(tests)}: a test of the unchanged file fails")
    print(f"# {file}: {len(candidates)} mutants, tests take {seconds:.1f} s of processor time", flush=True)
    for mutant in candidates:
        connection.send((mutant, 3.0 * seconds + 2.0))
        survives = connection.recv() is not None
        survives = survives and passes_in_new_process(tests, mutant, 3.0 * seconds + 10.0)
        result += [mutant] * survives
        if survives or print_all:
            print(f"{'SURVIVED' if survives else 'killed'} {mutant}", flush=True)
    connection.send(None)
    return result


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("pattern", nargs="*", help="only files whose path contains it")
    parser.add_argument("--most", type=int, default=40, help="mutants of a file, drawn at random")
    parser.add_argument("--all", action="store_true", help="all mutants")
    parser.add_argument("--lines", default="1:", help="only mutants of lines such as 150: or 1:150")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--list", action="store_true", help="print the outcome of every mutant")
    options = parser.parse_args()
    first, last = (int(number or sys.maxsize) for number in options.lines.split(":"))
    os.chdir(ROOT)
    sys.path.insert(0, str(ROOT))
    sys.dont_write_bytecode = True
    for name in SHARED:
        importlib.import_module(name)
    start, rows, survivors = time.time(), [], 0
    for file, tests in TESTS.items():
        if options.pattern and not any(pattern in file for pattern in options.pattern):
            continue
        population = [mutant for mutant in mutants(file) if first <= mutant.line < last]
        count = min(options.most, len(population))
        sample = random.Random(f"{options.seed} {file}").sample(population, count)
        tested = population if options.all else sorted(sample, key=lambda mutant: mutant.line)
        counted = [mutant for mutant in tested if not mutant.equivalent]
        survived = len(surviving_mutants(tests, counted, print_all=options.list)) if counted else 0
        survivors += survived
        killed = len(counted) - survived
        rows.append((file, len(population), len(counted), killed, len(tested) - len(counted)))
        print(f"# {file}: {killed} of {len(counted)} killed, {time.time() - start:.0f} s", flush=True)
    total = [sum(row[i] for row in rows) for i in range(1, 5)]
    print("\n| file | mutants | tested | killed | | equivalent |\n|---|---|---|---|---|---|")
    for name, number, tested, killed, equivalent in [*rows, ("all", *total)]:
        print(f"| {name} | {number} | {tested} | {killed} | {killed / max(1, tested):.0%} | {equivalent} |")
    return 1 if survivors > 0.05 * total[1] else 0


if __name__ == "__main__":
    sys.exit(main())
