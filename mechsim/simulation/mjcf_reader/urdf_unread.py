"""Elements of a URDF file that neither MuJoCo nor a dialect of loops reads, as findings with their lines."""

import re
from collections.abc import Iterator

from mechsim.mechanism.finding import HARMLESS, Finding
from mechsim.simulation.mjcf_reader.coordinates import did_you_mean
from mechsim.simulation.mjcf_reader.urdf_tree import Element, UrdfTree

# element -> elements in it that are read
READ = {
    "robot": "link joint material mujoco frame gazebo loop coupling loop_joint drake_ball_constraint "
    "drake_linear_bushing_rpy",
    "link": "inertial visual collision",
    "joint": "origin parent child axis limit dynamics mimic",
    "loop": "predecessor successor axis",
    "coupling": "predecessor successor ratio",
    "loop_joint": "link1 link2 axis",
    "gazebo": "joint",
}
# elements for controllers, sensors and pictures, which describe no motion
WITHOUT_MOTION = (
    "transmission ros2_control plugin sensor material contact self_collision_checking calibration "
    "safety_controller drake_collision_filter_group drake_proximity_properties verbose"
)
# tags with text, in <gazebo> or of another program, that describe a motion; the others are settings
_MOTION = re.compile(
    r"loop|closure|constraint|coupling|mimic|spring|damping|^(?:joint|model|link) |"
    r"^gravity (?:0|false)|(?:static|turnGravityOff) (?:1|true)",
    re.IGNORECASE,
)
MOVABLE = ("revolute", "continuous", "prismatic")
REMEDY = "write it as an element that is read (docs/reference/mjcf.md), or take it out"


def unread_elements(tree: UrdfTree) -> Iterator[Finding]:
    """Yield findings on mimics without effect, and on elements that are not read."""
    yield from _mimics(tree)
    lines_of: dict[tuple[str, str, bool], list[int]] = {}
    for parent, child in _unread_in(tree.root):
        key = parent.tag, child.tag, _describes_motion(parent, child)
        lines_of.setdefault(key, []).append(tree.lines[child])
    for (parent, tag, motion), lines in lines_of.items():
        tag = tag.replace("drake_", "drake:")
        message = f"<{tag}> in <{parent}> is not read{_times(lines)}"
        yield _finding(tag, message, REMEDY if motion else HARMLESS, lines[0])
    yield from _loop_joints(tree)
    for key in ("effort", "velocity"):
        lines = [
            tree.lines[limit] for limit in tree.root.findall("joint/limit") if limit.get(key, "").strip(" 0.")
        ]
        if lines:
            message = f"{key} in <limit> is not compared with the motion{_times(lines)}"
            yield _finding(key, message, HARMLESS, lines[0])


def _times(lines: list[int]) -> str:
    return f" ({len(lines)} times)" if len(lines) > 1 else ""


def _loop_joints(tree: UrdfTree) -> Iterator[Finding]:
    """Yield findings on limits, damping and mimics of joints that close loops."""
    for joint in [*tree.second, *tree.root.findall("loop_joint"), *tree.root.findall("gazebo/joint")]:
        # of the elements of URDF, which has values in attributes, and of SDFormat, which has them in elements
        tags = [name for name in ("limit", "dynamics", "mimic") if _states_values(joint.find(name))]
        tags += [name for name in ("limit", "dynamics") if len(joint.findall(f"axis/{name}/*"))]
        name = joint.get("name", "")
        if joint in tree.second and joint.get("type") == "floating":
            message = f"floating joint {name!r} leads to a link that has a parent, and closes nothing"
            yield _finding(name, message, REMEDY, tree.lines[joint])
        elif tags:
            names = " and ".join(f"<{tag}>" for tag in tags)
            message = f"{names} of loop joint {name!r} {'is' if len(tags) == 1 else 'are'} not read"
            yield _finding(name, message, "give a joint next to the closure what it needs", tree.lines[joint])


def _finding(name: str, message: str, remedy: str, line: int) -> Finding:
    return Finding(kind="unread", object=name, value=1.0, message=message, remedy=remedy, line=line)


def _mimics(tree: UrdfTree) -> Iterator[Finding]:
    """Yield findings on mimics of or at joints without a coordinate, which MuJoCo leaves out."""
    joints = [joint for joint in tree.root.findall("joint") if joint not in tree.second]
    movable = [joint.get("name", "") for joint in joints if joint.get("type") in MOVABLE]
    for joint in joints:
        mimic, name = joint.find("mimic"), joint.get("name", "")
        target = "" if mimic is None else mimic.get("joint", "")
        if mimic is not None and not {name, target} <= {*movable}:
            wrong = name if name not in movable else target
            yield _finding(
                name,
                f"the mimic of joint {name!r} has no effect: {wrong!r} is no revolute, continuous or "
                "prismatic joint",
                f"name one{did_you_mean(wrong, movable)}",
                tree.lines[mimic],
            )


def _unread_in(element: Element) -> Iterator[tuple[Element, Element]]:
    """Yield the unread elements with the elements that contain them."""
    for child in element:
        if child.tag not in READ[element.tag].split():
            yield element, child
        # a joint of Gazebo has the elements of SDFormat
        elif child.tag in READ and element.tag != "gazebo":
            yield from _unread_in(child)


def _describes_motion(parent: Element, child: Element) -> bool:
    if child.tag in WITHOUT_MOTION.split():  # a transmission of Drake has the inertia of a rotor
        return any(element.tag.endswith("inertia") for element in child.iter())
    foreign = parent.tag == "gazebo" or ":" in child.tag
    texts = (f"{each.tag.split(':')[-1]} {(each.text or '').strip()}" for each in child.iter())
    return not foreign or any(map(_MOTION.search, texts))


def _states_values(element: Element | None) -> bool:
    """Return whether an element states a value; a revolute joint needs a limit without one."""
    return element is not None and any(
        element.get(key) for key in ("lower", "upper", "damping", "friction", "joint")
    )
