"""The scenes and motions that reduced_scenes.py puts `mechsim reduce` through."""

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


GRIP = {"fingers_actuator": "255*(0.5-0.5*cos(2*pi*t))"}
ANKLE = {"left_motor_joint": "0.3*sin(2*pi*0.6*t)", "right_motor_joint": "-0.15*sin(2*pi*0.6*t)"}
SWING = "0.15*(1-cos(2*pi*t))"
LEG = {
    "left-hip-roll": "0",
    "left-hip-yaw": "0",
    "left-hip-pitch": f"0.5+{SWING}",
    "left-knee": f"-1.2-{SWING}",
    "left-foot": "-1.6+0.1*(1-cos(2*pi*t))",
}
MOTORS = {"motor1": "0.2*sin(2*pi*t)", "motor2": "0.1*(1-cos(2*pi*t))"}
SHOULDERS = {f"shoulder_{i}": f"{0.15 if i == 1 else 0.1}*(1-cos(2*pi*t))" for i in (1, 2, 3)}
MENAGERIE = "Kcygt_mujoco_menagerie"
# scenes -> files in clones of mujoco_menagerie and of the repositories that tuned_cases.py names
CASES = {
    "2F-85, both pads": Case("robotiq_2f85.xml", ("right_pad", "left_pad"), GRIP),
    "2F-85, one pad": Case("robotiq_2f85.xml", ("right_pad",), GRIP),
    "Cassie's leg": Case(f"{MENAGERIE}/agility_cassie/cassie.xml", ("left-foot",), drive=LEG, key="home"),
    "G1 ankle": Case("g1_ankle.xml", ("roll_link", "toe,roll_link@0.1,0.05,0"), ANKLE, duration=2.0),
    "looper": Case("", ("E",), drive={"crank": "60rpm"}),
    "jansen": Case("", ("foot",), drive={"crank": "60rpm"}),
    "xArm gripper": Case(f"{MENAGERIE}/ufactory_xarm7/hand.xml", ("left_finger", "right_finger"), GRIP),
    "Panda hand": Case(
        f"{MENAGERIE}/franka_emika_panda/hand.xml",
        ("left_finger", "right_finger"),
        {"actuator8": GRIP["fingers_actuator"]},
    ),
    "Tiangong ankle": Case(
        "feidedao_Parallel_Ankle_Joint/5_tiangong/urdf/TG10-00.xml", ("toe,foot_link@0.1,0,0",), ANKLE
    ),
    "planar-2dof": Case("Rhoban_onshape-to-robot-examples/planar-2dof/robot.xml", ("branch2",), MOTORS),
    "delta robot": Case(
        "jurmy24_delta-simulation/simulation/delta-robot/robot.xml", ("mobile_gripper_side",), SHOULDERS
    ),
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
