"""Gepetto's parallel robots: URDF with closures in a sidecar file, moved about the assembly that is found.

The residual is computed from the files alone: each joint and each closure relates the poses of two links, and
the poses are those of the motion. A revolute joint keeps the origin and the axis, a fixed one the whole
frame, UJOINT_XY the origin and a right angle between x of one frame and y of the other, a closure of type 3d
the origin, of type 6d the frame.
"""

import tempfile
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

import mechsim as ms
from mechsim.errors import cut
from mechsim.kinematics.loops.start import start_poses
from validation.published.table import Row
from validation.suites.case import Case, Clone, Suite

# of the motors about the assembly, in [rad] or [m]
SWING, INSTANTS = 0.02, 9
TOLERANCE = 1e-11
# characters of a sentence
MAX_REASON = 120
REASON = "in m and rad: loops close to 1e-12 of a link, and a chain of 50 links adds its rounding"
# robot -> letters of its URDF that its sidecar file spells otherwise, and how
REPAIRS = {"disney_robot": ("\u0125", "ph")}
# why mechsim has no motion; least squares by Levenberg-Marquardt over all joints in code of its own
CAUSES = {
    "kangaroo_like": "no assembly: separate least squares from 250 starts leave 0.096 m at best",
    "kangaroo_like_2legs": "no assembly: separate least squares from 40 starts leave 0.093 m at best",
    "wl16_like": "the assembly found is singular: with motors and spins locked, rank 27 of 30",
}
Pose = tuple[np.ndarray, np.ndarray]


def frame(origin) -> Pose:
    """Return position and rotation of an <origin>."""
    written = {} if origin is None else origin.attrib
    position, angles = (np.array(written.get(key, "0 0 0").split(), float) for key in ("xyz", "rpy"))
    return position, Rotation.from_euler("xyz", angles).as_matrix()


def after(pose: Pose, local: Pose) -> Pose:
    """Return a frame on a link in the ground's frame, poses (n, 3) and (n, 3, 3)."""
    return pose[0] + pose[1] @ local[0], pose[1] @ local[1]


def misfit(a: Pose, b: Pose, kind: str, axis: np.ndarray) -> float:
    """Return the largest violation of a joint between two frames."""
    apart = b[0] - a[0]
    if kind == "prismatic":
        apart = np.cross(apart, a[1] @ axis)
    if kind.startswith("ujoint_"):
        first, second = (np.eye(3)["xyz".index(letter)] for letter in kind[-2:])
        right = ((a[1] @ first) * (b[1] @ second)).sum(-1)
        return float(max(np.abs(apart).max(), np.abs(right).max()))
    apart_axes = a[1] @ axis - b[1] @ axis if kind in ("revolute", "continuous") else a[1] - b[1]
    return float(max(np.abs(apart).max(), 0.0 if kind == "spherical" else np.abs(apart_axes).max()))


def residual(text: str, sidecar: dict, motion: ms.Motion) -> float:
    """Return the largest violation of a joint or closure of the files by a motion."""
    root = ElementTree.fromstring(text)
    joints = {joint.find("child").get("link"): joint for joint in root.findall("joint")}
    changed = dict(zip(sidecar.get("joint_name", ()), sidecar.get("joint_type", ()), strict=True))
    count = len(motion.angle)

    def kind(joint) -> str:
        return changed.get(joint.get("name"), joint.get("type")).lower()

    def pose(link: str) -> Pose:
        if link in motion.links:
            return motion.links[link].position, motion.links[link].rotation
        if link not in joints:
            return np.zeros((count, 3)), np.broadcast_to(np.eye(3), (count, 3, 3))
        return after(pose(joints[link].find("parent").get("link")), frame(joints[link].find("origin")))

    worst = 0.0
    for link, joint in joints.items():
        written = joint.find("axis")
        axis = np.array(("1 0 0" if written is None else written.get("xyz")).split(), float)
        base = after(pose(joint.find("parent").get("link")), frame(joint.find("origin")))
        worst = max(worst, misfit(base, pose(link), kind(joint), axis))
    placed = {joint.get("name"): link for link, joint in joints.items()}
    for (a, b), what in zip(sidecar["closed_loop"], sidecar["type"], strict=True):
        ends = [pose(placed.get(name, name)) for name in (a, b)]
        worst = max(worst, misfit(*ends, "spherical" if what.lower() == "3d" else "fixed", np.zeros(3)))
    return worst


def motors_of(text: str, sidecar: dict) -> list[str]:
    """Return the motors, without joints that follow another one."""
    joints = ElementTree.fromstring(text).findall("joint")
    following = {joint.get("name") for joint in joints if joint.find("mimic") is not None}
    return [name for name in sidecar["name_mot"] if name not in following]


def motion_of(urdf: Path, sidecar: Path, motors: list[str]) -> ms.Motion:
    """Return the motion of all motors, within their ranges, about the assembly where mechsim starts."""
    model = ms.load(urdf, loops=sidecar)
    _, start = start_poses(model.mechanism)
    laws = {}
    for name in motors:
        lower, upper = model.ranges.get(name, (-np.inf, np.inf))
        middle = min(max(start[name], lower + SWING), upper - SWING)
        laws[name] = f"{middle!r}+{SWING}*sin(2*pi*t)"
    driven = ms.load(urdf, loops=sidecar, drive=laws, duration=1.0, lock_others=True)
    return driven.solve(t=np.linspace(0.0, 1.0, INSTANTS))


def cases(clone: Clone | None) -> Iterator[Case]:
    if clone is None:
        return
    paths = clone.paths("robots")
    for path in sorted(path for path in paths if path.endswith(".urdf")):
        folder = path.rpartition("/")[0]
        name = folder.removeprefix("robots/")
        sidecar = f"{folder}/robot.yaml"
        if sidecar not in paths:
            yield Case(name, rejected="it has no sidecar file, so no loops")
            continue
        wrong, letters = REPAIRS.get(name, ("", ""))
        texts = clone.read(path).replace(wrong, letters), clone.read(sidecar)
        with tempfile.TemporaryDirectory() as scratch:
            files = Path(scratch, "robot.urdf"), Path(scratch, "robot.yaml")
            for file, text in zip(files, texts, strict=True):
                file.write_text(text)
            description = yaml.safe_load(texts[1])
            try:
                moved = motion_of(*files, motors_of(texts[0], description))
            except ms.MechsimError as error:
                text = cut(str(error).replace(f"{files[0]}: ", ""), MAX_REASON)
                yield Case(name, rejected=CAUSES.get(name, text))
                continue
        row = Row("joints and closures", residual(texts[0], description, moved), TOLERANCE, "", REASON)
        yield Case(name, (row,), note=f"a name of its URDF repaired by {letters!r}" if letters else "")


SUITE = Suite(
    "Gepetto: parallel robots",
    "Gepetto/example-parallel-robots",
    "All motors swing by 0.02 rad or m about an assembly; the files alone give the residual. Licence BSD-3.",
    cases,
)
