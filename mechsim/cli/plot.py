"""Command `mechsim plot`: a kind of plot -> how its bytes are made."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

from mechsim.cli.motion_source import Road, motion_of, profile_of
from mechsim.cli.options import Name, Sets, Speed, drive_of, speed_of, writable
from mechsim.cli.output import progress
from mechsim.cli.render import File

if TYPE_CHECKING:
    from mechsim.analytic.catalog.base import ClosedForm
    from mechsim.analytic.dynamics import InverseDynamics, Machine
    from mechsim.model.motion import Motion
    from mechsim.pictures.plots import Format

SAMPLES = 360
# what a work-precision plot may take to measure, in [s]; `mechsim tradeoff --plot` takes a budget
BUDGET = 20.0


@dataclass(frozen=True, slots=True)
class PlotAsked:
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

    drive: "ClosedForm"
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


def motion(asked: PlotAsked) -> bytes:
    """Displacement, velocity and acceleration."""
    from mechsim.pictures import plots

    return plots.motion_plot(asked.motion(), asked.points, form=asked.form)


def curve(asked: PlotAsked) -> bytes:
    """Paths of points, in a plane or from three sides."""
    from mechsim.pictures import plots

    return plots.coupler_curve(asked.drive.mechanism, asked.motion(), asked.points, form=asked.form)


def space(asked: PlotAsked) -> bytes:
    """Paths of points in space."""
    from mechsim.pictures import plots

    return plots.space_curve(asked.drive.mechanism, asked.motion(), asked.points, form=asked.form)


def transmission(asked: PlotAsked) -> bytes:
    """The transmission angle."""
    from mechsim.pictures import plots

    angles = asked.motion("closed").angle
    return plots.transmission_plot(angles, asked.drive.transmission_angle(angles), form=asked.form)


def error(asked: PlotAsked) -> bytes:
    """Place errors of a run over the turn."""
    from mechsim.pictures import plots

    run = asked.motion("simulated", 180)
    exact = asked.drive.solve(run.angle, run.speed, run.acceleration)
    return plots.error_plot(run.angle, run.place_errors(exact), unit="m", form=asked.form)


def plan(asked: PlotAsked) -> bytes:
    """The velocity plan with one crank stopped."""
    import math

    from mechsim.analytic.catalog.warp_knitter import WarpKnitter
    from mechsim.errors import InputError
    from mechsim.pictures import plots
    from mechsim.theory.velocity_plan import velocity_plan

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


def torque(asked: PlotAsked) -> bytes:
    """Drive torque and its parts; simulated: MuJoCo's as rings."""
    from mechsim.pictures.plots import dynamics as drawn
    from mechsim.simulation.dynamics.prescribed_motion import driven

    machine, study = _study(asked)
    rings = None
    if asked.road == "simulated":
        profile = profile_of(asked.drive, asked.speed, 1.0)
        run = driven(machine.mechanism, machine.forces, profile=profile, samples=SAMPLES)
        rings = run.motion.angle, run.efforts.torque
    return drawn.torque_plot(study, rings, form=asked.form)


def reactions(asked: PlotAsked) -> bytes:
    """The force in each joint in polar form."""
    from mechsim.pictures.plots import dynamics as drawn

    return drawn.reaction_plot(_study(asked)[1], form=asked.form)


def power(asked: PlotAsked) -> bytes:
    """The powers that must balance."""
    from mechsim.pictures.plots import dynamics as drawn

    return drawn.energy_plot(_study(asked)[1], form=asked.form)


def precision(asked: PlotAsked) -> bytes:
    """Error over cost of MuJoCo's settings, measured now."""
    from mechsim.studies.tradeoff import measure, subject_of
    from mechsim.studies.tradeoff.plot import work_precision

    return work_precision(measure(subject_of(asked.drive, asked.speed), budget=BUDGET), form=asked.form)


def stability(asked: PlotAsked) -> bytes:
    """Where runs stop to be right along every axis, found now, in few values."""
    from mechsim.errors import InputError
    from mechsim.studies.extremes.plot import extremes_map
    from mechsim.studies.extremes.stability_map import axes_of, study

    if asked.changed:
        raise InputError("a stability map is of the catalogue's own dimensions; leave out --set")
    names = [asked.drive.name]
    with progress("extremes", axes_of(names, quick=True)) as tick:
        return extremes_map(study(names, quick=True, done=tick), form=asked.form)


def _study(asked: PlotAsked) -> "tuple[Machine, InverseDynamics]":
    """Links as rods of steel, with their weight, as `mechsim dynamics` has them."""
    from mechsim.analytic import dynamics
    from mechsim.model.forces import Forces

    machine = dynamics.machine(asked.drive, Forces(gravity=(0.0, -9.81, 0.0)))
    closed = asked.motion("closed")
    return machine, dynamics.prescribed(machine, closed.angle, closed.speed, closed.acceleration)


DRAWN: dict[str, Callable[[PlotAsked], bytes]] = {
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


def plot(
    name: Name,
    output: File,
    kind: Annotated[str, typer.Option(help=f"One of {', '.join(DRAWN)}.")] = "motion",
    points: Annotated[str | None, typer.Option(help="Tracked points, with commas; all if left out.")] = None,
    road: Road = "closed",
    speed: Speed = "600rpm",
    angle: Annotated[str, typer.Option(help="Crank angle of a velocity plan.")] = "0deg",
    stopped: Annotated[
        str, typer.Option(help="Crank stopped in a velocity plan: crank1 or crank2.")
    ] = "crank2",
    sets: Sets = None,
) -> None:
    """Plot motions, curves, transmission, errors, velocity plans, dynamics or studies: .svg, .pdf or .png.

    Kind precision takes 20 s to measure, kind stability minutes; `mechsim tradeoff` and `mechsim extremes`
    tell the numbers too.
    """
    from mechsim import units
    from mechsim.errors import InputError
    from mechsim.pictures import plots

    form = plots.form_of(output)
    place = writable(output)
    if kind not in DRAWN:
        raise InputError(f"there is no plot {kind!r}; known are {', '.join(DRAWN)}")
    asked = PlotAsked(
        drive=drive_of(name, sets),
        changed=bool(sets),
        road=road,
        speed=speed_of(speed),
        points=points.split(",") if points else None,
        angle=units.parse_angle(angle, "the crank angle"),
        stopped=stopped,
        form=form,
    )
    plots.write(place, DRAWN[kind](asked))
    typer.echo(f"wrote {output}")
