"""Time that mechsim adds to bare stepping in C.

100,000 steps of the same model with the same settings, by one bare `Batch.rollout` that records nothing, by
mechsim's stepping loop, and by `simulate` with its checks of every recorded instant; and steps of released
mechanisms under forces that MuJoCo lacks, against bare steps of the same model. Medians over interleaved
rounds of processor time. Targets: stepping within 5 % of bare, with forces within 30 %.

Run: python validation/speed/step_overhead.py [ROUNDS [STEPS WITH FORCES]]
"""

import copy
import sys
import time
from collections.abc import Callable
from contextlib import nullcontext
from statistics import median

import mujoco
import numpy as np
from mujoco import batch

from mechsim import catalog, load
from mechsim.mechanism.forces import Forces, Friction
from mechsim.mechanism.joints import End
from mechsim.mechanism.load_profile import table
from mechsim.mechanism.motors import Controller
from mechsim.mechanism.nonlinear_springs import Bushing, NonlinearSpring, SoftStop, diagonal
from mechsim.mechanism.scene import Scene
from mechsim.simulation import Settings, constant, loop_jacobian, simulate
from mechsim.simulation.dynamics.applied_controls import AppliedControls, prepared
from mechsim.simulation.dynamics.forward_run import FREE, ITERATIONS, Start, start_of
from mechsim.simulation.model_loops import ModelLoops, read_loops
from mechsim.simulation.source import assembled
from mechsim.simulation.stepping import step

SPEED = 20.0 * np.pi
STEPS, TURNS = 100_000, 100
SETTINGS = Settings(steps_per_turn=STEPS // TURNS)
ROUNDS = 5
ANGLES = np.linspace(0.0, 2.0 * np.pi, 13)
MOUNT = Bushing("mount", End("ground"), End("crank"), diagonal(*[1.0] * 6))
# mechanism and forces
UNDER_FORCES = {
    "controller": ("four_bar", Forces(controllers=(Controller("crank", "-2*(crank.q-0.5)-0.2*crank.v"),))),
    "load over angle": ("four_bar", Forces(crank_torque=table(ANGLES, 0.01 * np.sin(ANGLES)))),
    "stop": ("four_bar", Forces(nonlinear_springs=(NonlinearSpring("crank", SoftStop(0.5, 1.0, 100.0)),))),
    "bushing": ("four_bar", Forces(bushings=(MOUNT,))),
    "friction of a ball": ("rssr", Forces(friction=(Friction("P2", coulomb=1e-3),))),
    "rods": (str(catalog.models() / "machines/peaucellier_rods.toml"), Forces()),
    "cam": (str(catalog.models() / "gallery/cam_follower.toml"), Forces()),
}


def main(rounds: int = ROUNDS, steps: int = 5000) -> None:
    mechanism = catalog.make("rssr").mechanism
    loops = read_loops(assembled(mechanism, Scene()).compile())
    start = loops.model.qpos0
    rates = SPEED * loop_jacobian.tangent(loops, loops.linearise(start[None])[1])[0]
    profile = constant(SPEED, TURNS, float(start[loops.crank_address]))

    def copied() -> ModelLoops:
        return read_loops(copy.copy(loops.model))

    def bare_rollout() -> None:
        copied_loops = copied()
        SETTINGS.apply(copied_loops, SETTINGS.timestep(SPEED))
        sims = batch.Batch(copied_loops.model, 1, 1)
        sims.bind("qpos")[:], sims.bind("qvel")[:] = start, rates
        sims.rollout(STEPS, record=())

    def mechsim_stepping() -> None:
        step(copied(), SETTINGS, profile, (start, rates), STEPS, STEPS // TURNS // 72)

    def simulated_run() -> None:
        simulate(mechanism, speed=SPEED, turns=TURNS, settings=SETTINGS, samples=7200)

    runs: dict[str, Callable[[], None]] = {
        "bare rollout in C": bare_rollout,
        "mechsim's stepping": mechsim_stepping,
        "simulate, 7,200 samples": simulated_run,
    }
    times: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(rounds):
        for name, run_once in runs.items():
            begin = time.process_time()
            run_once()
            times[name].append(time.process_time() - begin)
    for name, seconds in times.items():
        ratio = median(a / b for a, b in zip(seconds, times["bare rollout in C"], strict=True))
        per_step, overhead = 1e6 * median(seconds) / STEPS, 100.0 * (ratio - 1.0)
        print(f"{name:<24} {per_step:6.2f} us a step, {overhead:+6.1f} % relative to bare")

    for name, (source, forces) in UNDER_FORCES.items():
        mechanism = load(source, still=True).mechanism
        begin = start_of(mechanism, forces, {}, {mechanism.drivers[0]: 0.1})
        ratios = [with_forces(begin, steps) for _ in range(rounds)]
        print(f"{name:<24} {median(ratios):6.2f} times bare steps")


def with_forces(start: Start, steps: int) -> float:
    """Return the time of steps under forces over that of bare steps of the same model."""
    controls = AppliedControls(start.model, prepared(start.model, FREE, 1e-4, ITERATIONS))
    model, seconds = controls.loops.model, list[float]()
    for forced in (True, False):
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = start.qpos, start.qvel
        with controls.installed(data) if forced else nullcontext() as expand:
            functions = expand and any(row.function for row in controls.loops.couplings)
            begin = time.process_time()
            for _ in range(steps if functions else 1):
                if functions:
                    expand()
                mujoco.mj_step(model, data, nstep=1 if functions else steps)
            seconds.append(time.process_time() - begin)
    return seconds[0] / seconds[1]


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
