"""Scenes that lack parts judged against the full one: places, efforts and energies over two motions."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import mujoco
import numpy as np

from mechsim.maths.arrays import Array
from mechsim.simulation.mjcf.compiling import plainly_compiled
from mechsim.simulation.mjcf.silence import quiet
from mechsim.studies.reduction.lean_scene import LeanScene, lean_scene
from mechsim.studies.scenes.scene_errors import worst_distance
from mechsim.studies.scenes.scene_limit import interpolated
from mechsim.studies.scenes.scene_run import SceneRun, stepped
from mechsim.studies.scenes.step_time import step_times
from mechsim.studies.scenes.user_scene import UserScene

Tracked = Mapping[str, tuple[str, Array]]
# instants at which energies are compared
LOOKS = 100


@dataclass(frozen=True, slots=True)
class LeanErrors:
    """How far a scene that lacks parts is from the full one, the worst of all instants.

    Attributes:
        trajectory: of a tracked point, in [m].
        torque: of the effort of an actuator that both have, or of what prescribes a joint, [N m] or [N].
        energy: of the change of the energy since the start, in [J].
    """

    trajectory: float
    torque: float
    energy: float

    def by(self, measure: str) -> float:
        """Return the one that counts."""
        return self.torque if measure == "torque" else self.trajectory


BROKEN = LeanErrors(np.inf, np.inf, np.inf)


@dataclass(frozen=True)
class Bench:
    """The full scene over one motion, and what is compared with it.

    Attributes:
        motion: the scene as tune and simulate run it.
        spec: of the full scene, spelled out.
        tracked: point -> name of its body, place in its frame in [m].
    """

    motion: UserScene
    spec: mujoco.MjSpec
    tracked: Tracked

    @cached_property
    def full(self) -> LeanScene:
        """The full scene."""
        return lean_scene(self.motion, self.spec, self.tracked, self.named)

    @cached_property
    def named(self) -> mujoco.MjModel:
        """The full scene's model, its parts named."""
        return plainly_compiled(self.spec.copy())

    @cached_property
    def run(self) -> SceneRun:
        """The full scene's run, every step of it."""
        return stepped(self.full, records=None)

    @cached_property
    def moved(self) -> float:
        """How far what is tracked goes from where it starts, in [m]."""
        return worst_distance(np.linalg.norm(self.run.points - self.run.points[0], axis=2))

    @cached_property
    def efforts(self) -> Mapping[str, Array]:
        """The full scene's efforts, by name, (n,) each."""
        return _efforts(self._sparse)

    @cached_property
    def energies(self) -> Array:
        """The full scene's energy since its start, (n,) in [J]."""
        return _energies(self._sparse)

    @cached_property
    def _sparse(self) -> SceneRun:
        """As many records of the run as interpolation takes."""
        stride = max(1, len(self.run.time) // 4000)
        part = slice(None, None, stride)
        return replace(self.run, time=self.run.time[part], qpos=self.run.qpos[part], qvel=self.run.qvel[part])

    def lean(self, spec: mujoco.MjSpec) -> LeanScene:
        """Return a scene over the same motion, its joints starting as the full one's."""
        return lean_scene(self.motion, spec, self.tracked, self.named)

    def away(self, run: SceneRun) -> Array:
        """Return from where the full one is to where a run's tracked points are, (n, k, 3) in [m]."""
        return run.points - interpolated(self.run.time, self.run.points, run.time)

    def errors(self, scene: LeanScene, *, all_of_them: bool = True) -> LeanErrors:
        """Return how far a scene is from the full one.

        Args:
            scene: as `lean` returns it.
            all_of_them: whether efforts and energies are compared too; else they are NaN.
        """
        run = stepped(scene)
        if run.broken:
            return BROKEN
        away = worst_distance(np.linalg.norm(self.away(run), axis=2))
        if not all_of_them:
            return LeanErrors(away, np.nan, np.nan)
        known = self._sparse.time
        torque = 0.0
        for name, values in _efforts(run).items():
            if name in self.efforts:
                other = interpolated(known, self.efforts[name], run.time)
                torque = max(torque, worst_distance(np.abs(values - other)))
        part = slice(None, None, max(1, len(run.time) // LOOKS))
        some = replace(run, time=run.time[part], qpos=run.qpos[part], qvel=run.qvel[part])
        energy = np.abs(_energies(some) - interpolated(known, self.energies, some.time))
        return LeanErrors(away, torque, worst_distance(energy))


def time_ratios(
    full: LeanScene,
    others: Sequence[LeanScene],
    rounds: int = 3,
    tell: Callable[[float], None] = lambda _: None,
) -> Array:
    """Return the processor time of a simulated second of scenes, in parts of the full one's, (others,)."""
    times = step_times([(one, one.model) for one in (full, *others)], rounds, tell)
    return times[1:] / times[0]


def _efforts(run: SceneRun) -> dict[str, Array]:
    names = [run.model.actuator(i).name for i in range(run.model.nu)]
    names += [f"drive of {name}" for name in run.scene.drive]
    return dict(zip(names, run.efforts.T, strict=True))


@quiet()
def _energies(run: SceneRun) -> Array:
    """Return the energy since the first instant, without that of driven rotors, (n,) in [J]."""
    model, data = run.model, mujoco.MjData(run.model)
    wheels = np.zeros(model.nv)
    for dof, (inertia, _) in zip(run.scene.driven_dofs, run.scene.wheels.values(), strict=True):
        wheels[dof] = inertia
    found = np.empty(len(run.time))
    for i, (qpos, qvel) in enumerate(zip(run.qpos, run.qvel, strict=True)):
        data.qpos[:], data.qvel[:] = qpos, qvel
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_energyPos(model, data)
        mujoco.mj_energyVel(model, data)
        found[i] = data.energy.sum() - 0.5 * float(wheels @ qvel**2)
    return found - found[0]
