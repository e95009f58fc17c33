"""Reduced scenes: the full scene, scenes without some elements, other motions, and observations."""

import copy
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import mujoco
import numpy as np

from mechsim.mechanism.motion_laws import State
from mechsim.numerics.arrays import Array
from mechsim.numerics.rank import rank
from mechsim.simulation.equality_rows import coincident_frames
from mechsim.simulation.mjcf.compiling import plainly_compiled, quiet
from mechsim.simulation.mjcf_reader.equality_constraints import CONNECT, WELD
from mechsim.simulation.mjcf_reader.parsed_file import name_elements, name_unnamed
from mechsim.simulation.state import dense_rows, matching_state, quaternion
from mechsim.studies.scene.errors import SceneErrors, SceneEvaluator
from mechsim.studies.scene.run import SceneRun, run_scene, step_times
from mechsim.studies.scene.scene import UserScene, with_scaled_tolerance


def reduced_scene(
    full: UserScene, spec: mujoco.MjSpec, tracked: Mapping[str, tuple[str, Array]], like: mujoco.MjModel
) -> UserScene:
    """Return a reduced scene over the motion of the full scene.

    Args:
        full: the full scene; the remaining joints start as in this scene.
        spec: specification of the reduced scene; not changed.
        tracked: point -> name of its body, position in its frame in [m].
        like: model of the full scene, with the element names of `spec`.

    Raises:
        ValueError: if MuJoCo rejects the reduced scene, or an element is missing that the motion requires.
    """
    spec = spec.copy()
    plain = plainly_compiled(spec)
    inertias: dict[str, tuple[float, float]] = {}
    for name in full.joint_laws:
        joint = spec.joint(name)
        if joint is None:
            raise ValueError(f"joint {name} is prescribed and cannot be removed")
        inertias[name] = full.drive_inertias[name][0], float(joint.armature)
        joint.armature = full.drive_inertias[name][0]
    model = with_scaled_tolerance(plain, plainly_compiled(spec), spec) if inertias else plain
    actuators = {model.actuator(i).name for i in range(model.nu)}
    if missing := [name for name in full.ctrl if name not in actuators]:
        raise ValueError(f"actuator {missing[0]} has a motion law and cannot be removed")
    positions = {name: (_body(model, body), position) for name, (body, position) in tracked.items()}
    start = matching_state(model, like, full.start)
    if full.key is not None:
        # its controls are those of the full scene's keyframe
        values = full.keyframe_values
        controls = [values["ctrl"][like.actuator(actuator.name).id] for actuator in spec.actuators]
        act = {"act": values["act"]} if len(spec.actuators) == full.model.nu and full.model.na else {}
        spec.add_key(name=full.key, qpos=start[0], qvel=start[1], ctrl=controls, **act)
        model = plainly_compiled(spec)
    driven = {name: int(model.joint(name).id) for name in full.joint_laws}
    return replace(
        full, model=model, start=start, tracked=positions, driven_joints=driven, drive_inertias=inertias
    )


@dataclass(frozen=True)
class ReducedSceneEvaluator:
    """Makes reduced scenes and compares them with the full scene over one motion.

    Attributes:
        motion: the full scene as `tune` and `simulate` run it.
        spec: normalised specification of the full scene.
        tracked: point -> name of its body, position in its frame in [m].
    """

    motion: UserScene
    spec: mujoco.MjSpec
    tracked: Mapping[str, tuple[str, Array]]

    @classmethod
    def from_scene(cls, scene: UserScene, spec: mujoco.MjSpec) -> "ReducedSceneEvaluator":
        """Return the evaluator of a scene over its motion, with the specification of its file."""
        full = normalised(spec)
        named = plainly_compiled(full.copy())
        tracked = {name: (named.body(body).name, local) for name, (body, local) in scene.tracked.items()}
        return cls(scene, full, tracked)

    @cached_property
    def full(self) -> UserScene:
        """The full scene."""
        return self.scene(self.spec)

    @cached_property
    def named(self) -> mujoco.MjModel:
        """The full scene's model, all elements named."""
        return plainly_compiled(self.spec.copy())

    @cached_property
    def run(self) -> SceneRun:
        """The full scene's run with a record of every step."""
        return run_scene(self.full, records=None)

    def scene(self, spec: mujoco.MjSpec) -> UserScene:
        """Return the scene of a specification over the same motion, with the full scene's initial state."""
        return reduced_scene(self.motion, spec, self.tracked, self.named)

    def errors(self, scene: UserScene, *, compare_forces: bool = True) -> SceneErrors:
        """Return the errors of a scene relative to the full scene.

        Args:
            scene: a result of `scene`.
            compare_forces: whether forces are also compared; otherwise they are NaN.
        """
        return SceneEvaluator(self.run, closure=False, forces=compare_forces).evaluate(scene).errors


def time_ratio(full: UserScene, other: UserScene, rounds: int = 3) -> float:
    """Return the processor time of a scene relative to the full scene's."""
    full_time, time = step_times([(full, full.model), (other, other.model)], rounds)
    return float(time / full_time)


def _body(model: mujoco.MjModel, name: str) -> int:
    index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)
    if index < 0:
        raise ValueError(f"body {name} carries a tracked point and cannot be removed")
    return index


BODY, SITE = mujoco.mjtObj.mjOBJ_BODY, mujoco.mjtObj.mjOBJ_SITE


def normalised(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """Return a copy in which every element has a name, and connects and welds join sites.

    Otherwise the compiler computes anchors between bodies from the pose of the reduced scene. The simulation
    of the copy is the same.
    """
    full = spec.copy()
    for key in list(full.keys):  # keyframes do not fit a scene without all joints
        full.delete(key)
    name_elements(full)
    for what in ("geom", "site", "actuator", "tendon", "sensor"):
        elements = getattr(full, f"{what}s")
        name_unnamed(elements, [f"{what}{number}" for number in range(1, len(elements) + 1)])
    _close_between_sites(full)
    return full


def _close_between_sites(spec: mujoco.MjSpec) -> None:
    model = plainly_compiled(spec)
    bodies = {body.name: body for body in spec.bodies}
    for number, equality in enumerate(list(spec.equalities)):
        if equality.type not in (CONNECT, WELD) or equality.objtype != BODY:
            continue
        names: list[str] = []
        for end, position, rotation in zip(*coincident_frames(model, number), strict=True):
            body = bodies[model.body(end).name]
            name = f"{equality.name}@{body.name}"
            while spec.site(name) is not None:
                name += "'"
            body.add_site(name=name, pos=position, quat=quaternion(rotation), group=5)
            names.append(name)
        equality.name1, equality.name2 = names
        equality.objtype = SITE
        data = np.zeros_like(model.eq_data[number])
        if equality.type == WELD:
            data[10:] = model.eq_data[number, 10:]
        equality.data = data


def other_motion(scene: UserScene, range_ratio: float, speed_variation: float) -> UserScene:
    """Return a scene over its motion with another range and speed, from the same start.

    Args:
        scene: scene with its motion.
        range_ratio: range relative to that of the motion.
        speed_variation: largest relative change of the speed.
    """

    def warped_law(state: State, number: int) -> State:
        """Return a law whose time advances at 1 - speed_variation sin(w t) and ends at the same value.

        The number selects the frequency w.
        """
        w = 2.0 * np.pi * (1 + number % 3) / scene.duration

        def other(time: Array) -> tuple[Array, Array, Array]:
            time = np.asarray(time, dtype=np.float64)
            warped, sine = time - speed_variation / w * (1.0 - np.cos(w * time)), np.sin(w * time)
            speed, speed_rate = 1.0 - speed_variation * sine, -speed_variation * w * np.cos(w * time)
            value, rate, acceleration = (np.broadcast_to(values, time.shape) for values in state(warped))
            start = state(np.zeros(1))[0][0]
            return (
                start + range_ratio * (value - start),
                range_ratio * rate * speed,
                range_ratio * (acceleration * speed**2 + rate * speed_rate),
            )

        return other

    joint_laws, ctrl = (
        {name: warped_law(state, number) for number, (name, state) in enumerate(states.items(), first)}
        for states, first in ((scene.joint_laws, 0), (scene.ctrl, len(scene.joint_laws)))
    )
    qpos, qvel = scene.start
    # rates that keep loops closed are proportional to the driver speeds
    start = qpos, range_ratio * qvel if scene.joint_laws else qvel
    return replace(scene, joint_laws=joint_laws, ctrl=ctrl, start=start)


# number of observed instants, evenly spaced over the motion
SAMPLES = 600
LIMIT_JOINT = int(mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT)
LIMIT_TENDON = int(mujoco.mjtConstraint.mjCNSTR_LIMIT_TENDON)
EQUALITY = int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
# relative singular value of the constraint Jacobian below which it is zero
RANK_TOLERANCE = 1e-6


@dataclass(frozen=True)
class Evidence:
    """Observations of a scene over its motion.

    Attributes:
        spec: specification of the scene.
        scene: the compiled scene.
        tracked: names of the bodies that carry tracked points.
        tolerance: in [m]; in [N m] or [N] if forces are the measure.
        qpos: observed states, (n, nq).
        touched: geoms with contact.
        limited: joints and tendons that reached a limit.
        forces: actuator -> its largest force.
        redundant: equalities that the others imply.
    """

    spec: mujoco.MjSpec
    scene: UserScene
    tracked: frozenset[str]
    tolerance: float
    qpos: Array
    touched: frozenset[str] = frozenset()
    limited: frozenset[str] = frozenset()
    forces: Mapping[str, float] = field(default_factory=dict[str, float])
    redundant: tuple[str, ...] = ()

    @property
    def model(self) -> mujoco.MjModel:
        """The model of the run."""
        return self.scene.model

    def values(self, joint: str) -> Array:
        """Return a hinge's or slide's coordinate over the motion, (n,) in [rad] or [m]."""
        return self.qpos[:, int(self.model.joint(joint).qposadr[0])]


@quiet()
def observe(spec: mujoco.MjSpec, scene: UserScene, tracked: frozenset[str], tolerance: float) -> Evidence:
    """Run a scene over its motion and record contacts, limits, forces and redundant equalities."""
    run = run_scene(scene, records=SAMPLES)
    model = copy.copy(scene.model)
    model.opt.jacobian = int(mujoco.mjtJacobian.mjJAC_DENSE)
    data = mujoco.MjData(model)
    touched, limited = set[int](), set[str]()
    forces = np.zeros(model.nu)
    needed: set[int] = set()
    steps = np.round(run.time / model.opt.timestep).astype(int)
    for i, (qpos, qvel, step) in enumerate(zip(run.qpos, run.qvel, steps, strict=True)):
        control = scene.controls(model, int(step), 1)[0]
        data.qpos[:], data.qvel[:] = qpos, qvel
        data.ctrl[:], data.qfrc_applied[:] = control[: model.nu], control[model.nu :]
        mujoco.mj_forward(model, data)
        touched |= set(data.contact.geom.ravel().tolist())
        for kind, element in ((LIMIT_JOINT, model.joint), (LIMIT_TENDON, model.tendon)):
            limited |= {element(int(index)).name for index in data.efc_id[data.efc_type == kind]}
        forces = np.maximum(forces, np.abs(data.actuator_force))
        if i % 20 == 0:
            # the equalities that the others do not imply
            equality = np.asarray(data.efc_type) == EQUALITY
            owner, jacobian = np.asarray(data.efc_id)[equality], dense_rows(data)[equality]
            full_rank = rank(jacobian, RANK_TOLERANCE, floor=0.0)
            needed |= {
                each
                for each in set(owner.tolist())
                if rank(jacobian[owner != each], RANK_TOLERANCE, floor=0.0) < full_rank
            }
    return Evidence(
        spec,
        scene,
        tracked,
        tolerance,
        run.qpos,
        frozenset(model.geom(g).name for g in touched if g >= 0),
        frozenset(limited),
        {model.actuator(a).name: float(forces[a]) for a in range(model.nu)},
        tuple(model.equality(e).name for e in range(model.neq) if e not in needed),
    )
