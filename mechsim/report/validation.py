"""The page of a validation, and that of a model compared with a formula or a table."""

import io
import math
import os
import sys
import warnings
from collections.abc import Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from mechsim.errors import MechsimError, MissingToolError, OutputError
from mechsim.files import stem_of, write_content
from mechsim.kinematics.designs import DesignFamily, placed_designs
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.motion import Motion
from mechsim.numerics.resources import Progress, no_progress
from mechsim.pictures import plots
from mechsim.pictures.number_text import quantity_text
from mechsim.pictures.plots.motion import TwoCurves, agreement_plot
from mechsim.pictures.render import Look, still
from mechsim.pictures.render.drawn_model import drawn_as
from mechsim.pictures.render.gl_backend import choose
from mechsim.pictures.view.offline_page import page, three_js
from mechsim.report.facts import about, facts
from mechsim.report.page import Section, write_report
from mechsim.report.plot_table import PLOTS, PlotSource
from mechsim.report.views import case_view
from mechsim.studies.agreement.agreement import Agreement
from mechsim.studies.agreement.attribution import COMPONENTS
from mechsim.studies.agreement.dimension_hypotheses import with_changed
from mechsim.studies.validate import Validation, finished_fractions

# pixels of a picture
RESOLUTION = (640, 480)
# the plot of a case that was not time-stepped
UNSTEPPED_PLOTS = ("curve",)
# quality of a picture in WebP: over the mechanisms of the default run a quarter of its size in PNG
PICTURE_QUALITY = 80
# number of mechanisms from which on several processes draw
MIN_SHARED = 4
# points whose displacement, velocity and acceleration are drawn: the last ones, mostly the output
MAX_POINTS = 2
# plots of a comparison: of the quantities with the largest error / tolerance
MAX_PLOTS = 4
# options of a picture without a ghost
NO_GHOST: Mapping[str, Any] = {}
# fraction of a difference from which a single component is not drawn: it is the whole difference
ONE_SHARE = 0.99


def write_validation_report(
    folder: Path,
    cases: Mapping[str, Validation],
    results: Mapping[str, Any],
    progress: Progress = no_progress,
) -> list[str]:
    """Write a page with its pictures and plots inside, and views in files of their own.

    Args:
        folder: made if it is not there.
        cases: name -> case.
        results: as `mechsim validate --json` prints them.
        progress: called with the name of each mechanism that is drawn, and the finished fraction.

    Returns:
        What could not be done, one sentence each: without OpenGL there are no pictures, and the
        sentence names the package that brings it.
    """
    folder.mkdir(exist_ok=True)
    notes: dict[str, None] = {}
    sections: list[Section] = []
    finished = finished_fractions([case.quick for case in cases.values()])
    for section, own in _sections(folder, cases):
        sections.append(section)
        notes.update(dict.fromkeys(own))
        progress(section.name, finished[len(sections)])
    write_report(folder, results, sections, notes=[*notes])
    return [*notes]


def _sections(folder: Path, cases: Mapping[str, Validation]) -> Iterator[tuple[Section, list[str]]]:
    """Yield the section and the notes of each mechanism; where processes fork, one for each core draws.

    A forked process has the mechanisms already; they contain functions, which cannot be sent to another one.
    """
    _CASES.update(cases)
    processes = drawing_processes(len(cases))
    if processes == 1:
        yield from (_section(folder, name) for name in cases)
        return
    # found and imported once, not in each process
    with suppress(MissingToolError):
        choose()
    plots.blank(1, 1, (1.0, 1.0))
    with ProcessPoolExecutor(processes, get_context("fork")) as pool, warnings.catch_warnings():
        # the threads of the linear algebra are idle
        warnings.filterwarnings("ignore", ".*multi-threaded", DeprecationWarning)
        drawn = [pool.submit(_section, folder, name) for name in cases]
        yield from (section.result() for section in drawn)


def drawing_processes(count: int) -> int:
    """Return how many processes draw a page of several mechanisms."""
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" and count >= MIN_SHARED else 1


# the mechanisms of a page, for the processes that draw it
_CASES: dict[str, Validation] = {}


def _section(folder: Path, name: str) -> tuple[Section, list[str]]:
    """Return the section of a mechanism and its notes, and write its interactive view."""
    case, notes = _CASES[name], list[str]()
    view, library, path = case_view(case), folder / "three.min.js", folder / f"{stem_of(name)}.view.html"
    # all views share one file of three.js
    if view:
        write_content(library, three_js())
        write_content(path, page(view, library.name))
    section = Section(
        name=name,
        about=about(case.solver),
        facts=_facts(case) | ({} if case.formula is None else error_of_a_run(case.formula)),
        picture=_picture(case.solver, case.run.motion, notes),
        view=path.name if view else "",
        plots=_plots(case),
        checks=case.verdict.checks,
        settings=_settings(case),
    )
    return section, notes


def _picture(
    solver: KinematicSolver, motion: Motion, notes: list[str], ghost: Mapping[str, Any] = NO_GHOST
) -> bytes | None:
    """Return a picture as lossy WebP, of the clearest pose unless the options of a ghost name another one.

    Where it cannot be drawn, the result is None and a note says why.
    """
    look, out = Look(size=RESOLUTION, **drawn_as(solver)), io.BytesIO()
    try:
        picture = still(solver.mechanism, motion, look, paths="whole", **ghost)
    except (MissingToolError, OutputError) as error:
        notes.append(str(error))
        return None
    from PIL import Image

    Image.fromarray(picture).save(out, "WEBP", quality=PICTURE_QUALITY)
    return out.getvalue()


def _plots(case: Validation) -> list[tuple[str, bytes]]:
    """Return captions and plots of a case."""
    # tolerance on positions by method; the first check has that of all
    bounds = {c.method: c.tolerance for c in reversed(case.verdict.checks) if c.kind == "position"}
    source = PlotSource(
        solver=case.solver,
        speed=float(np.abs(case.exact.speed).max()),
        motions={"closed": case.exact, "simulated": case.run.motion, "posed": case.poses.motion},
        bounds={"simulated": bounds.get("step", math.nan), "posed": bounds.get("pose", math.nan)},
    )
    last = {name: case.exact.points[name] for name in [*case.exact.points][-MAX_POINTS:]}
    sources = {"motion": replace(source, motions={"closed": replace(case.exact, points=last)})}
    figures = [
        (kind.about, kind.figure(sources.get(name, source)))
        for name, kind in PLOTS.items()
        if kind.on_page
        and (name in UNSTEPPED_PLOTS or not case.quick)
        and (not kind.transmission or case.solver.transmission_angle(case.exact.angle) is not None)
    ]
    # the first stands left of the picture; the page fills its columns in this order, tall ones last
    figures[1:] = sorted(figures[1:], key=lambda drawn: drawn[1].get_figheight())
    return [(caption, plots.webp(figure)) for caption, figure in figures]


def _facts(case: Validation) -> dict[str, Any]:
    data = facts(case.solver, searched=False)
    rows: dict[str, Any] = {
        "mobility": data["mobility_explained"],
        "joints": [f"{joint.name}: {joint.kind}, {' - '.join(joint.links)}" for joint in data["joints"]],
    }
    if "crank_range" not in data:
        return rows
    arcs = [" to ".join(f"{math.degrees(end):.4f}°" for end in arc) for arc in data["crank_ranges"]]
    rows["crank range"] = "full turn" if data["crank_range"] == "full turn" else arcs
    if data["assemblies_complete"]:
        rows["assemblies"] = f"{len(data['assemblies'])} at crank angle {math.degrees(data['angle']):g}°"
    if data["dead_centres"]:
        rows["dead centres"] = ", ".join(f"{math.degrees(angle):.4f}°" for angle in data["dead_centres"])
    if least := data["transmission_angle"]:
        smallest, angle = math.degrees(least["least"]), math.degrees(least["at_angle"]) % 360.0
        rows["transmission angle"] = f"at least {smallest:.2f}°, at crank angle {angle:.1f}°"
    if data["assur_explained"]:
        rows["Assur groups"] = data["assur_explained"]
    return rows


def _settings(case: Validation) -> dict[str, Any]:
    run = case.run
    poses = {"solved poses": f"{case.poses.steps} in {case.poses.seconds:.4g} s"}
    if case.quick:
        return poses
    assert run.settings is not None
    speed = f"{float(np.abs(run.motion.speed).max()) * 30 / math.pi:.6g} rpm"
    return {
        **run.settings.rows(),
        "time step": f"{run.timestep:.6g} s",
        # under motion laws the speed is that of the path parameter
        **({} if run.motion.drivers else {"crank speed": speed}),
        "steps": run.steps,
        "stepping time": f"{run.seconds:.4g} s",
        **poses,
    }


def write_agreement_report(
    folder: Path, agreement: Agreement, designs: DesignFamily, results: dict[str, Any]
) -> list[str]:
    """Write a page into a folder: the model, the curves, their difference, where it comes from.

    Args:
        folder: made if it is not there.
        agreement: result of the comparison.
        designs: the parametric model that was compared.
        results: as `mechsim validate --json` prints them.

    Returns:
        What could not be done, one sentence each.
    """
    folder.mkdir(exist_ok=True)
    notes: list[str] = []
    mechanism, source = agreement.solver.mechanism, Path(agreement.source).name
    rows: dict[str, Any] = {
        "compared with": source,
        "driven": ", ".join(mechanism.drivers),
        "instants": len(agreement.evaluation),
        "joints": [f"{j.name}: {j.kind}, {j.a.link} - {j.b.link}" for j in mechanism.joints],
    }
    worst_first = sorted(range(len(agreement.candidates)), key=lambda i: -agreement.checks[i].severity)
    section = Section(
        name=agreement.solver.name,
        cause=agreement.findings[0].message if agreement.findings and not agreement.passed else "",
        facts=rows | error_of_a_run(agreement),
        picture=_picture(
            agreement.solver, agreement.evaluation.motion, notes, ghost_of_cause(agreement, designs)
        ),
        plots=[
            (f"{curves.name}: exact and claimed", plots.webp(agreement_plot(curves)))
            for curves in (_curves(agreement, i) for i in worst_first[:MAX_PLOTS])
        ],
        checks=agreement.checks,
    )
    mechanisms = results["mechanisms"]
    if not agreement.passed:
        mechanisms = {
            name: {**case, "reason": f"disagrees with {source}"} for name, case in mechanisms.items()
        }
    write_report(folder, {**results, "mechanisms": mechanisms}, [section], notes=notes)
    return notes


def ghost_of_cause(agreement: Agreement, designs: DesignFamily) -> dict[str, Any]:
    """Return the options of a picture with the motion of the wrong dimension that explains a difference.

    It is shown where the difference is the largest; nothing where another cause explains it.
    """
    evaluation, cause = agreement.evaluation, next(iter(agreement.findings), None)
    described = (designs, placed_designs(agreement.solver))
    varied = next((d for d in described if cause and cause.object in d.dimensions), None)
    if cause is None or varied is None:
        return {}
    try:
        wrong = with_changed(evaluation, varied, cause.object, cause.value).motion
    except MechsimError:
        return {}
    worst = max(agreement.checks, key=lambda check: check.severity)
    return {
        "exact": replace(wrong, source=Path(agreement.source).name),
        "angle": worst.instant if worst.at_unit == "rad" else None,
        "caption": cause.message.partition(" (")[0],
    }


def _curves(agreement: Agreement, i: int) -> TwoCurves:
    candidate, instants = agreement.candidates[i], agreement.evaluation.instants
    by_component = agreement.attribution.get("quantities", {}).get(candidate.quantity.name, {})
    shares = {name: float(by_component[name]) for name in COMPONENTS if name in by_component}
    if max(shares.values(), default=0.0) > ONE_SHARE * sum(shares.values()):
        shares = {}
    return TwoCurves(
        name=candidate.quantity.name,
        unit=candidate.quantity.unit,
        instants=instants.value,
        over=instants.unit,
        exact=agreement.exact[i],
        claimed=candidate.values,
        components=candidate.quantity.axes,
        tolerance=agreement.checks[i].tolerance,
        source=Path(agreement.source).name,
        shares=shares,
    )


def error_of_a_run(agreement: Agreement) -> dict[str, Any]:
    """Return where the difference of a time-stepped run comes from; nothing without such a run."""
    data = agreement.attribution
    if "says" not in data:
        return {}
    sizes = {name: quantity_text(float(data[name]), str(data["unit"])) for name in ("whole", *COMPONENTS)}
    sources = ", ".join(f"{name} {sizes[name]}" for name in COMPONENTS)
    return {
        "error of a time-stepped run": [str(data["run"]), f"{data['quantity']}: {sizes['whole']} = {sources}"]
    }
