"""USD files: rigid bodies, masses and joints of one scene; a joint that closes a loop is one of them.

A coordinate is zero where the joint frames of both sides coincide. Drives are read as springs and dampers.
Numbers are in single precision, besides those that mechsim writes next to them (`usd_writer`).

Source: OpenUSD, "Rigid body physics", openusd.org.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from mechsim.errors import InputError, needs
from mechsim.files import require_file
from mechsim.io.plain_joints import FileContents
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.actuators import Actuator
from mechsim.mechanism.forces import JointSpring
from mechsim.mechanism.joint_friction import Friction
from mechsim.mechanism.joint_kinds import KINDS, KindName, coordinates
from mechsim.mechanism.joints import End, Joint
from mechsim.mechanism.links import GROUND, IDENTITY, Inertia, Link, Pose, vector
from mechsim.numerics.arrays import Array

# prefixes of the attributes of UsdPhysics and of mechsim, and the schema of joints that follow others
PHYSICS, DOUBLE, MIMIC = "physics:", "mechsim:", "NewtonMimicAPI"
# type of a joint in USD -> kind; a PhysicsJoint is free where no limit locks it
KIND_OF: dict[str, KindName] = {
    "PhysicsRevoluteJoint": "revolute",
    "PhysicsPrismaticJoint": "prismatic",
    "PhysicsSphericalJoint": "spherical",
    "PhysicsFixedJoint": "fixed",
}
AXES = "XYZ"
# kinds that a PhysicsJoint can be, and these by the numbers of its free slides and turns
FREE_KINDS: tuple[KindName, ...] = (
    *("fixed", "revolute", "prismatic", "cylindrical", "universal", "spherical", "planar", "cartesian"),
    "floating",
)
KIND_OF_FREE: dict[tuple[int, int], KindName] = {
    (len(KINDS[kind].slides), len(KINDS[kind].turns)): kind for kind in FREE_KINDS
}
# what files hold rounded to single precision: sines and cosines of 0, 30, 45, 60 and 90 degrees
ROUNDED = np.array([0.0, 0.5, np.sqrt(0.5), np.sqrt(0.75), 1.0])
ROUNDING = float(np.finfo(np.float32).eps)
# standard gravity, which a scene without a magnitude has, in [m/s2]
GRAVITY = 9.81
# types and schemas that are read, and the first words of those of mechanics
TYPES = {*KIND_OF, *(f"Physics{name}" for name in ("Joint", "DistanceJoint", "Scene", "CollisionGroup"))}
SCHEMAS = {
    MIMIC,
    *(f"Physics{name}API" for name in ("RigidBody", "Mass", "ArticulationRoot", "Drive", "Limit")),
}
ENGINES = ("Physics", "Physx", "Newton", "Mjc")
# attributes that are not read
UNREAD = "velocity angularVelocity breakForce breakTorque coneAngle0Limit coneAngle1Limit"
# largest file in bytes
MAX_BYTES = 200_000_000


def read_usd(path: str) -> KinematicSolver:
    """Return the mechanism of a file, text or binary, its forces and limits, and what is not read."""
    require_file(path, "a USD file", MAX_BYTES)
    with needs("usd"):
        from pxr import Tf, Usd
    try:
        stage = Usd.Stage.Open(path)
        return _contents(stage).solver(_unread(stage))
    except Tf.ErrorException as error:
        lines = [line.rpartition(" : ")[2].strip(" '") for line in str(error).splitlines() if " : " in line]
        raise InputError(f"{path} is no USD file ({lines[0]}); correct it") from None


@dataclass
class SceneReader:
    """A scene as it is read, in [m] and [kg].

    Attributes:
        contents: what was read.
        transforms: of all prims, in the units of the scene.
        metre: its unit of length in [m].
        kilogram: its unit of mass in [kg].
        links: path of a body -> link.
    """

    contents: FileContents
    transforms: Any
    metre: float
    kilogram: float
    links: dict[Any, str]

    def pose(self, prim: Any) -> Pose:
        """Return the pose of a prim in the world, its scale left out."""
        matrix = self.transforms.GetLocalToWorldTransform(prim)
        rotation = np.array(matrix.RemoveScaleShear().ExtractRotationMatrix(), float).T
        return Pose(np.array(matrix.ExtractTranslation(), float) * self.metre, rotation)

    def link(self, prim: Any) -> str:
        """Return the link to which a prim belongs; the ground outside of all bodies."""
        while prim and prim.GetPath() not in self.links:
            prim = prim.GetParent()
        return self.links[prim.GetPath()] if prim else GROUND

    def pose_of(self, link: str) -> Pose:
        """Return the pose of a link."""
        return self.contents.poses.get(link, IDENTITY)


def _contents(stage: Any) -> FileContents:
    """Return what a stage contains."""
    from pxr import Usd, UsdGeom, UsdPhysics

    metre, kilogram = UsdGeom.GetStageMetersPerUnit(stage), UsdPhysics.GetStageKilogramsPerUnit(stage)
    prims = list(stage.Traverse(Usd.TraverseInstanceProxies()))
    root = stage.GetDefaultPrim()
    name = _name(root) if root else Path(stage.GetRootLayer().identifier).stem
    contents = FileContents(name, _gravity(stage, prims, metre))
    contents.drivers = tuple(root.GetAttribute(f"{DOUBLE}drivers").Get() or ()) if root else ()
    scene = SceneReader(contents, UsdGeom.XformCache(), metre, kilogram, {})
    for body in (prim for prim in prims if _is_body(prim)):
        link = scene.links[body.GetPath()] = _unused(_name(body), body.GetPath(), contents.poses)
        start = contents.poses[link] = scene.pose(body)
        contents.links.append(Link(link, inertia=_inertia(scene, body)))
        if body.GetAttribute(f"{PHYSICS}kinematicEnabled").Get():
            z, x = (vector(start.rotation[:, column]) for column in (2, 0))
            side = End(GROUND, vector(start.position), z, x)
            contents.joints.append(Joint(f"{link} kinematic", "fixed", side, End(link)))
    joints = [prim for prim in prims if prim.IsA(UsdPhysics.Joint) and _enabled(prim)]
    names: dict[Any, str] = {}
    for prim in joints:
        names[prim.GetPath()] = _unused(_name(prim), prim.GetPath(), names.values())
        _add_joint(scene, prim, names[prim.GetPath()])
    for prim in joints:
        _add_mimic(contents, prim, names, metre)
    for prim in prims:
        if prim.GetAttribute(f"{DOUBLE}point").Get():
            link = scene.link(prim)
            contents.points[_name(prim)] = link, vector(scene.pose_of(link).local(scene.pose(prim).position))
    return contents


def _is_body(prim: Any) -> bool:
    """Return whether a prim is a rigid body that the scene moves."""
    enabled = prim.GetAttribute(f"{PHYSICS}rigidBodyEnabled")
    return "PhysicsRigidBodyAPI" in prim.GetAppliedSchemas() and enabled.Get() is not False


def _enabled(prim: Any) -> bool:
    return prim.GetAttribute(f"{PHYSICS}jointEnabled").Get() is not False


def _name(prim: Any) -> str:
    """Return the name of a prim, that of its link, joint or point if mechsim wrote it."""
    return prim.GetAttribute(f"{DOUBLE}name").Get() or prim.GetName()


def _unused(name: str, path: Any, names: Iterable[str]) -> str:
    """Return the name of a prim, or its path where another has the name."""
    return str(path) if name in names else name


def _numbers(prim: Any, name: str, count: int = 1) -> Array:
    """Return the numbers of an attribute in the precision of the file, (count,); nan without a value.

    What mechsim wrote in double precision counts as long as it agrees with the attribute.

    Args:
        prim: with the attribute.
        name: of the attribute; those of UsdPhysics without their prefix.
        count: 1, 3, or 4 for a quaternion in the order x, y, z, w.
    """
    value = prim.GetAttribute(name if ":" in name else PHYSICS + name).Get()
    if value is None:
        return np.full(count, np.nan)
    single = np.array([*value.GetImaginary(), value.GetReal()] if count == 4 else value, float).reshape(count)
    double = np.array(prim.GetAttribute(DOUBLE + name).Get() or single, float)
    if double.shape == single.shape and np.allclose(double, single, rtol=ROUNDING, atol=1e-30):
        return double
    return single


def _number(prim: Any, name: str, default: float) -> float:
    """Return the number of an attribute; `default` without a finite value."""
    (number,) = _numbers(prim, name)
    return float(number) if np.isfinite(number) else default


def _rotation(prim: Any, name: str) -> Array:
    """Return the matrix of a quaternion, (3, 3); rounded sines and cosines of simple angles are exact."""
    numbers = _numbers(prim, name, 4)
    if not np.linalg.norm(numbers) > 0.5:
        return np.eye(3)
    nearest = ROUNDED[np.abs(np.abs(numbers)[:, None] - ROUNDED).argmin(1)]
    if np.abs(np.abs(numbers) - nearest).max() <= ROUNDING:
        numbers = np.copysign(nearest, numbers)
    return Rotation.from_quat(numbers).as_matrix()


def _gravity(stage: Any, prims: Iterable[Any], metre: float) -> Array:
    """Return the gravity of the scene, (3,) in [m/s2]; none without a scene."""
    from pxr import UsdGeom

    for scene in (prim for prim in prims if prim.GetTypeName() == "PhysicsScene"):
        direction = _numbers(scene, "gravityDirection", 3)
        if not np.linalg.norm(direction) > 0.0:
            direction = -np.eye(3)[AXES.index(UsdGeom.GetStageUpAxis(stage))]
        magnitude = _number(scene, "gravityMagnitude", GRAVITY / metre)
        return direction / np.linalg.norm(direction) * magnitude * metre
    return np.zeros(3)


def _inertia(scene: SceneReader, body: Any) -> Inertia | None:
    """Return the inertia of a body; None without a mass. Only its centre is scaled, as by pxr."""
    from pxr import Gf

    mass = _number(body, "mass", 0.0) * scene.kilogram
    if not mass > 0.0:
        return None
    scale = np.array(Gf.Transform(scene.transforms.GetLocalToWorldTransform(body)).GetScale())
    centre = np.nan_to_num(_numbers(body, "centerOfMass", 3), neginf=0.0) * scale * scene.metre
    axes = _rotation(body, "principalAxes")
    moments = axes @ np.diag(np.nan_to_num(_numbers(body, "diagonalInertia", 3))) @ axes.T
    tensor: Any = (moments + moments.T) / 2.0 * scene.kilogram * scene.metre**2
    return Inertia(mass, vector(centre), tensor)


def _add_joint(scene: SceneReader, prim: Any, name: str) -> None:
    """Add a joint, and what limits and drives it."""
    kind, axes, length = _kind(prim, name)
    columns = np.roll(np.arange(3), -axes[0] - 1)  # the axis of the joint becomes z
    sides = [_side(scene, prim, side) for side in ("0", "1")]
    (_, start_a, frame_a), (_, start_b, frame_b) = sides
    frames = [frame_a[:, columns], frame_b[:, columns]]
    if KINDS[kind].crossed:
        # side a: z, and x toward the axis of side b; side b: the reverse
        frames = [_from_z_and_x(frame_a, *axes), _from_z_and_x(frame_b, *axes[::-1])]
    ends: list[End] = []
    for (link, start, _), frame in zip(sides, frames, strict=True):
        pose = scene.pose_of(link)
        z, x = (vector(pose.rotation.T @ frame[:, column]) for column in (2, 0))
        ends.append(End(link, vector(pose.local(start)), z, x))
    scene.contents.joints.append(Joint(name, kind, ends[0], ends[1], length=length * scene.metre))
    if KINDS[kind].single:
        (value,) = coordinates(KINDS[kind], start_b - start_a, frames[0], frames[1], 0.0)
        _add_axis_data(scene, prim, name, float(value), axes[0])


def _add_axis_data(scene: SceneReader, prim: Any, name: str, value: float, axis: int) -> None:
    """Add the coordinate of a joint with one axis at the poses of the file, its limits, spring and damper."""
    contents, hinge = scene.contents, name in scene.contents.hinges
    stated = prim.GetAttribute(f"{DOUBLE}position").Get()
    if hinge and stated is not None:  # revolutions, which poses do not show
        value += 2.0 * np.pi * round((stated - value) / (2.0 * np.pi))
    contents.positions[name] = value
    own, which = prim.GetTypeName() in KIND_OF, _instance(prim, hinge, axis)
    unit = np.deg2rad(1.0) if hinge else scene.metre
    limits = (
        ("lowerLimit", "upperLimit") if own else (f"limit:{which}:physics:{end}" for end in ("low", "high"))
    )
    low, high = (_numbers(prim, end)[0] * unit for end in limits)
    contents.ranges[name] = float(low), float(high)
    prefix = f"drive:{which}:{PHYSICS}"
    # forces in the unit of the file: torques from [kg m2/s2], forces from [kg m/s2]
    force = scene.kilogram * scene.metre ** (2 if hinge else 1)
    most = _number(prim, f"{prefix}maxForce", np.inf) * force
    acts = most > 0.0 and prim.GetAttribute(f"{prefix}type").Get() != "acceleration"
    factor = force * acts / unit
    stiffness, damping = (_number(prim, prefix + term, 0.0) * factor for term in ("stiffness", "damping"))
    rest, rate = (_number(prim, f"{prefix}target{what}", 0.0) * unit for what in ("Position", "Velocity"))
    limited = (stiffness or damping) and (rate * damping or most < np.inf)
    if limited:
        bias = (stiffness * rest + damping * rate, -stiffness, -damping)
        motor = Actuator(f"{name} drive", {name: 1.0}, bias=bias, force_range=(-most, most))
        contents.actuators.append(motor)
    if stiffness and not limited:
        contents.springs.append(JointSpring(name, stiffness, rest))
    if damping and not limited:
        contents.friction.append(Friction(name, damping))


def _instance(prim: Any, hinge: bool, axis: int) -> str:
    """Return the name of the drive and the limit of a joint with one axis."""
    if prim.GetTypeName() in KIND_OF:
        return "angular" if hinge else "linear"
    return f"{'rot' if hinge else 'trans'}{AXES[axis]}"


def _kind(prim: Any, name: str) -> tuple[KindName, tuple[int, ...], float]:
    """Return the kind of a joint, its axes as columns of the joint frame, and the length of a rod.

    Raises:
        InputError: for a joint that mechsim does not have.
    """
    type = prim.GetTypeName()
    if type in KIND_OF:
        axis = prim.GetAttribute(f"{PHYSICS}axis").Get() or "Z"
        return KIND_OF[type], (AXES.index(axis),), 0.0
    if type == "PhysicsDistanceJoint":
        shortest, longest = _number(prim, "minDistance", -1.0), _number(prim, "maxDistance", -1.0)
        if shortest == longest > 0.0:
            return "distance", (2,), shortest
        raise InputError(f"joint {name} keeps a distance between limits; only a rod of one length is read")
    slides, turns = (
        [i for i, axis in enumerate(AXES) if not _locked(prim, f"{word}{axis}")] for word in ("trans", "rot")
    )
    kind = KIND_OF_FREE.get((len(slides), len(turns)))
    axes = turns if 0 < len(turns) < 3 else [2] if len(slides) == 3 or not slides else slides
    # a cylindrical joint turns about its slide, a planar one about what is normal to both
    normal = {(1, 1): slides == turns, (2, 1): turns and turns[0] not in slides}
    if type != "PhysicsJoint" or kind is None or not normal.get((len(slides), len(turns)), True):
        free = ", ".join([*(f"trans{AXES[i]}" for i in slides), *(f"rot{AXES[i]}" for i in turns)])
        raise InputError(
            f"joint {name} is of type {type} with {free or 'nothing'} free, which is not read; types that "
            f"are read are {', '.join(KIND_OF)}, PhysicsDistanceJoint of one length, and PhysicsJoint "
            f"that is {' or '.join(KIND_OF_FREE.values())}"
        )
    return kind, tuple(axes), 0.0


def _locked(prim: Any, coordinate: str) -> bool:
    """Return whether limits lock a coordinate of a PhysicsJoint: the lower is not below the upper."""
    low, high = (_numbers(prim, f"limit:{coordinate}:physics:{end}")[0] for end in ("low", "high"))
    return bool(low >= high)


def _side(scene: SceneReader, prim: Any, side: str) -> tuple[str, Array, Array]:
    """Return the link of a side, and the position and the joint frame of the side in the world."""
    from pxr import Gf

    local, frame = _numbers(prim, f"localPos{side}", 3), _rotation(prim, f"localRot{side}")
    targets = prim.GetRelationship(f"{PHYSICS}body{side}").GetTargets()
    target = prim.GetStage().GetPrimAtPath(targets[0]) if targets else None
    if targets and not target:
        raise InputError(
            f"joint {_name(prim)} connects {targets[0]}, which does not exist; correct its bodies"
        )
    if target is None:
        return GROUND, local * scene.metre, frame
    position = scene.transforms.GetLocalToWorldTransform(target).Transform(Gf.Vec3d(*local))
    return scene.link(target), np.array(position) * scene.metre, scene.pose(target).rotation @ frame


def _from_z_and_x(frame: Array, z: int, x: int) -> Array:
    """Return a joint frame whose z and x are two columns of another, (3, 3)."""
    return np.column_stack([frame[:, x], np.cross(frame[:, z], frame[:, x]), frame[:, z]])


def _add_mimic(contents: FileContents, prim: Any, names: Mapping[Any, str], metre: float) -> None:
    """Add the coupling of a joint that follows another: q = c0 + c1 q', with c0 in degrees for a hinge."""
    enabled = prim.GetAttribute("newton:mimicEnabled").Get() is not False
    if not enabled or MIMIC not in prim.GetPrimTypeInfo().GetAppliedAPISchemas():
        return
    name, targets = names[prim.GetPath()], prim.GetRelationship("newton:mimicJoint").GetTargets()
    if not targets:
        raise InputError(
            f"joint {name} has {MIMIC} without newton:mimicJoint; name the joint that it follows"
        )
    unit = np.deg2rad(1.0) if name in contents.hinges else metre
    offset = _number(prim, "newton:mimicCoef0", 0.0) * unit
    leader, ratio = names.get(targets[0], str(targets[0])), _number(prim, "newton:mimicCoef1", 1.0)
    # lengths of the file a radian
    lengths = (name not in contents.hinges) - (leader not in contents.hinges)
    contents.follow(name, leader, ratio * metre**lengths, (offset, 0.0))


def _unread(stage: Any) -> Iterator[str]:
    """Yield types, schemas and attributes, joints without effect, and masses that are not read."""
    from pxr import Usd, UsdPhysics

    for prim in stage.Traverse(Usd.TraverseInstanceProxies()):
        applied = {*prim.GetPrimTypeInfo().GetAppliedAPISchemas()}
        yield from {schema for schema in applied if schema.partition(":")[0] not in SCHEMAS}
        if prim.GetTypeName().startswith(ENGINES) and prim.GetTypeName() not in TYPES:
            yield prim.GetTypeName()
        if prim.IsA(UsdPhysics.Joint):
            yield from _unread_in_joint(prim, applied) if _enabled(prim) else ["joints that are not enabled"]
        for name in (PHYSICS + name for name in UNREAD.split() if prim.HasAttribute(PHYSICS + name)):
            if prim.GetAttribute(name).Get() != prim.GetPrimDefinition().GetAttributeFallbackValue(name):
                yield name
        if not _is_body(prim):
            continue
        if not _number(prim, "mass", 0.0) > 0.0:
            yield "masses by density"
        elif not np.isfinite(_numbers(prim, "centerOfMass", 3)).all():
            yield "centres of mass by shapes"
        elif not _numbers(prim, "diagonalInertia", 3).any():
            yield "moments of inertia by shapes"


def _unread_in_joint(prim: Any, applied: Iterable[str]) -> Iterator[str]:
    """Yield drives and limits of coordinates other than that of a joint with one axis."""
    kind, axes, _ = _kind(prim, _name(prim))
    read = _instance(prim, KINDS[kind].hinge, axes[0]) if KINDS[kind].single else ""
    for schema, _, instance in (schema.partition(":") for schema in applied):
        if instance and instance != read and not _locked(prim, instance):
            yield f"{schema}:{instance}"
        if prim.GetAttribute(f"drive:{instance}:physics:type").Get() == "acceleration":
            yield "drives of type acceleration"
