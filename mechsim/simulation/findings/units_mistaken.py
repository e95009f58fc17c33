"""Lengths that look like millimetres, and angles that look like degrees where radians are meant or back."""

from collections.abc import Iterator

import numpy as np

from mechsim.model.finding import Finding
from mechsim.simulation.findings.inspected import Inspected
from mechsim.simulation.mjcf_reader.joint_types import DRIVABLE, SLIDE

# a scene this large in [m], or a part so many times farther off than the middle one, is in mm
MAX_LENGTH, MAX_RATIO = 10.0, 100.0
# a hinge of a loop with a range this wide in [rad] has it in degrees; hinges with a range as narrow as this
# in degrees have it in rad
WIDE_RANGE, NARROW_RANGE = 10.0, 2.0 * np.pi


def mistaken_units(scene: Inspected) -> Iterator[Finding]:
    """Yield what looks like another unit."""
    yield from _lengths(scene)
    yield from _angles(scene)


def _lengths(scene: Inspected) -> Iterator[Finding]:
    model = scene.model
    if scene.size > MAX_LENGTH:
        yield Finding(
            kind="units",
            what="lengths",
            by=scene.size,
            explains=0.0,
            message=f"the linkage is {scene.size:.3g} m large: its lengths look like mm",
            remedy="MuJoCo takes lengths as they stand and gravity as 9.81: write m",
        )
        return
    moving = [b for b in range(1, model.nbody) if model.body_weldid[b] != 0]
    distances = {b: float(np.linalg.norm(model.body_pos[b])) for b in moving}
    middle = float(np.median([by for by in distances.values() if by > 0.0] or [0.0]))
    bodies = {body.name: body for body in scene.read.spec.bodies}
    for b, by in distances.items():
        if middle > 0.0 and by > MAX_RATIO * middle and by > 1.0:
            name = str(model.body(b).name)
            yield Finding(
                kind="units",
                what=name,
                by=by,
                explains=0.0,
                message=f"body {name} is {by:.3g} m from its parent, others {middle:.2g} m: it looks like mm",
                remedy="write m",
                **scene.place(bodies[name]),
            )


def _angles(scene: Inspected) -> Iterator[Finding]:
    model = scene.model
    joints = {joint.name: joint for joint in scene.read.spec.joints}
    hinges = [
        int(j)
        for j in np.flatnonzero(model.jnt_limited)
        if int(model.jnt_type[j]) in DRIVABLE and int(model.jnt_type[j]) != SLIDE
    ]
    widths = {j: float(np.abs(model.jnt_range[j]).max()) for j in hinges}
    wide = [j for j, width in widths.items() if width > WIDE_RANGE and _in_loop(scene, j)]
    # a range of several turns that a file has in degrees is meant so
    if wide and not scene.read.spec.compiler.degree:
        names = ", ".join(str(model.joint(j).name) for j in wide)
        low, high = model.jnt_range[max(wide, key=lambda j: widths[j])]
        yield Finding(
            kind="units",
            what=names,
            by=max(widths[j] for j in wide),
            explains=0.0,
            message=f"{names} of a loop may turn from {low:g} to {high:g} rad: that looks like degrees",
            remedy='write rad, or angle="degree" for the whole file',
            **scene.place(joints[str(model.joint(wide[0]).name)]),
        )
    narrow = [j for j, width in widths.items() if 0.0 < np.rad2deg(width) <= NARROW_RANGE]
    if scene.read.spec.compiler.degree and len(narrow) == len(hinges) > 1:
        j = max(narrow, key=lambda j: widths[j])
        yield Finding(
            kind="units",
            what="angles",
            by=widths[j],
            explains=0.0,
            message=f"no hinge may turn by more than {np.rad2deg(widths[j]):.3g} deg: "
            "the ranges look like rad",
            remedy='angles are degrees unless the file says <compiler angle="radian"/>',
            **scene.place(joints[str(model.joint(j).name)]),
        )


def _in_loop(scene: Inspected, j: int) -> bool:
    """Say whether the loops feel a joint."""
    jacobian, _ = scene.generic
    return bool(np.abs(jacobian[:, int(scene.model.jnt_dofadr[j])]).max(initial=0.0) > 0.0)
