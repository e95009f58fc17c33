"""Alternative models for comparisons: other drives of the crank, a rod as a constant distance.

The generator does not use them: other drives keep the speed worse (validation/choices/crank_actuation.py),
and a rod as a distance saves a fifth of the time of a step and moves points of the rssr by 0.28 cranks.
"""

import mujoco
import numpy as np

from mechsim.model.joint_kinds import KINDS
from mechsim.model.link_poses import plane_normals
from mechsim.model.links import GROUND
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array
from mechsim.numerics.rounding import ROUNDING
from mechsim.simulation.mjcf.generator import DRIVE_INERTIA_RATIO
from mechsim.simulation.mjcf.loop_cuts import cut_loops, joints_with
from mechsim.simulation.state import data_at, mass_matrix

MOTOR = "crank@motor"
# suffix of the sites at the ends of a rod that is a constant distance
LENGTH = "@length"
# inertia of a motor's rotor without its virtual inertia, in [kg m2]
ROTOR_INERTIA = 1e-6


def gear_to_motor(spec: mujoco.MjSpec) -> None:
    """Drive the crank by an equality with a separate wheel, which has the virtual inertia."""
    body = spec.worldbody.add_body(name=MOTOR)
    body.mass, body.inertia, body.explicitinertial = 1.0, np.full(3, ROTOR_INERTIA), True
    wheel = body.add_joint(name=MOTOR, type=mujoco.mjtJoint.mjJNT_HINGE, axis=(0.0, 0.0, 1.0))
    weight = sum(float(body_.mass) for body_ in spec.bodies)
    reach = max((float(np.linalg.norm(body_.pos)) for body_ in spec.bodies), default=1.0)
    wheel.armature = DRIVE_INERTIA_RATIO * weight * max(reach, 1e-6) ** 2
    gear = spec.add_equality(
        name=MOTOR,
        type=mujoco.mjtEq.mjEQ_JOINT,
        objtype=mujoco.mjtObj.mjOBJ_JOINT,
        name1="crank",
        name2=MOTOR,
    )
    gear.data[:5] = 0.0, 1.0, 0.0, 0.0, 0.0


def add_servo(spec: mujoco.MjSpec) -> None:
    """Drive the crank by a velocity servo; its gain is set on the compiled model."""
    motor = spec.add_actuator(name=MOTOR, trntype=mujoco.mjtTrn.mjTRN_JOINT, target="crank")
    motor.biastype = mujoco.mjtBias.mjBIAS_AFFINE


def inertia_at_crank(model: mujoco.MjModel, qpos: Array, tangent: Array) -> float:
    """Return the inertia of the links at the crank without its armature, in [kg m2].

    Args:
        model: the compiled model.
        qpos: closed state, (nq,).
        tangent: rates of all DOFs per radian of the crank, (nv,).
    """
    inertia = mass_matrix(data_at(model, qpos)) - np.diag(model.dof_armature)
    return float(tangent @ inertia @ tangent)


def rod_of(mechanism: Mechanism) -> str | None:
    """Return a link that only keeps two joints at a constant distance; None without one.

    In the model one of its joints must be a tree joint and the other a cut joint, both spherical, or both
    revolute in a planar mechanism. Points tracked on it must lie at these joints.
    """
    tree = cut_loops(mechanism)
    parents = {branch.parent.link for branch in tree.branches}
    planar = plane_normals(mechanism) is not None
    coupled = [name for law in mechanism.laws for name in law.coordinates]
    fixed = joints_with(mechanism, [*mechanism.drivers, *mechanism.locked, *coupled])
    cuts = {joint.name for joint in tree.cuts}
    for link in mechanism.links:
        joints = [joint for joint in mechanism.joints if link.name in (joint.a.link, joint.b.link)]
        if link.name in parents or len(joints) != 2 or sum(joint.name in cuts for joint in joints) != 1:
            continue
        kinds = [KINDS[joint.kind] for joint in joints]
        if not all(kind.hinge if planar else kind.ball for kind in kinds):
            continue
        if any(joint.name in fixed for joint in joints):
            continue
        ends = [end.point for end in mechanism.ends(link.name)]
        tracked = [point for link_name, point in mechanism.points.values() if link_name == link.name]
        if all(
            min(_distance(point, end) for end in ends) <= ROUNDING * mechanism.characteristic_length
            for point in tracked
        ):
            return link.name
    return None


def rod_as_length(spec: mujoco.MjSpec, mechanism: Mechanism, rod: str) -> None:
    """Replace a rod's body in an assembled model by a constant distance of its ends.

    The equality is inactive as compiled, because `ModelLoops` does not support its kind.

    Args:
        spec: assembled specification of the mechanism, with the generator's choice of cuts.
        mechanism: the mechanism of the model.
        rod: name from `rod_of`.
    """
    sites: list[str] = []
    tracked = {name: point for name, (link, point) in mechanism.points.items() if link == rod}
    for joint in [joint for joint in mechanism.joints if rod in (joint.a.link, joint.b.link)]:
        mine, other = (joint.a, joint.b) if joint.a.link == rod else (joint.b, joint.a)
        body = spec.worldbody if other.link == GROUND else spec.body(other.link)
        sites.append(body.add_site(name=f"{joint.name}{LENGTH}", pos=other.point).name)
        for name, point in tracked.items():
            if _distance(point, mine.point) <= ROUNDING * mechanism.characteristic_length:
                spec.delete(spec.site(name))
                body.add_site(name=name, pos=other.point)
        for equality in list(spec.equalities):
            if equality.name in (joint.name, f"{joint.name}+"):
                spec.delete(equality)
    spec.delete(spec.body(rod))
    tendon = spec.add_tendon(name=rod)
    for site in sites:
        tendon.wrap_site(site)
    kind, object_type = mujoco.mjtEq.mjEQ_TENDON, mujoco.mjtObj.mjOBJ_TENDON
    spec.add_equality(name=rod, type=kind, objtype=object_type, name1=rod, active=False)


def _distance(a: tuple[float, float, float], b: tuple[float, float, float]) -> float:
    return float(np.linalg.norm(np.asarray(a) - np.asarray(b)))
