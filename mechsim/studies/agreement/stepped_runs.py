"""Runs in time to be held against claims: a mechanism's own model, or a user's scene as it is published.

Each is a record at instants, with the exact motion where its drivers really were, and the same with a finer
step and the same softness of the loops.
"""

import copy
from collections.abc import Mapping
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from mechsim.analytic.loops.loop_form import LoopForm
from mechsim.errors import InputError
from mechsim.model.crank_profile import CrankProfile
from mechsim.numerics.arrays import Array
from mechsim.simulation import Settings
from mechsim.studies.agreement.comparand import Comparand
from mechsim.studies.agreement.named_quantities import NamedQuantity
from mechsim.studies.motion_source import profile_of, simulated
from mechsim.studies.scenes.published_run import published_scene
from mechsim.studies.scenes.scene_limit import interpolated
from mechsim.studies.scenes.scene_run import SceneRun, stepped
from mechsim.studies.scenes.user_scene import UserScene
from mechsim.subjects.mjcf_source import MjcfForm

# steps a turn of a mechanism's own model, and how much finer the second run is
STEPS, FINER = 1000, 4
TURN = 2.0 * np.pi


@dataclass(frozen=True)
class RunAtInstants:
    """A run, and what is exact where its drivers were.

    Attributes:
        there: the exact motion at the run's own drivers.
        values: what the run had of each quantity, (n, k) each.
    """

    there: Comparand
    values: tuple[Array, ...]


@dataclass(frozen=True)
class TwoRuns:
    """A run as it is, and one with a finer step and loops as soft.

    Attributes:
        plain: the run.
        fine: with the finer step.
        asked: the exact motion where the drivers were asked to be.
        how: what was run, in words.
    """

    plain: RunAtInstants
    fine: RunAtInstants
    asked: Comparand
    how: str


def runs_of(comparand: Comparand, named: list[NamedQuantity]) -> TwoRuns:
    """Return two runs of what moves, at the instants of a comparand.

    Raises:
        MechsimError: where it cannot be run; says why.
    """
    if comparand.time is None:
        raise InputError("no time is told, so that nothing is run in time")
    if isinstance(comparand.form, MjcfForm) and comparand.form.source is not None:
        return _scene_runs(comparand, named)
    return _own_runs(comparand, named)


def _own_runs(comparand: Comparand, named: list[NamedQuantity]) -> TwoRuns:
    """Return runs of the model made of a mechanism, driven by flywheels."""
    form, samples = comparand.form, len(comparand) - 1
    profile = _profile(comparand)
    found: list[RunAtInstants] = []
    for steps in (STEPS, FINER * STEPS):
        run = simulated(form, profile, settings=Settings(steps_per_turn=steps), samples=samples)
        if run.outcome == "diverged":
            raise InputError(f"{form.name}: the run in time diverged")
        motion = run.motion
        there = replace(
            comparand, angle=motion.angle, speed=motion.speed, acceleration=motion.acceleration, solved=None
        )
        if isinstance(form, LoopForm) and motion.drivers:
            there = replace(there, solved=form.solve_as(motion))
        values = replace(there, solved=motion)
        found.append(RunAtInstants(there, tuple(values.exact(one) for one in named)))
    return TwoRuns(found[0], found[1], comparand, f"the model of {form.name}, {STEPS} steps a turn")


def _profile(comparand: Comparand) -> CrankProfile:
    """Return the motion of the crank that a comparand was made of."""
    form, speed = comparand.form, float(comparand.speed[0])
    if form.motion_laws is not None:
        return profile_of(form, 1.0, 1.0)
    assert comparand.time is not None
    fastest = float(np.abs(comparand.speed).max()) * float(np.sign(speed or 1.0))
    return profile_of(form, fastest, form.period / TURN)


def _scene_runs(comparand: Comparand, named: list[NamedQuantity]) -> TwoRuns:
    form = comparand.form
    assert isinstance(form, MjcfForm)
    assert form.source is not None
    if form.motion_laws is None:
        raise InputError(f"{form.name}: no program says how its drivers move in time")
    scene, fed = published_scene(form)
    fine = _finer(scene)
    how = f"{scene.path} as published, step {float(scene.model.opt.timestep) * 1e3:g} ms"
    runs = [
        _at_instants(scene, stepped(scene, model, records=None), comparand, named) for model in (None, fine)
    ]
    return TwoRuns(runs[0], runs[1], comparand, f"{how}, {fed}")


def _finer(scene: UserScene) -> mujoco.MjModel:
    """Return a scene's model with a finer step, and loops as soft as they are with its own."""
    model = copy.copy(scene.model)
    step = float(model.opt.timestep)
    if not int(model.opt.disableflags) & int(mujoco.mjtDisableBit.mjDSBL_REFSAFE):
        # what the coarser step does to a time constant is softness
        soft = model.eq_solref[:, 0] > 0.0
        model.eq_solref[soft, 0] = np.maximum(model.eq_solref[soft, 0], 2.0 * step)
    model.opt.timestep = step / FINER
    return model


def _at_instants(
    scene: UserScene, run: SceneRun, comparand: Comparand, named: list[NamedQuantity]
) -> RunAtInstants:
    """Return what a run of a scene had at the instants of a comparand, and what is exact there."""
    form, time = comparand.form, comparand.time
    assert isinstance(form, MjcfForm)
    assert time is not None
    if run.broken:
        raise InputError(f"{form.name}: {run.broken}")
    keep = run.time <= time[-1] + 2.0 * float(run.model.opt.timestep)
    qpos = interpolated(run.time[keep], run.qpos[keep], time)
    at = replace(run, time=time, qpos=qpos, qvel=np.zeros((len(time), run.qvel.shape[1])))
    joints = _coordinates(scene, run.model, qpos)
    drivers = {
        name: replace(
            motion, value=_near(joints[name], motion.value) if motion.unit == "rad" else joints[name]
        )
        for name, motion in comparand.motion.joints.items()
        if name in form.mechanism.drivers
    }
    record = replace(comparand.motion, joints={**comparand.motion.joints, **drivers})
    there = replace(comparand, solved=form.solve_as(record))
    places = dict(zip(scene.places, np.moveaxis(at.points, 1, 0), strict=True))
    values: list[Array] = []
    for one in named:
        if one.kind == "position":
            values.append(one.components(places[one.subject]))
        elif one.subject in joints:
            values.append(joints[one.subject][:, None])
        else:
            raise InputError(f"a run of {form.name} does not tell {one.subject}")
    return RunAtInstants(there, tuple(values))


def _coordinates(scene: UserScene, model: mujoco.MjModel, qpos: Array) -> Mapping[str, Array]:
    """Return the hinges and slides of a scene by their names, (n,) each."""
    single = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    names = [joint.name for joint in scene.mechanism.joints[: model.njnt]]
    return {
        name: qpos[:, int(model.jnt_qposadr[i])]
        for i, name in enumerate(names)
        if int(model.jnt_type[i]) in single
    }


def _near(value: Array, wanted: Array) -> Array:
    return value + TURN * np.round((wanted - value) / TURN)
