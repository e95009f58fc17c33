"""Pinocchio from C++: configurations by Newton's method, compiled against the libraries of its wheel.

The tangent predicts each configuration from the one before. It needs g++ and Eigen's headers from the package
cmeel-eigen.

Inside the time: the loop over configurations. Outside: compilation, model, points from angles.
"""

import subprocess
import sys
import tempfile
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
from by_pinocchio import Solver as PythonSolver
from problem import Array, Positions, Problem
from protocol import Setting

from mechsim.errors import InputError

POSES = (20, 100, 1000, 10_000)
# loop-closure error at which Newton's method ends, in units of the crank
CLOSURE_TOLERANCE = 1e-13
# as Pinocchio's CMake files define them
MACROS = [
    "-DPINOCCHIO_ENABLE_TEMPLATE_INSTANTIATION",
    "-DBOOST_MPL_LIMIT_LIST_SIZE=30",
    "-DBOOST_MPL_CFG_NO_PREPROCESSED_HEADERS",
]
SOURCE = Path(__file__).with_name("pinocchio_newton.cpp")


def settings(problem: Problem) -> list[Setting]:
    try:
        executable()
    except InputError as error:
        print(error, file=sys.stderr)
        return []
    return [Setting("Pinocchio (C++), Newton", n, poses=True) for n in POSES]


@cache
def executable() -> Path:
    """Return the compiled program.

    Raises:
        InputError: without g++ or Eigen.
    """
    prefix = next(parent for parent in Path(pin.__file__).parents if parent.name == "cmeel.prefix")
    path = Path(tempfile.mkdtemp(prefix="mechsim-peers-")) / "pinocchio_newton"
    folders = [f"-I{prefix / 'include'}", f"-isystem{prefix / 'include' / 'eigen3'}", f"-L{prefix / 'lib'}"]
    command = ["g++", "-std=c++17", "-O2", "-DNDEBUG", *MACROS, str(SOURCE)]
    command += [*folders, f"-Wl,-rpath,{prefix / 'lib'}", "-lpinocchio_default", "-o", str(path)]
    try:
        result = subprocess.run(command, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        raise InputError("Pinocchio's C++ needs g++; apt-get install g++ provides it") from None
    if result.returncode:
        first = next((line for line in result.stderr.splitlines() if "error" in line), result.stderr[:200])
        raise InputError(f"Pinocchio's C++ does not compile: {first}; pip install cmeel-eigen provides Eigen")
    return path


class Solver:
    """The linkage as numbers for the compiled program."""

    def __init__(self, problem: Problem, setting: Setting):
        self.problem = problem
        python_solver = PythonSolver(problem, setting)
        placements = [python_solver.model.jointPlacements[i] for i in (1, 2, 3)]
        numbers = [float(problem.planar), setting.steps, CLOSURE_TOLERANCE * problem.crank]
        for placement in placements:
            numbers += [*placement.rotation.ravel(), *placement.translation]
        for end in python_solver.ends:
            numbers += [*end]
        self.text = " ".join(repr(float(number)) for number in [*numbers, *python_solver.q])
        executable()

    def run(self) -> tuple[float, Positions]:
        output = subprocess.run(
            [executable()], input=self.text, capture_output=True, text=True, check=True
        ).stdout
        seconds, *angles = map(float, output.split())
        pairs = np.array(angles).reshape(-1, 2)
        return seconds, self.problem.positions(pairs[:, 0], pairs[:, 1])

    def torque(self) -> Array | None:
        """Return None: configurations have no forces."""
        return None


build = Solver
