"""What the page and a plot tell of a model held against a formula or a table."""

from pathlib import Path
from typing import Any

from mechsim.errors import MissingToolError, OutputError
from mechsim.files import stem_of, written_beside
from mechsim.pictures import plots
from mechsim.pictures.plots.agreement import TwoCurves, agreement_plot
from mechsim.report.page import Section, write_report
from mechsim.studies.agreement.agreement import Agreement
from mechsim.studies.agreement.attribution import PARTS

SIZE = (640, 480)
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
        facts=_facts(found),
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
        at=instants.value,
        over=instants.unit,
        exact=found.exact[i],
        claimed=claim.values,
        parts=claim.named.axes,
        bound=found.checks[i].tolerance if noise is None else noise.largest.limit * noise.deviation,
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


def _facts(found: Agreement) -> dict[str, Any]:
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
