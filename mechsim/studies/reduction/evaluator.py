"""Errors of reduced scenes against the full scene: positions, forces and energies over a motion."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import mujoco
import numpy as np

from mechsim.numerics.arrays import Array
from mechsim.simulation.mjcf.compiling import plainly_compiled, quiet
from mechsim.studies.reduction.reduced_scene import ReducedScene, reduced_scene
from mechsim.studies.scene.converged_reference import interpolated
from mechsim.studies.scene.errors import worst_distance
from mechsim.studies.scene.evaluator import SceneRun, step_times, stepped
from mechsim.studies.scene.scene import UserScene

Tracked = Mapping[str, tuple[str, Array]]
# number of instants at which energies are compared
ENERGY_SAMPLES = 100


@dataclass(frozen=True, slots=True)
class ReducedErrors:
    """Largest deviations of a reduced scene from the full scene over all instants.

    Attributes:
        trajectory: of a tracked point's position, in [m].
        torque: of the force of an actuator that both scenes have, or of a prescribed joint, [N m] or [N].
        energy: of the energy change since the start, in [J].
    """

    trajectory: float
    torque: float
    energy: float

    def by(self, measure: str) -> float:
        """Return the error by a measure, "trajectory" or "torque"."""
        return self.torque if measure == "torque" else self.trajectory


DIVERGED = ReducedErrors(np.inf, np.inf, np.inf)


@dataclass(frozen=True)
class Evaluator:
    """Compares reduced scenes with the full scene over one motion.

    Attributes:
        motion: the scene as tune and simulate run it.
        spec: of the full scene, normalised.
        tracked: point -> name of its body, position in its frame in [m].
    """

    motion: UserScene
    spec: mujoco.MjSpec
    tracked: Tracked

    @cached_property
    def full(self) -> ReducedScene:
        """The full scene."""
        return reduced_scene(self.motion, self.spec, self.tracked, self.named)

    @cached_property
    def named(self) -> mujoco.MjModel:
        """The full scene's model, all elements named."""
        return plainly_compiled(self.spec.copy())

    @cached_property
    def run(self) -> SceneRun:
        """The full scene's run, every step of it."""
        return stepped(self.full, records=None)

    @cached_property
    def displacement_range(self) -> float:
        """Largest distance of a tracked point from its initial position, in [m]."""
        return worst_distance(np.linalg.norm(self.run.points - self.run.points[0], axis=2))

    @cached_property
    def forces(self) -> Mapping[str, Array]:
        """The full scene's actuator and drive forces by name, (n,) each."""
        return _forces(self._sparse)

    @cached_property
    def energies(self) -> Array:
        """The full scene's energy change since the start, (n,) in [J]."""
        return _energies(self._sparse)

    @cached_property
    def _sparse(self) -> SceneRun:
        """At most about 4000 records of the run, enough for interpolation."""
        step = max(1, len(self.run.time) // 4000)
        every = slice(None, None, step)
        return replace(
            self.run, time=self.run.time[every], qpos=self.run.qpos[every], qvel=self.run.qvel[every]
        )

    def scene(self, spec: mujoco.MjSpec) -> ReducedScene:
        """Return the scene of a specification over the same motion, with the full scene's initial state."""
        return reduced_scene(self.motion, spec, self.tracked, self.named)

    def deviation(self, run: SceneRun) -> Array:
        """Return the displacements of a run's tracked points from the full scene's, (n, k, 3) in [m]."""
        return run.points - interpolated(self.run.time, self.run.points, run.time)

    def errors(self, scene: ReducedScene, *, compare_forces: bool = True) -> ReducedErrors:
        """Return the errors of a scene against the full scene.

        Args:
            scene: as `scene` returns it.
            compare_forces: whether forces and energies are compared too; otherwise they are NaN.
        """
        run = stepped(scene)
        if run.broken:
            return DIVERGED
        worst = worst_distance(np.linalg.norm(self.deviation(run), axis=2))
        if not compare_forces:
            return ReducedErrors(worst, np.nan, np.nan)
        times = self._sparse.time
        torque = 0.0
        for name, values in _forces(run).items():
            if name in self.forces:
                reference = interpolated(times, self.forces[name], run.time)
                torque = max(torque, worst_distance(np.abs(values - reference)))
        every = slice(None, None, max(1, len(run.time) // ENERGY_SAMPLES))
        sampled = replace(run, time=run.time[every], qpos=run.qpos[every], qvel=run.qvel[every])
        energy = np.abs(_energies(sampled) - interpolated(times, self.energies, sampled.time))
        return ReducedErrors(worst, torque, worst_distance(energy))


def time_ratios(
    full: ReducedScene,
    others: Sequence[ReducedScene],
    rounds: int = 3,
    progress: Callable[[float], None] = lambda _: None,
) -> Array:
    """Return the processor times of scenes relative to the full scene's, (others,)."""
    times = step_times([(scene, scene.model) for scene in (full, *others)], rounds, progress)
    return times[1:] / times[0]


def _forces(run: SceneRun) -> dict[str, Array]:
    names = [run.model.actuator(i).name for i in range(run.model.nu)]
    names += [f"drive of {name}" for name in run.scene.drive]
    return dict(zip(names, run.efforts.T, strict=True))


@quiet()
def _energies(run: SceneRun) -> Array:
    """Return the energy change since the first instant without virtual drive inertia, (n,) in [J]."""
    model, data = run.model, mujoco.MjData(run.model)
    inertias = np.zeros(model.nv)
    for dof, (inertia, _) in zip(run.scene.driven_dofs, run.scene.wheels.values(), strict=True):
        inertias[dof] = inertia
    energy = np.empty(len(run.time))
    for i, (qpos, qvel) in enumerate(zip(run.qpos, run.qvel, strict=True)):
        data.qpos[:], data.qvel[:] = qpos, qvel
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_energyPos(model, data)
        mujoco.mj_energyVel(model, data)
        energy[i] = data.energy.sum() - 0.5 * float(inertias @ qvel**2)
    return energy - energy[0]
