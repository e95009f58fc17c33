"""Efforts at states that a stepped model passed through, from its own constraint forces."""

import copy
from dataclasses import replace

import mujoco
import numpy as np
from numpy.typing import NDArray

from mechsim.motion import join
from mechsim.simulation.bench import Bench
from mechsim.simulation.efforts import Efforts, constrained, efforts, situation
from mechsim.simulation.record import CHUNK, States

Array = NDArray[np.float64]

# factor on the inverse weights below which forces are not evaluated, and Newton steps for them: between
# an error of 1e-6 x factor and rounding over 1e4 x factor, measured 5e-10 of the drive torque
HARDEST, ITERATIONS = 1e-5, 10
# factor on the flywheel, and on what drives it, where the crank's speed changes: beside so large a torque
# that of the machine would be lost in rounding
LIGHTER = 1e-6


def efforts_of(
    bench: Bench, stepped: mujoco.MjModel, hardness: float, states: States, force: Array | None = None
) -> Efforts:
    """Return the efforts at recorded states of a stepped model, from its own constraint forces.

    Args:
        bench: the mechanism.
        stepped: the model as it was stepped, the drive's inertia in it.
        hardness: factor on its inverse weights.
        states: recorded.
        force: of the drive on the crank at each state besides what holds its speed, (n,) in [N m].
    """
    model = copy.copy(stepped)
    bench.prepare(model)
    # forces are the softness times a tiny gap: harder than this, rounding of the gap shows in them
    soften = max(1.0, HARDEST / hardness)
    model.body_invweight0[:] *= soften
    model.dof_invweight0[:] *= soften
    model.opt.iterations = ITERATIONS
    if force is not None:
        model.dof_armature[bench.loops.crank] *= LIGHTER
    parts = []
    for first in range(0, len(states.time), CHUNK):
        part = states.at(first)
        at = situation(bench, part)
        acting = replace(at.outer, generalised=at.outer.generalised.copy())
        if force is not None:
            acting.generalised[:, bench.loops.crank] += LIGHTER * force[first : first + CHUNK]
        fields = bench.look(model, part, acting)
        multipliers, torque = constrained(bench, at, fields)
        parts.append(efforts(bench, at, fields["qacc"], multipliers, torque))
    return join(parts)


def stiffen_friction(model: mujoco.MjModel, timestep: float) -> None:
    """Let dry friction hold within two steps: MuJoCo's default of 20 ms is long beside a turn."""
    for name in ("dof_solref", "tendon_solref_fri"):
        getattr(model, name)[:] = 2.0 * timestep, 1.0
    for name in ("dof_solimp", "tendon_solimp_fri"):
        getattr(model, name)[:] = 0.9999, 0.9999, 0.001, 0.5, 2.0
