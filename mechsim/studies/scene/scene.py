"""A custom MJCF scene and its motion, as plain MuJoCo runs them; other models are written as one."""

import re
import shlex
from collections.abc import Generator, Iterable, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from os import PathLike, fspath
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from mechsim import files
from mechsim.errors import AssemblyError, InputError
from mechsim.io.law_text import control_laws, python_expression
from mechsim.io.prescription import duration_of
from mechsim.io.readers import load
from mechsim.kinematics.loops.joint_locks import undetermined_joints
from mechsim.kinematics.loops.start import start_poses
from mechsim.mechanism.links import GROUND, Pose, Vector, vector
from mechsim.mechanism.mechanism import Mechanism, described
from mechsim.mechanism.motion_laws import State, steady
from mechsim.mechanism.scene import Scene
from mechsim.numerics.arrays import Array
from mechsim.simulation.mjcf.compiling import plainly_compiled, quiet, to_xml
from mechsim.simulation.mjcf.generator import DRIVE_INERTIA_RATIO
from mechsim.simulation.mjcf_reader.coordinates import actuator_names, did_you_mean, listed
from mechsim.simulation.mjcf_reader.fixed_bodies import FixedBodies, fix_bodies_in_scene
from mechsim.simulation.mjcf_reader.kinematic_tree import carriers, link_name
from mechsim.simulation.mjcf_reader.mjcf_model import MjcfModel
from mechsim.simulation.mjcf_reader.parsed_file import parse_file
from mechsim.simulation.mjcf_reader.reading import states_of
from mechsim.simulation.source import assembled
from mechsim.studies.scene.exact_closure import ASSEMBLED, ExactClosure, exact_closure
from mechsim.units import si

RK4 = int(mujoco.mjtIntegrator.mjINT_RK4)


@dataclass(frozen=True)
class UserScene:
    """A scene and its motion.

    Attributes:
        path: path of the file.
        model: model as plain MuJoCo compiles the file, with virtual drive inertia on prescribed joints.
        start: initial state and velocities, (nq,) and (nv,).
        duration: duration of the motion in [s].
        closure: exact closure of its loops.
        tracked: point -> body, and position in its frame in [m].
        driven_joints: prescribed joint -> its index in the model.
        joint_laws: prescribed joint -> its motion law.
        ctrl: actuator -> motion law of its control; other actuators keep their initial controls.
        drive_inertias: prescribed joint -> (virtual drive inertia, own armature), in [kg m2] or [kg].
        key: initial keyframe; None for the reference configuration.
        inertia_ratio: mean inertia without virtual drive inertia divided by that with it.
        fixed_bodies: floating bases and ball joints fixed by options, not by the file; None without any.
        allowed: kinds of elements that may be disabled, from `ALLOWABLE`.
        assembled_start: whether it starts in an assembled configuration that differs from the file's.
    """

    path: str
    model: mujoco.MjModel
    start: tuple[Array, Array]
    duration: float
    closure: ExactClosure
    tracked: Mapping[str, tuple[int, Array]]
    driven_joints: Mapping[str, int] = field(default_factory=dict[str, int])
    joint_laws: Mapping[str, State] = field(default_factory=dict[str, State])
    ctrl: Mapping[str, State] = field(default_factory=dict[str, State])
    drive_inertias: Mapping[str, tuple[float, float]] = field(default_factory=dict[str, tuple[float, float]])
    key: str | None = None
    inertia_ratio: float = 1.0
    fixed_bodies: FixedBodies | None = None
    allowed: tuple[str, ...] = ()
    assembled_start: bool = False

    @property
    def own_start(self) -> bool:
        """Whether its start differs from the file's or keyframe's."""
        return bool(self.joint_laws) or self.assembled_start

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism read from the file."""
        return self.closure.mechanism

    @cached_property
    def driven_dofs(self) -> NDArray[np.intp]:
        """Degrees of freedom of the prescribed joints, in the order of `joint_laws`."""
        return self.model.jnt_dofadr[[*self.driven_joints.values()]].astype(np.intp)

    @cached_property
    def controlled(self) -> NDArray[np.intp]:
        """Indices of the actuators with motion laws, in the order of `ctrl`."""
        names = actuator_names(self.model)
        return np.array([names.index(name) for name in self.ctrl], dtype=np.intp)

    @property
    def solver_tolerance(self) -> float:
        """MuJoCo's default solver tolerance, reduced by the ratio of inertias."""
        return float(f"{mujoco.MjOption().tolerance * self.inertia_ratio:.3g}")

    def controls(self, model: mujoco.MjModel, first: int, count: int, phase: float = 0.0) -> Array:
        """Return the actuator controls and applied forces of steps, (count, nu + nv).

        The force on a drive inertia gives the speed with which its joint is exact at the end of the step. RK4
        averages both speeds; there the force gives the speed of the motion law at that time.

        Args:
            model: model with its time step and integrator.
            first: number of preceding steps.
            count: number of steps.
            phase: fraction of a step, 0 to 1, at which controls are evaluated; 0 for a loop in Python.
        """
        timestep = float(model.opt.timestep)
        out = np.zeros((count, self.model.nu + self.model.nv))
        out[:, : self.model.nu] = self.keyframe_values["ctrl"]
        time = timestep * (first + np.arange(-1.0, count + 1.0))
        for index, law in zip(self.controlled, self.ctrl.values(), strict=True):
            out[:, index] = law(time[1:-1] + phase * timestep)[0]
        for name, dof, law in self._drives:
            value, rate, _ = law(time)
            speed = rate[1:]
            if model.opt.integrator != RK4:
                speed = np.diff(value) / timestep
                speed[0] = rate[1] if first == 0 else speed[0]
            out[:, self.model.nu + dof] = self.drive_inertias[name][0] * np.diff(speed) / timestep
        return out

    def inputs_at(self, time: Array) -> tuple[Array, Array]:
        """Return controls (n, nu) and applied forces (n, nv) of the motion laws at times (n,)."""
        controls = np.tile(self.keyframe_values["ctrl"], (len(time), 1))
        forces = np.zeros((len(time), self.model.nv))
        for index, law in zip(self.controlled, self.ctrl.values(), strict=True):
            controls[:, index] = law(time)[0]
        for name, dof, law in self._drives:
            forces[:, dof] = self.drive_inertias[name][0] * law(time)[2]
        return controls, forces

    @cached_property
    def keyframe_values(self) -> Mapping[str, Array]:
        """Initial activations, controls and mocap poses, which are not part of the state."""
        data = mujoco.MjData(self.model)
        if self.key is not None:
            mujoco.mj_resetDataKeyframe(self.model, data, self.model.key(self.key).id)
        return {
            "act": data.act.copy(),
            "ctrl": data.ctrl.copy(),
            "mpos": data.mocap_pos.ravel().copy(),
            "mquat": data.mocap_quat.ravel().copy(),
        }

    @property
    def _drives(self) -> list[tuple[str, int, State]]:
        """Name, degree of freedom and motion law of each prescribed joint."""
        dofs = [int(dof) for dof in self.driven_dofs]
        return [*zip(self.joint_laws, dofs, self.joint_laws.values(), strict=True)]


@quiet()
def scene_of(
    read: MjcfModel,
    mechanism: Mechanism,
    *,
    joint_laws: Mapping[str, State] | None = None,
    ctrl: Mapping[str, State] | None = None,
    duration: float = 1.0,
    points: Mapping[str, tuple[str, Vector]] | None = None,
    key: str | None = None,
    started: bool = False,
) -> UserScene:
    """Return a scene and its motion.

    Without prescribed joints, the motion starts in the state in which the file was read, at rest or with the
    rates of a keyframe. With prescribed joints, it starts in the assembled state and with the rates of their
    motion laws.

    Args:
        read: contents of the file.
        mechanism: the same mechanism with lengths precise enough for its loops to close
            (`KinematicSolver.mechanism`); closure is measured at its drivers.
        joint_laws: prescribed joint -> its motion law.
        ctrl: actuator -> motion law of its control.
        duration: in [s].
        points: tracked points: name -> (link, position in its frame in [m]); None for body origins and the
            points at which joints close the loops.
        key: initial keyframe, if the file was read in one.
        started: whether it starts in the assembly of the mechanism's guess, as selected by a user.

    Raises:
        InputError: for an unknown actuator or joint, or motion laws without a start.
        AssemblyError: if the loops do not close at the start of the motion laws.
    """
    joint_laws, ctrl = joint_laws or {}, ctrl or {}
    if not 0.0 < duration < np.inf:
        raise InputError(f"the duration is {duration} s; give a finite time above 0")
    spec, fixed = parse_file(read.source)[0], None
    if read.fixed:
        fixed = fix_bodies_in_scene(spec, plainly_compiled(spec), read.fixed, key)
    plain = plainly_compiled(spec)
    actuators, joints = actuator_names(plain), {plain.joint(i).name for i in range(plain.njnt)}
    if unknown := [name for name in ctrl if name not in actuators]:
        raise InputError(
            f"--ctrl names {unknown[0]!r}{did_you_mean(unknown[0], actuators)}; "
            f"actuators of the model are {listed(actuators)}"
        )
    if other := [name for name in mechanism.drivers if name not in joints]:
        # the coordinate of a point or the pose of a body
        raise InputError(f"{other[0]} is no joint; a plain MuJoCo scene is driven by joints: drive joints")
    named = plainly_compiled(read.spec.copy())
    bodies = {link_name(named, b): b for b in range(1, named.nbody) if named.body_jntnum[b]} | {GROUND: 0}
    if points is None:
        points = _all_points(mechanism, named)
    closure = exact_closure(replace(mechanism, points=dict(points)), plain, bodies)
    joint_names = [joint.name for joint in mechanism.joints[: plain.njnt]]
    inertias = _add_drive_inertias(spec, plain, mechanism, tuple(joint_laws))
    model = with_scaled_tolerance(plain, plainly_compiled(spec), spec) if inertias else plain
    start = read.qpos.copy(), np.zeros(model.nv) if key is None else model.key(key).qvel.copy()
    if started:
        poses, values = start_poses(mechanism)
        links = {name: Pose(pose.position[None], pose.rotation[None]) for name, pose in poses.items()}
        start = states_of(named, {name: np.array([x]) for name, x in values.items()}, links)[0], start[1]
    if joint_laws:
        # the assembled state and the velocities at the start of motion laws
        first = {name: [float(values[0]) for values in law(np.zeros(1))] for name, law in joint_laws.items()}
        closed = closure.moved_to(start[0], {name: value for name, (value, _, _) in first.items()})
        speeds = {name: rate for name, (_, rate, _) in first.items()}
        start = closed, closure.rates(closed, speeds)
    return UserScene(
        read.path,
        model,
        start,
        float(duration),
        closure,
        {name: (bodies[link], np.array(local)) for name, (link, local) in points.items()},
        {name: joint_names.index(name) for name in joint_laws},
        dict(joint_laws),
        dict(ctrl),
        inertias,
        key,
        float(plain.stat.meaninertia / model.stat.meaninertia),
        fixed,
        assembled_start=started,
    )


def with_assembled_start(scene: UserScene) -> UserScene:
    """Return a scene that starts in the nearest assembled state, with unchanged drivers.

    Raises:
        AssemblyError: if no assembled state is near.
    """
    qpos, qvel = scene.start
    closed, violation = scene.closure.closed(qpos[None])
    if not violation[0] <= ASSEMBLED:
        raise AssemblyError(
            f"{scene.path}: its loops are open at the start, and no nearby pose closes them; start from "
            "another keyframe (--key)"
        )
    return replace(scene, start=(closed[0], qvel), assembled_start=True)


def spec_of(scene: UserScene) -> mujoco.MjSpec:
    """Return the specification of a scene's file with its fixed bodies fixed."""
    spec = parse_file(scene.path)[0]
    if scene.fixed_bodies is not None:
        fix_bodies_in_scene(spec, plainly_compiled(spec), scene.fixed_bodies.joints, scene.key)
    return spec


def _all_points(mechanism: Mechanism, model: mujoco.MjModel) -> dict[str, tuple[str, Vector]]:
    """Return the origins of all moving bodies, and the points at which joints close the loops."""
    frames = carriers(model)
    points = {
        model.body(b).name: (frames[b].link, vector(frames[b].pose.position))
        for b in range(1, model.nbody)
        if frames[b].link != GROUND
    }
    for joint in mechanism.joints[model.njnt :]:
        for end in (joint.a, joint.b):
            point = (end.link, end.point)
            if end.link != GROUND and point not in points.values():
                points[f"{joint.name}@{end.link}"] = point
    return points


def _add_drive_inertias(
    spec: mujoco.MjSpec, model: mujoco.MjModel, mechanism: Mechanism, names: tuple[str, ...]
) -> dict[str, tuple[float, float]]:
    """Add virtual inertia to joints, so large that only the drive force moves them."""
    weight = model.body_mass.sum() * mechanism.characteristic_length**2 + model.body_inertia.max(1).sum()
    order = [joint.name for joint in mechanism.joints[: model.njnt]]
    joints = sorted(spec.joints, key=lambda joint: joint.id)
    inertias: dict[str, tuple[float, float]] = {}
    for name in names:
        joint = joints[order.index(name)]
        slides = joint.type == mujoco.mjtJoint.mjJNT_SLIDE
        inertia = float(
            f"{DRIVE_INERTIA_RATIO * weight / (mechanism.characteristic_length**2 if slides else 1.0):.3g}"
        )
        inertias[name] = inertia, float(joint.armature)
        joint.armature = inertia
    return inertias


def with_scaled_tolerance(
    plain: mujoco.MjModel, driven: mujoco.MjModel, spec: mujoco.MjSpec
) -> mujoco.MjModel:
    """Return a model with virtual drive inertia whose solver is as precise as without it.

    MuJoCo scales its solver tolerance with the mean inertia; drive inertia would stop the solver early.
    """
    spec.option.tolerance *= plain.stat.meaninertia / driven.stat.meaninertia
    driven.opt.tolerance = spec.option.tolerance
    return driven


@contextmanager
def scene_file(model: Any) -> Generator[str]:
    """Yield the path of a model's MJCF file; for other models the file is temporary.

    Args:
        model: an MJCF file, or any input of `mechsim.load`.
    """
    if isinstance(model, str | PathLike) and fspath(model).lower().endswith(".xml"):
        yield fspath(model)
        return
    solver = load(model, still=True)
    if solver.source is not None:
        spec = solver.source.spec.copy()
    else:
        spec = assembled(described(solver), Scene(level="dynamics", forces=solver.forces))
    with TemporaryDirectory(prefix="mechsim-") as folder:
        path = Path(folder) / f"{solver.name.replace(' ', '_')}.xml"
        path.write_text(to_xml(spec), encoding="utf-8")
        yield str(path)


def open_scene(
    path: str,
    *,
    ctrl: Mapping[str, str | float] | None = None,
    track: Iterable[str] = (),
    key: str | None = None,
    duration: str | float | None = None,
    **options: Any,
) -> tuple[UserScene, tuple[str, ...]]:
    """Return the scene of an MJCF file and its prescribed motion, and notes on changes made to read it.

    Args:
        path: path of the file.
        ctrl: actuator -> its control as text, such as "255*(0.5-0.5*cos(2*pi*t))", "FILE.csv" or a number.
        track: recorded points, as for `mechsim.load`.
        key: initial keyframe.
        duration: in [s] or as text; by default that of the motion laws.
        options: `drive`, `lock` and other arguments of `mechsim.load`.

    Raises:
        InputError: for a joint, actuator, keyframe or point that is missing.
        AssemblyError: if the loops do not close at the start of the motion laws.
    """
    seconds = si(duration, "s", "the duration")
    # without motion laws of joints the duration is that of the controls
    driven = bool(options.get("drive"))
    own = seconds if driven else None
    solver = load(path, track=track, key=key, duration=own, still=not driven, **options)
    mechanism = solver.mechanism
    if not mechanism.drivers:
        # actuators between sites: closure is measured at independent joints
        mechanism = replace(mechanism, driver=tuple(undetermined_joints(mechanism)))
    joint_laws = dict(solver.motion_laws.by_name)
    joint_laws |= {name: steady(value, 0.0) for name, value in solver.mechanism.locked.items()}
    controls = control_laws({name: str(law) for name, law in (ctrl or {}).items()})
    laws: dict[str, State] = {**joint_laws, **controls}
    points: dict[str, tuple[str, Vector]] | None = dict(solver.mechanism.points) if track else None
    scene = scene_of(
        solver.source,
        mechanism,
        joint_laws=joint_laws,
        ctrl=controls,
        duration=duration_of(seconds, None, laws),
        points=points,
        key=key,
        started=bool(options.get("start")),
    )
    return scene, tuple(f"{solver.name}: {fact}" for fact in solver.facts)


def require_mjcf(path: str) -> None:
    """Raise InputError for a model that is not an MJCF file, whose settings could be changed."""
    if not path.lower().endswith(".xml"):
        written = shlex.quote(f"{Path(path).stem}.xml")
        raise InputError(
            f"{path!r} is not an MJCF file, whose MuJoCo settings this command changes; write one with "
            f"`mechsim export {shlex.quote(path)} -o {written}` and name that file"
        )


def python_laws(scene: UserScene) -> dict[str, str]:
    """Return the laws of joints and controls as Python expressions of t: name -> expression."""
    return {name: _expression(law) for name, law in {**scene.joint_laws, **scene.ctrl}.items()}


def _expression(law: State) -> str:
    text = getattr(law, "text", "")
    if text.lower().endswith(files.EXTENSIONS):
        return f"table({text!r})(t)"
    if re.search(r"\bt\b", text):
        return python_expression(text)
    value, rate, _ = (float(item[0]) for item in law(np.zeros(1)))
    return repr(value) if not rate else f"{value!r} + {rate!r} * t"
