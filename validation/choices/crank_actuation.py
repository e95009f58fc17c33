"""How the crank is best driven: a flywheel, a velocity servo, a position servo, a motor fed forward.

Three mechanisms, one turn at 600 rpm, 1,000 steps; links of 1 kg, so that the load is heavy next to the
crank's own inertia. Drive errors: of the speed, relative; of the angle, in rad, against the requested angle
at that time. The place error of the driven point is against the closed form at the crank angle really
reached, in units of the crank: what the drive adds to the error of the loop. inf: diverged.

Run: python validation/choices/crank_actuation.py
"""

import copy
import time
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np
import study_table as sheet
from mujoco import batch

from mechsim import catalog
from mechsim.mechanism.scene import Scene
from mechsim.simulation import Settings, loop_jacobian
from mechsim.simulation.mjcf.compiling import quiet
from mechsim.simulation.model_loops import read_loops
from mechsim.simulation.poses import follow
from mechsim.simulation.source import assembled

SPEED = 20.0 * np.pi
STEPS = 1000
REPEATS = 3
# in kg m2, next to 1e-5 of the lightest crank
NO_FLYWHEEL = 1e-9


@dataclass(frozen=True)
class Actuation:
    """A way to drive the crank.

    Attributes:
        name: for the table.
        settings: of the run; the softer loop is what the low-order integrators need.
        proportional: position gain in units of inertia over step squared; counts from the requested angle.
        derivative: velocity gain in units of inertia over step.
        feed_forward: whether the torque that inverse dynamics asks for is added.
    """

    name: str
    settings: Settings
    proportional: float = 0.0
    derivative: float = 0.0
    feed_forward: bool = False


HARD = Settings(steps_per_turn=STEPS, drive_inertia=NO_FLYWHEEL)
SOFT = replace(HARD, compliance=1.0, constant_steps=2.0)
ACTUATIONS = (
    Actuation("flywheel 1e9", replace(HARD, drive_inertia=1e9)),
    Actuation("flywheel 1e3", replace(HARD, drive_inertia=1e3)),
    Actuation("velocity servo", HARD, derivative=1.0),
    Actuation("velocity servo x 1e4", replace(SOFT, integrator="implicitfast"), derivative=1e4),
    Actuation("velocity servo x 10", replace(SOFT, integrator="discrete"), derivative=10.0),
    Actuation("position servo", HARD, proportional=0.1, derivative=0.6),
    Actuation("position servo x 10", replace(SOFT, integrator="implicitfast"), 1.0, 10.0),
    Actuation("position servo x 10", replace(SOFT, integrator="discrete"), 1.0, 10.0),
    Actuation("fed-forward motor", HARD, feed_forward=True),
    Actuation("fed-forward motor + servo", HARD, 0.1, 0.6, feed_forward=True),
)


class Rig:
    """A mechanism ready to be driven: its model, the angles it should pass, the control of each step."""

    def __init__(self, name: str, actuation: Actuation):
        self.exact, self.actuation = catalog.make(name), actuation
        spec = assembled(self.exact.mechanism, Scene())
        spec.add_actuator(name="motor", trntype=mujoco.mjtTrn.mjTRN_JOINT, target="crank")
        model = spec.compile()
        self.loops, self.dt = read_loops(model), HARD.timestep(SPEED)
        actuation.settings.apply(self.loops, self.dt)
        self.angle = model.qpos0[self.loops.crank_address] + SPEED * self.dt * np.arange(STEPS + 1)
        torque, inertia = self._inverse_dynamics()
        stiff = actuation.proportional * inertia / self.dt**2
        damping = actuation.derivative * inertia / self.dt
        model.actuator_biastype[0] = int(mujoco.mjtBias.mjBIAS_AFFINE)
        model.actuator_biasprm[0, 1:3] = -stiff, -damping
        # a target held over a step is right in its middle for RK4, at its end for implicit integrators
        target = self.angle[1:] - (0.5 * SPEED * self.dt if actuation.settings.integrator == "RK4" else 0.0)
        self.control = stiff * target + damping * SPEED + (torque if actuation.feed_forward else 0.0)

    def _inverse_dynamics(self) -> tuple[np.ndarray, float]:
        """Return the torque in the middle of each step, by virtual work, and the crank's least inertia."""
        loops, model = self.loops, copy.copy(self.loops.model)
        off = mujoco.mjtDisableBit
        model.opt.disableflags |= int(off.mjDSBL_CONSTRAINT | off.mjDSBL_ACTUATION)
        middle = self.angle[:-1] + 0.5 * SPEED * self.dt
        h = 1e-4  # rad: central differences of tangents, rounding 1e-12 and truncation 1e-8
        states = [follow.follow(loops, model.qpos0, middle + k * h) for k in (0, 1, -1)]
        tangent, after, before = (loop_jacobian.tangent(loops, loops.linearise(q)[1]) for q in states)
        data, torque, inertia = mujoco.MjData(model), np.empty(STEPS), np.inf
        full = np.empty((model.nv, model.nv))
        for i in range(STEPS):
            data.qpos[:], data.qvel[:] = states[0][i], SPEED * tangent[i]
            data.qacc[:] = SPEED**2 * (after[i] - before[i]) / (2.0 * h)
            mujoco.mj_inverse(model, data)
            torque[i] = tangent[i] @ data.qfrc_inverse
            mujoco.mj_fullM(model, data, full)
            inertia = min(inertia, float(tangent[i] @ full @ tangent[i]))
        return torque, inertia

    def run(self) -> dict[str, Any]:
        """Return the errors of one turn, and the time of stepping it."""
        loops, model = self.loops, self.loops.model
        sims = batch.Batch(model, 1, 1)
        sims.bind("qpos")[:] = model.qpos0
        sims.bind("qvel")[:] = SPEED * loop_jacobian.tangent(loops, loops.linearise(model.qpos0[None])[1])
        begin = time.perf_counter()
        out = sims.rollout(
            STEPS,
            control=self.control[None, :, None],
            control_spec=int(mujoco.mjtState.mjSTATE_CTRL),
            record=("qpos", "qvel"),
        )
        seconds = time.perf_counter() - begin
        qpos, qvel = out["qpos"][0], out["qvel"][0]
        row: dict[str, Any] = {
            "mechanism": self.exact.name,
            "drive": self.actuation.name,
            "integrator": self.actuation.settings.integrator,
            "speed": np.inf,
            "angle": np.inf,
            "place": np.inf,
            "us/step": 1e6 * seconds / STEPS,
        }
        if sims.warning[..., 1].any():
            return row
        angle, speed = qpos[:, loops.crank_address], qvel[:, loops.crank]
        point = "P3" if "P3" in self.exact.mechanism.points else "B"
        gap = loops.posed.site_positions(qpos)[:, model.site(point).id] - self.exact.positions(angle)[point]
        row["speed"] = float(np.abs(speed / SPEED - 1.0).max())
        row["angle"] = float(np.abs(angle - self.angle[1:]).max())
        row["place"] = float(np.sqrt((gap**2).sum(1)).max() / self.exact.crank)
        return row


@quiet()
def main() -> None:
    rows: list[dict[str, Any]] = []
    for name in ("rssr", "four_bar", "slider_crank"):
        rigs = [Rig(name, actuation) for actuation in ACTUATIONS]
        result = [rig.run() for rig in rigs]
        for _ in range(REPEATS - 1):
            for row, rig in zip(result, rigs, strict=True):
                row["us/step"] = min(row["us/step"], rig.run()["us/step"])
        rows += result
    sheet.show(rows)


if __name__ == "__main__":
    main()
