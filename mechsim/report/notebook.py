"""Display of results in a notebook: tables, plots, videos, interactive pages."""

from __future__ import annotations

import base64
import tempfile
from dataclasses import dataclass, field, replace
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

from mechsim.numerics.arrays import REVOLUTION

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from os import PathLike

    from mechsim.kinematics.solvers import KinematicSolver
    from mechsim.mechanism.mechanism import Mechanism, Up
    from mechsim.mechanism.motion import Motion
    from mechsim.pictures.render import Look
    from mechsim.studies.release import Release

PASS_COLOUR, FAIL_COLOUR = "#00694c", "#a8261a"
# default crank speed of a page, in [rad/s]
SPEED = 10.0 * REVOLUTION


@dataclass(frozen=True, slots=True)
class Video:
    """A video that plays as the last line of a notebook's cell.

    Attributes:
        data: the mp4 file.
        width: in pixels.
    """

    data: bytes = field(repr=False)
    width: int

    def _repr_html_(self) -> str:
        source = base64.b64encode(self.data).decode("ascii")
        return (
            f'<video width="{self.width}" controls loop muted autoplay playsinline '
            f'src="data:video/mp4;base64,{source}"></video>'
        )


@dataclass(frozen=True, slots=True)
class Still:
    """A picture, shown as the last line of a notebook's cell.

    Attributes:
        data: the PNG file.
    """

    data: bytes = field(repr=False)

    def _repr_png_(self) -> bytes:
        return self.data


@dataclass(frozen=True, slots=True)
class FramedPage:
    """An interactive page, shown as the last line of a notebook's cell.

    Attributes:
        text: the page as HTML; a file with this text equals the output of `mechsim view`.
        height: in pixels.
    """

    text: str = field(repr=False)
    height: int

    def _repr_html_(self) -> str:
        return (
            f'<iframe srcdoc="{escape(self.text)}" width="100%" height="{self.height}" '
            'style="border: 0" title="interactive view"></iframe>'
        )


@overload
def show(mechanism: Any, *, speed: float | str = SPEED, height: int = 720) -> FramedPage: ...
@overload
def show(mechanism: Mechanism, motion: Motion, look: Look | None = None, **options: Any) -> Video: ...
def show(mechanism: Any, motion: Motion | None = None, look: Look | None = None, **options: Any) -> Any:
    """Return a page to turn a mechanism by hand; with a motion, a film of it.

    Args:
        mechanism: what moves: what `load` takes; for a film its description.
        motion: how it moves, analytic or simulated; None for a page.
        look: what the film shows; None is the usual, with paths that reach back a quarter of a turn.
        options: of a page, those of `view`; of a film, `frames_per_turn`, `fps`, `size`, fields of `Look`,
            and `exact`, the same motion by the closed form, drawn as a ghost.
    """
    return view(mechanism, **options) if motion is None else video(mechanism, motion, look, **options)


def view(
    model: Any,
    output: str | PathLike[str] | None = None,
    *,
    set: Mapping[str, str | float] | None = None,
    speed: float | str = SPEED,
    up: Up | None = None,
    live: bool = False,
    height: int = 720,
    **options: Any,
) -> FramedPage:
    """Return an interactive 3-D page of a model, as `mechsim view` writes it.

    Args:
        model: any argument of `load`: a name, a file, a MuJoCo object, a mechanism or a solver.
        output: path of the page, .html; None writes none.
        set: parameter -> its value, as for `load`.
        speed: of the crank, in [rad/s] or as "600rpm".
        up: axis that points up, as "z" or "-y"; by default opposite to gravity, else y.
        live: whether the page solves the mechanism, with sliders of its dimensions and points to drag.
        height: of the frame in a notebook, in pixels.
        options: `drive`, `lock` and further arguments of `load`.

    Raises:
        InputError: for what does not move, or an unknown model.
        AssemblyError: where the loops do not close.
        MobilityError: of a live page, where the drivers do not determine the motion.

    Example:
        >>> ms.view("stewart_gough", "platform.html")
    """
    from mechsim.files import write_content
    from mechsim.io.readers import load, open_model, parametric_model
    from mechsim.mechanism.mechanism import require_axis
    from mechsim.pictures.view.offline_page import page
    from mechsim.report.views import live_view, model_view
    from mechsim.units import si

    require_axis("up", up)
    opened, rate = open_model(model), si(speed, "rad/s", "the speed")
    solver = load(opened, set, **options)
    contents = model_view(solver, rate, up)
    if live:
        contents = live_view(contents, opened, solver, parametric_model(opened, set, **options), rate)
    framed = FramedPage(page(contents), height)
    if output is not None:
        write_content(Path(output), framed.text)
    return framed


def plot(
    model: Any,
    output: str | PathLike[str] | None = None,
    *,
    kind: str = "motion",
    quantities: Sequence[str] | None = None,
    set: Mapping[str, str | float] | None = None,
    speed: float | str = SPEED,
    **options: Any,
) -> Any:
    """Return a plot of a driven motion as a figure of matplotlib, as `mechsim plot` draws it.

    Args:
        model: any argument of `load`.
        output: path to write, .svg, .pdf or .png; None writes none.
        kind: as of `mechsim plot --kind`, such as "motion" or "curve".
        quantities: names of quantities, for the kind "quantities".
        set: parameter -> its value, as for `load`.
        speed: of the crank, in [rad/s] or as "600rpm".
        options: `drive`, `lock` and further arguments of `load`.

    Raises:
        InputError: for an unknown kind or model.
        AssemblyError: where the loops do not close.

    Example:
        >>> ms.plot("four_bar", "curve.svg", kind="curve")
    """
    from mechsim.pictures import plots
    from mechsim.report.plot_table import OF_RUNS, PlotSource, plot_kind
    from mechsim.units import crank_speed

    row = plot_kind(kind, quantities)
    solver, release = _opened(model, set, options, still=kind == "schematic")
    release = release if kind in OF_RUNS else None
    source = PlotSource(solver=solver, speed=crank_speed(speed), quantities=quantities or (), release=release)
    figure = row.figure(source)
    if output is not None:
        plots.write(Path(output), figure)
    return figure


def render(
    model: Any,
    output: str | PathLike[str] | None = None,
    motion: Motion | None = None,
    *,
    angle: float | None = None,
    set: Mapping[str, str | float] | None = None,
    speed: float | str = SPEED,
    turns: float = 1.0,
    fps: float = 30.0,
    **options: Any,
) -> Still | None:
    """Return a picture of a mechanism, or write an animation of it, as `mechsim render` does.

    Args:
        model: any argument of `load`.
        output: path to write: .png, .mp4, .webm, .gif, .glb (glTF: meshes and their motion), or a new folder
            for a file of each frame; None writes none and returns a picture.
        motion: what is drawn, analytic or simulated; None for a turn of the crank, or the motion laws.
        angle: crank angle of a picture in [rad]; None for one that shows the mechanism well.
        set: parameter -> its value, as for `load`.
        speed: of the crank, in [rad/s] or as "600rpm".
        turns: of the crank.
        fps: frames per second of an animation; a turn has 72 frames, a given `motion` one for
            each instant.
        options: fields of `Look`, such as `camera`, `size` and `arrows`; `drive`, `lock` and further
            arguments of `load`.

    Raises:
        InputError: for an unknown model, option or kind of file.
        AssemblyError: where the loops do not close.
        MissingToolError: where this machine has no OpenGL, or no ffmpeg for a film.

    Example:
        >>> ms.render("rssr", "rssr.png", camera="top")
    """
    from mechsim.errors import require_known
    from mechsim.io.model_source import Prescription
    from mechsim.pictures.render import Look, write_picture, write_video
    from mechsim.pictures.render.drawn_model import drawn_as
    from mechsim.pictures.render.frame_poses import returns_visibly
    from mechsim.pictures.render.gltf import write_gltf
    from mechsim.pictures.render.look import look_options
    from mechsim.studies.drawn_motion import drawn_motion, initial_pose, is_undriven
    from mechsim.studies.motions import profile_of
    from mechsim.units import crank_speed

    shown = {name: options.pop(name) for name in [*options] if name in Look.__dataclass_fields__}
    require_known("a picture has no option", options, [*look_options(), *Prescription.__dataclass_fields__])
    solver, release = _opened(model, set, options, still=motion is not None)
    look = replace(Look(), **{**drawn_as(solver), **shown})
    timed, picture = not solver.motion_laws.crank, output is None or Path(output).suffix == ".png"
    if release is not None and motion is None:
        motion = release.shown_run(360 if picture else max(2, round(release.duration * fps))).motion
    elif is_undriven(solver) and motion is None:
        motion = initial_pose(solver.mechanism)
    elif motion is None:
        profile = profile_of(solver, crank_speed(speed), turns, angle)
        samples = 360.0 * abs(turns) if picture else profile.duration * fps if timed else 72.0 * abs(turns)
        motion = drawn_motion(solver, "closed", profile, max(1.0, samples))
    if output is not None and not picture:
        if Path(output).suffix == ".glb":
            write_gltf(output, solver.mechanism, motion, look, fps=fps)
            return None
        # a repeated first frame is left out
        angles = motion.angle[:-1] if returns_visibly(solver.mechanism, motion) else motion.angle
        write_video(output, solver.mechanism, motion, look, angles=angles, fps=fps)
        return None
    look = replace(look, paths="whole" if look.paths else False)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "picture.png" if output is None else Path(output)
        write_picture(path, solver.mechanism, motion, look, angle=angle)
        return Still(path.read_bytes())


def _opened(
    model: Any, set: Mapping[str, str | float] | None, options: dict[str, Any], *, still: bool
) -> tuple[KinematicSolver, Release | None]:
    """Return the solver of a model, and the run from the start of one that only its own forces move."""
    from mechsim.io.readers import load
    from mechsim.kinetics import dynamic_model
    from mechsim.studies.drawn_motion import is_undriven, moved_by_forces
    from mechsim.studies.release import DURATION, Release
    from mechsim.units import si

    undriven: dict[str, Any] = options | {"duration": None, "still": True}
    resting = load(model, set, **undriven)
    if moved_by_forces(resting):
        duration = si(options.get("duration") or DURATION, "s", "the duration")
        return resting, Release(model=dynamic_model(resting), duration=duration)
    return (resting if still or is_undriven(resting) else load(model, set, **options)), None


def video(
    mechanism: Mechanism,
    motion: Motion,
    look: Look | None = None,
    *,
    frames_per_turn: int = 48,
    fps: float = 24.0,
    size: tuple[int, int] = (480, 360),
    exact: Motion | None = None,
    **options: Any,
) -> Video:
    """Return a video of a motion, analytic or simulated; whole turns play in a loop without a seam.

    Args:
        mechanism: the mechanism.
        motion: its motion.
        look: what the film shows; None is the usual, with paths that reach back a quarter of a turn.
        frames_per_turn: frames in a revolution of the crank.
        fps: frames per second.
        size: (width, height) in pixels.
        exact: the same motion by the closed form, drawn as a ghost.
        options: other fields of `render.Look` in place of the look's, or `forces` and `moments` for its
            arrows, as `render.frames` takes them.
    """
    from mechsim.pictures.render import turn_angles, write_video

    if look is None:
        options.setdefault("paths", "tail")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "film.mp4"
        angles = turn_angles(mechanism, motion, frames_per_turn)
        write_video(path, mechanism, motion, look, angles=angles, fps=fps, exact=exact, size=size, **options)
        return Video(path.read_bytes(), size[0])


def result_html(result: Any) -> str:
    """Return a verdict, a validation or an agreement as its outcome and the table of its checks."""
    from mechsim.compare.checks import Verdict, check_table

    head, rows = check_table(result.checks)
    reason = result.reason if isinstance(result, Verdict) else result.why
    failed = [i for i, check in enumerate(result.checks) if not check.passed]
    return _title(result.outcome, reason) + _table(rows, head, failed)


def motion_html(motion: Motion) -> str:
    """Return a motion as its length and columns, and a plot."""
    names = [*motion.points, *motion.joints]
    rows = [("instants", len(motion)), ("source", motion.source), ("points and joints", ", ".join(names))]
    return _table(rows) + (_plot(motion) if motion.points else "")


def run_html(run: Any) -> str:
    """Return a run as its result, its settings, and a plot of its motion."""
    summary = run.summary()
    settings = {name.replace("_", " "): value for name, value in summary.pop("settings").items()}
    rows = [
        (name, f"{value:.6g}" if isinstance(value, float) else value)
        for name, value in [*summary.items(), *settings.items()]
    ]
    return f"{_title(run.outcome)}<details><summary>how</summary>{_table(rows)}</details>{_plot(run.motion)}"


def figure_svg(figure: Any) -> str | None:
    """Return a figure of matplotlib as SVG; None for one that pyplot displays itself."""
    from mechsim.pictures import plots

    if figure.canvas.manager is not None:
        return None
    drawing = plots.drawn(figure).decode("utf-8")
    return drawing[drawing.index("<svg") :]


# (module, class) -> MIME type and function of its display
SHOWN = {
    ("mechsim.compare.checks", "Verdict"): ("text/html", result_html),
    ("mechsim.studies.validate", "Validation"): ("text/html", result_html),
    ("mechsim.studies.agreement.agreement", "Agreement"): ("text/html", result_html),
    ("mechsim.mechanism.motion", "Motion"): ("text/html", motion_html),
    ("mechsim.simulation.result", "Run"): ("text/html", run_html),
    ("matplotlib.figure", "Figure"): ("image/svg+xml", figure_svg),
}


def register() -> None:
    """Register the displays with IPython, if it runs; imports nothing else."""
    from IPython.core.getipython import get_ipython

    shell: Any = get_ipython()
    if shell is None:
        return
    for (module, name), (kind, page) in SHOWN.items():
        shell.display_formatter.formatters[kind].for_type_by_name(module, name, page)


def _title(outcome: str, reason: str = "") -> str:
    colour = PASS_COLOUR if outcome == "passed" else FAIL_COLOUR
    text = escape(f"{outcome}: {reason}" if reason else outcome)
    return f'<p style="color:{colour};font-weight:600">{text}</p>'


def _plot(motion: Motion) -> str:
    from mechsim.pictures import plots

    return (figure_svg(plots.motion_plot(motion)) or "") if len(motion) > 1 else ""


def _table(rows: Sequence[Any], head: Sequence[str] = (), failed: Sequence[int] = ()) -> str:
    """Return rows of columns in HTML, those that failed in red."""
    lines = ["<table>"]
    if head:
        lines.append("<tr>" + "".join(f"<th>{escape(name)}</th>" for name in head) + "</tr>")
    for i, row in enumerate(rows):
        style = f' style="color:{FAIL_COLOUR}"' if i in failed else ""
        columns = "".join(f'<td style="text-align:left">{escape(str(text))}</td>' for text in row)
        lines.append(f"<tr{style}>{columns}</tr>")
    return "\n".join([*lines, "</table>"])
