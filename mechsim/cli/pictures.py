"""Commands that draw: render, plot."""

from typing import TYPE_CHECKING, Annotated, Any

import typer

from mechsim.cli.options import Name, Sets, Speed, drive_of, speed_of, writable

if TYPE_CHECKING:
    from mechsim.catalog.base import Drive
    from mechsim.motion import Motion

File = Annotated[str, typer.Option("-o", "--output", metavar="FILE", help="Where to write.")]
Road = Annotated[str, typer.Option("--from", help="closed: the closed form; simulated: MuJoCo.")]


def render(
    name: Name,
    output: File,
    road: Road = "closed",
    speed: Speed = "600rpm",
    turns: Annotated[float, typer.Option(help="Turns of the crank; backwards if negative.")] = 1.0,
    angle: Annotated[str | None, typer.Option(help="Crank angle of a still picture.")] = None,
    fps: Annotated[float, typer.Option(help="Frames a second.")] = 30.0,
    frames_per_turn: Annotated[int, typer.Option(help="Frames in a turn; 36 stand 10 degrees apart.")] = 72,
    size: Annotated[str, typer.Option(help="Pixels, width x height.")] = "960x720",
    camera: Annotated[str, typer.Option(help="iso, shaft, top or side.")] = "iso",
    backend: Annotated[
        str | None, typer.Option(help="egl or osmesa; the first that works if left out.")
    ] = None,
    paths: Annotated[bool, typer.Option(help="Draw the paths of tracked points.")] = True,
    labels: Annotated[bool, typer.Option(help="Write the names of tracked points.")] = True,
    project: Annotated[
        str | None, typer.Option(metavar="POINTS", help="Throw these points' paths on the coordinate planes.")
    ] = None,
    positions: Annotated[int, typer.Option(help="Positions drawn over one another in a still picture.")] = 1,
    sense: Annotated[bool, typer.Option(help="Show which way the crank turns.")] = False,
    sets: Sets = None,
) -> None:
    """Draw a mechanism without a screen: .png, .mp4, .webm, .gif, or a new folder of .png files."""
    from pathlib import Path

    from mechsim import units
    from mechsim.errors import InputError
    from mechsim.render import write_picture, write_video

    picture = Path(output).suffix == ".png"
    place = writable(output, ".png", ".mp4", ".webm", ".gif", "")
    if positions > 1 and not picture:
        raise InputError(
            f"{positions} positions over one another make a still picture; write it to a .png file"
        )
    at = None if angle is None else units.parse_angle(angle, "the crank angle")
    look = {
        "size": _size(size),
        "camera": camera,
        "backend": backend,
        "labels": labels,
        "sense": sense,
        "overlay": positions,
        "projections": tuple(project.split(",")) if project else (),
    }
    drive = drive_of(name, sets)
    # for a still the samples only shape the paths; with positions each sample is a position
    count = positions if positions > 1 else frames_per_turn
    motion = motion_of(drive, road, speed_of(speed), turns, count)
    if picture:
        write_picture(place, drive.mechanism, motion, angle=at, paths="whole" if paths else False, **look)
        typer.echo(f"wrote {output}")
        return
    whole = abs(turns - round(turns)) < 1e-9 and drive.crank_range().full
    shown = motion.angle[:-1] if whole else motion.angle
    count = write_video(
        place,
        drive.mechanism,
        motion,
        fps=fps,
        angles=shown,
        paths="tail" if paths and whole else paths,
        **look,
    )
    typer.echo(f"wrote {count} frames to {output}")


def motion_of(drive: "Drive", road: str, speed: float, turns: float, count: int) -> "Motion":
    """Return a motion to be drawn, `count` samples a turn, by the closed form or by MuJoCo.

    A crank that cannot turn fully swings once to and fro.
    """
    import numpy as np

    from mechsim.errors import InputError
    from mechsim.simulation import simulate
    from mechsim.validate import crank_profile

    if road not in ("closed", "simulated"):
        raise InputError(f"there is no road {road!r}; known are closed, simulated")
    if not (turns != 0.0 and abs(turns) < 1e4) or count < 1:
        raise InputError(
            f"{turns} turns with {count} frames each; give turns other than 0 and frames above 0"
        )
    profile = crank_profile(drive, speed if turns > 0 else -speed, abs(turns))
    samples = max(1, round(abs(turns) * count))
    if road == "simulated":
        return simulate(drive.mechanism, profile=profile, samples=samples).motion
    angles = profile.state(np.linspace(0.0, profile.duration, samples + 1))
    return drive.solve(*angles)


def _size(text: str) -> tuple[int, int]:
    from mechsim.errors import InputError

    parts = text.lower().split("x")
    if len(parts) != 2 or not all(part.strip().isdigit() for part in parts):
        raise InputError(f"--size is {text!r}; write width x height in pixels, as in 960x720")
    return int(parts[0]), int(parts[1])


def plot(
    name: Name,
    output: File,
    kind: Annotated[str, typer.Option(help="motion, curve, transmission, error or plan.")] = "motion",
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
    chosen = points.split(",") if points else None
    if kind == "motion":
        drawing = plots.motion_plot(motion_of(drive, road, asked, 1.0, 360), chosen, form=form)
    elif kind == "curve":
        motion = motion_of(drive, road, asked, 1.0, 360)
        drawing = plots.coupler_curve(drive.mechanism, motion, chosen, form=form)
    elif kind == "transmission":
        angles = motion_of(drive, "closed", asked, 1.0, 360).angle
        drawing = plots.transmission_plot(angles, drive.transmission_angle(angles), form=form)
    elif kind == "error":
        motion = motion_of(drive, "simulated", asked, 1.0, 180)
        exact = drive.solve(motion.angle, motion.speed, motion.acceleration)
        drawing = plots.error_plot(motion.angle, motion.place_errors(exact), unit="m", form=form)
    elif kind == "plan":
        drawing = _plan(drive, units.parse_angle(angle, "the crank angle"), asked, stopped, form)
    else:
        raise InputError(f"there is no plot {kind!r}; known are motion, curve, transmission, error, plan")
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
