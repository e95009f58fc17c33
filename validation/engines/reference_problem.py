"""What every engine of the table gets: a mechanism of `reference/`, one turn of its crank, the exact answers.

`mechsim export` writes the mechanism in MJCF, and MuJoCo's compiler reads it. An engine that reads MJCF takes
the compiled model; another one builds its bodies, joints and loops from the same numbers. A flywheel on the
crank keeps its speed, so that no engine needs a motor: its inertia times its deceleration is the torque.

Five mechanisms of `reference/` have several drivers that follow programs. A flywheel cannot follow one, so
they have no row.
"""

import copy
import csv
import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import mechsim as ms
from mechsim.simulation import loop_jacobian
from mechsim.simulation.model_loops import read_loops

Array = NDArray[np.float64]
REFERENCE = Path(__file__).parents[2] / "reference"
# name of the driver in the models that mechsim writes
CRANK = "crank"
# inertia of the flywheel over what the largest torque stops in a radian: the speed changes by about 1e-10
FLYWHEEL = 1e10
# a start that is not that of the reference would be judged as an error of the engines; in [m]
START_TOLERANCE = 1e-9
DEFAULT_SOLREF, DEFAULT_SOLIMP = (0.02, 1.0), (0.9, 0.95, 0.001, 0.5, 2.0)


class Unsupported(Exception):  # noqa: N818 - an outcome, not an error
    """What a mechanism needs and an engine lacks."""


@dataclass(frozen=True)
class Poses:
    """Where the bodies are at the instants of the reference after the first.

    Attributes:
        position, rotation: of the frames of the bodies in the order of the model, (n, bodies, 3) in [m] and
            (n, bodies, 3, 3).
        torque: of the drive, (n,) in [N m]; None if the engine does not yield it.
        seconds: processor time of the steps alone.
    """

    position: Array
    rotation: Array
    torque: Array | None
    seconds: float


@dataclass(frozen=True)
class Setting:
    """How an engine steps; the first of its settings is its default.

    Attributes:
        name: as the table prints it, without the step.
        step: in [s], rounded so that a whole number of steps leads from one instant of the reference to the
            next; a negative number is -steps between two instants.
        options: what the engine's adapter understands.
    """

    name: str
    step: float
    options: Any = None

    def steps(self, interval: float) -> int:
        """Return the number of steps between two instants of the reference."""
        return max(1, round(interval / self.step)) if self.step > 0 else round(-self.step)


class Engine(Protocol):
    """A module `by_NAME` of this folder; an engine's authors add theirs with these four names."""

    NAME: str
    PACKAGE: str
    SETTINGS: Sequence[Setting]

    def run(self, problem: "Problem", setting: Setting) -> Poses:
        """Return the poses of one turn; raise `Unsupported` for a mechanism that it cannot describe."""
        ...


@dataclass(frozen=True)
class Loop:
    """Two bodies that an equality constraint of the model holds together, at frames in each of them.

    Attributes:
        weld: whether the frames coincide; otherwise their origins alone do.
        bodies: index of each body.
        position, quaternion: of the frames in the bodies, (2, 3) in [m] and (2, 4), w first.
    """

    weld: bool
    bodies: tuple[int, int]
    position: Array
    quaternion: Array


@dataclass(frozen=True)
class JointCoupling:
    """Two joints j1 and j2 of the model with q1 - start1 = ratio (q2 - start2)."""

    joints: tuple[int, int]
    ratio: float


@dataclass(frozen=True)
class Problem:
    """A mechanism, its start and its exact motion.

    Attributes:
        model: MuJoCo's model with the flywheel and with MuJoCo's own options and constraint parameters.
        written: the same with the options and parameters that mechsim writes.
        moments: principal moments of inertia of the bodies without the flywheel, (bodies, 3) in [kg m2].
        qpos, qvel: consistent coordinates and velocities at the start.
        interval: between two instants of the reference, in [s].
        flywheel: its inertia in [kg m2].
        sites: the tracked points among the sites of the model.
        exact: their positions, (n, points, 3) in [m], and the drive torque, (n,) in [N m], after the start.
        characteristic_length: of the mechanism, to which errors refer, in [m].
    """

    name: str
    model: mujoco.MjModel
    written: mujoco.MjModel
    moments: Array
    qpos: Array
    qvel: Array
    interval: float
    flywheel: float
    sites: NDArray[np.int64]
    exact: tuple[Array, Array]
    characteristic_length: float

    @property
    def instants(self) -> int:
        return len(self.exact[1])

    @property
    def crank(self) -> int:
        """The joint of the crank; it is a hinge on the ground."""
        return self.model.joint(CRANK).id

    @cached_property
    def loops(self) -> list[Loop]:
        """The equality constraints between bodies."""
        model, result = self.model, []
        for kind, first, second in zip(model.eq_type, model.eq_obj1id, model.eq_obj2id, strict=True):
            if kind != mujoco.mjtEq.mjEQ_JOINT:
                ends = [first, second]
                bodies = (int(model.site_bodyid[first]), int(model.site_bodyid[second]))
                weld = kind == mujoco.mjtEq.mjEQ_WELD
                result.append(Loop(weld, bodies, model.site_pos[ends], model.site_quat[ends]))
        return result

    @cached_property
    def couplings(self) -> list[JointCoupling]:
        """The equality constraints between joints, which are linear in all mechanisms of `reference/`."""
        model = self.model
        rows = np.flatnonzero(model.eq_type == mujoco.mjtEq.mjEQ_JOINT)
        assert not model.eq_data[rows, 2:5].any()
        return [
            JointCoupling((int(model.eq_obj1id[i]), int(model.eq_obj2id[i])), float(model.eq_data[i, 1]))
            for i in rows
        ]

    def poses(self, qpos: Array, torque: Array | None, seconds: float) -> Poses:
        """Return the poses of all bodies at the model's coordinates (n, nq), by MuJoCo's kinematics."""
        data, model = mujoco.MjData(self.model), self.model
        position, rotation = np.empty((len(qpos), model.nbody, 3)), np.empty((len(qpos), model.nbody, 3, 3))
        for row, (p, r) in enumerate(zip(position, rotation, strict=True)):
            data.qpos[:] = qpos[row]
            mujoco.mj_kinematics(model, data)
            p[:], r[:] = data.xpos, data.xmat.reshape(-1, 3, 3)
        return Poses(position, rotation, torque, seconds)

    def errors(self, poses: Poses) -> tuple[float, float, float]:
        """Return the largest errors of points and loops, in sizes, and of the torque, in largest torques."""
        if not (np.isfinite(poses.position).all() and np.isfinite(poses.rotation).all()):
            return np.inf, np.inf, np.inf
        model, (points, torque) = self.model, self.exact
        computed = _in_ground(poses, model.site_bodyid[self.sites], model.site_pos[self.sites])
        position = float(np.linalg.norm(computed - points, axis=2).max())
        gap = max((_gap(poses, loop, self.characteristic_length) for loop in self.loops), default=np.nan)
        torque_error = np.nan
        if poses.torque is not None:
            torque_error = float(np.abs(poses.torque - torque).max() / np.abs(torque).max())
        return position / self.characteristic_length, gap, torque_error


def _in_ground(poses: Poses, bodies: NDArray[np.int64], local: Array) -> Array:
    """Return points (k, 3) of bodies (k,) in the ground frame, (n, k, 3) in [m]."""
    return poses.position[:, bodies] + np.einsum("nkij,kj->nki", poses.rotation[:, bodies], local)


def _gap(poses: Poses, loop: Loop, characteristic_length: float) -> float:
    """Return the largest distance between the ends of a loop in sizes, or a weld's angle if it is larger."""
    ends = _in_ground(poses, np.array(loop.bodies), loop.position)
    gap = float(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).max()) / characteristic_length
    if loop.weld:
        first, second = (
            poses.rotation[:, body] @ Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
            for body, quaternion in zip(loop.bodies, loop.quaternion, strict=True)
        )
        # |R1 - R2| of two rotations is 2 sqrt(2) times the sine of half the angle between them
        angle = np.linalg.norm(first - second, axis=(1, 2)).max() / np.sqrt(2.0)
        gap = max(gap, float(angle))
    return gap


def names() -> list[str]:
    """Return the mechanisms of `reference/` with one crank that turns steadily."""
    resources = json.loads((REFERENCE / "datapackage.json").read_text())["resources"]
    return [Path(item["path"]).stem for item in resources if item.get("crank_speed")]


def problem(name: str) -> Problem:
    """Return the problem of a mechanism of `reference/`."""
    path = REFERENCE / "mechanisms" / f"{name}.toml"
    package = json.loads((REFERENCE / "datapackage.json").read_text())
    resource = next(item for item in package["resources"] if item["path"] == f"data/{name}.csv")
    speed = float(resource["crank_speed"].split()[0])
    with (REFERENCE / resource["path"]).open() as file:
        rows = list(csv.DictReader(file))
    angle = np.array([float(row["angle"]) for row in rows])
    effort = next(column for column in rows[0] if column.startswith("torque:"))
    torque = np.array([float(row[effort]) for row in rows])
    points = [column[:-2] for column in rows[0] if column.endswith(".x")]
    exact = np.array([[[float(row[f"{p}.{axis}"]) for axis in "xyz"] for p in points] for row in rows])

    text = str(ms.export(path, scene="dynamics"))
    qpos = ms.closed_qpos(path, {effort.removeprefix("torque:"): angle[:1]})[0]
    written = mujoco.MjModel.from_xml_string(text)
    moments = written.body_inertia.copy()
    flywheel = _add_flywheel(written, torque, speed)
    loops = read_loops(written)
    qvel = speed * loop_jacobian.tangent(loops, loops.linearise(qpos[None])[1])[0]
    result = Problem(
        name,
        _plain(written),
        written,
        moments,
        qpos,
        qvel,
        float(angle[1] - angle[0]) / speed,
        flywheel,
        np.array([written.site(point).id for point in points]),
        (exact[1:], torque[1:]),
        loops.characteristic_length,
    )
    start = result.poses(qpos[None], None, 0.0)
    computed = _in_ground(start, written.site_bodyid[result.sites], written.site_pos[result.sites])
    assert np.abs(computed - exact[:1]).max() < START_TOLERANCE, name
    return result


def _add_flywheel(model: mujoco.MjModel, torque: Array, speed: float) -> float:
    """Add a flywheel to the crank of a model; return its inertia in [kg m2].

    The crank turns about an axis fixed in the ground, where only the moment about the axis matters: the
    flywheel has the same moment about all axes, which is a valid inertia in every engine.
    """
    body = model.jnt_bodyid[model.joint(CRANK).id]
    assert model.body_parentid[body] == 0
    flywheel = FLYWHEEL * float(np.abs(torque).max()) / speed**2
    model.body_inertia[body] += flywheel
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return flywheel


def _plain(written: mujoco.MjModel) -> mujoco.MjModel:
    """Return a copy with MuJoCo's own options and constraint parameters."""
    model, default = copy.copy(written), mujoco.MjModel.from_xml_string("<mujoco/>").opt
    gravity = model.opt.gravity.copy()
    for option in ("timestep", "integrator", "solver", "jacobian", "iterations", "tolerance", "disableflags"):
        setattr(model.opt, option, getattr(default, option))
    model.opt.gravity[:] = gravity
    model.eq_solref[:], model.eq_solimp[:] = DEFAULT_SOLREF, DEFAULT_SOLIMP
    return model
