"""Negative damping, friction and armature; dampers and springs too stiff for the time step."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from mechsim.mechanism.finding import Finding
from mechsim.numerics.arrays import Array
from mechsim.simulation.findings.compliance import AMPLIFICATION, GapDynamics, stable_step
from mechsim.simulation.findings.inspected import OFF, Element, Inspected, null_space
from mechsim.simulation.findings.predicted_gap import EULER, IMPLICIT, moment_arms
from mechsim.simulation.mjcf_reader.coordinates import actuator_names
from mechsim.simulation.plain_settings import option_value
from mechsim.simulation.state import SCALAR, data_at, is_disabled, mass_matrix

# growth in a step, less 1, above which a motion is unstable; rounding of eigenvalues leaves 1e-8
GROWTH = 1e-6


# attributes of joints, of which a tendon has the first two
LOSSES = ("damping", "frictionloss", "armature")


def negative_losses(scene: Inspected) -> Iterator[Finding]:
    """Yield joints and tendons with negative damping, Coulomb friction or armature."""
    spec = scene.read.spec
    attributes: list[tuple[str, Any, str]] = [
        ("joint", each, name) for each in spec.joints for name in LOSSES
    ]
    attributes += [("tendon", each, name) for each in spec.tendons for name in LOSSES[:2]]
    for label, element, attribute in attributes:
        value = float(np.ravel(getattr(element, attribute))[0])
        if value < 0.0:
            message = f"{label} {element.name} has a {attribute} of {value:g}, which adds energy"
            yield scene.finding("negative", element, abs(value), message, "write 0 or more")


@dataclass(frozen=True, eq=False)
class _SpringDamper:
    """A damper and a spring along one direction of motion.

    Attributes:
        label: its kind and name.
        element: of the file; None for an unnamed tendon.
        arm: rate of its length per rate of each DOF, (nv,).
        damping: force per rate of its length; 0 or more.
        stiffness: force per length; 0 or more.
        always: whether every implicit treatment includes its damping, that of Euler too.
    """

    label: str
    name: str
    element: Element | None
    arm: Array
    damping: float
    stiffness: float
    always: bool = False

    def shares(self, direction: Array, step: float) -> tuple[float, float]:
        """Return the shares of damping, with the limit h d / m = 2, and stiffness, h^2 k / m = 4."""
        square = float(np.abs(self.arm @ direction) ** 2)
        return 0.5 * step * self.damping * square, 0.25 * step**2 * self.stiffness * square


def too_stiff_for_step(scene: Inspected) -> Iterator[Finding]:
    """Yield the damper or spring that makes the motion unstable with the integrator and the time step."""
    model = scene.model
    integrator, step = int(model.opt.integrator), float(model.opt.timestep)
    if integrator not in AMPLIFICATION:
        return
    worst: tuple[float, Array, _Motion] | None = None
    for qpos, (jacobian, _) in zip(scene.sample_states, scene.sample_jacobians, strict=True):
        elements = _springs_and_dampers(scene, qpos)
        dampers = [damper for damper in elements if damper.damping or damper.stiffness]
        motion = _Motion(null_space(jacobian), mass_matrix(data_at(model, qpos)), dampers)
        if not dampers or not len(motion.free):
            continue
        growth, direction = motion.growth(model, integrator, step)
        if worst is None or growth > worst[0]:
            worst = growth, direction, motion
    if worst is None or worst[0] <= 1.0 + GROWTH:
        return
    growth, direction, motion = worst
    damper = max(motion.dampers, key=lambda damper: sum(damper.shares(direction, step)))
    by_damping, by_stiffness = damper.shares(direction, step)
    quantity = "damping" if by_damping > by_stiffness else "stiffness"
    stable = stable_step(lambda shorter: motion.growth(model, integrator, shorter)[0] <= 1.0 + GROWTH, step)
    remedy = f"take a step of {stable:.2g} s"
    if integrator not in IMPLICIT and motion.growth(model, IMPLICIT[1], step)[0] <= 1.0 + GROWTH:
        remedy = f'take integrator="implicitfast", or a step of {stable:.2g} s'
    message = (
        f"the {quantity} of {damper.label} is too large for the step of {step:g} s with "
        f"{option_value('integrator', integrator)}: a motion grows {growth:.3g}-fold a step"
    )
    yield scene.finding("explicit", damper.element, step / stable, message, remedy, damper.name)


@dataclass(frozen=True, eq=False)
class _Motion:
    """Motions that the loops allow, linear at a state: M v' = -D v - K q.

    Attributes:
        free: basis of these motions, (k, nv).
        mass: mass matrix, (nv, nv).
        dampers: dampers and springs.
    """

    free: Array
    mass: Array
    dampers: Sequence[_SpringDamper]

    def growth(self, model: mujoco.MjModel, integrator: int, step: float) -> tuple[float, Array]:
        """Return the largest growth in a step, and its direction (nv,).

        With an implicitly treated damping matrix D', the step solves (M + h D') (v1 - v0) = -h (D v0 + K q0).
        """
        euler = integrator == EULER and not is_disabled(model, OFF.mjDSBL_EULERDAMP)
        treated = [integrator in IMPLICIT or (euler and damper.always) for damper in self.dampers]
        rates = [damper.damping for damper in self.dampers]
        damping, implicit = self._sum(rates), self._sum(np.multiply(rates, treated))
        stiffness = self._sum([damper.stiffness for damper in self.dampers])
        mass = self.free @ self.mass @ self.free.T + step * implicit
        inverse = np.linalg.inv(mass).astype(np.float64)
        reduced = GapDynamics(inverse @ damping, inverse @ stiffness)
        values, vectors = np.linalg.eig(AMPLIFICATION[integrator](reduced, step))
        worst = int(np.argmax(np.abs(values)))
        return float(np.abs(values[worst])), vectors[: len(self.free), worst] @ self.free

    def _sum(self, factors: Sequence[float] | Array) -> Array:
        """Return the sum of the dampers' matrices with factors, in the free motions, (k, k)."""
        arms = np.array([self.free @ damper.arm for damper in self.dampers])
        return arms.T @ (np.array(factors)[:, None] * arms)


def _springs_and_dampers(scene: Inspected, qpos: Array) -> Iterator[_SpringDamper]:
    """Yield the dampers and springs of joints, tendons and servos at a state; negative ones count as 0."""
    model, spec = scene.model, scene.read.spec
    damps, springs = (not is_disabled(model, flag) for flag in (OFF.mjDSBL_DAMPER, OFF.mjDSBL_SPRING))
    for dof in range(model.nv):
        joint = int(model.dof_jntid[dof])
        name, scalar = str(model.joint(joint).name), int(model.jnt_type[joint]) in SCALAR
        damping = damps * _linear(model.dof_damping[dof])
        stiffness = springs * scalar * _linear(model.jnt_stiffness[joint])
        arm = np.eye(model.nv)[dof]
        yield _SpringDamper(f"joint {name}", name, spec.joint(name), arm, damping, stiffness, always=True)
    for t, arm in enumerate(_tendon_arms(scene, qpos)):
        name = str(model.tendon(t).name)
        damping = damps * _linear(model.tendon_damping[t])
        stiffness = springs * _linear(model.tendon_stiffness[t])
        yield _SpringDamper(f"tendon {name}", name, spec.tendon(name), arm, damping, stiffness)
    if is_disabled(model, OFF.mjDSBL_ACTUATION):
        return
    for a, arm in enumerate(moment_arms(scene, qpos)):
        name, affine = actuator_names(model)[a], model.actuator_biastype[a] == mujoco.mjtBias.mjBIAS_AFFINE
        kp, kv = (affine * max(-float(model.actuator_biasprm[a, k]), 0.0) for k in (1, 2))
        yield _SpringDamper(f"actuator {name}", name, spec.actuators[a], arm, kv, kp)


def _linear(coefficients: Array) -> float:
    """Return the linear part of a damping or stiffness, which may be a polynomial; at least 0."""
    return max(float(np.ravel(coefficients)[0]), 0.0)


def _tendon_arms(scene: Inspected, qpos: Array) -> Array:
    """Return the rates of the lengths of tendons per rate of each DOF, (ntendon, nv)."""
    model = scene.model
    dense = np.zeros((model.ntendon, model.nv))
    if model.ntendon:
        data = data_at(model, qpos)
        mujoco.mju_sparse2dense(dense, data.ten_J, model.ten_J_rownnz, model.ten_J_rowadr, model.ten_J_colind)
    return dense
