"""Command `mechsim render`: a picture or a video of a mechanism."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from mechsim.cli.command import Result, Stated, Without, command, output_file
from mechsim.cli.exit_codes import notes, print_stderr
from mechsim.cli.load_options import ReleaseOptions, masses_in_json, print_masses, released_model
from mechsim.cli.options import ModelOptions, warn_about_angle
from mechsim.cli.output import number
from mechsim.cli.progress import progress
from mechsim.errors import InputError, several
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.kinetics import dynamic_model
from mechsim.mechanism.masses import LinkMass
from mechsim.mechanism.motion import Motion
from mechsim.pictures.render import Look, write_picture, write_video
from mechsim.pictures.render.drawn_model import drawn_as, without_geoms
from mechsim.pictures.render.frame_poses import frame_indices, returns_visibly, samples_in_frame
from mechsim.pictures.render.gltf import write_gltf
from mechsim.studies.drawn_motion import (
    MAX_SAMPLES,
    drawn_motion,
    initial_pose,
    is_undriven,
    joint_loads,
    moved_by_forces,
)
from mechsim.studies.motions import profile_of
from mechsim.studies.release import Release
from mechsim.studies.scene.own_settings import runs_as_published
from mechsim.units import crank_speed, option, parse_angle

# duration of the animation of one cycle of a mode in [s]
CYCLE = 2.0
# options of the motion of a driven crank
DRIVEN = ("method", "angle", "turns", "frames_per_turn")


@dataclass(frozen=True, slots=True, kw_only=True)
class AnimationOptions:
    """The motion to draw, and its playback speed."""

    method: str = option(
        "closed",
        "Motion to draw: closed (analytic), simulated (MuJoCo), or both (the analytic one as a ghost).",
        name="--from",
        metavar="closed|simulated|both",
    )
    speed: float = option(
        20.0 * np.pi, "Crank speed; a bare number is rad/s.", read=crank_speed, text="600rpm"
    )
    turns: float = option(1.0, "Turns of the crank; negative runs backwards.")
    angle: str | None = option(
        None, "Crank angle of a picture. Default: a pose that shows the mechanism well."
    )
    fps: float = option(30.0, "Frames per second.")
    frames_per_turn: int | None = option(None, "Frames in a turn of the crank. Default: 72.")
    slow: float | None = option(None, "Show the motion at --speed this many times slower.")

    def samples(self, duration: float, picture: bool, positions: int, *, timed: bool) -> float:
        """Return the number of samples of a motion of `duration` [s]; a timed motion keeps its own time."""
        slow = 1.0 if self.slow is None and timed and not picture else self.slow
        if slow is not None:
            if self.frames_per_turn is not None:
                raise InputError("--slow determines the number of frames; leave out --frames-per-turn")
            if not 0.0 < slow < 1e6 or not 0.0 < self.fps <= 1000.0:
                raise InputError(
                    f"{slow:g} times slower at {self.fps:g} frames a second; give numbers above 0, --slow "
                    "below 1e+06 and --fps up to 1000"
                )
            count = duration * slow * self.fps
            return max(1.0, count) if self.slow is None else count
        # samples of a picture only define the paths; some of them are its positions
        if positions > 1:
            return abs(self.turns) * positions * samples_in_frame(positions)
        usual = 360 if picture else 72
        return abs(self.turns) * (usual if self.frames_per_turn is None else self.frames_per_turn)

    @property
    def caption(self) -> str:
        """The caption of a slowed animation; empty for any other."""
        if self.slow is None:
            return ""
        return "true speed" if self.slow == 1.0 else f"1/{self.slow:g} of true speed"


@command
def render(
    source: Annotated[ModelOptions, Without("loops")],
    output: Annotated[
        str,
        output_file(
            "Picture or animation to write: .png, .mp4, .webm, .gif, .glb (glTF), or a new folder.",
            *(".png", ".mp4", ".webm", ".gif", ".glb", ""),
        ),
    ],
    animation: AnimationOptions,
    look: Look,
    release: Annotated[ReleaseOptions, Without("until")],
    stated: Stated,
) -> Result:
    """Draw a mechanism without a screen: .png, .mp4, .webm, .gif, .glb, or a new folder of .png files.

    Motions that return to their start play in a loop without a seam: no frame is shown twice. Motions under
    motion laws and runs from an initial state are shown in their own time.

    Examples:
    mechsim render rssr -o rssr.png --angle 30deg
    mechsim render four_bar -o four_bar.mp4 --from both --slow 10
    mechsim render four_bar -o mode.mp4 --mode 1 --initial crank.q=-95deg
    """
    picture = output.endswith(".png")
    path = Path(output)
    _check(stated, output, animation, look)
    resting = replace(source, duration=None).load(still=True)
    if release.requested or moved_by_forces(resting):
        release.exclude(stated)
        free = "on drivers that are free"
        stated.exclude(DRIVEN, free)
        stated.exclude(["arrows"], f"as force or moment {free}", {"force", "moment"} & set(look.arrows))
        return _released(source, output, animation, look, release)
    if is_undriven(resting) and picture:
        stated.exclude([*DRIVEN, "speed", "overlay", "duration"], "on the initial pose, which nothing drives")
        look = replace(look, **drawn_as(resting))
        return _written(output, resting, initial_pose(resting.mechanism), look)
    angle = None if animation.angle is None else parse_angle(animation.angle, "the crank angle")
    solver = source.load_moving()
    warn_about_angle("--angle", animation.angle or "", solver.written.angle)
    look = replace(look, **drawn_as(solver))
    notes.extend(without_geoms(solver, look.bodies))
    timed = not solver.motion_laws.crank
    stated.exclude(["speed", "turns", "frames_per_turn"], "under motion laws", timed)
    if animation.slow is None and not timed:
        unshown = ["speed"] if animation.method == "closed" and not look.arrows else []
        stated.exclude(unshown + ([] if path.suffix else ["fps"]), "without --slow")
    profile = profile_of(solver, animation.speed, animation.turns, angle)
    samples = animation.samples(profile.duration, picture, look.overlay, timed=timed)
    both = animation.method == "both"
    every = 1 if picture else samples_in_frame(samples)
    motion = drawn_motion(solver, "simulated" if both else animation.method, profile, round(samples) * every)
    if animation.method != "closed" and solver.source is not None and not runs_as_published(solver):
        print_stderr(
            "mechsim: stepped with mechsim's settings: MuJoCo alone runs a file whose drivers are joints"
        )
    extra: dict[str, Any] = {}
    captions = [animation.caption]
    masses: Sequence[LinkMass] = ()
    if {"force", "moment"} & set(look.arrows):
        extra |= joint_loads(solver, animation.method, profile, motion)
        masses = dynamic_model(solver).masses
        captions.append("joint loads as they act on the driven link")
    if both:
        extra["exact"] = solver.solve_as(motion)
    look = replace(look, caption="; ".join(filter(None, captions)))
    if picture:
        return _written(output, solver, motion, look, masses, angle=angle, **extra)
    periodic = returns_visibly(solver.mechanism, motion)
    tail = periodic and not timed and solver.crank_range().full
    look = replace(look, paths="tail" if tail else look.paths)
    extra |= {"fps": animation.fps, "every": every}
    return _written(output, solver, motion, look, masses, periodic=periodic, **extra)


def _released(
    source: ModelOptions, output: str, animation: AnimationOptions, look: Look, options: ReleaseOptions
) -> Result:
    """Draw a run from an initial state, or one cycle of a mode of vibration."""
    model = released_model(source)
    release = options.release(model, source)
    if options.mode is None:
        motion, every = released_motion(release, animation.fps, animation.slow)
        caption = animation.caption
    else:
        cycle = release.cycle(options.mode, 2)
        seconds = CYCLE if animation.slow is None else cycle.period * animation.slow
        count = frame_count(seconds, animation.fps)
        every = samples_in_frame(count)
        motion = release.cycle(options.mode, count * every).motion
        caption = f"{cycle.title}; 1/{number(seconds / cycle.period, 3)} of true speed"
    look = replace(look, **drawn_as(model.solver), caption=caption)
    frames = {} if output.endswith(".png") else {"fps": animation.fps, "every": every}
    periodic = options.mode is not None
    return _written(output, model.solver, motion, look, model.masses, periodic=periodic, **frames)


def released_motion(release: Release, fps: float, slow: float | None) -> tuple[Motion, int]:
    """Return the motion of a run, and how many of its samples lead from one frame to the next."""
    slow = 1.0 if slow is None else slow
    count = frame_count(release.duration * slow, fps)
    run = release.shown_run(count * samples_in_frame(count))
    duration = float(run.time[-1])
    if duration < release.duration:
        # the run ended at an event or at rest: repeat it with the frames for its actual duration
        count = frame_count(duration * slow, fps)
        run = release.shown_run(count * samples_in_frame(count))
    return run.motion, samples_in_frame(count)


def frame_count(seconds: float, fps: float) -> int:
    """Return the number of intervals between frames of an animation; raise InputError for too many."""
    count = max(2, round(seconds * fps))
    if not count <= MAX_SAMPLES:
        raise InputError(f"{count} frames; give a shorter --duration, or less --slow, for {MAX_SAMPLES}")
    return count


def _written(
    output: str,
    solver: KinematicSolver,
    motion: Motion,
    look: Look,
    masses: Sequence[LinkMass] = (),
    *,
    periodic: bool = False,
    **extra: Any,
) -> Result:
    """Write a picture or an animation with progress; a periodic one ends before its repeated first frame."""
    path, mechanism, count = Path(output), solver.mechanism, None
    if path.suffix == ".png":
        write_picture(path, mechanism, motion, replace(look, paths="whole"), **extra)
    elif path.suffix == ".glb":
        count = write_gltf(path, mechanism, motion, look, **extra)
    else:
        indices = frame_indices(motion, None, extra["every"]).astype(np.intp)
        shown = motion.angle[indices[:-1] if periodic else indices]
        with progress("draw", len(shown)) as report:
            count = write_video(path, mechanism, motion, look, angles=shown, progress=report, **extra)

    def text() -> None:
        typer.echo(f"wrote {'' if count is None else several(count, 'frame') + ' to '}{output}")
        print_masses(masses)

    data = {"mechanism": solver.name, "output": output, "frames": count, **masses_in_json(masses)}
    return Result(data, text)


def _check(stated: Stated, output: str, animation: AnimationOptions, look: Look) -> None:
    """Raise InputError for options that exclude each other."""
    if output.endswith(".png"):
        stated.exclude(["fps", "slow", "frames_per_turn"], "on a picture")
        if look.overlay > 1:
            stated.exclude(["angle"], "with --positions, which show the whole motion")
    else:
        stated.exclude(["angle", "overlay"], "on an animation, only on a .png file")
    if output.endswith(".glb"):
        drawn = ["size", "camera", "labels", "arrows"] + ["method"] * (animation.method == "both")
        stated.exclude(drawn, "in a .glb file, which has meshes and their motion alone")
    width, height = look.size
    if output.endswith((".mp4", ".webm")) and (width % 2 or height % 2):
        raise InputError(
            f"--size is '{width}x{height}', but videos have even sizes; take one pixel more or less"
        )
