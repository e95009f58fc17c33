"""What can be left out of public closed-loop scenes: `mechsim reduce` at T = 1e-4 of each scene's size.

Problem: each scene moves as its row says; a part of it is tracked. Reference: the full scene as published, in
plain MuJoCo, over that motion and over a second one that chose nothing.

    python validation/choices/reduced_scenes.py FOLDER [--out DIR]

FOLDER holds robotiq_2f85.xml and cassie.xml (mujoco_menagerie) and g1_ankle.xml (feidedao's
Parallel_Ankle_Joint); one that is not there is skipped. The looper and Jansen's leg are exported here. None
lies in this repository.
"""

import argparse
import tempfile
from pathlib import Path

import mujoco
import numpy as np
import sheet

from mechsim.model.scene import Scene
from mechsim.pictures.render.exported_scene import exported
from mechsim.simulation import mjcf
from mechsim.simulation.mjcf_reader.parsed_file import parsed
from mechsim.studies.reduction import reduced
from mechsim.studies.scenes import scene_of
from mechsim.subjects.actuator_programs import actuator_programs
from mechsim.subjects.subject import load

PART = 1e-4
SWING = "0.15*(1-cos(2*pi*t))"
# scene -> file, prescribed, fed, tracked, duration, keyframe
SCENES = {
    "2F-85, one pad": (
        "robotiq_2f85.xml",
        {},
        {"fingers_actuator": "255*(0.5-0.5*cos(2*pi*t))"},
        ("right_pad",),
        1.0,
        None,
    ),
    "2F-85, both pads": (
        "robotiq_2f85.xml",
        {},
        {"fingers_actuator": "255*(0.5-0.5*cos(2*pi*t))"},
        ("right_pad", "left_pad"),
        1.0,
        None,
    ),
    "G1 ankle": (
        "g1_ankle.xml",
        {},
        {"left_motor_joint": "0.3*sin(2*pi*0.6*t)", "right_motor_joint": "-0.15*sin(2*pi*0.6*t)"},
        ("roll_link", "toe,roll_link@0.1,0.05,0"),
        2.0,
        None,
    ),
    "Cassie's leg": (
        "cassie_leg.xml",
        {
            "left-hip-roll": "0",
            "left-hip-yaw": "0",
            "left-hip-pitch": f"0.5+{SWING}",
            "left-knee": f"-1.2-{SWING}",
            "left-foot": "-1.6+0.1*(1-cos(2*pi*t))",
        },
        {},
        ("left-foot",),
        1.0,
        "home",
    ),
    "looper": ("looper.xml", {"crank": "60rpm"}, {}, ("E",), 1.0, None),
    "Jansen's leg": ("jansen.xml", {"crank": "60rpm"}, {}, ("foot",), 1.0, None),
}


def left_leg(source: Path, folder: Path) -> None:
    """Write the left leg of Cassie alone, its pelvis held where the keyframe home has it."""
    spec, model, _ = parsed(str(source))
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
    (folder / "cassie_leg.xml").write_text(spec.to_xml())


def _width(model: mujoco.MjModel, joint: int) -> int:
    return 4 if int(model.jnt_type[joint]) == int(mujoco.mjtJoint.mjJNT_BALL) else 1


def prepared(source: Path, folder: Path) -> None:
    """Put all scenes there are into a folder."""
    for name in ("robotiq_2f85.xml", "g1_ankle.xml"):
        if (source / name).exists():
            (folder / name).write_text((source / name).read_text())
    if (source / "cassie.xml").exists():
        left_leg(source / "cassie.xml", folder)
    for name in ("looper", "jansen"):
        text = mjcf.to_xml(exported(load(name).mechanism, Scene(level="motion")))
        (folder / f"{name}.xml").write_text(text)


def row(name: str, folder: Path) -> dict[str, object]:
    """Return what came of a scene."""
    file, drive, ctrl, track, duration, key = SCENES[name]
    form = load(str(folder / file), drive=drive, track=track, key=key)
    scene = scene_of(
        form.source,
        form.mechanism,
        drive={} if form.programs is None else dict(form.programs.by_name),
        ctrl=actuator_programs(ctrl),
        duration=duration,
        points=dict(form.mechanism.points),
        key=key,
    )
    bound = PART * scene.size
    keep = {part for text in track for part in text.partition("@")[0].split(",")}
    found = reduced(scene, parsed(str(folder / file))[0], bound, keep=keep)
    first, second = found.errors
    return {
        "scene": name,
        "T": bound,
        "error": first.trajectory,
        "second": second.trajectory,
        "effort": max(first.torque, second.torque),
        "energy": max(first.energy, second.energy),
        "ms/s": f"{1e3 * found.time:.3g}",
        "faster": f"{found.speedup:.2f}",
        "left out": "; ".join(one.candidate.what for one in found.left_out),
        "kept": "yes" if found.kept(bound) else "NO",
    }


@mjcf.quiet()
def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--out", type=Path)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        prepared(asked.folder, folder)
        rows = [row(name, folder) for name in SCENES if (folder / SCENES[name][0]).exists()]
    if asked.out is not None:
        asked.out.mkdir(parents=True, exist_ok=True)
    sheet.show(rows, asked.out, "reduced_scenes")


if __name__ == "__main__":
    main()
