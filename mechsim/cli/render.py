"""The command that draws: render."""

from typing import TYPE_CHECKING, Annotated, Any

import typer

from mechsim.cli.motion_source import Road, joint_loads, motion_of, profile_of
from mechsim.cli.options import Name, Sets, Speed, drive_of, speed_of, writable
from mechsim.cli.output import progress

if TYPE_CHECKING:
    from pathlib import Path

    from mechsim.analytic.catalog.base import ClosedForm
    from mechsim.model.motion import Motion

File = Annotated[str, typer.Option("-o", "--output", metavar="FILE", help="Where to write.")]


def render(
    name: Name,
    output: File,
    road: Road = "closed",
    speed: Speed = "600rpm",
    turns: Annotated[float, typer.Option(help="Turns of the crank; backwards if negative.")] = 1.0,
    angle: Annotated[str | None, typer.Option(help="Crank angle of a still picture.")] = None,
    fps: Annotated[float, typer.Option(help="Frames a second.")] = 30.0,
    frames_per_turn: Annotated[
        int | None, typer.Option(help="Frames in a turn, 72 if left out; 36 stand 10 degrees apart.")
    ] = None,
    slow: Annotated[
        float | None, typer.Option(help="Show the motion this many times slower than it is, at --speed.")
    ] = None,
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
    arrows: Annotated[
        str | None, typer.Option(metavar="KINDS", help="Arrows: velocity, acceleration, force, moment.")
    ] = None,
    magnify: Annotated[
        float | None, typer.Option(help="Factor on the error with --from both; a power of ten if left out.")
    ] = None,
    sense: Annotated[bool, typer.Option(help="Show which way the crank turns.")] = False,
    sets: Sets = None,
) -> None:
    """Draw a mechanism without a screen: .png, .mp4, .webm, .gif, or a new folder of .png files.

    Whole turns of a crank that turns fully play in a loop without a seam: no frame is shown twice.
    """
    from mechsim import units
    from mechsim.errors import InputError
    from mechsim.pictures.render import write_picture

    picture = output.endswith(".png")
    place = writable(output, ".png", ".mp4", ".webm", ".gif", "")
    if positions > 1 and not picture:
        raise InputError(
            f"{positions} positions over one another make a still picture; write it to a .png file"
        )
    if angle is not None and not picture:
        raise InputError(f"--angle {angle} is for a still picture; write it to a .png file, or leave it out")
    if magnify is not None and road != "both":
        raise InputError(f"--magnify {magnify:g} magnifies the error between two roads; add --from both")
    at = None if angle is None else units.parse_angle(angle, "the crank angle")
    pixels = _size(size)
    if output.endswith((".mp4", ".webm")) and (pixels[0] % 2 or pixels[1] % 2):
        raise InputError(f"--size is {size!r}, but videos have even sizes; take one pixel more or less")
    look: dict[str, Any] = {
        "size": pixels,
        "camera": camera,
        "backend": backend,
        "labels": labels,
        "sense": sense,
        "overlay": positions,
        "projections": tuple(project.split(",")) if project else (),
        "arrows": tuple(arrows.split(",")) if arrows else (),
        "magnify": magnify,
    }
    drive = drive_of(name, sets)
    profile = profile_of(drive, speed_of(speed), turns, at)
    # for a still the samples only shape the paths; with positions each sample is a position
    usual = positions if positions > 1 else 360 if picture else 72
    samples = abs(turns) * (usual if frames_per_turn is None or positions > 1 else frames_per_turn)
    if slow is not None:
        samples = _slowed(profile.duration, slow, fps, frames_per_turn)
        look["caption"] = f"1/{slow:g} of true speed" if slow != 1.0 else "true speed"
    motion = motion_of(drive, "simulated" if road == "both" else road, profile, samples)
    if {"force", "moment"} & set(look["arrows"]):
        look |= joint_loads(drive, road, profile, motion)
        said = "joint loads as they act on the driven link"
        look["caption"] = f"{look['caption']}; {said}" if "caption" in look else said
    if road == "both":
        look["exact"] = drive.solve(motion.angle, motion.speed, motion.acceleration)
    if picture:
        write_picture(place, drive.mechanism, motion, angle=at, paths="whole" if paths else False, **look)
        typer.echo(f"wrote {output}")
        return
    whole = abs(turns - round(turns)) < 1e-9 and drive.crank_range().full
    count = _film(
        place, drive, motion, whole, {"fps": fps, "paths": "tail" if paths and whole else paths, **look}
    )
    typer.echo(f"wrote {count} frames to {output}")


def _film(place: "Path", drive: "ClosedForm", motion: "Motion", whole: bool, look: dict[str, Any]) -> int:
    """Write a video, with progress on stderr; of whole turns the last frame, the first again, is left out."""
    from mechsim.pictures.render import write_video

    shown = motion.angle[:-1] if whole else motion.angle
    with progress("draw", len(shown)) as tick:
        return write_video(place, drive.mechanism, motion, angles=shown, done=tick, **look)


def _slowed(duration: float, slow: float, fps: float, frames_per_turn: int | None) -> float:
    """Return how many frames a motion of some seconds has, shown so many times slower."""
    from mechsim.errors import InputError

    if frames_per_turn is not None:
        raise InputError("--slow says how many frames there are; leave out --frames-per-turn")
    if not 0.0 < slow < 1e6 or not 0.0 < fps <= 1000.0:
        raise InputError(f"{slow:g} times slower at {fps:g} frames a second; give numbers above 0")
    return duration * slow * fps


def _size(text: str) -> tuple[int, int]:
    from mechsim.errors import InputError

    parts = text.lower().split("x")
    if len(parts) != 2 or not all(part.strip().isdigit() for part in parts):
        raise InputError(f"--size is {text!r}; write width x height in pixels, as in 960x720")
    return int(parts[0]), int(parts[1])
