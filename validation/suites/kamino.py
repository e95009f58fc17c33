"""Kamino's USD files of joints and mechanisms: released, against the joints as USD states them.

Every coordinate that mechsim names starts at a rate of 1 in SI. The residual is computed from the file alone,
by its joints' frames and limits: a constrained translation or rotation has a low limit above its high one.
"""

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import mechsim as ms
from mechsim.kinematics.solvers import KinematicSolver
from validation.published.table import Row
from validation.suites.case import Case, Clone, Suite, rejected
from validation.suites.gepetto import Pose, after
from validation.suites.released import entries

FOLDER = "newton/tests/assets/kamino"
DURATION, INSTANTS = 0.2, 20
CLOSED, ENERGY = 1e-12, 1e-10
REASONS = ("in m and of direction cosines", "of the exchanged energy")
# type -> free translations and rotations; others are free where limits do not exclude them
FREE = {
    "PhysicsFixedJoint": (),
    "PhysicsRevoluteJoint": ("rot{}",),
    "PhysicsPrismaticJoint": ("trans{}",),
    "PhysicsSphericalJoint": ("rotX", "rotY", "rotZ"),
}


def free_axes(prim: Any) -> set[str]:
    """Return the free translations and rotations of a joint, as transX."""
    from pxr import UsdPhysics

    kind = prim.GetTypeName()
    if kind in FREE:
        axis = prim.GetAttribute("physics:axis").Get() if "{}" in "".join(FREE[kind]) else ""
        return {name.format(axis) for name in FREE[kind]}
    names = {f"{what}{axis}" for what in ("trans", "rot") for axis in "XYZ"}
    limits = {name: UsdPhysics.LimitAPI.Get(prim, name) for name in names}
    ends = {name: (limit.GetLowAttr().Get(), limit.GetHighAttr().Get()) for name, limit in limits.items()}
    return {name for name, (low, high) in ends.items() if low is None or low <= high}


def misfit(a: Pose, b: Pose, free: set[str]) -> float:
    """Return the largest violation of a joint between two frames; the first rotation is about a's axis."""
    rotation = np.swapaxes(a[1], -1, -2) @ b[1]
    apart = np.einsum("...ji,...j->...i", a[1], b[0] - a[0])
    errors = [apart[..., i] for i, axis in enumerate("XYZ") if f"trans{axis}" not in free]
    turns = [i for i, axis in enumerate("XYZ") if f"rot{axis}" in free]
    if len(turns) == 2:
        errors.append(rotation[..., turns[0], turns[1]])
    elif len(turns) < 2:
        columns = turns or range(3)
        errors += [rotation[..., i, j] - (i == j) for i in range(3) for j in columns]
    return max((float(np.abs(error).max()) for error in errors), default=0.0)


def residual(path: Path, motion: ms.Motion) -> float:
    """Return the largest violation of a joint of a file by a motion."""
    from pxr import Usd, UsdPhysics

    ground = np.zeros((len(motion.angle), 3)), np.broadcast_to(np.eye(3), (len(motion.angle), 3, 3))
    worst = 0.0
    stage = Usd.Stage.Open(str(path))
    for prim in stage.Traverse():
        if not prim.IsA(UsdPhysics.Joint):
            continue
        joint, frames = UsdPhysics.Joint(prim), []
        for rel, position, rotation in (
            (joint.GetBody0Rel(), joint.GetLocalPos0Attr(), joint.GetLocalRot0Attr()),
            (joint.GetBody1Rel(), joint.GetLocalPos1Attr(), joint.GetLocalRot1Attr()),
        ):
            names = [path.name for path in rel.GetTargets()]
            link = motion.links[names[0]] if names else None
            pose = (link.position, link.rotation) if link else ground
            quaternion = [*rotation.Get().GetImaginary(), rotation.Get().GetReal()]
            frames.append(after(pose, (np.array(position.Get()), Rotation.from_quat(quaternion).as_matrix())))
        worst = max(worst, misfit(*frames, free_axes(prim)))
    return worst


def rates(solver: KinematicSolver) -> dict[str, Any]:
    """Return the initial rates of the first joint."""
    joint = solver.mechanism.joints[0]
    if joint.kind in ("spherical", "floating"):
        return {f"{joint.name}.w": (1.0, 2.0, 3.0)}
    return {f"{coordinate}.v": 1.0 for coordinate in joint.coordinates}


def compared(name: str, path: Path) -> Case:
    solver = ms.load(str(path), still=True)
    run = ms.dynamics.run(solver, initial=rates(solver), duration=DURATION, samples=INSTANTS)
    joints = Row("joints", residual(path, run.motion), CLOSED, "", REASONS[0])
    return Case(name, (joints, Row("energy", run.energy_error, ENERGY, "", REASONS[1])))


def cases(clone: Clone | None) -> Iterator[Case]:
    for source in clone.paths(FOLDER) if clone else ():
        folder, name = Path(source).parent.name, Path(source).stem
        if folder not in ("joints", "basics"):
            continue
        with tempfile.TemporaryDirectory() as scratch:
            path = Path(scratch, f"{name}.usda")
            path.write_text(clone.read(source))
            try:
                yield compared(name, path)
            except ms.MechsimError as error:
                yield rejected(name, error, entries("kamino").get(name, {}))


SUITE = Suite(
    "Kamino: USD files of joints and mechanisms",
    "newton-physics/newton",
    "Runs of 0.2 s; the file alone gives the residual. DR Legs is not in the repository. Licence Apache-2.0.",
    cases,
)
