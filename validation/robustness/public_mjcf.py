"""Public closed-loop MJCF files, solved by the loop equations and compared with MuJoCo's constraints.

Problem: each file of `public_mjcf.toml` moves for a second over one swing of its drivers. There are two
references, both to 1e-9 of the size. MuJoCo evaluates its equality constraints at mechsim's poses (`efc_pos`,
"MuJoCo") without a step or a solution. A separate closure (`mjcf_closure_oracle.py`) gives differences of
positions ("distance", relative to the size) and axes ("rotation") of the determined bodies, and its own
loop-closure error ("residual"). Where the rounded dimensions of a file contradict each other, its closure
error is allowed to be a multiple of the correction.

    python validation/robustness/public_mjcf.py FOLDER

FOLDER holds clones of the repositories in the list; missing files are skipped. None is in this repository.
"""

import sys
import tomllib
from pathlib import Path

import mujoco
import numpy as np
from mjcf_closure_oracle import worst_difference

from mechsim.analytic.loops.start import assembled
from mechsim.analytic.solvers import KinematicSolver
from mechsim.errors import MechsimError
from mechsim.model.motion_laws import make_motion_laws
from mechsim.simulation.mjcf.compiling import quiet
from mechsim.simulation.mjcf_reader.reading import states_of
from mechsim.subjects.mjcf_source import read_mjcf

# samples; tolerance; allowed multiple of the correction of a file whose dimensions contradict each other
SAMPLES, TOLERANCE, CONTRADICTION_FACTOR = 101, 1e-9, 10.0
# every so many poses are compared with the separate closure
EVERY = 5


def swing(start, amplitude):
    """Return the motion law of one swing from a start by an amplitude and back, in a second."""
    frequency = 2.0 * np.pi
    return lambda t: (
        start + 0.5 * amplitude * (1.0 - np.cos(frequency * t)),
        0.5 * amplitude * frequency * np.sin(frequency * t),
        0.5 * amplitude * frequency**2 * np.cos(frequency * t),
    )


def amplitudes(solver: KinematicSolver, requested):
    """Return the swing of each driver: 0.3 rad or a tenth of the size, within its limits."""
    mechanism, result = solver.mechanism, {}
    for name in mechanism.drivers:
        amplitude = 0.3 if mechanism.unit(name) == "rad" else 0.1 * mechanism.characteristic_length
        low, high = solver.source.limits.get(name, (-np.inf, np.inf))
        value = mechanism.guess_coordinates[name]
        above, below = high - value, value - low
        result[name] = requested.get(
            name, min(amplitude, above) if above >= min(amplitude, below) else -min(amplitude, below)
        )
    return result


@quiet()
def largest_violation(solver: KinematicSolver, motion):
    """Return the largest violation of MuJoCo's equality constraints at the poses of a motion."""
    model = solver.source.spec.copy().compile()
    data, largest = mujoco.MjData(model), 0.0
    for row in states_of(model, {name: joint.value for name, joint in motion.joints.items()}, motion.links):
        data.qpos[:] = row
        mujoco.mj_fwdPosition(model, data)
        rows = data.efc_pos[data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)]
        largest = max(largest, float(np.abs(rows).max(initial=0.0)))
    return largest


@quiet()
def closure_differences(solver: KinematicSolver, motion):
    """Return the largest differences from the separate closure: distance, rotation, residual."""
    model = solver.source.spec.copy().compile()
    instants = np.linspace(0.0, solver.motion_laws.duration, SAMPLES)[::EVERY]
    state = {
        name: (lambda t, s=s: float(s(np.array([t]))[0][0])) for name, s in solver.motion_laws.by_name.items()
    }
    locked = {name: (lambda t, v=v: v) for name, v in solver.mechanism.locked.items()}
    links = {name: (link.position[::EVERY], link.rotation[::EVERY]) for name, link in motion.links.items()}
    return worst_difference(
        model, solver.mechanism.characteristic_length, solver.source.qpos, state | locked, instants, links
    )


def table_row(path, options):
    """Return the row of one file, and whether it is within the tolerance."""
    names = ("drivers", "fix_base", "key", "track")
    locked = dict.fromkeys(options.get("holds", ()))
    solver = read_mjcf(str(path), lock=locked, **{name: options[name] for name in names if name in options})
    loops, coordinates = assembled(solver.mechanism)
    jacobian = loops.linearise(coordinates)[1][..., 0]
    rank = int(np.linalg.matrix_rank(jacobian, tol=1e-9)) if jacobian.size else 0
    start = {
        name: float(coordinates.values[loops.tree.index_of[name], 0]) for name in solver.mechanism.drivers
    }
    amplitude = amplitudes(solver, options.get("reach", {}))
    laws = make_motion_laws(
        solver.mechanism, {name: swing(start[name], amplitude[name]) for name in start}, 1.0
    )
    moving = KinematicSolver(solver.mechanism, motion_laws=laws, source=solver.source)
    motion = moving.solve(t=np.linspace(0.0, laws.duration, SAMPLES))
    violation, length = largest_violation(solver, motion), solver.mechanism.characteristic_length
    distance, rotation, residual = closure_differences(moving, motion)
    shift, tilt = solver.corrected
    text = (
        f"{loops.tree.count - rank:8d} {len(start):7d} {loops.rows:4d} {rank:4d} {solver.source.gap:8.1e} "
        f"{shift:8.1e} {violation:8.1e} {distance:8.1e} {rotation:8.1e} {residual:8.1e} {length:7.3f}"
    )
    # the residual of the separate closure measures how much the file contradicts itself
    allowance = CONTRADICTION_FACTOR * (shift / length + tilt + residual)
    return text, violation <= length * (TOLERANCE + allowance) and max(
        distance, rotation
    ) <= TOLERANCE + allowance


def main(folder):
    """Print the table and return whether all files are within the tolerance."""
    models = tomllib.loads(Path(__file__).with_suffix(".toml").read_text())["model"]
    print(
        f"{'model':30s}      DOF drivers rows rank      gap    shift   MuJoCo "
        "distance rotation residual   size [m]"
    )
    all_passed = True
    for options in models:
        path = Path(folder) / options["file"]
        if not path.exists():
            print(f"{options['name']:30s} missing: {path}")
            continue
        try:
            line, passed = table_row(path, options)
        except MechsimError as error:
            line, passed = str(error), False
        all_passed &= passed
        print(f"{options['name']:30s} {line}{'' if passed else '  FAILED'}", flush=True)
    return all_passed


if __name__ == "__main__":
    sys.exit(0 if main(sys.argv[1]) else 1)
