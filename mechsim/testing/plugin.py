"""The pytest plugin: a fixture, TOML files with a formula as tests, and where failed tests leave reports.

pytest loads it in every run, so nothing of mechsim is imported here before a test asks for it.
"""

import re
import tempfile
from collections.abc import Generator, Iterable
from fnmatch import fnmatch
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from mechsim.testing.running import RUNNING, RunningTest

if TYPE_CHECKING:
    from mechsim.testing.assertion import ModelFolder

# a description is no longer than this, and says so; pyproject.toml and its like are never looked into
MAX_LENGTH = 1_000_000
FORMULA = re.compile(r"^\s*\[\s*formula\s*\]", re.MULTILINE)
JOINTS = re.compile(r"^\s*(\[\s*joints\b|joints\s*[.=])", re.MULTILINE)
FOREIGN = ("pyproject.toml", "pytest.toml", "ruff.toml", "uv.toml", "pixi.toml")
CACHE = "mechsim"


def pytest_addoption(parser: pytest.Parser) -> None:
    """Declare what a project can ask for."""
    group = parser.getgroup("mechsim")
    group.addoption(
        "--mechsim-reports",
        metavar="DIR",
        help="Where failed agreements leave their reports (pytest's cache if left out).",
    )
    parser.addini(
        "mechsim_collect",
        "Patterns of TOML files that are tests if they have a [formula], as *.toml or models/*.toml; none if "
        "left out: then only those named on the command line are.",
        type="args",
        default=[],
    )
    parser.addini("mechsim_reports", "Where failed agreements leave their reports.", default="")


def pytest_configure(config: pytest.Config) -> None:
    """Register the mark of TOML files that are tests."""
    config.addinivalue_line("markers", "mechsim: a TOML file held against the formula it names")


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> pytest.Collector | None:
    """Return a TOML file with a formula as a test file, where it was named or the project asks for it."""
    if file_path.suffix != ".toml" or file_path.name in FOREIGN:
        return None
    if not (parent.session.isinitpath(file_path) or _is_requested(file_path, parent.config)):
        return None
    if not _has_formula(file_path):
        return None
    return TomlFile.from_parent(parent, path=file_path)


def _is_requested(path: Path, config: pytest.Config) -> bool:
    """Whether a pattern of the project's names a file, by its name or its path from the root."""
    root = config.rootpath
    called = path.relative_to(root).as_posix() if path.is_relative_to(root) else path.name
    patterns: list[str] = config.getini("mechsim_collect")
    return any(fnmatch(called, pattern) or fnmatch(path.name, pattern) for pattern in patterns)


def _has_formula(path: Path) -> bool:
    """Whether a file describes joints and names a formula; whether it is sound is for its test to say."""
    try:
        if path.stat().st_size > MAX_LENGTH:
            return False
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return False
    return bool(FORMULA.search(text) and JOINTS.search(text))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, Any, Any]:
    """Say which test runs, so that an assertion knows where to report."""

    def record(name: str, value: object) -> None:
        item.user_properties.append((name, str(value)))

    token = RUNNING.set(RunningTest(item.nodeid, _reports(item.config), record))
    try:
        return (yield)
    finally:
        RUNNING.reset(token)


def _reports(config: pytest.Config) -> Path:
    """Return where reports go: where was asked, else into pytest's cache, else among temporary files."""
    requested: str = config.getoption("--mechsim-reports") or config.getini("mechsim_reports")
    if requested:
        return config.rootpath / requested
    cache: Any = getattr(config, "cache", None)
    if cache is not None:
        return Path(config.rootpath, config.getini("cache_dir"), "d", CACHE)
    return Path(tempfile.gettempdir(), "mechsim-reports")


@pytest.fixture
def mechsim(request: pytest.FixtureRequest) -> "ModelFolder":
    """Models next to the test's own file: `mechsim.load(FILE)`, `mechsim.assert_agrees(FILE, formula)`."""
    module: Any = import_module("mechsim.testing.assertion")
    return module.ModelFolder(request.path.parent)


class FormulaItem(pytest.Item):
    """The test that a file's mechanism agrees with the formula it names."""

    def runtest(self) -> None:
        """Run it."""
        root = Path.cwd()
        path = self.path.relative_to(root) if self.path.is_relative_to(root) else self.path
        # what is only collected needs none of it
        assertion: Any = import_module("mechsim.testing.assertion")
        assertion.assert_agrees(str(path))

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: object = None) -> str:
        """Return the message of a difference or an error, without a traceback."""
        errors: Any = import_module("mechsim.errors")
        if isinstance(excinfo.value, AssertionError | errors.MechsimError):
            return str(excinfo.value)
        return str(super().repr_failure(excinfo))

    def reportinfo(self) -> tuple[Path, int, str]:
        """Return where the test stands."""
        return self.path, 0, self.nodeid


class TomlFile(pytest.File):
    """A file that describes a mechanism and names a formula."""

    def collect(self) -> Iterable[pytest.Item]:
        """Return its one test."""
        item = FormulaItem.from_parent(self, name="formula")
        item.add_marker("mechsim")
        return [item]
