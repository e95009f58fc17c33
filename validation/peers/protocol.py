"""What every peer is asked for, and which peers there are.

A peer is a module with `settings(problem) -> [Setting, ...]`, empty for a problem it cannot state, and
`build(problem, setting) -> Solver`. Everything that a user does once is done in `build`.
"""

import importlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from problem import SAMPLES, Array, Places, Problem

from mechsim.errors import InputError

# module -> the package it needs beyond what mechsim brings
PEERS = {
    "by_mechsim": None,
    "by_scipy": None,
    "by_exudyn": "exudyn",
    "by_pinocchio": "pinocchio",
    "by_pinocchio_cpp": "pinocchio",
    "by_drake": "pydrake",
    "by_pylinkage": "pylinkage",
    "by_scikit_robot": "skrobot",
}
EXTRA = "pip install -e '.[peers]'"


@dataclass(frozen=True)
class Setting:
    """One way to solve a turn.

    Attributes:
        family: what the curve is called.
        steps: or poses, a turn; 0 where the solver chooses.
        poses: whether every step is an answer by itself, so that all of them are judged.
    """

    family: str
    steps: int
    poses: bool = False

    @property
    def samples(self) -> int:
        """Instants after the first at which the turn is judged."""
        return self.steps if self.poses else SAMPLES


class Solver(Protocol):
    """A problem, ready to be solved again and again."""

    def run(self) -> tuple[float, Places]:
        """Solve one turn; return the processor time of the solver in [s] and the tracked points."""
        ...

    def torque(self) -> Array | None:
        """Return the drive torque at the samples of the last run, (n,) in [N m]; None where there is none."""
        ...


class Peer(Protocol):
    """What a peer's module holds."""

    def settings(self, problem: Problem) -> Sequence[Any]:
        """Return the settings to compare for a problem."""
        ...

    def build(self, problem: Problem, setting: Any) -> Solver:
        """Return what solves a problem with one of the settings."""
        ...


def load(module: str) -> Peer:
    """Return a peer's module.

    Raises:
        InputError: where the package it needs is not installed.
    """
    package = PEERS[module]
    try:
        result: Any = importlib.import_module(module)
    except ModuleNotFoundError as error:
        if package is None or error.name is None or error.name.split(".")[0] != package:
            raise
        raise InputError(f"{package} is not installed, so it is left out; to compare it: {EXTRA}") from None
    return result
