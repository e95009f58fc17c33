"""A user's MJCF scene and the motion it is put through, as plain MuJoCo runs it."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from mechsim.errors import AssemblyError, InputError
from mechsim.model.links import GROUND, Vector
from mechsim.model.mechanism import Mechanism
from mechsim.model.motion_laws import State
from mechsim.numerics.arrays import Array
from mechsim.simulation.mjcf.compiling import plainly_compiled, quiet
from mechsim.simulation.mjcf.generator import DRIVE_INERTIA_RATIO
from mechsim.simulation.mjcf_reader import MjcfModel
from mechsim.simulation.mjcf_reader.coordinates import did_you_mean, listed
from mechsim.simulation.mjcf_reader.fixed_bodies import FixedBodies, fix_bodies_in_scene
from mechsim.simulation.mjcf_reader.kinematic_tree import carriers, link_name, vector
from mechsim.simulation.mjcf_reader.parsed_file import parse_file
from mechsim.studies.scene.exact_closure import CLOSED, ExactClosure, exact_closure

RK4 = int(mujoco.mjtIntegrator.mjINT_RK4)


@dataclass(frozen=True)
class UserScene:
    """A scene and its motion.

    Attributes:
        path: of the file.
        model: as plain MuJoCo compiles the file; where joints are prescribed with flywheels on them.
        start: state and rates at time zero, (nq,) and (nv,).
        duration: of the motion in [s].
        closure: exact, of its loops.
        places: of each tracked point: body and place in its frame in [m].
        drive: prescribed joint -> its program.
        ctrl: actuator -> its program; the others stay at what the start has.
        wheels: prescribed joint -> (inertia of its flywheel, its own armature), in [kg m2] or [kg].
        key: keyframe in which it starts; None for the reference configuration.
        lighter: mean inertia without flywheels over that with them.
        still: balls and free joints that are held, which the file's own text does not; None without any.
        free: what need not stay as it is, of `FREEABLE`.
        begins_closed: whether it begins in a closed state that is not the file's own.
    """

    path: str
    model: mujoco.MjModel
    start: tuple[Array, Array]
    duration: float
    closure: ExactClosure
    places: Mapping[str, tuple[int, Array]]
    drive: Mapping[str, State] = field(default_factory=dict[str, State])
    ctrl: Mapping[str, State] = field(default_factory=dict[str, State])
    wheels: Mapping[str, tuple[float, float]] = field(default_factory=dict[str, tuple[float, float]])
    key: str | None = None
    lighter: float = 1.0
    still: FixedBodies | None = None
    free: tuple[str, ...] = ()
    begins_closed: bool = False

    @property
    def own_start(self) -> bool:
        """Whether it begins elsewhere than its file or its keyframe has it."""
        return bool(self.drive) or self.begins_closed

    @property
    def mechanism(self) -> Mechanism:
        """What was read of the file."""
        return self.closure.mechanism

    @cached_property
    def driven_joints(self) -> dict[str, int]:
        """Prescribed joint -> its index in the model."""
        names = [joint.name for joint in self.mechanism.joints[: self.model.njnt]]
        return {name: names.index(name) for name in self.drive}

    @cached_property
    def driven_dofs(self) -> NDArray[np.intp]:
        """Freedoms of the prescribed joints, in the order of `drive`."""
        joints = [*self.driven_joints.values()]
        return self.model.jnt_dofadr[joints].astype(np.intp)

    @cached_property
    def fed(self) -> NDArray[np.intp]:
        """Indices of the actuators that programs feed, in the order of `ctrl`."""
        names = [self.model.actuator(i).name or f"actuator{i + 1}" for i in range(self.model.nu)]
        return np.array([names.index(name) for name in self.ctrl], dtype=np.intp)

    @property
    def usual_tolerance(self) -> float:
        """MuJoCo's own tolerance of the solver, smaller by as much as flywheels make inertia larger."""
        return float(f"{mujoco.MjOption().tolerance * self.lighter:.3g}")

    @cached_property
    def size(self) -> float:
        """Yardstick of its lengths, in [m]."""
        return self.mechanism.size

    def controls(self, model: mujoco.MjModel, first: int, count: int, held: float = 0.0) -> Array:
        """Return the actuators' controls and the freedoms' forces of so many steps, (count, nu + nv).

        A force gives a flywheel the speed by which its joint stands right when the step ends; in RK4, whose
        steps take the mean of both speeds, the speed that its program then has.

        Args:
            model: with its time step and integrator.
            first: steps taken before.
            count: of steps.
            held: when in a step a control is its program's value, 0 to 1; as a loop in Python has it, 0.
        """
        timestep = float(model.opt.timestep)
        out = np.zeros((count, self.model.nu + self.model.nv))
        out[:, : self.model.nu] = self._standing
        time = timestep * (first + np.arange(-1.0, count + 1.0))
        for of, state in zip(self.fed, self.ctrl.values(), strict=True):
            out[:, of] = state(time[1:-1] + held * timestep)[0]
        for name, dof, state in zip(self.drive, self.driven_dofs, self.drive.values(), strict=True):
            value, rate, _ = state(time)
            speed = rate[1:]
            if model.opt.integrator != RK4:
                speed = np.diff(value) / timestep
                speed[0] = rate[1] if first == 0 else speed[0]
            out[:, self.model.nu + dof] = self.wheels[name][0] * np.diff(speed) / timestep
        return out

    def prescribed(self, time: Array) -> tuple[Array, Array]:
        """Return controls (n, nu) and forces on all freedoms (n, nv) that programs ask for at times (n,)."""
        controls, forces = np.tile(self._standing, (len(time), 1)), np.zeros((len(time), self.model.nv))
        for of, state in zip(self.fed, self.ctrl.values(), strict=True):
            controls[:, of] = state(time)[0]
        for name, dof, state in zip(self.drive, self.driven_dofs, self.drive.values(), strict=True):
            forces[:, dof] = self.wheels[name][0] * state(time)[2]
        return controls, forces

    @property
    def standing(self) -> Mapping[str, Array]:
        """What a keyframe has beside the state: activations, controls, mocap bodies."""
        data = mujoco.MjData(self.model)
        if self.key is not None:
            mujoco.mj_resetDataKeyframe(self.model, data, self.model.key(self.key).id)
        return {
            "act": data.act.copy(),
            "ctrl": data.ctrl.copy(),
            "mpos": data.mocap_pos.ravel(),
            "mquat": data.mocap_quat.ravel(),
        }

    @cached_property
    def _standing(self) -> Array:
        return self.standing["ctrl"]


@quiet()
def scene_of(
    read: MjcfModel,
    mechanism: Mechanism,
    *,
    drive: Mapping[str, State] | None = None,
    ctrl: Mapping[str, State] | None = None,
    duration: float = 1.0,
    points: Mapping[str, tuple[str, Vector]] | None = None,
    key: str | None = None,
    spec: mujoco.MjSpec | None = None,
    begin: Array | None = None,
) -> UserScene:
    """Return a scene and its motion.

    Without prescribed joints the motion begins as the file has it, or as its keyframe has, at rest; with
    them in the closed state in which their programs begin, and with their rates.

    Args:
        read: what was read of the file.
        mechanism: the same with digits that let its loops close (`MjcfForm.mechanism`); its drivers are where
            closure is judged.
        drive: joint -> its program: prescribed.
        ctrl: actuator -> its program: fed.
        duration: in [s].
        points: to track: name -> (link, place in its frame in [m]); None for body origins and ends of loops.
        key: keyframe to start from.
        spec: of the scene, in place of the file and without what is held in it; not changed.
        begin: coordinates (nq,) from which the motion starts, in place of the file's or the keyframe's.

    Raises:
        InputError: for an actuator or a joint that is not there, or programs that begin nowhere.
        AssemblyError: where the loops do not close where the programs begin.
    """
    drive, ctrl = drive or {}, ctrl or {}
    if not 0.0 < duration < np.inf:
        raise InputError(f"the duration is {duration} s; give a finite time above 0")
    still = None
    if spec is not None:
        spec = spec.copy()
    else:
        spec = parse_file(read.path)[0]
        if read.stilled:
            still = fix_bodies_in_scene(spec, plainly_compiled(spec), read.stilled, key)
    plain = plainly_compiled(spec)
    _require_actuators(plain, ctrl)
    named = plainly_compiled(read.spec.copy())
    bodies = {link_name(named, b): b for b in range(1, named.nbody) if named.body_jntnum[b]} | {GROUND: 0}
    if points is None:
        points = _every_point(mechanism, named)
    closure = exact_closure(mechanism, plain, points)
    wheels = _put_flywheels(spec, plain, mechanism, tuple(drive))
    model = plain if not wheels else as_exact(plain, plainly_compiled(spec), spec)
    lighter = float(plain.stat.meaninertia / model.stat.meaninertia)
    data = mujoco.MjData(model)
    if key is not None:
        mujoco.mj_resetDataKeyframe(model, data, model.key(key).id)
    start = (data.qpos if begin is None else begin).copy(), data.qvel.copy()
    if drive:
        start = _started(closure, model, start[0], drive)
    places = {name: (bodies[link], np.array(local)) for name, (link, local) in points.items()}
    return UserScene(
        read.path,
        model,
        start,
        float(duration),
        closure,
        places,
        dict(drive),
        dict(ctrl),
        wheels,
        key,
        lighter,
        still,
    )


def begun_closed(scene: UserScene) -> UserScene:
    """Return a scene that begins in the closed state nearest to its own start, its drivers where they are.

    Raises:
        AssemblyError: where no closed state is near.
    """
    qpos, qvel = scene.start
    closed, gap = scene.closure.closed(scene.closure.coordinates(qpos[None]))
    if not gap[0] <= CLOSED:
        raise AssemblyError(
            f"{scene.path}: its loops stand open where it starts and close in no pose near; start from "
            "another keyframe (--key)"
        )
    return replace(scene, start=(scene.closure.states(closed, qpos)[0], qvel), begins_closed=True)


def spec_of(scene: UserScene) -> mujoco.MjSpec:
    """Return the specification of a scene's file, without the balls and free joints that are held."""
    spec = parse_file(scene.path)[0]
    if scene.still is not None:
        fix_bodies_in_scene(spec, plainly_compiled(spec), scene.still.joints, scene.key)
    return spec


def _every_point(mechanism: Mechanism, model: mujoco.MjModel) -> dict[str, tuple[str, Vector]]:
    """Return the origins of all moving bodies, and the points at which joints close the loops."""
    chained = carriers(model)
    found = {
        model.body(b).name: (chained[b].link, vector(chained[b].at.position))
        for b in range(1, model.nbody)
        if chained[b].link != GROUND
    }
    for joint in mechanism.joints[model.njnt :]:
        for end in (joint.a, joint.b):
            place = (end.link, end.point)
            if end.link != GROUND and place not in found.values():
                found[f"{joint.name}@{end.link}"] = place
    return found


def _require_actuators(model: mujoco.MjModel, ctrl: Mapping[str, State]) -> None:
    names = [model.actuator(i).name or f"actuator{i + 1}" for i in range(model.nu)]
    for name in ctrl:
        if name not in names:
            raise InputError(
                f"--ctrl names {name!r}{did_you_mean(name, names)}; "
                f"actuators of the model are {listed(names)}"
            )


def _put_flywheels(
    spec: mujoco.MjSpec, model: mujoco.MjModel, mechanism: Mechanism, names: tuple[str, ...]
) -> dict[str, tuple[float, float]]:
    """Put flywheels on joints, so heavy that no reaction turns them: their forces alone do."""
    if not names:
        return {}
    weight = model.body_mass.sum() * mechanism.size**2 + model.body_inertia.max(1).sum()
    order = [joint.name for joint in mechanism.joints[: model.njnt]]
    joints = sorted(spec.joints, key=lambda joint: joint.id)
    wheels: dict[str, tuple[float, float]] = {}
    for name in names:
        joint = joints[order.index(name)]
        slides = joint.type == mujoco.mjtJoint.mjJNT_SLIDE
        inertia = float(f"{DRIVE_INERTIA_RATIO * weight / (mechanism.size**2 if slides else 1.0):.3g}")
        wheels[name] = inertia, float(joint.armature)
        joint.armature = inertia
    return wheels


def as_exact(plain: mujoco.MjModel, wheeled: mujoco.MjModel, spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Return a model with flywheels whose solver is as exact as that of the same without.

    By the mean inertia MuJoCo's solver judges what is small: with flywheels it would end before its time,
    and what is light would shake.
    """
    spec.option.tolerance *= plain.stat.meaninertia / wheeled.stat.meaninertia
    wheeled.opt.tolerance = spec.option.tolerance
    return wheeled


def _started(
    closure: ExactClosure, model: mujoco.MjModel, qpos: Array, drive: Mapping[str, State]
) -> tuple[Array, Array]:
    """Return the closed state and the rates with which programs begin."""
    first = {name: [float(part[0]) for part in state(np.zeros(1))] for name, state in drive.items()}
    closed = closure.brought(qpos, {name: value for name, (value, _, _) in first.items()})
    speeds = {name: rate for name, (_, rate, _) in first.items()}
    return closed, closure.rates(closed, speeds, model.jnt_dofadr.tolist(), model.nv)
