"""Forces of every kind at every joint, point and link of a mechanism where they may act."""

from collections.abc import Collection

from mechsim.mechanism.forces import Couple, Forces, Friction, JointSpring, Load, Spring, located
from mechsim.mechanism.joint_kinds import KINDS
from mechsim.mechanism.links import GROUND
from mechsim.mechanism.load_profile import constant
from mechsim.mechanism.mechanism import Mechanism


def every_force(
    mechanism: Mechanism,
    rubbing: Collection[str] = ("revolute", "prismatic"),
    dry: Collection[str] | None = None,
    viscous: float = 0.1,
) -> Forces:
    """Return weight, friction, springs, loads and couples; moments are proportional to lengths.

    Args:
        mechanism: any.
        rubbing: kinds of joints with friction.
        dry: names of joints whose friction is also dry, by default all.
        viscous: coefficient of viscous friction at a length of 1 m, in [N m s/rad] or [N s/m].
    """
    length, friction = mechanism.characteristic_length, []
    for joint in mechanism.joints:
        if joint.kind in rubbing:
            coulomb = 0.1 * length if dry is None or joint.name in dry else 0.0
            angular = viscous * length**2, coulomb
            mixed = KINDS[joint.kind].mixed
            friction.append(
                Friction(joint.name, *((10.0 * viscous, coulomb / length, *angular) if mixed else angular))
            )
    moving = [name for name in mechanism.points if located(mechanism, name)[0] != GROUND]
    single = [joint.name for joint in mechanism.joints if KINDS[joint.kind].single]
    anchor, moment = (length, 2.0 * length, -length), (0.1 * length, 0.2 * length, -0.3 * length)
    return Forces(
        gravity=(1.0, -9.81, 3.0),
        friction=tuple(friction),
        springs=tuple(Spring((GROUND, anchor), name, 50.0, 0.5 * length, 0.5) for name in moving[:3]),
        joint_springs=tuple(JointSpring(name, 0.3 * length, 0.1) for name in single),
        loads=tuple(Load(name, constant((0.7, 0.5, -0.6))) for name in moving[-2:]),
        couples=(Couple(mechanism.links[0].name, constant(moment)),),
    )
