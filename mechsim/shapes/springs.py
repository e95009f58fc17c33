"""Springs and dampers of a mechanism as they are drawn: their ends, and the joints in which they act."""

from collections.abc import Iterator

import numpy as np

from mechsim.mechanism.forces import Forces, LinkPoint, Spring, located
from mechsim.mechanism.joint_kinds import KINDS
from mechsim.mechanism.joints import Joint
from mechsim.mechanism.mechanism import Mechanism

SpringEnds = tuple[LinkPoint, LinkPoint, bool]


def spring_ends(mechanism: Mechanism, forces: Forces | None) -> tuple[SpringEnds, ...]:
    """Return the ends of all springs between points and in slides, each as a link and a point in [m].

    The third entry is whether it is a damper alone, or a cylinder: an actuator between points. A spring in a
    slide is drawn from a point on the first link, half of the mechanism's size before the unloaded position
    of the second.
    """
    springs = () if forces is None else (*forces.springs, *forces.nonlinear_springs)
    ends = list[SpringEnds]()
    for spring in springs:
        pair = (spring.a, spring.b) if isinstance(spring, Spring) else spring.ends
        if not isinstance(pair, str):
            damper = isinstance(spring, Spring) and spring.stiffness == 0.0
            ends.append((located(mechanism, pair[0]), located(mechanism, pair[1]), damper))
    for actuator in () if forces is None else forces.actuators:
        if actuator.ends is not None:
            a, b = (located(mechanism, end) for end in actuator.ends)
            ends.append((a, b, True))
    for joint, rest in _joint_springs(mechanism, forces):
        if KINDS[joint.kind].slides:
            before = (rest - 0.5 * mechanism.characteristic_length) * np.asarray(joint.a.axis)
            x, y, z = (before + joint.a.point).tolist()
            ends.append(((joint.a.link, (x, y, z)), (joint.b.link, joint.b.point), False))
    return tuple(ends)


def torsion_springs(mechanism: Mechanism, forces: Forces | None) -> tuple[str, ...]:
    """Return the revolute joints in which springs act."""
    springs = _joint_springs(mechanism, forces)
    return tuple(dict.fromkeys(joint.name for joint, _ in springs if KINDS[joint.kind].turns))


def _joint_springs(mechanism: Mechanism, forces: Forces | None) -> Iterator[tuple[Joint, float]]:
    """Yield the joints of one coordinate in which springs act, without stops, and their unloaded value."""
    if forces is None:
        return
    joints = {joint.name: joint for joint in mechanism.joints if KINDS[joint.kind].single}
    rests = [(spring.joint, spring.rest) for spring in forces.joint_springs]
    rests += [
        (spring.ends, spring.law.reference)
        for spring in forces.nonlinear_springs
        if isinstance(spring.ends, str) and not hasattr(spring.law, "side")
    ]
    for name, rest in rests:
        if name in joints:
            yield joints[name], rest
