"""The pytest plugin: a fixture, and TOML files with a formula as tests.

pytest loads it in every run, so it imports nothing of mechsim before a test needs it.
"""

import re
from collections.abc import Generator, Iterable
from fnmatch import fnmatch
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from mechsim.testing.running import RUNNING, RunningTest

if TYPE_CHECKING:
    from mechsim.testing.assertion import ModelFolder

# characters of a description at most; other TOML files, such as pyproject.toml, are not read
MAX_LENGTH = 1_000_000
FORMULA = re.compile(r"^\s*\[\s*formula\s*\]", re.MULTILINE)
JOINTS = re.compile(r"^\s*(\[\s*joints\b|joints\s*[.=])", re.MULTILINE)
OTHER_TOML = ("pyproject.toml", "pytest.toml", "ruff.toml", "uv.toml", "pixi.toml")


def pytest_addoption(parser: pytest.Parser) -> None:
    """Declare the setting of a project."""
    parser.addini(
        "mechsim_collect",
        "Patterns of TOML files that are tests if they have a [formula], such as *.toml or models/*.toml; by "
        "default only files named on the command line are.",
        type="args",
        default=[],
    )


def pytest_configure(config: pytest.Config) -> None:
    """Register the marker of TOML files that are tests."""
    config.addinivalue_line("markers", "mechsim: a TOML file compared with its formula")


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> pytest.Collector | None:
    """Return a TOML file with a formula as a test file, if it is named or a pattern selects it."""
    if file_path.suffix != ".toml" or file_path.name in OTHER_TOML:
        return None
    requested = parent.session.isinitpath(file_path) or _is_requested(file_path, parent.config)
    return TomlFile.from_parent(parent, path=file_path) if requested and _has_formula(file_path) else None


def _is_requested(path: Path, config: pytest.Config) -> bool:
    """Whether a pattern of the project selects a file, by its name or its path from the root."""
    root = config.rootpath
    called = path.relative_to(root).as_posix() if path.is_relative_to(root) else path.name
    patterns: list[str] = config.getini("mechsim_collect")
    return any(fnmatch(called, pattern) or fnmatch(path.name, pattern) for pattern in patterns)


def _has_formula(path: Path) -> bool:
    """Whether a file describes joints and has a formula; its test checks whether it is valid."""
    try:
        if path.stat().st_size > MAX_LENGTH:
            return False
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return False
    return bool(FORMULA.search(text) and JOINTS.search(text))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, Any, Any]:
    """Set the running test, so that an assertion can record its result."""

    def record(name: str, value: object) -> None:
        item.user_properties.append((name, str(value)))

    token = RUNNING.set(RunningTest(item.nodeid, record))
    try:
        return (yield)
    finally:
        RUNNING.reset(token)


@pytest.fixture
def mechsim(request: pytest.FixtureRequest) -> "ModelFolder":
    """Models in the folder of the test: `mechsim.load(FILE)`, `mechsim.assert_agrees(FILE, formula)`."""
    module: Any = import_module("mechsim.testing.assertion")
    return module.ModelFolder(request.path.parent)


class FormulaItem(pytest.Item):
    """The test that a file's mechanism agrees with its formula."""

    def runtest(self) -> None:
        """Run it."""
        root = Path.cwd()
        path = self.path.relative_to(root) if self.path.is_relative_to(root) else self.path
        # import only when a test runs, not when it is collected
        assertion: Any = import_module("mechsim.testing.assertion")
        assertion.assert_file_agrees(str(path))

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: object = None) -> str:
        """Return the message of a difference or an error, without a traceback."""
        errors: Any = import_module("mechsim.errors")
        if isinstance(excinfo.value, AssertionError | errors.MechsimError):
            return str(excinfo.value)
        return str(super().repr_failure(excinfo))

    def reportinfo(self) -> tuple[Path, int, str]:
        """Return the position of the test in its file."""
        return self.path, 0, self.nodeid


class TomlFile(pytest.File):
    """A file that describes a mechanism and has a formula."""

    def collect(self) -> Iterable[pytest.Item]:
        """Return its single test."""
        item = FormulaItem.from_parent(self, name="formula")
        item.add_marker("mechsim")
        return [item]
