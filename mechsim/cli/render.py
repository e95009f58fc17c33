"""Command `mechsim render`: a picture or a video of a mechanism."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import typer

from mechsim.analytic.forms import Form
from mechsim.analytic.loops.loop_form import LoopForm
from mechsim.cli.declared_options import spread
from mechsim.cli.load_options import print_masses
from mechsim.cli.options import (
    DriveOptions,
    File,
    Json,
    Model,
    Sets,
    form_of,
    moving,
    speed_of,
    writable,
)
from mechsim.cli.output import print_json
from mechsim.cli.progress import progress
from mechsim.cli.unit_warnings import asked_angle
from mechsim.errors import InputError
from mechsim.model.masses import LinkMass
from mechsim.model.motion import Motion
from mechsim.numerics.angles import REVOLUTION
from mechsim.pictures.render import Look, write_picture, write_video
from mechsim.pictures.render.file_bodies import drawn_as
from mechsim.pictures.render.frame_poses import VISIBLE_DIFFERENCE, comes_round
from mechsim.studies.motion_source import MOST_SAMPLES, joint_loads, motion_of, profile_of, weighing
from mechsim.units import option, parse_angle


@dataclass(frozen=True, slots=True, kw_only=True)
class FilmOptions:
    """Which motion is drawn, and how fast it is shown."""

    road: str = option(
        "closed",
        "closed: the closed form; simulated: MuJoCo; both: MuJoCo, the closed form as a dark ghost.",
        name="--from",
    )
    speed: float = option(20.0 * np.pi, "Crank speed; a bare number is rad/s.", read=speed_of, text="600rpm")
    turns: float = option(1.0, "Turns of the crank; backwards if negative.")
    angle: str | None = option(None, "Crank angle of a still picture.")
    fps: float = option(30.0, "Frames a second.")
    frames_per_turn: int | None = option(None, "Frames in a turn, 72 if left out; 36 stand 10 degrees apart.")
    slow: float | None = option(None, "Show the motion this many times slower than it is, at --speed.")
    trace: bool = option(
        False,
        "Go round the curve of assemblies at an even pace, through dead centres, as `mechsim trace`.",
    )

    def samples(self, duration: float, picture: bool, positions: int, *, timed: bool) -> float:
        """Return how many samples of a motion of some seconds are drawn, a timed one in its own time."""
        if self.slow is not None:
            return self._slowed(duration, self.slow)
        if timed and not picture:
            if self.turns != 1.0 or self.frames_per_turn is not None:
                raise InputError(
                    "--turns and --frames-per-turn are of a crank without a program; leave them out"
                )
            return max(1.0, self._slowed(duration, 1.0))
        # for a still the samples only shape the paths; with positions each sample is a position
        usual = positions if positions > 1 else 360 if picture else 72
        asked = None if positions > 1 else self.frames_per_turn
        return abs(self.turns) * (usual if asked is None else asked)

    @property
    def pace(self) -> str:
        """What a slow film says of itself."""
        return "true speed" if self.slow == 1.0 else f"1/{self.slow:g} of true speed"

    def _slowed(self, duration: float, slow: float) -> float:
        if self.frames_per_turn is not None:
            raise InputError("--slow says how many frames there are; leave out --frames-per-turn")
        if not 0.0 < slow < 1e6 or not 0.0 < self.fps <= 1000.0:
            raise InputError(f"{slow:g} times slower at {self.fps:g} frames a second; give numbers above 0")
        return duration * slow * self.fps


@spread
def render(
    model: Model,
    output: File,
    film: FilmOptions,
    look: Look,
    driven: DriveOptions,
    sets: Sets = None,
    as_json: Json = False,
) -> None:
    """Draw a mechanism without a screen: .png, .mp4, .webm, .gif, or a new folder of .png files.

    Motions that come back to where they began play in a loop without a seam: no frame is shown twice.
    Motions under programs are filmed in their own time.
    """
    picture = output.endswith(".png")
    place = writable(output, ".png", ".mp4", ".webm", ".gif", "")
    _check(output, film, look)
    at = None if film.angle is None else parse_angle(film.angle, "the crank angle")
    drive = moving(form_of(model, sets, driven))
    asked_angle("--angle", film.angle or "", drive)
    look = replace(look, **drawn_as(drive))
    if film.trace:
        _tell(drive.name, output, _round(place, drive, film, look, picture), as_json)
        return
    programmed = drive.motion_laws is not None
    if programmed and film.speed != FilmOptions().speed:
        raise InputError(f"--speed is of a crank without a program, and {drive.name} has one; leave it out")
    profile = profile_of(drive, film.speed, film.turns, at)
    samples = film.samples(profile.duration, picture, look.overlay, timed=programmed)
    motion = motion_of(drive, "simulated" if film.road == "both" else film.road, profile, samples)
    beside: dict[str, Any] = {}
    said = [] if film.slow is None else [film.pace]
    masses: Sequence[LinkMass] = ()
    if {"force", "moment"} & set(look.arrows):
        beside |= joint_loads(drive, film.road, profile, motion)
        masses = weighing(drive).masses
        said.append("joint loads as they act on the driven link")
    if film.road == "both" and isinstance(drive, LoopForm):
        beside["exact"] = drive.solve_as(motion)
    elif film.road == "both":
        beside["exact"] = drive.solve_along(motion.angle, motion.speed, motion.acceleration)
    look = replace(look, caption="; ".join(said))
    if picture:
        look = replace(look, paths="whole" if look.paths else False)
        write_picture(place, drive.mechanism, motion, look, angle=at, **beside)
        _tell(drive.name, output, None, as_json, masses)
        return
    whole = comes_round(drive.mechanism, motion, VISIBLE_DIFFERENCE, VISIBLE_DIFFERENCE)
    tail = whole and not programmed and drive.crank_range().full
    look = replace(look, paths="tail" if look.paths and tail else look.paths)
    count = _write_film(place, drive, motion, whole, look, {"fps": film.fps, **beside})
    _tell(drive.name, output, count, as_json, masses)


def _tell(name: str, output: str, frames: int | None, as_json: bool, masses: Sequence[LinkMass] = ()) -> None:
    if as_json:
        used = {"masses": [one.as_dict() for one in masses]} if masses else {}
        print_json({"mechanism": name, "output": output, "frames": frames} | used)
    else:
        typer.echo(f"wrote {'' if frames is None else f'{frames} frames to '}{output}")
        print_masses(masses)


def _round(place: Path, drive: Form, film: FilmOptions, look: Look, picture: bool) -> int | None:
    """Draw one round of the curve of assemblies; return how many frames a film has.

    The last frame, the first again, is left out.
    """
    # found where it is used: with it comes much that other pictures do without
    from mechsim.theory.continuation import crank_path_length, even_motion, trace

    curve = trace(drive, starts=0).curves[0]
    per_turn = film.frames_per_turn or 72
    count = round(per_turn * max(1.0, crank_path_length(curve) / REVOLUTION))
    if not 1 <= count <= MOST_SAMPLES:
        raise InputError(f"{count} frames asked for; give --frames-per-turn 1 to {MOST_SAMPLES}")
    motion = even_motion(curve, count, 1.0)
    look = replace(look, paths="whole" if look.paths else False)
    if picture:
        write_picture(place, drive.mechanism, motion, look)
        return None
    return _write_film(place, drive, motion, True, look, {"fps": film.fps})


def _check(output: str, film: FilmOptions, look: Look) -> None:
    """Refuse what does not go together."""
    usual = FilmOptions()
    if output.endswith(".png"):
        for name, given in (("--fps", film.fps != usual.fps), ("--slow", film.slow is not None)):
            if given:
                raise InputError(f"{name} is of a film, and {output!r} is one picture; leave it out")
        if look.overlay > 1 and film.angle is not None:
            raise InputError(
                f"{look.overlay} positions over one another show the whole motion; leave out --angle or "
                "--positions"
            )
    else:
        if look.overlay > 1:
            raise InputError(
                f"{look.overlay} positions over one another make a still picture; write it to a .png file"
            )
        if film.angle is not None:
            raise InputError(
                f"--angle {film.angle} is for a still picture; write it to a .png file, or leave it out"
            )
    if film.trace:
        apart = {
            "--from": film.road != "closed",
            "--angle": film.angle is not None,
            "--speed": film.speed != usual.speed,
            "--turns": film.turns != 1.0,
            "--slow": film.slow is not None,
            "--sense": look.sense,
            "--positions": look.overlay > 1,
            "--arrows of forces": bool({"force", "moment"} & set(look.arrows)),
        }
        for name, given in apart.items():
            if given:
                raise InputError(f"--trace goes once round the curve of assemblies; leave out {name}")
    if look.magnify is not None and film.road != "both":
        raise InputError(f"--magnify {look.magnify:g} magnifies the error between two roads; add --from both")
    width, height = look.size
    if output.endswith((".mp4", ".webm")) and (width % 2 or height % 2):
        raise InputError(
            f"--size is '{width}x{height}', but videos have even sizes; take one pixel more or less"
        )


def _write_film(
    place: Path, drive: Form, motion: Motion, whole: bool, look: Look, beside: dict[str, Any]
) -> int:
    """Write a video, with progress on stderr, without its last frame where that is the first again."""
    shown = motion.angle[:-1] if whole else motion.angle
    with progress("draw", len(shown)) as tick:
        return write_video(place, drive.mechanism, motion, look, angles=shown, progress=tick, **beside)
