"""Recorded states as a motion: positions, rates, accelerations, and the forces on moved coordinates."""

import copy
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import mujoco
import numpy as np
from mujoco import batch
from numpy.typing import NDArray

from mechsim.mechanism.motion import JointMotion, LinkMotion, Motion, PointMotion, Source, join, mapped
from mechsim.numerics.arrays import Array, cross
from mechsim.numerics.resources import Progress, no_progress
from mechsim.simulation import loop_jacobian
from mechsim.simulation.drivers import PARAMETER_JOINT
from mechsim.simulation.equality_rows import CouplingConstraint, RodPair, chained, rates
from mechsim.simulation.model_loops import ModelLoops
from mechsim.simulation.state import (
    HINGE,
    ONE_THREAD,
    gravity,
    has_dry_friction,
    scalar_joints,
)

if TYPE_CHECKING:
    from mechsim.numerics.banded import SparseMatrices


def followers(loops: ModelLoops) -> list[CouplingConstraint]:
    """Return the nonlinear couplings of coordinates that depend on the drivers only."""
    return [row for row in _chain(loops) if row.nonlinear]


def actuated_dofs(loops: ModelLoops) -> NDArray[np.int64]:
    """Return the DOFs that forces move: the crank or all drivers, then nonlinear followers."""
    nonlinear = [int(row.left.dofs[0]) for row in followers(loops)]
    return np.array([*loops.driven_dofs, *nonlinear], dtype=np.int64)


def actuated_rates(loops: ModelLoops, angle: Array, speed: Array) -> Array:
    """Return the rates of `actuated_dofs`, (n, k), at angles and speeds of the crank, (n,)."""
    value, rate, _ = loops.drivers.law(angle)
    values = {loops.crank_address: angle} | dict(zip(loops.drivers.addresses.tolist(), value, strict=True))
    speeds = {loops.crank: speed} | dict(zip(loops.drivers.dofs.tolist(), rate * speed, strict=True))
    chained_rates = rates(_chain(loops), values, speeds)
    return np.stack([chained_rates[int(dof)] for dof in actuated_dofs(loops)], 1)


def _chain(loops: ModelLoops) -> list[CouplingConstraint]:
    return chained(loops.couplings, loops.driven_dofs.tolist())


OFF = mujoco.mjtDisableBit
# flags that disable forces that may be large: actuators, springs and dampers
FORCE_FLAGS = int(OFF.mjDSBL_ACTUATION) | int(OFF.mjDSBL_SPRING) | int(OFF.mjDSBL_DAMPER)
# number of states evaluated together, which limits memory
CHUNK = 2048
RATES = {
    "linvel": mujoco.mjtSensor.mjSENS_FRAMELINVEL,
    "angvel": mujoco.mjtSensor.mjSENS_FRAMEANGVEL,
    "linacc": mujoco.mjtSensor.mjSENS_FRAMELINACC,
    "angacc": mujoco.mjtSensor.mjSENS_FRAMEANGACC,
}


@dataclass(frozen=True, slots=True)
class Track:
    """The recorded points, links and coordinates of a model.

    Attributes:
        points: names of the sites.
        links: names of the bodies.
        hidden: links of the model that motions leave out.
        coordinates: joint of the model -> name of its coordinate, and its index in a joint with several;
            others are recorded by their own names.
    """

    points: tuple[str, ...]
    links: tuple[str, ...]
    hidden: frozenset[str] = frozenset()
    coordinates: Mapping[str, tuple[str, int | None]] = field(
        default_factory=dict[str, tuple[str, int | None]]
    )

    def name(self, joint: str) -> tuple[str, int | None]:
        """Return the name of a joint's coordinate, and its index in a joint with several."""
        return self.coordinates.get(joint, (joint, None))


def add_sensors(spec: mujoco.MjSpec, points: tuple[str, ...]) -> Track:
    """Add the sensors that `evaluate` reads to a specification; they are off while the model is stepped.

    Args:
        spec: of the model; bodies without a name get one.
        points: names of the sites to track.
    """
    for i, body in enumerate(spec.bodies[1:]):
        body.name = body.name or f"body{i + 1}"
    body_kind, site_kind = mujoco.mjtObj.mjOBJ_XBODY, mujoco.mjtObj.mjOBJ_SITE
    links = tuple(body.name for body in spec.bodies[1:])
    sensors = [(body_kind, link, f"{link}:{rate}", kind) for link in links for rate, kind in RATES.items()]
    for rate in ("linvel", "linacc"):
        sensors += [(site_kind, point, f"{point}.{rate}", RATES[rate]) for point in points]
    for object_kind, owner, name, kind in sensors:
        spec.add_sensor(name=name, type=kind, objtype=object_kind, objname=owner)
    return Track(points, links)


@dataclass(frozen=True, slots=True)
class States:
    """Recorded states, and accelerations and forces there if they are known.

    Attributes:
        time: (n,) in [s].
        qpos: (n, nq).
        qvel: (n, nv).
        crank_acceleration: (n,) in [rad/s2].
        driver_acceleration: of the drivers, (n, drivers), if it differs from their motion laws.
        force: generalised force on the crank, (n,) in [N m]; or on `actuated_dofs`, (n, k).
    """

    time: Array
    qpos: Array
    qvel: Array
    crank_acceleration: Array | None = None
    driver_acceleration: Array | None = None
    force: Array | None = None

    def chunk(self, first: int) -> "States":
        """Return the chunk of states from an index on."""
        return mapped(lambda array: array[first : first + CHUNK], self)


def evaluate(
    loops: ModelLoops, track: Track, states: States, source: Source, progress: Progress = no_progress
) -> Motion:
    """Return the motion at recorded states.

    With a known acceleration of the crank, all others are those that keep the loops closed exactly. Otherwise
    they are the result of MuJoCo's dynamics at the state; with Coulomb friction, the crank's acceleration is
    MuJoCo's, and all others keep the loops closed.

    Args:
        loops: of the model the states belong to.
        track: points, links and coordinates to record.
        states: n recorded states.
        source: the method that computed them.
        progress: callback with the progress as text and as a fraction.
    """
    n, chunks = len(states.time), list[Motion]()
    for i in range(0, n, CHUNK):
        chunks.append(_evaluated(loops, track, states.chunk(i), source))
        progress(f"{min(i + CHUNK, n):,} of {n:,} poses", min(i + CHUNK, n) / n)
    return join(chunks)


def _evaluated(loops: ModelLoops, track: Track, states: States, source: Source) -> Motion:
    # a given crank acceleration determines all others: MuJoCo's soft constraints need not be solved. Servos
    # against a drive, springs and dampers would accelerate light links so much that digits would be lost
    model = copy.copy(loops.model)
    model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_SENSOR)
    crank_acceleration, driver_acceleration = states.crank_acceleration, states.driver_acceleration
    if crank_acceleration is not None:
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT) | FORCE_FLAGS
    # the model has the Taylor polynomials of functions at one state only
    functions = [row.equality for row in loops.couplings if row.function is not None]
    model.eq_active0[functions] = 0
    n = len(states.time)
    sims = batch.Batch(model, n, 1 if n <= ONE_THREAD else 0)
    sims.bind("qpos")[:] = states.qpos
    sims.bind("qvel")[:] = states.qvel
    if states.force is not None:
        sims.bind("qfrc_applied")[:, actuated_dofs(loops)] = states.force.reshape(n, -1)
    fields = {name: sims.bind(name) for name in ("xpos", "xmat", "site_xpos", "sensordata", "qacc")}
    sims.forward()
    links, points = link_motions(model, track, fields), point_motions(model, track, fields)
    qacc = fields["qacc"].copy()
    residual, jacobian = loops.linearised(states.qpos)
    nonlinear = any(row.nonlinear for row in (*loops.couplings, *loops.rods))
    if crank_acceleration is None and (has_dry_friction(model) or nonlinear):
        # while friction sticks or reverses, soft loops oscillate about the motion; the force of a follower is
        # constant over each step; MuJoCo's constraints of rods and polynomials omit the velocity-product term
        crank_acceleration = qacc[:, loops.crank].copy()
        driver_acceleration = qacc[:, loops.drivers.dofs].copy()
    if crank_acceleration is not None:
        # after this change of MuJoCo's accelerations, (n, nv), the loops stay closed exactly
        change, opened = np.zeros_like(qacc), closure_acceleration(loops, states, qacc, links)
        change[:, loops.crank] = crank_acceleration - qacc[:, loops.crank]
        if driver_acceleration is not None:
            opened[:, loops.driven_rows] = qacc[:, loops.drivers.dofs] - driver_acceleration
        if opened.shape[1]:
            right = opened + _column(jacobian, loops.crank) * change[:, [loops.crank]]
            change[:, loops.free] = loop_jacobian.solve(loops, jacobian, -right[..., None])[..., 0]
        qacc += change
        links, points = _accelerated(loops, change, links, points)
    return Motion(
        source,
        states.qpos[:, loops.crank_address],
        states.qvel[:, loops.crank],
        qacc[:, loops.crank],
        points,
        {name: link for name, link in links.items() if name not in track.hidden},
        _joints(loops, track, states, qacc),
        time=states.time,
        closure=np.abs(residual[:, loops.point_rows]).max(1, initial=0.0),
        conditioning=loop_jacobian.conditioning(loops, jacobian),
        drivers=loops.drivers.names,
    )


def _column(jacobian: "Array | SparseMatrices", column: int) -> Array:
    """Return a column of Jacobians, (n, m)."""
    return jacobian[:, :, column] if isinstance(jacobian, np.ndarray) else jacobian.column(column).T


def _accelerated(
    loops: ModelLoops, change: Array, links: Mapping[str, LinkMotion], points: Mapping[str, PointMotion]
) -> tuple[dict[str, LinkMotion], dict[str, PointMotion]]:
    """Return links and points at the states of the last evaluation of the loops, with accelerations changed.

    Args:
        loops: of the model.
        change: of the accelerations of the DOFs, (n, nv).
        links: motions of links.
        points: motions of points.
    """
    model = loops.model
    bodies = [model.body(name).id for name in links]
    bodies += [int(model.site_bodyid[model.site(name).id]) for name in points]
    index, dofs = loops.posed.moving_dofs(np.array(bodies, dtype=np.intp))
    position = np.stack(
        [*(link.position for link in links.values()), *(point.position for point in points.values())], 1
    )
    rates = loops.posed.rates(np.array(bodies)[index], dofs, position[:, index])
    # the entries of a body follow one another; the ground has none
    moved, first = np.unique(index, return_index=True)
    linear, angular = np.zeros_like(position), np.zeros_like(position)
    for total, rate in zip((linear, angular), rates, strict=True):
        total[:, moved] = np.add.reduceat(rate * change[:, dofs, None], first, axis=1)
    new_links = {
        name: replace(
            link,
            acceleration=link.acceleration + linear[:, i],
            angular_acceleration=link.angular_acceleration + angular[:, i],
        )
        for i, (name, link) in enumerate(links.items())
    }
    new_points = {
        name: replace(point, acceleration=point.acceleration + linear[:, i])
        for i, (name, point) in enumerate(points.items(), len(links))
    }
    return new_links, new_points


def _sensors(model: mujoco.MjModel, fields: Mapping[str, Array]) -> dict[str, Array]:
    """Return the values of all sensors, name -> (n, 3)."""
    return {
        model.sensor(i).name: fields["sensordata"][:, adr : adr + 3] for i, adr in enumerate(model.sensor_adr)
    }


def point_motions(model: mujoco.MjModel, track: Track, fields: Mapping[str, Array]) -> dict[str, PointMotion]:
    """Return the motion of each point from fields site_xpos and sensordata of a batch at n states."""
    sensors, weight = _sensors(model, fields), gravity(model)
    return {
        name: PointMotion(
            fields["site_xpos"][:, model.site(name).id],
            sensors[f"{name}.linvel"],
            sensors[f"{name}.linacc"] + weight,
        )
        for name in track.points
    }


def link_motions(model: mujoco.MjModel, track: Track, fields: Mapping[str, Array]) -> dict[str, LinkMotion]:
    """Return the motion of each link from fields xpos, xmat and sensordata of a batch at n states."""
    sensors, weight = _sensors(model, fields), gravity(model)
    return {
        name: LinkMotion(
            fields["xpos"][:, model.body(name).id],
            fields["xmat"][:, model.body(name).id].reshape(-1, 3, 3),
            sensors[f"{name}:linvel"],
            sensors[f"{name}:angvel"],
            # MuJoCo's accelerometers measure gravity as an upward acceleration of the world
            sensors[f"{name}:linacc"] + weight,
            sensors[f"{name}:angacc"],
        )
        for name in track.links
    }


def closure_acceleration(
    loops: ModelLoops, states: States, qacc: Array, links: Mapping[str, LinkMotion]
) -> Array:
    """Return the second time derivative of the constraint residuals at given accelerations, (n, m)."""
    model = loops.model
    rates = list[Array]()
    motions = {model.body(name).id: link for name, link in links.items()} | {0: resting(len(qacc))}
    for pair in (*loops.pairs, *loops.rods):
        a, b = (point_rates(motions[body], local) for body, local in pair.ends)
        gap, speed, acceleration = (first - second for first, second in zip(a, b, strict=True))
        if isinstance(pair, RodPair):
            acceleration = pair.along(gap) * acceleration + pair.along(speed) * speed
            acceleration = acceleration.sum(1, keepdims=True)
        rates.append(acceleration)
    for pair in loops.frames:
        a, b = (motions[body] for body in pair.bodies)
        apart = a.angular_acceleration - b.angular_acceleration
        apart = apart - np.cross(b.angular_velocity, a.angular_velocity)
        rates.append((pair.rotation_error(a.rotation, b.rotation)[1] @ apart[..., None])[..., 0])
    for coupling in loops.couplings:
        rows = coupling.jacobian(states.qpos, model.nv)
        rates.append(((rows * qacc).sum(1) - coupling.velocity_product(states.qpos, states.qvel))[:, None])
    _, first, second = loops.drivers.law(states.qpos[:, loops.crank_address])
    targets = first * qacc[:, loops.crank] + second * states.qvel[:, loops.crank] ** 2
    return np.concatenate([*rates, qacc[:, loops.drivers.dofs] - targets.T], 1)


def resting(n: int) -> LinkMotion:
    """Return the motion of the ground at n states."""
    still = np.zeros((n, 3))
    return LinkMotion(still, np.tile(np.eye(3), (n, 1, 1)), still, still, still, still)


def point_rates(link: LinkMotion, local: Array) -> tuple[Array, Array, Array]:
    """Return position, velocity and acceleration of a point of a link, (n, 3) each."""
    arm, spin = link.rotation @ local, link.angular_velocity
    swing = cross(spin, arm)
    acceleration = link.acceleration + cross(link.angular_acceleration, arm) + cross(spin, swing)
    return link.position + arm, link.velocity + swing, acceleration


def _joints(loops: ModelLoops, track: Track, states: States, qacc: Array) -> dict[str, JointMotion]:
    model, joints = loops.model, {}
    for name, i in scalar_joints(model).items():
        if name and name != PARAMETER_JOINT:
            (called, index), unit = track.name(name), "rad" if model.jnt_type[i] == HINGE else "m"
            dof, value = model.jnt_dofadr[i], states.qpos[:, model.jnt_qposadr[i]]
            joints[called] = JointMotion(value, states.qvel[:, dof], qacc[:, dof], unit, index)
    return joints
