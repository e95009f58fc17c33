"""The interface of a peer, and the table of peers.

A peer is a module with `settings(problem) -> [Setting, ...]`, empty for a problem that it cannot describe,
and `build(problem, setting) -> Solver`. `build` does what a user does once.
"""

import importlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from problem import SAMPLES, Array, Positions, Problem

from mechsim.errors import InputError

# module -> package that it needs in addition to those of mechsim
PEERS = {
    "by_mechsim": None,
    "by_scipy": None,
    "by_exudyn": "exudyn",
    "by_pinocchio": "pinocchio",
    "by_pinocchio_cpp": "pinocchio",
    "by_pylinkage": "pylinkage",
}
EXTRA = "pip install -e '.[peers]'"


@dataclass(frozen=True)
class Setting:
    """One setting of a solver.

    Attributes:
        series: name of the curve.
        steps: steps or configurations of a revolution; 0 if the solver chooses them.
        poses: whether each configuration is solved by itself, so that all of them are compared.
    """

    series: str
    steps: int
    poses: bool = False

    @property
    def samples(self) -> int:
        """Number of compared instants after the first."""
        return self.steps if self.poses else SAMPLES


class Solver(Protocol):
    """A problem that can be solved repeatedly."""

    def run(self) -> tuple[float, Positions]:
        """Solve one revolution; return the processor time of the solver in [s] and the tracked points."""
        ...

    def torque(self) -> Array | None:
        """Return the drive torque at the samples of the last run, (n,) in [N m]; None if there is none."""
        ...


class Peer(Protocol):
    """The functions of a peer's module."""

    def settings(self, problem: Problem) -> Sequence[Any]:
        """Return the settings to compare for a problem."""
        ...

    def build(self, problem: Problem, setting: Any) -> Solver:
        """Return a solver of a problem with one of the settings."""
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
        raise InputError(f"{package} is not installed, so it is skipped; to compare it: {EXTRA}") from None
    return result
