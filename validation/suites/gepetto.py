"""Gepetto's parallel robots: URDF with closures in a sidecar file, moved about the assembly that is found.

The residual is computed from the files alone: each joint and each closure relates the poses of two links, and
the poses are those of the motion. A revolute joint keeps the origin and the axis, a fixed one the whole
frame, UJOINT_XY the origin and a right angle between x of one frame and y of the other, a closure of type 3d
the origin, of type 6d the frame.
"""

import tempfile
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import yaml
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import mechsim as ms
from mechsim.kinematics.loops.start import start_poses
from validation.published.table import Row
from validation.suites.case import Case, Clone, Suite, printed_rows, rejected
from validation.suites.released import entries

# of the motors about the assembly, in [rad] or [m]
SWING, INSTANTS = 0.02, 9
TOLERANCE = 1e-11
REASON = "in m and rad: loops close to 1e-12 of a link, and a chain of 50 links adds its rounding"
# separate least squares: random starts; length in [m] that multiplies differences of directions
STARTS, ARM = 4, 0.1
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


class Robot:
    """The joints and closures of the files, by which a robot is placed without mechsim.

    Attributes:
        joints: link -> joint above it; frames: its frame on the link above.
        closures: name of the first end -> links of the two ends, and the kind of the closure.
    """

    def __init__(self, text: str, sidecar: dict) -> None:
        self.joints = {j.find("child").get("link"): j for j in ElementTree.fromstring(text).findall("joint")}
        self.frames = {link: frame(joint.find("origin")) for link, joint in self.joints.items()}
        placed = {joint.get("name"): link for link, joint in self.joints.items()}
        self.closures = {
            a: (placed.get(a, a), placed.get(b, b), "spherical" if kind.lower() == "3d" else "fixed")
            for (a, b), kind in zip(sidecar["closed_loop"], sidecar["type"], strict=True)
        }

    def pose(self, link: str, values: Mapping[str, float]) -> Pose:
        """Return the pose of a link by the coordinates of the joints above it."""
        if link not in self.joints:
            return np.zeros(3), np.eye(3)
        joint = self.joints[link]
        base = after(self.pose(joint.find("parent").get("link"), values), self.frames[link])
        along = values.get(joint.get("name"), 0.0) * axis_of(joint)
        slides = joint.get("type") == "prismatic"
        return after(
            base, (along, np.eye(3)) if slides else (0.0 * along, Rotation.from_rotvec(along).as_matrix())
        )

    def least_gap(self, ends: Collection[str]) -> float:
        """Return what least squares over the joints leave of the closures with these first ends, in [m]."""
        waiting, names = [link for end in ends for link in self.closures[end][:2]], set()
        while waiting:
            if (joint := self.joints.get(waiting.pop())) is not None:
                waiting.append(joint.find("parent").get("link"))
                names |= {joint.get("name")} if joint.get("type") != "fixed" else set()
        names = sorted(names)

        def gaps(values: np.ndarray) -> np.ndarray:
            coordinates, rows = dict(zip(names, values, strict=True)), []
            for *pair, kind in map(self.closures.get, ends):
                (p, r), (s, t) = (self.pose(link, coordinates) for link in pair)
                rows += [s - p, ARM * (t - r).ravel() * (kind == "fixed")]
            return np.concatenate(rows)

        starts = np.random.default_rng(0).normal(0.0, 1.0, (STARTS, len(names)))
        return min(float(np.linalg.norm(least_squares(gaps, start).fun)) for start in starts)


def axis_of(joint) -> np.ndarray:
    written = joint.find("axis")
    return np.array(("1 0 0" if written is None else written.get("xyz")).split(), float)


def residual(text: str, sidecar: dict, motion: ms.Motion) -> float:
    """Return the largest violation of a joint or closure of the files by a motion."""
    robot = Robot(text, sidecar)
    changed = dict(zip(sidecar.get("joint_name", ()), sidecar.get("joint_type", ()), strict=True))
    count = len(motion.angle)

    def pose(link: str) -> Pose:
        if link in motion.links:
            return motion.links[link].position, motion.links[link].rotation
        if link not in robot.joints:
            return np.zeros((count, 3)), np.broadcast_to(np.eye(3), (count, 3, 3))
        joint = robot.joints[link]
        return after(pose(joint.find("parent").get("link")), robot.frames[link])

    worst = 0.0
    for link, joint in robot.joints.items():
        kind = changed.get(joint.get("name"), joint.get("type")).lower()
        base = after(pose(joint.find("parent").get("link")), robot.frames[link])
        worst = max(worst, misfit(base, pose(link), kind, axis_of(joint)))
    return max(
        [worst, *(misfit(pose(a), pose(b), kind, np.zeros(3)) for a, b, kind in robot.closures.values())]
    )


def motors_of(text: str, sidecar: dict) -> list[str]:
    """Return the motors, without joints that follow another one."""
    joints = ElementTree.fromstring(text).findall("joint")
    following = {joint.get("name") for joint in joints if joint.find("mimic") is not None}
    return [name for name in sidecar["name_mot"] if name not in following]


def motion_of(urdf: Path, sidecar: Path, motors: list[str], start: Mapping[str, float]) -> ms.Motion:
    """Return the motion of all motors, within their ranges, about a start, or about the one of mechsim."""
    model = ms.load(urdf, loops=sidecar)
    around, laws = start or start_poses(model.mechanism)[1], {}
    for name in motors:
        lower, upper = model.ranges.get(name, (-np.inf, np.inf))
        middle = min(max(around[name], lower + SWING), upper - SWING)
        laws[name] = f"{middle!r}+{SWING}*sin(2*pi*t)"
    driven = ms.load(urdf, loops=sidecar, drive=laws, duration=1.0, lock_others=True, start=dict(start))
    return driven.solve(t=np.linspace(0.0, 1.0, INSTANTS))


def compared(name: str, urdf: str, sidecar: str) -> Case:
    """Return the case of the texts of a robot's files."""
    entry, description = entries("gepetto").get(name, {}), yaml.safe_load(sidecar)
    urdf = urdf.replace(*entry.get("repair", ("", "")))
    with tempfile.TemporaryDirectory() as scratch:
        files = Path(scratch, "robot.urdf"), Path(scratch, "robot.yaml")
        for file, text in zip(files, (urdf, sidecar), strict=True):
            file.write_text(text)
        try:
            motion = motion_of(*files, motors_of(urdf, description), entry.get("start", {}))
        except ms.MechsimError as error:
            gap = Robot(urdf, description).least_gap(entry["closures"]) if "closures" in entry else 0.0
            text = f"least squares leave={entry['gap']}" if gap else ""
            return rejected(name, error, entry, tuple(printed_rows(text, lambda _: gap)))
    row = Row("joints and closures", residual(urdf, description, motion), TOLERANCE, "", REASON)
    return Case(name, (row,), note=entry.get("note", ""))


def cases(clone: Clone | None) -> Iterator[Case]:
    paths = clone.paths("robots") if clone else []
    for path in sorted(path for path in paths if path.endswith(".urdf")):
        folder = path.rpartition("/")[0]
        name, sidecar = folder.removeprefix("robots/"), f"{folder}/robot.yaml"
        if sidecar in paths:
            yield compared(name, clone.read(path), clone.read(sidecar))
        else:
            yield Case(name, rejected="it has no sidecar file, so no loops")


SUITE = Suite(
    "Gepetto: parallel robots",
    "Gepetto/example-parallel-robots",
    "All motors swing by 0.02 rad or m about an assembly; the files alone give the residual. Licence BSD-3.",
    cases,
)
