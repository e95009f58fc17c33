"""Do the tests bite? Change one operator, sign or number of a core file at a time, and see that a test fails.

`python validation/mutation.py [PART ...] [--most 40] [--seed 0] [--all] [--lines 150:]`: files whose path
contains a PART.

Nothing is written. The tests named for a file are collected once; each mutant (`mutants.py`) is a forked
process that puts the changed file in the place of the imported one and runs them, quickest first, up to
the first failure. What lives is tried again in a process that imports the changed file before it collects.
One that takes more than thrice the processor time of the tests as they are counts as killed. Of kept tools
mutmut 3 leaves what stands outside functions alone, where the bounds are, and cosmic-ray starts a new
interpreter for each mutant and writes into the sources.
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
from collections import Counter
from itertools import zip_longest
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path

import hypothesis
import pytest
from mutants import Mutant, mutants, unchanged

ROOT = Path(__file__).resolve().parents[1]
VERDICT = ["verdict/test_tolerances.py", "verdict/test_tolerance_values.py", "verdict/test_quantities.py"]
CLOSURE = ["analytic/test_rates_are_derivatives.py", "analytic/test_closure.py"]
TREE = ["analytic/test_tree_equations.py", "analytic/test_rates_are_derivatives.py"]
LOOPS = [
    "simulation/test_model_loops.py",
    "analytic/test_negligible_equations.py",
    "simulation/test_loop_constraints.py",
    "simulation/test_free_bodies.py",
    "simulation/test_recorded_motion.py",
    "simulation/test_many_designs.py",
    "simulation/test_motion_laws.py",
]
PATHS = [
    f"analytic/test_continuation_path.py::test_{element}"
    for element in (
        "a_smooth_path_needs_few_segments_and_none_is_rejected",
        "a_segment_that_loses_most_of_its_rank_margin_is_halved",
        "the_tangent_predictor_has_second_order",
    )
]
# file of mechsim/ -> tests that are there to kill its mutants, quickest first
KILLERS: dict[str, list[str]] = {
    "verdict/tolerances.py": VERDICT,
    "verdict/quantities.py": VERDICT,
    "verdict/record_errors.py": ["verdict/test_error_sizes.py"],
    "verdict/checks.py": VERDICT,
    "verdict/crosscheck.py": [
        *VERDICT,
        "verdict/test_motion_law_drivers.py",
        "verdict/test_other_assembly.py",
    ],
    "analytic/loops/maximal_coordinates.py": CLOSURE,
    "analytic/loops/oracle.py": CLOSURE,
    "analytic/loops/record.py": ["analytic/test_joint_motion.py", *CLOSURE],
    "analytic/loops/constraints.py": TREE,
    "analytic/loops/tree.py": TREE,
    "analytic/loops/kinematics.py": TREE,
    "analytic/loops/path_rates.py": [
        "analytic/test_tree_rates.py",
        "analytic/test_rates_are_derivatives.py",
        "analytic/test_change_points.py::test_loop_equations_and_closed_form_agree_through_change_points",
    ],
    "analytic/loops/motion.py": [
        "analytic/test_crank_motion.py",
        "analytic/test_undetermined_joints.py",
    ],
    "analytic/loops/design_motion.py": ["analytic/test_many_motion.py"],
    "numerics/loop_solver.py": ["analytic/test_loop_solver.py", *PATHS],
    "numerics/continuation.py": ["analytic/test_continuation_path.py"],
    "simulation/poses/equations.py": ["simulation/test_pose_path.py", "simulation/test_free_bodies.py"],
    **{
        f"simulation/{name}.py": [
            *LOOPS,
            "simulation/test_spherical_change_points.py",
            "studies/test_driven_efforts.py",
        ]
        for name in ("model_loops", "loop_jacobian")
    },
    "simulation/mjcf/loop_cuts.py": ["simulation/test_loop_cuts.py"],
    "simulation/state.py": ["simulation/test_posed_bodies.py"],
    "numerics/rank.py": ["numerics/test_rank.py"],
    "simulation/equality_rows.py": [
        "simulation/test_loop_constraints.py",
        "simulation/test_recorded_motion.py",
        "simulation/test_model_loops.py",
    ],
    "simulation/recording.py": [
        "simulation/test_loop_constraints.py",
        "simulation/test_recorded_motion.py",
        "simulation/test_motion_laws.py",
    ],
    **{
        f"numerics/{name}.py": ["numerics"]
        for name in ("angles", "arrays", "convergence", "inputs", "newton")
    },
}
# hypothesis is loaded before pytest could rewrite it: no news
KNOWN = ["-W", "ignore:Module already imported:pytest.PytestAssertRewriteWarning"]
# rewritten asserts come with a finder of their own, first of all where a package brings a plugin
OPTIONS = ["-x", "-q", "--assert=plain", "-p", "no:cacheprovider", "-p", "no:xdist", "--tb=no", *KNOWN]
# loaded once, for all mutants to share
SHARED = ("mujoco", "mujoco.batch", "networkx", "scipy.linalg", "scipy.optimize")


class Mutated(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Imports one module as it is changed."""

    def __init__(self, mutant: Mutant):
        self.mutant = mutant

    def find_spec(self, fullname, path=None, target=None):
        if fullname == self.mutant.module:
            origin = str(ROOT / "mechsim" / self.mutant.file)
            return importlib.util.spec_from_file_location(fullname, origin, loader=self)
        return None

    def exec_module(self, module):
        self.mutant.run(module.__dict__)


def put(mutant: Mutant) -> None:
    """Put a changed file in the place of the imported one, in all modules that know its names."""
    sys.meta_path.insert(0, Mutated(mutant))
    if mutant.module not in sys.modules:
        return
    new = sys.modules[mutant.module].__dict__
    old = dict(new)
    mutant.run(new)
    moved = {id(value): name for name, value in old.items() if value is not new[name]}
    for module in [
        element for element in sys.modules.values() if str(ROOT) in str(getattr(element, "__file__", ""))
    ]:
        for alias, value in list(vars(module).items()):
            name = moved.get(id(value))
            # a small whole number is the same object everywhere
            if name is not None and (alias == name or not isinstance(value, int)):
                setattr(module, alias, new[name])


class Unshrunk:
    """A failing example is enough: it need not be the smallest."""

    def pytest_sessionstart(self):
        plain = hypothesis.settings.get_profile("mechsim")
        phases = (hypothesis.Phase.explicit, hypothesis.Phase.generate)
        hypothesis.settings.register_profile("mutant", plain, phases=phases, database=None)
        hypothesis.settings.load_profile("mutant")


class Collected:
    """Runs the tests that were collected for each mutant that is sent, in a process of its own."""

    def __init__(self, wire: Connection):
        self.wire = wire

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        while not session.testsfailed and (asked := self.wire.recv()):
            taken = self.tried(session, *asked)
            self.wire.send(None if taken is None else sum(taken.values()))
            if taken:
                files = Counter[Path]()
                for item in session.items:
                    files[item.path] += taken[item.nodeid]
                session.items.sort(key=lambda item: (files[item.path], taken[item.nodeid]))
        return True

    @staticmethod
    def tried(session: pytest.Session, mutant: Mutant, seconds: float) -> dict[str, float] | None:
        """What each test took, in seconds of a processor; None where one fails or takes too long."""
        reader, writer = Pipe(duplex=False)
        child = os.fork()
        if child == 0:
            limit(seconds)
            put(mutant)
            taken = {}
            for item, following in zip_longest(session.items, session.items[1:]):
                before = sum(os.times()[:4])
                item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
                taken[item.nodeid] = sum(os.times()[:4]) - before
                if session.shouldfail:
                    os._exit(1)
            writer.send(taken)
            os._exit(0)
        writer.close()
        try:
            return reader.recv()
        except EOFError:
            return None
        finally:
            os.waitpid(child, 0)


def limit(seconds: float) -> None:
    """Allow this process some seconds of a processor, and no more memory than there is."""
    resource.setrlimit(resource.RLIMIT_CPU, (int(seconds) + 1, int(seconds) + 2))
    resource.setrlimit(resource.RLIMIT_AS, (16 << 30, 16 << 30))


def pytests(tests: list[str], *plugins: object) -> int:
    """Run pytest on some files of tests without a word."""
    silent = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silent, 1)
    os.dup2(silent, 2)
    return int(
        pytest.main([*OPTIONS, *(f"tests/{element}" for element in tests)], plugins=[Unshrunk(), *plugins])
    )


def collected(tests: list[str]) -> Connection:
    """Start a process that collects tests and waits for mutants."""
    here, there = Pipe()
    if os.fork() == 0:
        here.close()
        os._exit(pytests(tests, Collected(there)))
    there.close()
    return here


def passes_anew(tests: list[str], mutant: Mutant, seconds: float) -> bool:
    """Whether tests pass in a process that imports the changed file before it collects them."""
    child = os.fork()
    if child == 0:
        limit(seconds)
        sys.meta_path.insert(0, Mutated(mutant))
        os._exit(pytests(tests))
    return os.waitpid(child, 0)[1] == 0


def living(tests: list[str], some: list[Mutant], *, every: bool) -> list[Mutant]:
    """The mutants that no test notices, printed as they come; every one's fate if wished."""
    file, wire, result = some[0].file, collected(tests), []
    wire.send((unchanged(file), 600.0))
    try:
        seconds = wire.recv()
    except EOFError:
        seconds = None
    if seconds is None:
        raise SystemExit(f"{', '.join(tests)}: a test fails as it is")
    print(f"# {file}: {len(some)} mutants, tests of {seconds:.1f} s of processor", flush=True)
    for element in some:
        wire.send((element, 3.0 * seconds + 2.0))
        lives = wire.recv() is not None and passes_anew(tests, element, 3.0 * seconds + 10.0)
        result += [element] * lives
        if lives or every:
            print(f"{'SURVIVED' if lives else 'killed'} {element}", flush=True)
    wire.send(None)
    return result


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("part", nargs="*", help="only files whose path contains it")
    parser.add_argument("--most", type=int, default=40, help="mutants of a file, drawn by chance")
    parser.add_argument("--all", action="store_true", help="all mutants")
    parser.add_argument("--lines", default="1:", help="only those of some lines, such as 150: or 1:150")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--list", action="store_true", help="print each mutant's fate")
    asked = parser.parse_args()
    first, last = (int(element or sys.maxsize) for element in asked.lines.split(":"))
    os.chdir(ROOT)
    sys.path.insert(0, str(ROOT))
    sys.dont_write_bytecode = True
    for name in SHARED:
        importlib.import_module(name)
    began, rows, alive = time.time(), [], 0
    for file, tests in KILLERS.items():
        if asked.part and not any(part in file for part in asked.part):
            continue
        every = [element for element in mutants(file) if first <= element.line < last]
        drawn = random.Random(f"{asked.seed} {file}").sample(every, min(asked.most, len(every)))
        tried = every if asked.all else sorted(drawn, key=lambda element: element.line)
        counted = [element for element in tried if not element.equivalent]
        lived = len(living(tests, counted, every=asked.list)) if counted else 0
        alive += lived
        rows.append((file, len(every), len(counted), len(counted) - lived, len(tried) - len(counted)))
        print(
            f"# {file}: {len(counted) - lived} of {len(counted)} killed, {time.time() - began:.0f} s",
            flush=True,
        )
    total = [sum(row[i] for row in rows) for i in range(1, 5)]
    print("\n| file | mutants | tried | killed | | equivalent |\n|---|---|---|---|---|---|")
    for name, every, tried, killed, excused in [*rows, ("all", *total)]:
        print(f"| {name} | {every} | {tried} | {killed} | {killed / max(1, tried):.0%} | {excused} |")
    return 1 if alive > 0.05 * total[1] else 0


if __name__ == "__main__":
    sys.exit(main())
