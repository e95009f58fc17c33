"""A scene whose loops stand open where its file starts, as of a keyframe with few digits, begun closed."""

from dataclasses import replace

from mechsim.errors import AssemblyError
from mechsim.studies.scenes.exact_closure import CLOSED
from mechsim.studies.scenes.scene_errors import worst_distance
from mechsim.studies.scenes.scene_run import stepped
from mechsim.studies.scenes.user_scene import UserScene


def start_error(scene: UserScene) -> float:
    """Return the worst distance of a tracked point from the exact closure at time zero, in [m]."""
    run = stepped(scene, records=2, duration=float(scene.model.opt.timestep))
    return worst_distance(scene.closure.errors(run.qpos[:1], run.points[:1]))


def begun_closed(scene: UserScene) -> UserScene:
    """Return a scene that begins in the closed state nearest to its own start, its drivers where they are.

    Raises:
        AssemblyError: where no closed state is near.
    """
    qpos, qvel = scene.start
    closed, gap = scene.closure.closed(scene.closure.coordinates(qpos[None]))
    if not gap[0] <= CLOSED:
        raise AssemblyError(
            f"{scene.path}: its loops stand open where it starts and close in no pose near; start from "
            "another keyframe (--key)"
        )
    return replace(scene, start=(scene.closure.states(closed, qpos)[0], qvel), begins_closed=True)
