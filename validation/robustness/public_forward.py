"""Public MJCF mechanisms run forward with their own masses, springs, dampers and friction.

Each file starts near its reference configuration with small displacements and rates, and runs for 0.5 s.
Three results are compared: mechsim's equations of motion; MuJoCo stepping the file itself (RK4; contacts,
limits, actuators, armature and fluid off; stiff constraints); and the verdict of mechsim's own comparison
with its MuJoCo model. The error is the largest distance between the first two of a point on a body, off its
origin by the size of the mechanism, relative to the largest displacement. Runs with half the step bound
MuJoCo's own error.

    python validation/robustness/public_forward.py FILE.xml ...

The files are not in this repository; docs/explanation/accuracy.md names those that were run.
"""

import sys
from dataclasses import replace
from pathlib import Path
from time import process_time

import mujoco
import numpy as np

import mechsim as ms
from mechsim.errors import MechsimError
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.kinetics.dynamic_run import initial_values
from mechsim.studies.dynamics_check import crosscheck_forward

DURATION, SAMPLES, STEPS, MAX_STEPS = 0.5, 40, 2000, 128_000
# initial displacement and rate of every driver, in [rad] or relative to the size
DISPLACEMENT, RATE = 0.05, 0.5
DISABLE = mujoco.mjtDisableBit


def mujoco_positions(
    path: Path, run: ms.dynamics.DynamicRun, steps: int, offset: np.ndarray
) -> dict[str, np.ndarray]:
    """Return the positions of bodies at the times of a run, stepped by MuJoCo from its first state."""
    spec = mujoco.MjSpec.from_file(str(path))
    # before compilation, which stores the inertia of single bodies
    for joint in spec.joints:
        joint.armature = 0.0
    model = spec.compile()
    model.opt.disableflags |= int(DISABLE.mjDSBL_CONTACT | DISABLE.mjDSBL_LIMIT | DISABLE.mjDSBL_ACTUATION)
    model.opt.timestep, model.opt.integrator = DURATION / steps, mujoco.mjtIntegrator.mjINT_RK4
    model.opt.tolerance, model.opt.iterations = 0.0, 100
    model.opt.density, model.opt.viscosity = 0.0, 0.0
    model.opt.solver, model.opt.cone = mujoco.mjtSolver.mjSOL_NEWTON, mujoco.mjtCone.mjCONE_ELLIPTIC
    model.dof_solref[:] = 2.0 * model.opt.timestep, 1.0
    model.dof_solimp[:] = 0.9999, 0.9999, 0.001, 0.5, 2.0
    if model.neq:
        model.eq_solref[:] = 2.0 * model.opt.timestep, 1.0
        model.eq_solimp[:] = 0.99999, 0.99999, 1.0, 0.5, 2.0
    data = mujoco.MjData(model)
    for name, joint in run.motion.joints.items():
        index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name)
        if index < 0:
            continue
        data.qpos[model.jnt_qposadr[index]] = joint.value[0]
        data.qvel[model.jnt_dofadr[index]] = joint.rate[0]
    kind = mujoco.mjtObj.mjOBJ_BODY
    bodies = {name: [] for name in run.motion.links if mujoco.mj_name2id(model, kind, name) >= 0}
    for i in range(SAMPLES + 1):
        mujoco.mj_kinematics(model, data)
        for name, positions in bodies.items():
            body = data.body(name)
            positions.append(body.xpos + body.xmat.reshape(3, 3) @ offset)
        if i < SAMPLES:
            mujoco.mj_step(model, data, nstep=steps // SAMPLES)
    return {name: np.array(positions) for name, positions in bodies.items()}


def initial_state(solver: KinematicSolver) -> dict[str, float]:
    """Return a displacement and a rate of each driver, within its limits."""
    initial: dict[str, float] = {}
    for name in solver.mechanism.drivers:
        scale = 1.0 if solver.mechanism.unit(name) == "rad" else solver.mechanism.characteristic_length
        low, high = solver.source.limits.get(name, (-np.inf, np.inf))
        start = solver.mechanism.guess_coordinates.get(name, 0.0)
        sign = 1.0 if high - start > start - low else -1.0
        initial |= {f"{name}.q": start + sign * DISPLACEMENT * scale, f"{name}.v": sign * RATE * scale}
    return initial


def table_row(path: Path) -> str:
    """Return a row of the table."""
    solver = ms.load(str(path), lock_others=False, still=True)
    initial = initial_state(solver)
    # joint limits are disabled in both methods
    solver = replace(solver, ranges={})
    model = ms.dynamics.dynamic_model(solver)
    start = process_time()
    run = ms.dynamics.run(model, initial=initial, duration=DURATION, samples=SAMPLES)
    seconds = process_time() - start
    # a point on the body, off its origin by the size of the mechanism
    offset = solver.mechanism.characteristic_length * np.array([0.6, 0.48, 0.64])
    steps, fine = STEPS, mujoco_positions(path, run, STEPS, offset)
    change = travel = 1.0
    # damping of light links limits the step
    while change > 0.1 * travel and steps < MAX_STEPS:
        steps, coarse = 2 * steps, fine
        fine = mujoco_positions(path, run, steps, offset)
        travel = max(float(np.abs(values - values[0]).max()) for values in fine.values())
        change = max(float(np.abs(coarse[name] - fine[name]).max()) for name in fine)
    computed = {name: link.position + link.rotation @ offset for name, link in run.motion.links.items()}
    error = max(float(np.abs(computed[name] - fine[name]).max()) for name in fine)
    verdict = crosscheck_forward(run, model, initial_values(model, initial))
    forces = model.forces
    springs = len(forces.springs) + len(forces.joint_springs)
    return (
        f"| {path.stem} | {len(solver.mechanism.joints)} | {springs} | {len(forces.friction)} | "
        f"{travel:.2g} | {error / travel:.1e} | {change / travel:.1e} | "
        f"{verdict.outcome} {verdict.reason} | {run.outcome} | {run.energy_error:.0e} | {seconds:.1f} |"
    )


def main() -> None:
    columns = (
        "file",
        "joints",
        "springs",
        "dampers",
        "displacement [m]",
        "error",
        "MuJoCo's error",
        "verdict",
        "outcome",
    )
    print(f"| {' | '.join(columns)} | energy | s |")
    print("|---" * (len(columns) + 2) + "|")
    for name in sys.argv[1:]:
        try:
            print(table_row(Path(name)), flush=True)
        except MechsimError as error:
            print(f"| {Path(name).stem} | {str(error)[:200]} |", flush=True)


if __name__ == "__main__":
    main()
