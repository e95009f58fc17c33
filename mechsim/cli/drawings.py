"""The command that plots."""

from typing import TYPE_CHECKING, Annotated, Any

import typer

from mechsim.cli.options import Name, Sets, Speed, drive_of, speed_of, writable
from mechsim.cli.pictures import File
from mechsim.cli.roads import Road, motion_of, profile_of

if TYPE_CHECKING:
    from mechsim.catalog.base import Drive


def plot(
    name: Name,
    output: File,
    kind: Annotated[str, typer.Option(help="motion, curve, space, transmission, error or plan.")] = "motion",
    points: Annotated[str | None, typer.Option(help="Tracked points, with commas; all if left out.")] = None,
    road: Road = "closed",
    speed: Speed = "600rpm",
    angle: Annotated[str, typer.Option(help="Crank angle of a velocity plan.")] = "0deg",
    stopped: Annotated[
        str, typer.Option(help="Crank stopped in a velocity plan: crank1 or crank2.")
    ] = "crank2",
    sets: Sets = None,
) -> None:
    """Plot motions, coupler curves, transmission angle, errors or velocity plans: .svg, .pdf or .png."""
    from mechsim import plots, units
    from mechsim.errors import InputError

    form = plots.form_of(output)
    place = writable(output)
    drive, asked = drive_of(name, sets), speed_of(speed)
    profile = profile_of(drive, asked, 1.0)
    chosen = points.split(",") if points else None
    if kind == "motion":
        drawing = plots.motion_plot(motion_of(drive, road, profile, 360), chosen, form=form)
    elif kind == "curve":
        motion = motion_of(drive, road, profile, 360)
        drawing = plots.coupler_curve(drive.mechanism, motion, chosen, form=form)
    elif kind == "space":
        motion = motion_of(drive, road, profile, 360)
        drawing = plots.space_curve(drive.mechanism, motion, chosen, form=form)
    elif kind == "transmission":
        angles = motion_of(drive, "closed", profile, 360).angle
        drawing = plots.transmission_plot(angles, drive.transmission_angle(angles), form=form)
    elif kind == "error":
        motion = motion_of(drive, "simulated", profile, 180)
        exact = drive.solve(motion.angle, motion.speed, motion.acceleration)
        drawing = plots.error_plot(motion.angle, motion.place_errors(exact), unit="m", form=form)
    elif kind == "plan":
        drawing = _plan(drive, units.parse_angle(angle, "the crank angle"), asked, stopped, form)
    else:
        raise InputError(
            f"there is no plot {kind!r}; known are motion, curve, space, transmission, error, plan"
        )
    plots.write(place, drawing)
    typer.echo(f"wrote {output}")


def _plan(drive: "Drive", angle: float, speed: float, stopped: str, form: Any) -> bytes:
    import math

    from mechsim import plots
    from mechsim.catalog.warp_knitter import WarpKnitter
    from mechsim.errors import InputError
    from mechsim.velocity_plan import velocity_plan

    if not isinstance(drive, WarpKnitter):
        raise InputError(f"{drive.name} has no velocity plan with a crank stopped; warp_knitter has")
    both = velocity_plan(drive, angle, speed)
    plans = {"crank2": both.crank2_stopped, "crank1": both.crank1_stopped}
    if stopped not in plans:
        raise InputError(f"there is no crank {stopped!r} to stop; known are crank1, crank2")
    plan = plans[stopped]
    title = f"{stopped} stopped, crank angle {math.degrees(angle):g} deg, {plan.scale:.4g} m/s per unit"
    return plots.velocity_plan_plot(plan, title, form=form)
