"""Runs an MJCF file in plain MuJoCo with its own settings."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from mechsim.errors import InputError, MechsimError
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.links import GROUND
from mechsim.mechanism.motion import JointMotion, LinkMotion, Motion, PointMotion, select_instants
from mechsim.mechanism.motion_laws import CrankProfile, State, steady
from mechsim.numerics.arrays import Array
from mechsim.simulation.mjcf.compiling import plainly_compiled
from mechsim.simulation.model_loops import loops_with_crank
from mechsim.simulation.plain_settings import settings_of
from mechsim.simulation.state import PosedBodies
from mechsim.studies.motions import scaled_law
from mechsim.studies.scene.published_run import PublishedRun
from mechsim.studies.scene.run import SceneRun, run_scene
from mechsim.studies.scene.scene import UserScene, scene_of

# largest number of steps of a run; these take one minute for a scene of 20 bodies
MAX_STEPS = 2_000_000
# approximate number of compared instants
RECORDS = 4000
# records per sample of a drawn motion, whose rates are differences between records
RECORDS_PER_SAMPLE = 10
SHOWN = ("integrator", "solver", "iterations", "tolerance", "solref")


def published_run(source: KinematicSolver, profile: CrankProfile) -> PublishedRun:
    """Run a file with its own settings over the motion of its drivers.

    Args:
        source: mechanism read from the file.
        profile: motion of the crank, used without motion laws.
    """
    own = settings_of(plainly_compiled(source.source.spec.copy())).as_dict()
    settings = {name: own[name] for name in ("timestep", *SHOWN) if name in own}
    result = PublishedRun(path=source.source.path, settings=settings)
    steps = profile.duration / float(settings["timestep"])
    if not steps <= MAX_STEPS:
        note = f"they take {steps:.3g} steps, more than {MAX_STEPS:,}; give a shorter --duration"
        return replace(result, note=note, run=False)
    try:
        scene, driven = published_scene(source, profile)
    except MechsimError as error:
        return replace(result, note=str(error), run=False)
    run = run_scene(scene, records=RECORDS)
    if run.broken:
        return replace(result, driven=driven, note=run.broken)
    return replace(
        result,
        driven=driven,
        instants=profile.state(run.time)[0] if source.motion_laws.crank else run.time,
        instants_unit=source.motion_laws.unit,
        gaps=loop_gaps(run),
        errors=scene.closure.errors(run.qpos, run.points).max(1, initial=0.0),
    )


def published_scene(source: KinematicSolver, profile: CrankProfile | None = None) -> tuple[UserScene, str]:
    """Return the scene of a file over the motion of its drivers, and a description of the actuation.

    Position servos of the file receive controls; other drivers have virtual drive inertia. The run starts in
    the state in which the file was read, such as a keyframe.

    Args:
        source: mechanism read from the file, with motion laws or a crank.
        profile: motion of the crank, used without motion laws.

    Raises:
        MechsimError: if the scene cannot start.
    """
    profile, laws = profile or source.motion_laws.path_profile, dict(source.motion_laws.by_name)
    if source.motion_laws.crank:
        laws = {source.mechanism.crank.name: profile.state}
    # position servos receive the laws of their joints as controls
    model, ctrl = plainly_compiled(source.source.spec.copy()), dict[str, State]()
    for actuator, joints in source.source.actuators.items():
        gain = _servo_gain(model, actuator)
        if gain is not None and len(joints) == 1 and joints[0] in laws:
            ctrl[actuator] = scaled_law(laws.pop(joints[0]), gain)
    # virtual drive inertia also keeps locked joints in position
    laws |= {name: steady(value, 0.0) for name, value in source.mechanism.locked.items()}
    scene = scene_of(
        source.source,
        source.mechanism,
        joint_laws=laws,
        ctrl=ctrl,
        duration=profile.duration,
        points=source.mechanism.points,
        started=bool(source.mechanism.guess),
    )
    return scene, f"{', '.join(ctrl)} fed" if ctrl else "its drivers carried by virtual drive inertia"


def runs_as_published(solver: KinematicSolver) -> bool:
    """Return whether a mechanism is that of a file which plain MuJoCo can run: its drivers are joints."""
    if solver.source is None or not Path(solver.source.path).is_file():
        return False
    return set(solver.mechanism.drivers) <= {joint.name for joint in solver.source.spec.joints}


def published_motion(source: KinematicSolver, profile: CrankProfile, samples: int) -> Motion:
    """Return the motion of a file with its own settings, with gaps in its loops.

    Links have the poses of MuJoCo's bodies. Rates are differences between records.

    Args:
        source: mechanism for which `runs_as_published` is true.
        profile: motion of the crank, used without motion laws.
        samples: number of evenly spread samples after the first; each is the nearest record.

    Raises:
        MechsimError: if the scene cannot start, or its run diverges at once.
    """
    scene, _ = published_scene(source, profile)
    run = run_scene(scene, records=RECORDS_PER_SAMPLE * samples)
    if len(run.time) < 3:
        raise InputError(f"{scene.path}: with the file's own settings {run.broken or 'it takes two steps'}")

    def rates(values: Array) -> tuple[Array, Array, Array]:
        rate = np.gradient(values, run.time, axis=0)
        return values, rate, np.gradient(rate, run.time, axis=0)

    def link_motion(position: Array, rotation: Array) -> LinkMotion:
        """Return the motion of a link from its positions (n, 3) and rotations (n, 3, 3)."""
        _, velocity, acceleration = rates(position)
        # the cross-product matrix of the angular velocity
        spin = rates(rotation)[1] @ np.swapaxes(rotation, 1, 2)
        angular = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], 1)
        return LinkMotion(position, rotation, velocity, angular, acceleration, rates(angular)[1])

    unit: Any = scene.mechanism.unit
    joints = {name: JointMotion(*rates(values), unit=unit(name)) for name, values in run.coordinates.items()}
    position, rotation = PosedBodies(run.model).body_poses(run.qpos)
    links = {
        name: link_motion(position[:, body], rotation[:, body])
        for name, body in scene.closure.bodies.items()
        if name != GROUND
    }
    points = {name: PointMotion(*rates(run.points[:, k])) for k, name in enumerate(scene.tracked)}
    crank = joints[source.mechanism.crank.name] if source.motion_laws.crank else None
    path = crank or JointMotion(*source.motion_laws.path_profile.state(run.time))
    drivers = () if crank else source.motion_laws.drivers
    motion = Motion(
        "step", path.value, path.rate, path.acceleration, points, links, joints, run.time, loop_gaps(run),
        broken=run.broken, drivers=drivers,
    )  # fmt: skip
    instants = np.linspace(0.0, scene.duration, samples + 1)
    rows = np.abs(run.time - instants[instants <= run.time[-1] * (1.0 + 1e-9)][:, None]).argmin(1)
    return select_instants(motion, np.unique(rows))


def loop_gaps(run: SceneRun) -> Array:
    """Return the largest distance between the two sides of a connect or weld at each record, (n,) in [m]."""
    loops = loops_with_crank(run.model, 0)
    gaps = loops.residual(run.qpos)[:, : 3 * len(loops.pairs)].reshape(len(run.qpos), -1, 3)
    return np.linalg.norm(gaps, axis=2).max(1, initial=0.0)


def _servo_gain(model: mujoco.MjModel, actuator: str) -> float | None:
    """Return the control of a position servo per unit of position; None for other actuators."""
    try:
        i = model.actuator(actuator).id
    except KeyError:
        return None
    gain, bias = float(model.actuator_gainprm[i, 0]), model.actuator_biasprm[i]
    affine = int(model.actuator_biastype[i]) == int(mujoco.mjtBias.mjBIAS_AFFINE)
    if not (affine and gain and bias[1] < 0.0 and bias[0] == 0.0):
        return None
    return float(-bias[1] / gain * model.actuator_gear[i, 0])
