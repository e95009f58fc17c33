"""Motions to draw, by the closed form or by MuJoCo."""

from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from mechsim.analytic.catalog.base import ClosedForm
    from mechsim.model.motion import Motion
    from mechsim.simulation import CrankProfile

Road = Annotated[
    str,
    typer.Option(
        "--from",
        help="closed: the closed form; simulated: MuJoCo; both: MuJoCo, the closed form as a dark ghost.",
    ),
]
# what one picture or video may hold
MOST_SAMPLES = 100_000


def profile_of(
    drive: "ClosedForm", speed: float, turns: float, through: float | None = None
) -> "CrankProfile":
    """Return the crank's motion: whole turns, or for a crank that cannot turn fully one swing to and fro.

    The swing passes a crank angle, or where assembly begins.
    """
    from mechsim.errors import InputError
    from mechsim.model.crank_profile import within_range

    if not (turns != 0.0 and abs(turns) < 1e4):
        raise InputError(f"{turns:g} turns; give turns other than 0, fewer than 10000 either way")
    return within_range(drive, speed if turns > 0 else -speed, abs(turns), through)


def motion_of(drive: "ClosedForm", road: str, profile: "CrankProfile", samples: float) -> "Motion":
    """Return a motion to be drawn, with so many evenly spread samples after the first."""
    import numpy as np

    from mechsim.errors import InputError
    from mechsim.simulation import simulate

    if road not in ("closed", "simulated"):
        raise InputError(f"there is no road {road!r} here; known are closed, simulated and, to draw, both")
    count = round(samples)
    if not 1 <= count <= MOST_SAMPLES:
        raise InputError(f"{samples:g} frames or samples asked for; give 1 to {MOST_SAMPLES}")
    if road == "simulated":
        return simulate(drive.mechanism, profile=profile, samples=count, method="step").motion
    angles = profile.state(np.linspace(0.0, profile.duration, count + 1))
    return drive.solve(*angles)


def joint_loads(drive: "ClosedForm", road: str, profile: "CrankProfile", motion: "Motion") -> dict[str, Any]:
    """Return forces and moments in the joints at the samples of a motion, from the same road as the motion.

    They act on the link b of each joint; links are rods of steel and weigh, as `mechsim dynamics` has it.
    """
    import numpy as np

    from mechsim.analytic import dynamics
    from mechsim.model.forces import Forces
    from mechsim.simulation.dynamics.prescribed_motion import driven

    machine = dynamics.machine(drive, Forces(gravity=(0.0, -9.81, 0.0)))
    if road == "simulated":
        run = driven(machine.mechanism, machine.forces, profile=profile, samples=len(motion) - 1)
        found = run.efforts.reactions
    else:
        found = dynamics.prescribed(
            machine, motion.angle, motion.speed, motion.acceleration
        ).efforts.reactions
    forces = {name: one.force for name, one in found.items()}
    # a moment that the largest force makes on a billionth of the size is rounding, and no arrow
    least = 1e-9 * drive.mechanism.size * max(float(np.abs(force).max()) for force in forces.values())
    moments = {name: np.where(np.abs(one.moment) > least, one.moment, 0.0) for name, one in found.items()}
    return {"forces": forces, "moments": moments}
