"""Tuning of a model or its motor: cheapest settings of plain MuJoCo within a tolerance, in its file."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, cast

import mujoco
import numpy as np

from mechsim.errors import InputError
from mechsim.files import attributes, write_content
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion_laws import constant
from mechsim.numerics.resources import Progress, no_progress
from mechsim.simulation.driven_run import first_state
from mechsim.simulation.mjcf.compiling import plainly_compiled
from mechsim.simulation.mjcf.joints import CRANK
from mechsim.simulation.plain_settings import ALLOWABLE
from mechsim.simulation.source import from_mechanism
from mechsim.studies.scene import errors, write_tuned
from mechsim.studies.scene.run import run_scene
from mechsim.studies.scene.scene import UserScene, open_scene, python_laws, scene_file, with_assembled_start
from mechsim.studies.scene.tune import AIMED_FRACTION, SECONDS, Tuned, tuned
from mechsim.units import si

MOTOR, RUN_KEY = "motor", "turning"
# inertia of the servo relative to that of the links; the servo accelerates the crank within 0.1 rad
SERVO_INERTIA_RATIO = 10.0


def turning(spec: mujoco.MjSpec, mechanism: Mechanism, speed: float) -> mujoco.MjSpec:
    """Return a model with a motor on its crank, and an assembled keyframe in which the crank rotates.

    Args:
        spec: specification of the mechanism from the generator, which names the hinge of the crank "crank".
        mechanism: mechanism with one crank.
        speed: crank speed, in [rad/s].

    Raises:
        InputError: for a mechanism without a crank.
        AssemblyError: for a crank that cannot rotate fully.
    """
    if not mechanism.has_crank:
        raise InputError(f"{mechanism.name} has no single crank that can turn at a speed; leave out --speed")
    spec = spec.copy()
    closed = from_mechanism(mechanism, spec.copy(), tuple(mechanism.points), follows_laws=False)
    qpos, qvel = first_state(closed, constant(speed, 1.0, mechanism.start))
    model, joint = plainly_compiled(spec.copy()), spec.joint(CRANK)
    weight = (
        float(joint.armature)
        or SERVO_INERTIA_RATIO * float(model.body_mass.sum()) * mechanism.characteristic_length**2
    )
    motor = spec.add_actuator(name=MOTOR, trntype=mujoco.mjtTrn.mjTRN_JOINT, target=joint.name)
    motor.set_to_velocity(kv=weight * abs(speed))
    spec.add_key(name=RUN_KEY, qpos=qpos, qvel=qvel, ctrl=[speed])
    return spec


@dataclass(frozen=True)
class TunedModel:
    """A tuned model.

    Attributes:
        report: result of the search, with the errors of the written file.
        text: tuned MJCF file.
        diff: changes relative to the file as published.
        included: names of included files that were merged into it because they change.
        notes: changes made to read the file.
    """

    report: Tuned
    text: str
    diff: str
    included: tuple[str, ...]
    notes: tuple[str, ...]

    @property
    def reached(self) -> bool:
        """Whether the tuned file satisfies the tolerance."""
        return self.report.reached

    def __str__(self) -> str:
        return "\n".join(self.report.sentences)

    __repr__ = __str__

    def as_dict(self) -> dict[str, Any]:
        """Return the output of `mechsim tune --json` without the paths of files."""
        result = self.report
        return {
            "mechanism": result.scene.mechanism.name,
            **attributes(result, "by", "tolerance", "unit", "reached", "seconds"),
            "summary": result.sentences,
            "published": _as_dict(result, result.published)
            | {"error": result.published_error, "reached": result.satisfied},
            "tuned": _as_dict(result, result.best)
            | {
                "error": result.error,
                "estimate": result.best.errors.by(result.by) + result.reference_error,
                "errors": result.errors,
            },
            "limit": {
                "what": result.reference.what,
                "error": result.reference.errors[0],
                "effort_error": result.reference.errors[1],
            },
            "put_in": list(self.included),
            "diff": self.diff,
            "tried": [_as_dict(result, trial) for trial in result.tried],
        }


def tune(
    model: Any,
    tolerance: float | str,
    *,
    by: str = "closure",
    ctrl: Mapping[str, str | float] | None = None,
    allow: Sequence[str] = (),
    budget: float | str = SECONDS,
    output: str | PathLike[str] | None = None,
    python: str | PathLike[str] | None = None,
    progress: Progress = no_progress,
    **options: Any,
) -> TunedModel:
    """Return the cheapest settings with which plain MuJoCo satisfies a tolerance on a model and its motion.

    Args:
        model: an MJCF file, or any input of `load`, which is then written as MJCF.
        tolerance: in [m] or text, such as "10um"; by torque in [N m], or in [N] for a slide.
        by: "closure" (points against the exact closure at the run's own drivers), "trajectory" (points
            against the converged motion) or "torque" (forces against the converged motion).
        ctrl: actuator -> its control: text such as "255*(0.5-0.5*cos(2*pi*t))", FILE.csv, or a number.
        allow: elements that may be disabled or softened: contacts, limits, friction, actuators, springs.
        budget: duration of the search, in [s] or text.
        output: path of the tuned MJCF file; None writes none.
        python: path of a script that runs the file, with settings that no file can contain if necessary.
        progress: callback with a description and the completed fraction.
        options: `drive`, `lock`, `lock_others`, `fix_base`, `track`, `key`, `duration`, as for `load`.

    Raises:
        InputError: for an invalid model, motion or tolerance.
        AssemblyError: for loops that do not close.

    Example:
        >>> tuned = ms.tune("gripper.xml", "10um", ctrl={"fingers": 120}, output="tuned.xml")
        >>> tuned.reached, tuned.report.error
    """
    limit = errors.tolerance_in_si(tolerance, by, errors.MEASURES)
    if unknown := [kind for kind in allow if kind not in ALLOWABLE]:
        raise InputError(f"--allow names {unknown[0]!r}; choose from {', '.join(ALLOWABLE)}")
    with scene_file(model) as path, TemporaryDirectory(prefix="mechsim-") as folder:
        target = Path(folder) / "tuned.xml" if output is None else Path(output)
        if target.resolve() == Path(path).resolve():
            raise InputError(f"-o {output} is the input file; name another file")
        scene, notes = open_scene(path, ctrl=ctrl, **options)
        scene = replace(scene, allowed=tuple(allow))
        if by == "closure" and (error := _start_gap(scene, limit)):
            scene = with_assembled_start(scene)
            notes += (
                f"{scene.path}: its loops are open by {error:.2g} m at the initial pose; the tuned file "
                f"starts assembled, in keyframe {write_tuned.KEY}",
            )
        seconds = si(budget, "s", "the budget")
        result = tuned(scene, limit, cast(errors.By, by), budget=seconds, progress=progress)
        if not np.isfinite(result.closest.errors.by(result.by)):
            cause = errors.divergence_reason(run_scene(scene)) or "no closed pose is near its states"
            raise InputError(
                f"{scene.path}: the scene diverges with all of {len(result.tried)} settings: {cause}; "
                "change the motion or the scene"
            )
        return _written(result, target, None if python is None else Path(python), notes)


def _start_gap(scene: UserScene, tolerance: float) -> float:
    """Return the error of the initial pose in [m]; zero if the scene satisfies a tolerance from there."""
    error = errors.start_error(scene)
    if error <= AIMED_FRACTION * tolerance or (
        error <= tolerance
        and errors.SceneEvaluator().errors(run_scene(scene, records=None)).closure <= tolerance
    ):
        return 0.0
    return error


def _written(result: Tuned, path: Path, script: Path | None, notes: tuple[str, ...]) -> TunedModel:
    """Write the tuned scene, and run it as plain MuJoCo reads it."""
    best = result.best
    scene = replace(result.scene, model=best.settings.applied(result.scene.model))
    laws = python_laws(scene)
    draft = write_tuned.tuned_text(result.scene, best.settings, [], path.parent)
    reports: list[Tuned] = []

    def finish(read_back: UserScene) -> str:
        run = run_scene(read_back, records=None)
        reports.append(replace(result, errors=result.reference.evaluator(result.by).errors(run)))
        comment = _comment(reports[0], scene, laws)
        return write_tuned.tuned_text(result.scene, best.settings, comment, path.parent).after

    read_back = write_tuned.write_scene(result.scene, best.settings, draft.after, path, finish)
    if script is not None:
        write_content(script, write_tuned.python_of(read_back, path, laws))
    after = path.read_text(encoding="utf-8")
    lines = difflib.unified_diff(
        draft.before.splitlines(), after.splitlines(), result.scene.path, str(path), lineterm="", n=0
    )
    return TunedModel(reports[0], after, "\n".join(lines), draft.included, notes)


def _as_dict(result: Tuned, trial: errors.SceneTrial) -> dict[str, Any]:
    return {
        "error": trial.errors.by(result.by),
        "ms_per_s": 1e3 * trial.seconds,
        "settings": dict(write_tuned.setting_changes(result.scene, trial.settings)),
        "errors": trial.errors,
    }


def _comment(result: Tuned, scene: UserScene, laws: dict[str, str]) -> list[str]:
    """Return the comment of the file: the satisfied tolerance, and how to step the model."""
    start = "from mj_resetData"
    if scene.own_start or scene.key:
        start = f"from keyframe {write_tuned.KEY if scene.own_start else scene.key}"
    first, *rest = result.sentences
    return [
        f"mechsim tune: {first};",
        *(f"{sentence};" for sentence in rest),
        f"step it {start}, and set before each step, with t = data.time, h = {scene.model.opt.timestep:g}:",
        *([f"  {line}" for line in write_tuned.control_lines(scene, laws)] or ["  nothing"]),
        *(f"  where q({name!r}, t) = {laws[name]}" for name in scene.joint_laws),
    ]
