"""Stepping a model as it is, for the studies of cost: settings applied, then changed, then timed."""

import copy
import time
from collections.abc import Callable

import mujoco
import numpy as np
from mujoco import batch

from mechsim.simulation import Settings, loop_jacobian
from mechsim.simulation.model_loops import read_loops

SPEED = 20.0 * np.pi
Change = Callable[[mujoco.MjModel], None]


class Bare:
    """A model at constant crank speed.

    Attributes:
        loops: of the model, settings and change applied.
        qpos: states of the last turn stepped, (steps, nq).
        times: processor time of each turn stepped, in [s].
        broken: whether MuJoCo warned of a bad state.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        steps: int,
        change: Change = lambda _: None,
        like: mujoco.MjModel | None = None,
    ):
        """Apply settings for a number of steps a turn, then a change of a user's own.

        Args:
            model: compiled; copied.
            steps: in a turn.
            change: made after the settings were applied.
            like: a model whose hinges of the same names say how this one starts, where its loops are
                closed by what `ModelLoops` does not know; None lets its own loops say it.
        """
        self.steps, self.loops = steps, read_loops(copy.copy(model))
        settings = Settings(steps_per_turn=steps)
        self.start = _start(model) if like is None else _start_like(model, like)
        settings.apply(self.loops, settings.timestep(SPEED))
        change(self.loops.model)
        self.qpos, self.times, self.broken = self.start[0], list[float](), False

    def time_revolution(self) -> None:
        """Step one turn and note the time."""
        sims = batch.Batch(self.loops.model, 1, 1)
        sims.bind("qpos")[:], sims.bind("qvel")[:] = self.start
        begin = time.process_time()
        out = sims.rollout(self.steps, record=("qpos",))
        self.times.append(time.process_time() - begin)
        self.qpos, self.broken = out["qpos"][0], bool(sims.warning[..., 1].any())

    @property
    def microseconds(self) -> float:
        """The median processor time of one step, in [us]."""
        return 1e6 * float(np.median(self.times)) / self.steps

    def rows(self) -> int:
        """Return how many rows of constraints are active at the start."""
        data = mujoco.MjData(self.loops.model)
        data.qpos[:] = self.start[0][0]
        mujoco.mj_forward(self.loops.model, data)
        return int(data.nefc)

    def site_error(self, exact: dict[str, np.ndarray]) -> float:
        """Return the worst distance of sites from where they should be, name -> (steps, 3), in [m]."""
        if self.broken or not np.isfinite(self.qpos).all():
            return float("inf")
        positions, model = self.loops.posed.site_positions(self.qpos), self.loops.model
        gaps = [
            positions[:, model.site(name).id] - position
            for name, position in exact.items()
            if _has(model, name)
        ]
        return float(np.sqrt((np.stack(gaps) ** 2).sum(-1)).max())


def _start(model: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray]:
    loops = read_loops(model)
    qpos = loop_jacobian.close(loops, model.qpos0[None])
    return qpos, SPEED * loop_jacobian.tangent(loops, loops.linearise(qpos)[1])


def _start_like(model: mujoco.MjModel, like: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray]:
    qpos, qvel = _start(like)
    names = [model.joint(i).name for i in range(model.njnt)]
    addresses = [like.joint(name).qposadr[0] for name in names]
    return qpos[:, addresses], qvel[:, [like.joint(name).dofadr[0] for name in names]]


def _has(model: mujoco.MjModel, site: str) -> bool:
    return mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, site) >= 0
