"""Do the tests bite? Change one operator, sign or number of a core file at a time, and see that a test fails.

`python validation/mutation.py [PART ...] [--most 40] [--seed 0] [--all]`: files whose path contains a PART.

Nothing is written: each mutant is a forked process that imports the changed file from memory and runs
the tests named for it, up to the first failure. One that takes more than thrice the processor time of
the tests as they are counts as killed. Messages, annotations and text are left alone, and so is `<` for
`<=`: no two floats that matter here are equal. Of kept tools mutmut 3 leaves what stands outside
functions alone, where the bounds are, and cosmic-ray starts a new interpreter for each mutant and
writes into the sources.
"""

import argparse
import ast
import copy
import importlib
import importlib.abc
import importlib.util
import os
import random
import resource
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import hypothesis
import pytest
from equivalent_mutants import EQUIVALENT

ROOT = Path(__file__).resolve().parents[1]
VERDICT = ["verdict/test_tolerances.py", "verdict/test_bounds.py", "verdict/test_quantities.py"]
CLOSURE = ["analytic/test_rates_are_derivatives.py", "analytic/test_closure.py"]
TREE = ["analytic/test_tree_equations.py", "analytic/test_rates_are_derivatives.py"]
LOOPS = [
    "simulation/test_model_loops.py",
    "analytic/test_rows_of_rounding.py",
    "simulation/test_loop_constraints.py",
    "simulation/test_free_bodies.py",
    "simulation/test_recorded_motion.py",
    "simulation/test_many_designs.py",
    "simulation/test_programs.py",
]
# file of mechsim/ -> tests that are there to kill its mutants, quickest first
KILLERS: dict[str, list[str]] = {
    "verdict/tolerances.py": VERDICT,
    "verdict/quantities.py": VERDICT,
    "verdict/record_errors.py": ["verdict/test_error_sizes.py"],
    "verdict/checks.py": VERDICT,
    "verdict/judge.py": [*VERDICT, "verdict/test_programmed.py"],
    "verdict/other_assembly.py": ["verdict/test_other_assembly.py"],
    "analytic/closure/joint_rows.py": CLOSURE,
    "analytic/closure/motion.py": CLOSURE,
    "analytic/closure/joint_motion.py": ["analytic/test_joint_motion.py", *CLOSURE],
    "analytic/closure/cut_rows.py": TREE,
    "analytic/closure/tree_layout.py": TREE,
    "analytic/closure/tree_motion.py": TREE,
    "analytic/closure/tree_rates.py": [
        "analytic/test_tree_rates.py",
        "analytic/test_rates_are_derivatives.py",
        "analytic/test_change_points.py::test_closed_form_and_loop_equations_pass_change_points_alike",
    ],
    "analytic/closure/whole_motion.py": [
        "analytic/test_whole_motion.py",
        "analytic/test_rates_are_derivatives.py",
        "analytic/test_open_joints.py",
    ],
    "analytic/closure/many_paths.py": ["analytic/test_many_motion.py"],
    "analytic/closure/loop_solver.py": [
        "analytic/test_loop_solver.py",
        "analytic/test_rates_are_derivatives.py",
        "analytic/test_followed_path.py",
    ],
    "analytic/closure/followed_path.py": ["analytic/test_followed_path.py", "analytic/test_change_points.py"],
    "simulation/model_loops.py": [*LOOPS, "studies/test_driven_efforts.py"],
    "simulation/posed_bodies.py": [
        "simulation/test_model_loops.py",
        "simulation/test_recorded_motion.py",
        "simulation/test_many_designs.py",
    ],
    "simulation/telling.py": ["analytic/test_telling.py", "analytic/test_rows_of_rounding.py"],
    "analytic/closure/telling.py": ["analytic/test_telling.py", "analytic/test_rows_of_rounding.py"],
    "simulation/loop_constraints.py": [
        "simulation/test_loop_constraints.py",
        "simulation/test_recorded_motion.py",
        "simulation/test_model_loops.py",
    ],
    "simulation/recorded_motion.py": [
        "simulation/test_loop_constraints.py",
        "simulation/test_recorded_motion.py",
        "simulation/test_programs.py",
    ],
    **{f"maths/{name}.py": ["maths"] for name in ("angles", "convergence", "given", "norms", "roots")},
}
SWAPPED: dict[type[ast.AST], type[ast.AST]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
    ast.Pow: ast.Mult,
    ast.And: ast.Or,
    ast.Or: ast.And,
    ast.Lt: ast.GtE,
    ast.GtE: ast.Lt,
    ast.Gt: ast.LtE,
    ast.LtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
}
# hypothesis is loaded before pytest could rewrite it: no news
KNOWN = ["-W", "ignore:Module already imported:pytest.PytestAssertRewriteWarning"]
Change = Callable[[], None]
# loaded once, for all mutants to share
SHARED = ("mujoco", "mujoco.batch", "networkx", "scipy.linalg", "scipy.optimize")


@dataclass(frozen=True)
class Mutant:
    """A file with one thing changed."""

    file: str
    line: int
    before: str
    after: str
    tree: ast.Module

    def __str__(self) -> str:
        same = _alike(self.before, self.after)
        end = _alike(self.before[:same:-1], self.after[:same:-1])
        before, after = (
            text[max(0, same - 60) : same] + text[same : len(text) - end] + text[len(text) - end :][:20]
            for text in (self.before, self.after)
        )
        return f"mechsim/{self.file}:{self.line}: {before}  ->  {after}"

    @property
    def equivalent(self) -> bool:
        """Whether it is known to change nothing that counts."""
        return any((self.file, self.before, after) in EQUIVALENT for after in (self.after, "..."))


def nodes(node: ast.AST) -> Iterator[ast.AST]:
    """All nodes but messages, annotations and checks of lengths."""
    yield node
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list", "type_params"):
            continue
        for child in value if isinstance(value, list) else [value]:
            message = isinstance(child, (ast.JoinedStr, ast.Raise))
            # zip's check of lengths that are equal
            strict = isinstance(child, ast.keyword) and child.arg == "strict"
            if isinstance(child, ast.AST) and not message and not strict:
                yield from nodes(child)


def changes(node: ast.AST) -> Iterator[Change]:
    """What can be changed in a node, in place."""
    if isinstance(node, (ast.BinOp, ast.BoolOp, ast.AugAssign)) and type(node.op) in SWAPPED:
        yield lambda: setattr(node, "op", SWAPPED[type(node.op)]())
    elif isinstance(node, ast.Compare):
        for i, op in enumerate(node.ops):
            yield lambda i=i, op=op: node.ops.__setitem__(i, SWAPPED[type(op)]())
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        yield lambda: setattr(node, "op", ast.UAdd())
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        yield lambda: setattr(node, "operand", ast.UnaryOp(ast.Not(), node.operand))
    elif isinstance(node, (ast.If, ast.IfExp, ast.While)) and not isinstance(node.test, ast.Compare):
        yield lambda: setattr(node, "test", ast.UnaryOp(ast.Not(), node.test))
    elif isinstance(node, ast.Constant) and isinstance(node.value, (bool, int, float)):
        for other in others(node.value):
            yield lambda other=other: setattr(node, "value", other)


def others(value: bool | float) -> list[bool | float]:
    """Numbers for a number: the tenfold and the tenth, or of a small whole number the next."""
    if isinstance(value, bool):
        return [not value]
    if isinstance(value, int):
        return [value + 1] if abs(value) < 10 else [10 * value, value // 10]
    return [10.0 * value, 0.1 * value] if value else [1.0]


def _alike(one: str, other: str) -> int:
    """How many letters two texts begin with alike."""
    pairs = zip(one, other, strict=False)
    return next((i for i, (a, b) in enumerate(pairs) if a != b), min(len(one), len(other)))


def mutants(file: str) -> list[Mutant]:
    """All mutants of a file."""
    text = (ROOT / "mechsim" / file).read_text()
    plain = ast.parse(text)
    found: list[Mutant] = []
    for k, node in enumerate(nodes(plain)):
        for m in range(len(list(changes(node)))):
            tree = copy.deepcopy(plain)
            changed = next(one for i, one in enumerate(nodes(tree)) if i == k)
            statement = _statement(tree, changed)
            before = ast.unparse(statement)
            list(changes(changed))[m]()
            after = ast.unparse(statement)
            found.append(
                Mutant(
                    file,
                    getattr(changed, "lineno", 0),
                    *_differing(before, after),
                    ast.fix_missing_locations(tree),
                )
            )
    return found


def _statement(tree: ast.Module, node: ast.AST) -> ast.AST:
    """The smallest statement that holds a node."""
    holding = [
        one for one in ast.walk(tree) if isinstance(one, ast.stmt) and any(node is n for n in ast.walk(one))
    ]
    return holding[-1]


def _differing(before: str, after: str) -> tuple[str, str]:
    """The lines in which two texts differ."""
    pairs = zip(before.splitlines(), after.splitlines(), strict=True)
    return next((a.strip(), b.strip()) for a, b in pairs if a != b)


class Mutated(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Imports one module from a syntax tree."""

    def __init__(self, mutant: Mutant):
        self.mutant = mutant
        self.name = "mechsim." + mutant.file.removesuffix(".py").replace("/", ".")
        self.path = str(ROOT / "mechsim" / mutant.file)

    def find_spec(self, fullname, path=None, target=None):
        if fullname == self.name:
            return importlib.util.spec_from_file_location(fullname, self.path, loader=self)
        return None

    def exec_module(self, module):
        exec(compile(self.mutant.tree, self.path, "exec"), module.__dict__)


class Unshrunk:
    """A failing example is enough: it need not be the smallest."""

    def pytest_sessionstart(self):
        plain = hypothesis.settings.get_profile("mechsim")
        phases = (hypothesis.Phase.explicit, hypothesis.Phase.generate)
        hypothesis.settings.register_profile("mutant", plain, phases=phases, database=None)
        hypothesis.settings.load_profile("mutant")


def passes(tests: list[str], mutant: Mutant | None, seconds: float) -> tuple[bool, float]:
    """Whether files of tests pass within some processor time, and what they took, in their own process."""
    before = sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2])
    child = os.fork()
    if child == 0:
        resource.setrlimit(resource.RLIMIT_CPU, (int(seconds) + 1, int(seconds) + 2))
        resource.setrlimit(resource.RLIMIT_AS, (16 << 30, 16 << 30))
        silent = os.open(os.devnull, os.O_WRONLY)
        os.dup2(silent, 1)
        os.dup2(silent, 2)
        if mutant is not None:
            sys.meta_path.insert(0, Mutated(mutant))
        # rewritten asserts come with a finder of their own, first of all where a package brings a plugin
        options = [
            "-x",
            "-q",
            "--assert=plain",
            "-p",
            "no:cacheprovider",
            "-p",
            "no:xdist",
            "--tb=no",
            *KNOWN,
        ]
        os._exit(int(pytest.main([*options, *(f"tests/{one}" for one in tests)], plugins=[Unshrunk()])))
    _, status = os.waitpid(child, 0)
    return status == 0, sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2]) - before


def clean_time(tests: list[str]) -> float:
    """What files of tests take as things are, in seconds; refuse such as fail."""
    clean, seconds = passes(tests, None, 600.0)
    if not clean:
        raise SystemExit(f"{', '.join(tests)}: a test fails as it is")
    return seconds


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("part", nargs="*", help="only files whose path contains it")
    parser.add_argument("--most", type=int, default=40, help="mutants of a file, drawn by chance")
    parser.add_argument("--all", action="store_true", help="all mutants")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--list", action="store_true", help="print each mutant's fate")
    asked = parser.parse_args()
    os.chdir(ROOT)
    sys.path.insert(0, str(ROOT))
    sys.dont_write_bytecode = True
    for name in SHARED:
        importlib.import_module(name)
    began, rows, alive = time.time(), [], 0
    for file, tests in KILLERS.items():
        if asked.part and not any(part in file for part in asked.part):
            continue
        seconds = clean_time(tests)
        every = mutants(file)
        drawn = random.Random(f"{asked.seed} {file}").sample(every, min(asked.most, len(every)))
        tried = every if asked.all else sorted(drawn, key=lambda one: one.line)
        excused = [one for one in tried if one.equivalent]
        killed = 0
        for one in tried:
            if one in excused:
                continue
            lives = passes(tests, one, 3.0 * seconds + 2.0)[0]
            killed += not lives
            if lives or asked.list:
                fate = "SURVIVED" if lives else "killed"
                print(f"{fate} {one}", flush=True)
        counted = len(tried) - len(excused)
        alive += counted - killed
        rows.append((file, len(every), counted, killed, len(excused)))
        print(f"# {file}: {killed} of {counted} killed, {time.time() - began:.0f} s", flush=True)
    total = [sum(row[i] for row in rows) for i in range(1, 5)]
    print("\n| file | mutants | tried | killed | | equivalent |\n|---|---|---|---|---|---|")
    for name, every, tried, killed, excused in [*rows, ("all", *total)]:
        print(f"| {name} | {every} | {tried} | {killed} | {killed / max(1, tried):.0%} | {excused} |")
    return 1 if alive > 0.05 * total[1] else 0


if __name__ == "__main__":
    sys.exit(main())
