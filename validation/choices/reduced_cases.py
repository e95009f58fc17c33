"""The scenes and motions that reduced_scenes.py puts `mechsim reduce` through."""

import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import mujoco
import numpy as np

from mechsim.io.law_text import control_laws
from mechsim.io.readers import load
from mechsim.mechanism.scene import Scene
from mechsim.simulation.mjcf.compiling import to_xml
from mechsim.simulation.mjcf_reader.parsed_file import parse_file
from mechsim.studies.export import exported
from mechsim.studies.scene.scene import UserScene, scene_of


@dataclass(frozen=True)
class Case:
    """A scene, how it moves and what of it is tracked.

    Attributes:
        file: in the folder; of the catalogue where it is none.
        track: points, as --track has them.
        ctrl: actuator -> its control over time.
        drive: joint -> its motion law.
        duration: in [s].
        key: keyframe that it starts in.
    """

    file: str
    track: tuple[str, ...]
    ctrl: dict[str, str] = field(default_factory=dict[str, str])
    drive: dict[str, str] = field(default_factory=dict[str, str])
    duration: float = 1.0
    key: str | None = None

    @property
    def keep(self) -> set[str]:
        """Names of bodies that stay bodies."""
        return {body for text in self.track for body in text.partition("@")[0].split(",")}

    def scene(self, folder: Path) -> UserScene:
        """Return the scene and its motion, its file in a folder."""
        solver = load(str(folder / Path(self.file).name), drive=self.drive, track=self.track, key=self.key)
        return scene_of(
            solver.source,
            solver.mechanism,
            joint_laws=dict(solver.motion_laws.by_name),
            ctrl=control_laws(self.ctrl),
            duration=self.duration,
            points=dict(solver.mechanism.points),
            key=self.key,
        )


CASES = {
    name: Case(**entry | {"track": tuple(entry["track"])})
    for name, entry in tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8")).items()
}


def prepared(source: Path, work: Path) -> Iterator[tuple[str, Case, Path]]:
    """Yield the scenes that are there, and the folder that each is in; Cassie's leg is cut out into `work`.

    Args:
        source: the folder with the clones.
        work: a folder to write in.
    """
    for name, case in CASES.items():
        file = source / case.file
        if not case.file:
            text = to_xml(exported(load(name).mechanism, Scene(level="motion")))
            (work / f"{name}.xml").write_text(text)
            yield name, Case(f"{name}.xml", case.track, drive=case.drive), work
        elif not file.is_file():
            print(f"{name}: {case.file} is not there: skipped")
        elif name == "Cassie's leg":
            left_leg(file, work)
            yield name, case, work
        else:
            yield name, case, file.parent


def left_leg(source: Path, folder: Path) -> None:
    """Write the left leg of Cassie alone, its pelvis held where the keyframe home has it."""
    spec, model, *_ = parse_file(str(source))
    home = model.key("home").qpos.copy()
    for key in list(spec.keys):
        spec.delete(key)
    spec.delete(spec.body("right-hip-roll"))
    pelvis = spec.body("cassie-pelvis")
    pelvis.pos = home[:3]
    for joint in list(pelvis.joints):
        spec.delete(joint)
    leg = spec.compile()
    qpos = np.concatenate(
        [home[model.joint(leg.joint(j).name).qposadr[0] :][: _width(leg, j)] for j in range(leg.njnt)]
    )
    spec.add_key(name="home", qpos=qpos)
    spec.compile()
    (folder / source.name).write_text(spec.to_xml())


def _width(model: mujoco.MjModel, joint: int) -> int:
    return 4 if int(model.jnt_type[joint]) == int(mujoco.mjtJoint.mjJNT_BALL) else 1
