"""Where the distance between a run in time and a claim comes from: formula, softness, step, drive, rest."""

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np

from mechsim.analytic.loops.loop_form import LoopForm
from mechsim.errors import InputError, MechsimError
from mechsim.model.motion_laws import CrankProfile
from mechsim.numerics.arrays import Array
from mechsim.simulation import Settings
from mechsim.studies.agreement.candidate import Claim
from mechsim.studies.agreement.discrepancy import Scales, errors
from mechsim.studies.agreement.evaluation_points import Comparand
from mechsim.studies.motion_source import profile_of, simulated
from mechsim.studies.quantities import Quantity
from mechsim.studies.scene.converged_reference import interpolated
from mechsim.studies.scene.evaluator import SceneRun, stepped
from mechsim.studies.scene.published_run import published_scene
from mechsim.studies.scene.scene import UserScene
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


def runs_of(comparand: Comparand, named: list[Quantity]) -> TwoRuns:
    """Return two runs of what moves, at the instants of a comparand.

    Raises:
        MechsimError: where it cannot be run; says why.
    """
    if comparand.time is None:
        raise InputError("no time is told, so that nothing is run in time")
    if isinstance(comparand.form, MjcfForm) and comparand.form.source is not None:
        return _scene_runs(comparand, named)
    return _own_runs(comparand, named)


def _own_runs(comparand: Comparand, named: list[Quantity]) -> TwoRuns:
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


def _scene_runs(comparand: Comparand, named: list[Quantity]) -> TwoRuns:
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
    scene: UserScene, run: SceneRun, comparand: Comparand, named: list[Quantity]
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


PARTS = ("formula", "softness", "time step", "drive", "rest")
KINDS = ("position", "joint")

# what is claimed where the drivers of another comparand are
AskedAgain = Callable[[Comparand], Sequence[Claim]]


@dataclass(frozen=True)
class Attribution:
    """The distance of one quantity, taken apart.

    Attributes:
        name: of the quantity.
        unit: of all parts.
        at: crank angle in [rad], or time of motion laws in [s], where the distance is largest.
        at_unit: of it; "row" where a table has no times.
        whole: the largest distance between run and claim.
        parts: part -> how far it moves the run from the claim there, along the distance: they add up to it.
        largest: part -> the most that it is anywhere, by itself.
        how: what was run.
    """

    name: str
    unit: str
    at: float
    at_unit: str
    whole: float
    parts: dict[str, float]
    largest: dict[str, float]
    how: str

    def as_dict(self) -> dict[str, Any]:
        """Return it as `mechsim validate --json` prints it."""
        told = {"unit": self.unit, "whole": self.whole, "quantity": self.name, "at": self.at}
        told["at_unit"] = self.at_unit
        return {**self.parts, **told, "largest": self.largest, "run": self.how}

    @property
    def says(self) -> str:
        """The parts in one line."""
        parts = ", ".join(f"{name} {self.parts[name]:.2g}" for name in PARTS)
        return f"run against {self.name}: {self.whole:.2g} {self.unit} = {parts}"


def attributed(
    comparand: Comparand, claims: Sequence[Claim], scales: Scales, again: AskedAgain | None = None
) -> list[Attribution]:
    """Return where the distances between a run and claims come from, the largest first.

    Args:
        comparand: what moves, and when.
        claims: what is said of it; places of points and coordinates of joints count.
        scales: by which distances of several kinds are compared.
        again: asks the same where the run's drivers were; None where only a table tells.

    Raises:
        MechsimError: where nothing can be run; says why.
    """
    some = [claim for claim in claims if claim.named.kind in KINDS]
    if not some:
        return []
    runs = runs_of(comparand, [claim.named for claim in some])
    there = None
    if again is not None:
        there = {claim.named.name: claim for claim in again(runs.plain.there)}
    found = [
        _of_one(runs, i, claim, None if there is None else there[claim.named.name])
        for i, claim in enumerate(some)
    ]
    return sorted(
        found, key=lambda one: -one.whole / scales.of(next(c.named for c in some if c.named.name == one.name))
    )


def _of_one(runs: TwoRuns, i: int, claim: Claim, there: Claim | None) -> Attribution:
    named = claim.named

    def gap(one: Array, other: Array) -> Array:
        return errors(named, one, other)

    asked = runs.asked.exact(named)
    plain, fine = (run.there.exact(named) for run in (runs.plain, runs.fine))
    run, finer = runs.plain.values[i], runs.fine.values[i]
    whole = gap(run, claim.values)
    soft = gap(finer, fine)
    parts = {
        "formula": gap(asked, claim.values) if there is None else gap(plain, there.values),
        "softness": soft,
        "time step": gap(gap(run, plain), soft),
        "drive": gap(plain, asked),
    }
    parts["rest"] = gap(whole, np.sum([*parts.values()], axis=0))
    size = np.linalg.norm(whole, axis=1)
    at = int(np.argmax(size))
    along = whole[at] / size[at] if size[at] > 0.0 else np.zeros(whole.shape[1])
    instants = runs.asked.instants
    return Attribution(
        name=named.name,
        unit=named.unit,
        at=float(instants.value[at]),
        at_unit=instants.unit,
        whole=float(size[at]),
        parts={name: float(part[at] @ along) for name, part in parts.items()},
        largest={name: float(np.linalg.norm(part, axis=1).max()) for name, part in parts.items()},
        how=runs.how,
    )


def told(
    comparand: Comparand, claims: Sequence[Claim], scales: Scales, again: AskedAgain | None
) -> dict[str, Any]:
    """Return the attribution of the quantity farthest off as plain data, with all; a note where none is."""
    try:
        found = attributed(comparand, claims, scales, again)
    except MechsimError as error:
        return {"note": str(error)}
    if not found:
        return {}
    return {
        **found[0].as_dict(),
        "says": found[0].says,
        "quantities": {one.name: one.as_dict() for one in found},
    }
