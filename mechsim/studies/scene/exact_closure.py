"""Exact closure of a scene's loops, in the coordinates of MuJoCo's state.

Errors of a run are distances from the assembled state at the run's own driver positions.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from mechsim.errors import AssemblyError
from mechsim.kinematics.loops.mobility import driver_determinacy
from mechsim.kinematics.loops.start import ASSEMBLY
from mechsim.mechanism.mechanism import Mechanism
from mechsim.numerics.arrays import Array
from mechsim.numerics.loop_solver import LoopSystem
from mechsim.numerics.newton import newton
from mechsim.numerics.rank import least_norm
from mechsim.simulation.model_loops import loops_with_crank
from mechsim.simulation.poses.equations import ModelEquations, ModelStates

# largest residual of assembled loops, in characteristic lengths
ASSEMBLED = 1e-10
# largest driver displacement between two solutions on the path to a start, in [rad] or characteristic lengths
DRIVER_STEP = 0.02


@dataclass(frozen=True)
class ExactClosure:
    """The loops of a model, with its drivers prescribed.

    If the drivers leave degrees of freedom undetermined, as in a gripper with swinging pads, the solution is
    the nearest assembled configuration.

    Attributes:
        mechanism: mechanism read from the model, with the tracked points; its first joints are the model's.
        equations: the model's equality constraints.
        drivers: joints whose coordinates are prescribed.
        bodies: link, the ground included -> its body in the model.
    """

    mechanism: Mechanism
    equations: ModelEquations
    drivers: tuple[str, ...]
    bodies: Mapping[str, int]

    @cached_property
    def free(self) -> NDArray[np.intp]:
        """Degrees of freedom that are not prescribed."""
        return np.setdiff1d(np.arange(self.equations.count), self._joints(self.drivers)[1])

    def _joints(self, names: Sequence[str]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Return addresses in qpos and degrees of freedom of hinges and slides by their names."""
        # the model's joints may have no names
        order, model = [joint.name for joint in self.mechanism.joints], self.equations.closure.model
        joints = [order.index(name) for name in names]
        return model.jnt_qposadr[joints].astype(np.intp), model.jnt_dofadr[joints].astype(np.intp)

    def closed(self, qpos: Array) -> tuple[Array, Array]:
        """Return the nearest assembled states at the same drivers, (n, nq), and the largest residuals, (n,).

        Residuals are in characteristic lengths or [rad].
        """
        if not self.equations.rows:
            return qpos, np.zeros(len(qpos))
        result = newton(LoopSystem(self.equations, self.free), ModelStates(qpos), ASSEMBLY, least_norm)
        return result.q.qpos, result.residual

    def points(self, qpos: Array) -> Array:
        """Return the positions of the tracked points at states, (n, k, 3) in [m]."""
        position, rotation, _ = self.equations.closure.posed.poses(qpos)
        located = [(self.bodies[link], np.array(local)) for link, local in self.mechanism.points.values()]
        return points_on(position, rotation, located)

    def errors(self, qpos: Array, points: Array) -> Array:
        """Return the distances of tracked points from the closure at the run's own drivers, (n, k) in [m].

        Args:
            qpos: states, (n, nq).
            points: positions of the tracked points at these states, (n, k, 3).

        Returns:
            Zero without loops; infinite where the loops do not close nearby.
        """
        if not self.equations.rows:
            return np.zeros(points.shape[:2])
        with np.errstate(all="ignore"):
            closed, violation = self.closed(qpos)
            distance = np.linalg.norm(points - self.points(closed), axis=2)
        return np.where((violation <= ASSEMBLED)[:, None] & np.isfinite(distance), distance, np.inf)

    def moved_to(self, qpos: Array, target: Mapping[str, float]) -> Array:
        """Return the assembled state, (nq,), at driver values, reached along a straight path of the drivers.

        Raises:
            AssemblyError: where the loops do not close.
        """
        addresses, dofs = self._joints([*target])
        start, displacement = qpos[addresses], np.array([*target.values()]) - qpos[addresses]
        distance = np.abs(displacement / self.equations.units[dofs]).max(initial=0.0)
        count = max(1, int(np.ceil(distance / DRIVER_STEP)))
        for i in range(1, count + 1):
            qpos = qpos.copy()
            qpos[addresses] = start + displacement * i / count
            (closed,), (violation,) = self.closed(qpos[None])
            if not violation <= ASSEMBLED:
                text = ", ".join(
                    f"{name} = {value:.6g}" for name, value in zip(target, qpos[addresses], strict=True)
                )
                raise AssemblyError(
                    f"{self.mechanism.name}: the loops do not close at {text}, on the path to the start of "
                    "the motion laws; change the motion laws, or start from another keyframe (--key)"
                )
            qpos = closed
        return qpos

    def rates(self, qpos: Array, speeds: Mapping[str, float]) -> Array:
        """Return the velocities of all degrees of freedom, (nv,), that keep the loops closed.

        Args:
            qpos: assembled state, (nq,).
            speeds: driver -> its speed in [rad/s] or [m/s]; other drivers are at rest.
        """
        jacobian, units = self.equations.linearise(ModelStates(qpos[None]))[1][..., 0], self.equations.units
        rates = np.zeros(self.equations.count)
        dofs = self._joints([*speeds])[1]
        rates[dofs] = np.array([*speeds.values()]) / units[dofs]
        rates[self.free] = -least_norm(jacobian[:, self.free], jacobian @ rates)
        return rates * units


def points_on(position: Array, rotation: Array, located: Iterable[tuple[int, Array]]) -> Array:
    """Return points, each given by its body and its position there in [m], at body poses, (n, k, 3)."""
    points = [position[:, body] + rotation[:, body] @ local for body, local in located]
    return np.stack(points, 1) if points else np.empty((len(position), 0, 3))


def exact_closure(mechanism: Mechanism, model: mujoco.MjModel, bodies: Mapping[str, int]) -> ExactClosure:
    """Return the exact closure of a mechanism read from a model; arguments as for `ExactClosure`."""
    try:
        redundant = driver_determinacy(mechanism).redundant_drivers
    except AssemblyError:
        redundant = ()
    drivers = tuple(name for name in (*mechanism.drivers, *mechanism.locked) if name not in redundant)
    loops = loops_with_crank(model, 0)
    # a weld with torquescale 0 constrains the point only
    welds = np.flatnonzero(model.eq_active0.astype(bool) & (model.eq_type == mujoco.mjtEq.mjEQ_WELD))
    turning = model.eq_data[welds, 10] != 0.0
    frames = [pair for pair, turns in zip(loops.frames, turning, strict=True) if turns]
    equations = ModelEquations(replace(loops, frames=frames), model.qpos0)
    return ExactClosure(mechanism, equations, drivers, bodies)
