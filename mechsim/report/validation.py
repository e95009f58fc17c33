"""The page of a validation: each case with its facts, pictures, plots, verdict and cost."""

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from mechsim.analytic.catalog.base import ClosedForm
from mechsim.errors import MissingToolError, OutputError
from mechsim.files import stem_of, written_beside
from mechsim.pictures import plots
from mechsim.pictures.plots.motion import TwoCurves, agreement_plot
from mechsim.pictures.view import page, three_js
from mechsim.report.facts import facts
from mechsim.report.page import Section, studies_in, write_report
from mechsim.report.plot_table import PLOTS, PlotSource
from mechsim.report.views import case_view
from mechsim.studies.agreement.agreement import Agreement
from mechsim.studies.agreement.attribution import PARTS
from mechsim.studies.validate import Case

SIZE = (640, 480)
FRAMES_PER_TURN = 36
FRAMES_PER_SECOND = 18.0
# of a case without a stepped run: a still and this plot
QUICK = ("curve",)


def write_validation_report(
    folder: Path,
    cases: Mapping[str, Case],
    results: Mapping[str, Any],
    done: Callable[[str], None] = lambda _: None,
) -> list[str]:
    """Write plots, pictures, videos and the page that shows them into a folder.

    Args:
        folder: made if it is not there.
        cases: name -> case.
        results: as `mechsim validate --json` prints them.
        done: called with the name of each mechanism drawn.

    Returns:
        What could not be done, one sentence each: without OpenGL there are no pictures, and the
        sentence names the package that brings it.
    """
    folder.mkdir(exist_ok=True)
    notes: list[str] = []
    sections: list[Section] = []
    for name, case in cases.items():
        still, video = _drawn(folder, name, case, notes)
        turned = _turned(folder, name, case)
        drawings = _plots(case)
        for kind, drawing in drawings.items():
            with written_beside(folder / f"{stem_of(name)}_{kind}.svg") as beside:
                beside.write_bytes(drawing)
        sections.append(
            Section(
                name=name,
                title=name,
                facts=_facts(case) | ({} if case.formula is None else explanations(case.formula)),
                still=still,
                video=video,
                turned=turned,
                plots=[(PLOTS[kind].about, drawing) for kind, drawing in drawings.items()],
                checks=case.verdict.checks,
                settings=_settings(case),
            )
        )
        done(name)
    write_report(folder, results, sections, notes=notes, studies=studies_in(folder))
    return notes


def _drawn(folder: Path, name: str, case: Case, notes: list[str]) -> tuple[bytes | None, Path | None]:
    """Write a still and, of a stepped run, a video; return the still's bytes and the video's path.

    What cannot be drawn is None, and the notes say why; the page does without it.
    """
    from mechsim.pictures.render import Look, turn_angles, write_picture, write_video
    from mechsim.pictures.render.file_bodies import drawn_as

    mechanism, motion = case.drive.mechanism, case.run.motion
    look = Look(size=SIZE, **drawn_as(case.drive))
    picture, video = folder / f"{stem_of(name)}.png", folder / f"{stem_of(name)}.mp4"
    still: bytes | None = None
    try:
        write_picture(picture, mechanism, motion, look, angle=float(motion.angle[0]), paths="whole")
        still = picture.read_bytes()
        if case.quick:
            return still, None
        angles = turn_angles(mechanism, motion, FRAMES_PER_TURN)
        write_video(video, mechanism, motion, look, angles=angles, fps=FRAMES_PER_SECOND, paths="tail")
    except (MissingToolError, OutputError) as error:
        # where nothing at all can be written, the page says so
        if str(error) not in notes:
            notes.append(str(error))
        return still, None
    return still, video


def _turned(folder: Path, name: str, case: Case) -> str:
    """Write a page to turn the mechanism by hand and return its name; empty where there is none.

    All pages share one file of three.js.
    """
    shown = case_view(case)
    if shown is None:
        return ""
    library, place = folder / "three.min.js", folder / f"{stem_of(name)}.view.html"
    for path, text in ((library, three_js()), (place, page(shown, library.name))):
        with written_beside(path) as beside:
            beside.write_text(text, encoding="utf-8")
    return place.name


def _plots(case: Case) -> dict[str, bytes]:
    """Return the plots of a case as SVG: kind -> bytes."""
    source = PlotSource(
        solver=case.drive,
        speed=float(np.abs(case.exact.speed).max()),
        motions={"closed": case.exact, "simulated": case.run.motion, "posed": case.poses.motion},
        bounds={road: _bound(case, by) for road, by in (("simulated", "step"), ("posed", "pose"))},
    )
    wanted = {
        name: kind for name, kind in PLOTS.items() if kind.on_page and (name in QUICK or not case.quick)
    }
    closed = isinstance(case.drive, ClosedForm)
    return {
        name: plots.drawn(kind.draw(source)) for name, kind in wanted.items() if closed or not kind.closed
    }


def _bound(case: Case, road: str) -> float:
    bounds = (
        check.tolerance for check in case.verdict.checks if (check.method, check.kind) == (road, "position")
    )
    return next(bounds, math.nan)


def _facts(case: Case) -> dict[str, Any]:
    known = facts(case.drive)
    listed: dict[str, Any] = {
        "what it is": known["about"],
        "mobility": known["mobility_explained"],
        "joints": [f"{j['name']}: {j['kind']}, {j['links'][0]} - {j['links'][1]}" for j in known["joints"]],
    }
    if "crank_range" not in known:
        return listed
    reach = known["crank_range"]
    if reach != "full turn":
        reach = [
            f"{math.degrees(low):.4f}° to {math.degrees(high):.4f}°" for low, high in known["crank_ranges"]
        ]
    listed["crank range"] = reach
    listed["assemblies"] = f"{len(known['assemblies'])} at crank angle {math.degrees(known['angle']):g}°"
    if known["dead_centres"]:
        listed["dead centres"] = ", ".join(f"{math.degrees(at):.4f}°" for at in known["dead_centres"])
    if known["transmission_angle"] is not None:
        least = known["transmission_angle"]
        value, place = math.degrees(least["least"]), math.degrees(least["at_angle"]) % 360.0
        listed["transmission angle"] = f"at least {value:.2f}°, at crank angle {place:.1f}°"
    if known["assur_explained"]:
        listed["Assur groups"] = known["assur_explained"]
    return listed


def _settings(case: Case) -> dict[str, Any]:
    run = case.run
    posed = {"poses": f"{case.poses.steps} solved in {case.poses.seconds:.4g} s"}
    if case.quick:
        return posed
    assert run.settings is not None
    return {
        **run.settings.rows(),
        "time step": f"{run.timestep:.6g} s",
        "crank speed": f"{float(np.abs(run.motion.speed).max()) * 30 / math.pi:.6g} rpm",
        "steps": run.steps,
        "stepping time": f"{run.seconds:.4g} s",
        **posed,
    }


# quantities drawn on the page: those farthest beyond their bounds
DRAWN = 4


def write_agreement_report(folder: Path, found: Agreement, results: dict[str, Any]) -> list[str]:
    """Write a page into a folder: the model, the curves, their difference, where it comes from.

    Args:
        folder: made if it is not there.
        found: what came of the comparison.
        results: as `mechsim validate --json` prints them.

    Returns:
        What could not be done, one sentence each.
    """
    folder.mkdir(exist_ok=True)
    notes: list[str] = []
    drawings: list[tuple[str, bytes]] = []
    for curves in worst_first(found)[:DRAWN]:
        drawings.append((f"{curves.name}: exact and claimed", plots.drawn(agreement_plot(curves))))
    for name, (_, drawing) in zip(_stems(found), drawings, strict=False):
        with written_beside(folder / f"{name}.svg") as beside:
            beside.write_bytes(drawing)
    section = Section(
        name=found.form.name,
        title=found.form.name,
        facts=_agreement_facts(found),
        still=_still(folder, found, notes),
        plots=drawings,
        checks=found.checks,
    )
    told = {
        name: {**one, "reason": one["why"]} for name, one in results["mechanisms"].items() if not found.passed
    }
    write_report(folder, {**results, "mechanisms": told or results["mechanisms"]}, [section], notes=notes)
    return notes


def worst_first(found: Agreement) -> list[TwoCurves]:
    """Return the curves of all quantities, those that use most of their bounds first."""
    order = sorted(range(len(found.claims)), key=lambda i: -(found.checks[i].fraction_of_tolerance or 0.0))
    return [_curves(found, i) for i in order]


def _curves(found: Agreement, i: int) -> TwoCurves:
    claim, comparand = found.claims[i], found.comparand
    instants = comparand.instants
    noise = found.noise[i] if found.noise else None
    apart = found.attribution.get("quantities", {}).get(claim.named.name, {})
    return TwoCurves(
        name=claim.named.name,
        unit=claim.named.unit,
        instants=instants.value,
        over=instants.unit,
        exact=found.exact[i],
        claimed=claim.values,
        components=claim.named.axes,
        tolerance=found.checks[i].tolerance if noise is None else noise.largest.limit * noise.deviation,
        source=found.source,
        shares={part: apart[part] for part in PARTS if part in apart},
    )


def _stems(found: Agreement) -> list[str]:
    names = [curves.name for curves in worst_first(found)[:DRAWN]]
    return [f"against_{stem_of(name)}" for name in names]


def _still(folder: Path, found: Agreement, notes: list[str]) -> bytes | None:
    from mechsim.pictures.render import write_picture
    from mechsim.pictures.render.file_bodies import drawn_as

    picture, motion = folder / "model.png", found.comparand.motion
    start = float(found.comparand.angle[0])
    try:
        write_picture(picture, found.form.mechanism, motion, size=SIZE, angle=start, **drawn_as(found.form))
        return picture.read_bytes()
    except (MissingToolError, OutputError) as error:
        notes.append(str(error))
        return None


def _agreement_facts(found: Agreement) -> dict[str, Any]:
    mechanism = found.form.mechanism
    facts: dict[str, Any] = {
        "held against": found.source,
        "driven": ", ".join(mechanism.drivers),
        "instants": len(found.comparand),
        "joints": [f"{j.name}: {j.kind}, {j.a.link} - {j.b.link}" for j in mechanism.joints],
    }
    return facts | explanations(found)


def explanations(found: Agreement) -> dict[str, Any]:
    """Return what explains a difference, and where that of a run in time comes from, as facts of a page."""
    facts: dict[str, Any] = {}
    if found.measured:
        facts["noise of what was measured"] = [found.noise_report]
    if found.findings:
        facts["what explains the difference"] = [[one.message] for one in found.findings]
    if "says" in found.attribution:
        facts["a run in time"] = [str(found.attribution["run"]), str(found.attribution["says"])]
    return facts
