"""A mechanism as an MJCF file whose motor turns it in plain MuJoCo within a tolerance."""

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import mujoco

from mechsim.errors import InputError
from mechsim.files import stem_of
from mechsim.model.mechanism import Mechanism
from mechsim.model.motion_laws import constant
from mechsim.numerics.angles import REVOLUTION
from mechsim.simulation.driven_run import first_state
from mechsim.simulation.mjcf.compiling import plainly_compiled, quiet, to_xml
from mechsim.simulation.mjcf.joints import CRANK
from mechsim.simulation.mjcf_reader import read_model
from mechsim.simulation.mjcf_text.edited_text import EditedText, put_comment
from mechsim.simulation.source import from_mechanism
from mechsim.simulation.stepping import Progress, no_progress
from mechsim.studies.budget import Budget
from mechsim.studies.scene import errors_of, run_scene, scene_of
from mechsim.studies.scene.scene import UserScene
from mechsim.studies.scene.tune import SECONDS, tuned
from mechsim.studies.scene.write_tuned import plain_model, tuned_text

MOTOR, KEY = "motor", "turning"
# revolutions over which the search satisfies a tolerance; it verifies its choice over three times as many
TURNS = 2.0
# inertia of the servo relative to that of the links: it accelerates the crank within 0.1 rad
STIFF = 10.0


def turning(spec: mujoco.MjSpec, mechanism: Mechanism, speed: float) -> mujoco.MjSpec:
    """Return a model with a motor on its crank and a keyframe, closed and moving, in which it turns.

    Args:
        spec: of the mechanism, as the generator makes it: whatever the crank's name, its hinge is "crank".
        mechanism: with one crank that turns.
        speed: of the crank, in [rad/s].

    Raises:
        InputError: for a mechanism without a crank.
        AssemblyError: where the crank cannot turn.
    """
    if not mechanism.has_crank:
        raise InputError(
            f"{mechanism.name} has no single crank that could turn at a speed; leave out --speed and "
            "--tolerance"
        )
    spec = spec.copy()
    closed = from_mechanism(mechanism, spec.copy(), tuple(mechanism.points), programmed=False)
    qpos, qvel = first_state(closed, constant(speed, TURNS, mechanism.start))
    model, joint = plainly_compiled(spec.copy()), spec.joint(CRANK)
    weight = (
        float(joint.armature) or STIFF * float(model.body_mass.sum()) * mechanism.characteristic_length**2
    )
    motor = spec.add_actuator(name=MOTOR, trntype=mujoco.mjtTrn.mjTRN_JOINT, target=joint.name)
    motor.set_to_velocity(kv=weight * abs(speed))
    spec.add_key(name=KEY, qpos=qpos, qvel=qvel, ctrl=[speed])
    return spec


def turning_scene(path: str, mechanism: Mechanism, speed: float) -> UserScene:
    """Return the scene of a file made by `turning`, whose points are tracked over whole revolutions."""
    read = read_model(path, drivers=[CRANK], key=KEY)
    duration = TURNS * REVOLUTION / abs(speed)
    points = {name: point for name, point in mechanism.points.items() if name in read.mechanism.points}
    return scene_of(read, read.mechanism, duration=duration, points=points or None, key=KEY)


@quiet()
def exported_model(
    spec: mujoco.MjSpec,
    mechanism: Mechanism,
    speed: float,
    tolerance: float,
    *,
    budget: float | Budget = SECONDS,
    progress: Progress = no_progress,
) -> tuple[str, float]:
    """Return the text of a model that turns within a tolerance, and its error as read back.

    Args:
        spec: as of `turning`.
        mechanism: as of `turning`.
        speed: of the crank, in [rad/s].
        tolerance: of tracked points from the exact closure at the crank's own angle, in [m].
        budget: of the search, in [s].
        progress: called after each trial.
    """
    with TemporaryDirectory() as folder:
        path = Path(folder, f"{stem_of(mechanism.name)}.xml")
        path.write_text(to_xml(turning(spec, mechanism, speed)))
        scene = turning_scene(str(path), mechanism, speed)
        result = tuned(scene, tolerance, "closure", budget=budget, progress=progress)
        text = tuned_text(scene, result.best.settings, [], path.parent).after
        path.write_text(text)
        written_scene = replace(scene, model=plain_model(str(path)))
        error = errors_of(run_scene(written_scene, records=None)).closure
        edited = EditedText(text)
        comment = [
            f"mechsim export: {'keeps' if error <= tolerance else 'does not keep'} {tolerance:g} m at "
            f"{speed:g} rad/s over {TURNS:g} turns, errs by {error:.2g};",
            f"to be stepped from keyframe {KEY} (mj_resetDataKeyframe(model, data, 0)), nothing else.",
        ]
        put_comment(edited, comment)
    return edited.result, error
