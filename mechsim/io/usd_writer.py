"""Mechanisms as USD text: rigid bodies at their poses at the start, and all joints, those of loops too.

USD stores masses, joint frames and limits in single precision. A second attribute in double precision, whose
name begins with `mechsim:`, stands next to each of them; other programs ignore it.

Source: OpenUSD, "Rigid body physics", openusd.org; `NewtonMimicAPI` of the schemas of Newton for joints that
follow others.
"""

from typing import Any

import networkx as nx
import numpy as np
from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdPhysics
from scipy.spatial.transform import Rotation

from mechsim.errors import InputError
from mechsim.io.plain_joints import BETWEEN, leaders, left_out, split_joints, unique_name
from mechsim.io.usd_reader import DOUBLE, KIND_OF, MIMIC, PHYSICS
from mechsim.kinematics.loops.start import start_poses
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.forces import forces_of
from mechsim.mechanism.joint_kinds import KINDS
from mechsim.mechanism.joints import Joint
from mechsim.mechanism.links import GROUND, IDENTITY, Inertia, Pose
from mechsim.mechanism.masses import with_inertia

TYPE_OF = {kind: name for name, kind in KIND_OF.items()}
SIDES = ("0", "1")


def to_usd(solver: KinematicSolver) -> tuple[str, str]:
    """Return a mechanism as USD text in metres and kilograms, and a sentence on what is left out.

    Raises:
        InputError: for joints and couplings that USD does not have.
        AssemblyError: if the loops do not close.
    """
    mechanism = with_inertia(solver.mechanism)
    assembled, values = start_poses(mechanism)
    kinds = ("cylindrical", "universal")
    links, joints, poses = split_joints(mechanism, {GROUND: IDENTITY, **assembled}, kinds)
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdPhysics.SetStageKilogramsPerUnit(stage, 1.0)
    unique = {"physics": "physics"}
    root = _named(stage, "", "Xform", mechanism.name, unique)
    stage.SetDefaultPrim(root)
    UsdPhysics.ArticulationRootAPI.Apply(root)
    _set(root, "drivers", list(mechanism.drivers), Sdf.ValueTypeNames.StringArray)
    gravity = np.array(forces_of(solver).gravity)
    magnitude = float(np.linalg.norm(gravity))
    scene = UsdPhysics.Scene.Define(stage, root.GetPath().AppendChild("physics")).GetPrim()
    _add(scene, "gravityMagnitude", magnitude)
    _add(scene, "gravityDirection", *(gravity / magnitude if magnitude else (0.0, 0.0, -1.0)))
    paths, followed = {GROUND: str(root.GetPath())}, leaders(mechanism, "USD")
    for link in links:
        body = _named(stage, root.GetPath(), "Xform", link.name, unique)
        paths[link.name] = str(body.GetPath())
        UsdPhysics.RigidBodyAPI.Apply(body)
        _set_pose(body, poses[link.name])
        _add_inertia(body, link.inertia or BETWEEN)
    for name, (link, point) in mechanism.points.items():
        prim = _named(stage, paths[link], "Xform", name, unique)
        _set_pose(prim, Pose(np.array(point), np.eye(3)))
        _set(prim, "point", True, Sdf.ValueTypeNames.Bool)
    tree = {*nx.minimum_spanning_edges(nx.Graph([joint.links for joint in joints]), data=False)}
    prims: dict[str, Any] = {}
    for joint in joints:
        prim = prims[joint.name] = _add_joint(stage, joint, paths, unique)
        ends = joint.links if joint.links in tree else joint.links[::-1]
        # of two joints between the same links, the first is in the tree
        if ends not in tree:
            UsdPhysics.Joint(prim).CreateExcludeFromArticulationAttr(True)
        tree.discard(ends)
        if KINDS[joint.kind].single:
            _set(prim, "position", values[joint.name], Sdf.ValueTypeNames.Double)
            _add_axis_data(prim, joint, solver)
    for name, (leader, ratio) in followed.items():
        prims[name].AddAppliedSchema(MIMIC)
        prims[name].CreateRelationship("newton:mimicJoint").SetTargets([prims[leader].GetPath()])
        degrees = np.rad2deg(1.0) if prims[name].IsA(UsdPhysics.RevoluteJoint) else 1.0
        _add(prims[name], "newton:mimicCoef0", (values[name] - ratio * values[leader]) * degrees)
        _add(prims[name], "newton:mimicCoef1", ratio)
    return stage.GetRootLayer().ExportToString(), left_out(solver, "USD")


def _named(stage: Any, parent: Any, type: str, name: str, unique: dict[str, str]) -> Any:
    """Return a new prim, whose name is that of a link, joint or point as far as USD allows it."""
    own = unique_name(Tf.MakeValidIdentifier(name), type, unique)
    prim = stage.DefinePrim(f"{parent}/{own}", type)
    _set(prim, "name", name, Sdf.ValueTypeNames.String)
    return prim


def _set(prim: Any, name: str, value: object, type: Any) -> None:
    """Add an attribute of mechsim."""
    prim.CreateAttribute(DOUBLE + name, type).Set(value)


def _add(prim: Any, name: str, *values: float) -> None:
    """Add numbers in single precision, and next to them in double precision."""
    numbers = [float(value) for value in values]
    single = numbers[0] if len(numbers) == 1 else tuple(numbers)
    if len(numbers) == 4:  # x, y, z, w
        single = Gf.Quatf(numbers[3], *numbers[:3])
    own = name if ":" in name else PHYSICS + name
    # attributes of the schemas of Newton are unknown to USD
    attribute = prim.GetAttribute(own) or prim.CreateAttribute(own, Sdf.ValueTypeNames.Float, custom=False)
    attribute.Set(single)
    _set(prim, name, numbers, Sdf.ValueTypeNames.DoubleArray)


def _set_pose(prim: Any, pose: Pose) -> None:
    """Give a prim a pose relative to its parent."""
    xform = UsdGeom.Xformable(prim)
    xform.AddTranslateOp(UsdGeom.XformOp.PrecisionDouble).Set(Gf.Vec3d(*pose.position))
    x, y, z, w = Rotation.from_matrix(pose.rotation).as_quat()
    xform.AddOrientOp(UsdGeom.XformOp.PrecisionDouble).Set(Gf.Quatd(w, x, y, z))


def _add_inertia(body: Any, inertia: Inertia) -> None:
    """Add mass, centre, and principal moments with their axes."""
    moments, axes = np.linalg.eigh(np.array(inertia.moments))
    axes[:, 2] *= np.linalg.det(axes)
    UsdPhysics.MassAPI.Apply(body)
    _add(body, "mass", inertia.mass)
    _add(body, "centerOfMass", *inertia.centre)
    _add(body, "diagonalInertia", *moments)
    _add(body, "principalAxes", *Rotation.from_matrix(axes).as_quat())


def _add_joint(stage: Any, joint: Joint, paths: dict[str, str], unique: dict[str, str]) -> Any:
    """Add a joint with the joint frames of both sides, whose z is its axis."""
    if joint.kind not in TYPE_OF:
        raise InputError(f"joint {joint.name} is {joint.kind}, which USD does not have; export it to TOML")
    prim = _named(stage, paths[GROUND], TYPE_OF[joint.kind], joint.name, unique)
    for side, end in zip(SIDES, (joint.a, joint.b), strict=True):
        prim.CreateRelationship(f"{PHYSICS}body{side}", custom=False).SetTargets([Sdf.Path(paths[end.link])])
        _add(prim, f"localPos{side}", *end.point)
        _add(prim, f"localRot{side}", *Rotation.from_matrix(end.frame).as_quat())
    if KINDS[joint.kind].single:
        prim.CreateAttribute(f"{PHYSICS}axis", Sdf.ValueTypeNames.Token, custom=False).Set("Z")
    return prim


def _add_axis_data(prim: Any, joint: Joint, solver: KinematicSolver) -> None:
    """Add limits, and spring and damper as a drive; USD measures the angles in degrees."""
    forces, hinge = forces_of(solver), KINDS[joint.kind].hinge
    degrees = np.rad2deg(1.0) if hinge else 1.0
    for name, limit in zip(("lowerLimit", "upperLimit"), solver.ranges.get(joint.name, ()), strict=False):
        _add(prim, name, limit * degrees)
    terms, kind = {}, "angular" if hinge else "linear"
    for friction in (each for each in forces.friction if each.joint == joint.name and each.viscous):
        terms["damping"] = friction.viscous / degrees
    for spring in (each for each in forces.joint_springs if each.joint == joint.name):
        terms |= {"stiffness": spring.stiffness / degrees, "targetPosition": spring.rest * degrees}
    if terms:
        UsdPhysics.DriveAPI.Apply(prim, kind)
    for name, value in terms.items():
        _add(prim, f"drive:{kind}:{PHYSICS}{name}", value)
