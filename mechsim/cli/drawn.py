"""What `mechsim plot` can draw: a kind of plot -> how its bytes are made."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mechsim.cli.output import progress
from mechsim.cli.roads import motion_of, profile_of

if TYPE_CHECKING:
    from mechsim.catalog.base import Drive
    from mechsim.dynamics import Machine, Study
    from mechsim.motion import Motion
    from mechsim.plots import Format

SAMPLES = 360
# what a work-precision plot may take to measure, in [s]; `mechsim tradeoff --plot` takes a budget
BUDGET = 20.0


@dataclass(frozen=True, slots=True)
class Asked:
    """What is to be drawn.

    Attributes:
        drive: the mechanism.
        changed: whether its dimensions are not the catalogue's.
        road: "closed" or "simulated".
        speed: of the crank in [rad/s].
        points: tracked points; None for all.
        angle: crank angle of a velocity plan in [rad].
        stopped: crank stopped in it.
        form: of the file.
    """

    drive: "Drive"
    changed: bool
    road: str
    speed: float
    points: list[str] | None
    angle: float
    stopped: str
    form: "Format"

    def motion(self, road: str | None = None, samples: int = SAMPLES) -> "Motion":
        """Return the motion to draw, from the road asked for or a given one."""
        return motion_of(self.drive, road or self.road, profile_of(self.drive, self.speed, 1.0), samples)


def motion(asked: Asked) -> bytes:
    """Displacement, velocity and acceleration."""
    from mechsim import plots

    return plots.motion_plot(asked.motion(), asked.points, form=asked.form)


def curve(asked: Asked) -> bytes:
    """Paths of points, in a plane or from three sides."""
    from mechsim import plots

    return plots.coupler_curve(asked.drive.mechanism, asked.motion(), asked.points, form=asked.form)


def space(asked: Asked) -> bytes:
    """Paths of points in space."""
    from mechsim import plots

    return plots.space_curve(asked.drive.mechanism, asked.motion(), asked.points, form=asked.form)


def transmission(asked: Asked) -> bytes:
    """The transmission angle."""
    from mechsim import plots

    angles = asked.motion("closed").angle
    return plots.transmission_plot(angles, asked.drive.transmission_angle(angles), form=asked.form)


def error(asked: Asked) -> bytes:
    """Place errors of a run over the turn."""
    from mechsim import plots

    run = asked.motion("simulated", 180)
    exact = asked.drive.solve(run.angle, run.speed, run.acceleration)
    return plots.error_plot(run.angle, run.place_errors(exact), unit="m", form=asked.form)


def plan(asked: Asked) -> bytes:
    """The velocity plan with one crank stopped."""
    import math

    from mechsim import plots
    from mechsim.catalog.warp_knitter import WarpKnitter
    from mechsim.errors import InputError
    from mechsim.velocity_plan import velocity_plan

    if not isinstance(asked.drive, WarpKnitter):
        raise InputError(f"{asked.drive.name} has no velocity plan with a crank stopped; warp_knitter has")
    both = velocity_plan(asked.drive, asked.angle, asked.speed)
    plans = {"crank2": both.crank2_stopped, "crank1": both.crank1_stopped}
    if asked.stopped not in plans:
        raise InputError(f"there is no crank {asked.stopped!r} to stop; known are crank1, crank2")
    drawn = plans[asked.stopped]
    at = f"crank angle {math.degrees(asked.angle):g} deg"
    title = f"{asked.stopped} stopped, {at}, {drawn.scale:.4g} m/s per unit"
    return plots.velocity_plan_plot(drawn, title, form=asked.form)


def torque(asked: Asked) -> bytes:
    """Drive torque and its parts; simulated: MuJoCo's as rings."""
    from mechsim.plots import dynamics as drawn
    from mechsim.simulation.dynamics import driven

    machine, study = _study(asked)
    rings = None
    if asked.road == "simulated":
        profile = profile_of(asked.drive, asked.speed, 1.0)
        run = driven(machine.mechanism, machine.forces, profile=profile, samples=SAMPLES)
        rings = run.motion.angle, run.efforts.torque
    return drawn.torque_plot(study, rings, form=asked.form)


def reactions(asked: Asked) -> bytes:
    """The force in each joint in polar form."""
    from mechsim.plots import dynamics as drawn

    return drawn.reaction_plot(_study(asked)[1], form=asked.form)


def power(asked: Asked) -> bytes:
    """The powers that must balance."""
    from mechsim.plots import dynamics as drawn

    return drawn.energy_plot(_study(asked)[1], form=asked.form)


def precision(asked: Asked) -> bytes:
    """Error over cost of MuJoCo's settings, measured now."""
    from mechsim.plots.tradeoff import work_precision
    from mechsim.tradeoff import measure, subject_of

    return work_precision(measure(subject_of(asked.drive, asked.speed), budget=BUDGET), form=asked.form)


def stability(asked: Asked) -> bytes:
    """Where runs stop to be right along every axis, found now, in few values."""
    from mechsim.errors import InputError
    from mechsim.extremes.study import axes_of, study
    from mechsim.plots.extremes import extremes_map

    if asked.changed:
        raise InputError("a stability map is of the catalogue's own dimensions; leave out --set")
    names = [asked.drive.name]
    with progress("extremes", axes_of(names, quick=True)) as tick:
        return extremes_map(study(names, quick=True, done=tick), form=asked.form)


def _study(asked: Asked) -> "tuple[Machine, Study]":
    """Links as rods of steel, with their weight, as `mechsim dynamics` has them."""
    from mechsim import dynamics
    from mechsim.forces import Forces

    machine = dynamics.machine(asked.drive, Forces(gravity=(0.0, -9.81, 0.0)))
    closed = asked.motion("closed")
    return machine, dynamics.prescribed(machine, closed.angle, closed.speed, closed.acceleration)


DRAWN: dict[str, Callable[[Asked], bytes]] = {
    one.__name__: one
    for one in (
        motion,
        curve,
        space,
        transmission,
        error,
        plan,
        torque,
        reactions,
        power,
        precision,
        stability,
    )
}
