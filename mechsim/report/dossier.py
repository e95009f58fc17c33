"""The dossier of a model: its use, where its dimensions come from, what was compared, and what was not.

The headings follow ASME V&V 10 and NASA-STD-7009B. No level of credibility is assigned: it is a judgement for
one decision. A third file is of the SSP Traceability standard, a
SimulationResourceMetaData 1.0.0, which points to the model's file by its checksum.
"""

import hashlib
import math
import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote
from xml.etree import ElementTree

from mechsim._version import __version__
from mechsim.compare.tolerances import instants_of
from mechsim.files import plain, stem_of, write_content, write_json
from mechsim.io import catalog, gallery
from mechsim.kinematics.designs import DesignFamily
from mechsim.report.page import METHODS, about_this_run, environment, tightest
from mechsim.studies.agreement.agreement import Agreement
from mechsim.studies.sensitivity.moved_family import MovedFamily, spread_instants
from mechsim.studies.sensitivity.sensitivity import derivative_table, tolerance_study
from mechsim.studies.validate import Validation

# rows of a table on the page, which has one side of A4; the JSON file has all
MAX_ROWS = 12
SRMD, COMMON = (
    f"http://ssp-standard.org/SSPTraceability1/{name}"
    for name in ("SimulationResourceMetaData", "SSPTraceabilityCommon")
)


def write_dossier(
    folder: Path, target: str, name: str, model: str, design: DesignFamily, record: Validation | Agreement
) -> None:
    """Write page, JSON and SRMD of a model.

    Args:
        folder: folder of the files while they are incomplete.
        target: folder in which they will lie.
        name: name of the model.
        model: the model as on the command line: a name or a path.
        design: the model with its dimensions.
        record: its comparison by all methods, or with a formula or table.
    """
    data = dossier(name, model, design, record)
    stem = folder / stem_of(name)
    write_json(f"{stem}.dossier.json", data)
    rows = sorted((check for _, check in tightest(record.checks)), key=lambda check: -check.severity)
    template = environment().get_template("dossier.html")
    page = template.render(**data, checks=rows, most=MAX_ROWS, json=f"{stem.name}.dossier.json")
    write_content(f"{stem}.dossier.html", page)
    write_content(f"{stem}.srmd", _srmd(data, target))


def dossier(name: str, model: str, design: DesignFamily, record: Validation | Agreement) -> dict[str, Any]:
    """Return what a dossier states, as plain data in SI."""
    inputs = input_files(model)
    if isinstance(record, Agreement):
        inputs += input_files(record.source)
    dimensions = {
        dimension: {
            "value": row.value,
            "unit": row.unit,
            "uncertainty": row.uncertainty,
            "source": row.source or None,
            "computed_from": sorted(design.derived.get(dimension, ())),
        }
        for dimension, row in design.dimensions.items()
    }
    methods = dict.fromkeys(check.method for check in record.checks)
    return plain(
        {
            "model": name,
            "intended_use": design.intended_use or None,
            "dimensions": dimensions,
            "effects": _effects(design),
            "compared": [" with ".join(METHODS.get(method, (method, ""))) for method in methods],
            "verification": record.as_dict(),
            "validation": _table(record),
            "not_covered": not_covered(design, record),
            "inputs": {path: _digest(path, "sha256") for path in dict.fromkeys(inputs)},
            "about": about_this_run(),
        }
    )


def not_covered(design: DesignFamily, record: Validation | Agreement) -> list[str]:
    """Return what a comparison leaves open, in sentences."""
    instants = record.evaluation.instants if isinstance(record, Agreement) else instants_of(record.exact)
    factor, unit = (180.0 / math.pi, "deg") if instants.unit == "rad" else (1.0, instants.unit)
    first, last = factor * instants.value[0], factor * instants.value[-1]
    independent = [row for name, row in design.dimensions.items() if not design.derived.get(name)]
    count = len(independent)
    sentences = []
    if not design.intended_use:
        sentences.append("Intended use: the model states none, so nothing was judged against it.")
    for what, missing in {
        "source": [row.name for row in independent if not row.source],
        "uncertainty": [row.name for row in independent if row.uncertainty is None],
    }.items():
        if missing:
            named = f": {', '.join(missing)}" if len(missing) <= MAX_ROWS else ""
            sentences.append(f"No {what} is stated for {len(missing)} of {count} dimensions{named}.")
    if _table(record) is None:
        sentences.append("The real mechanism: no table of measurements was compared (--against FILE.csv).")
    if isinstance(record, Validation):
        if record.quick or record.run.note:
            sentences.append(f"A run in time: {record.run.note or 'not stepped'}.")
        if record.formula is None:
            sentences.append("A formula by another author: the model names none.")
        sentences.append("Torques, reactions and masses: compared by mechsim dynamics, not here.")
    sentences.append(f"Other motions than this one from {first:.4g} to {last:.4g} {unit}.")
    sentences.append("Deformation, wear and temperature: links are rigid.")
    return sentences


def _table(record: Validation | Agreement) -> str | None:
    """Return the table with which a model was compared, or None."""
    if isinstance(record, Agreement) and record.source.lower().endswith(".csv"):
        return record.source
    return None


def _effects(design: DesignFamily) -> dict[str, dict[str, float]]:
    """Return the largest deviation of each point's coordinates by the stated uncertainties, in [m]."""
    bounds, solver = design.uncertainties, design.make({})
    if not bounds or not solver.mechanism.points:
        return {}
    moved = MovedFamily(design, spread_instants(solver), 1.0)
    table = derivative_table(moved, [*solver.mechanism.points], list(bounds))
    study = tolerance_study(table, bounds)
    return {
        quantity: {"worst": study.worst(quantity).max(), "rss": study.squares(quantity).max()}
        for quantity in table.values
    }


def input_files(model: str) -> list[str]:
    """Return the file of a model and the files that it names in quotes, and those that these name."""
    path = re.sub(r"(\.py):[^/]*$", r"\1", model)
    own = gallery.named() | {name: catalog.models() / f"{name}.toml" for name in catalog.MECHANISMS}
    files, waiting = list[str](), [str(own.get(path, path))]
    while waiting:
        path = waiting.pop()
        if path in files or not os.path.isfile(path):
            continue
        files.append(path)
        if not path.endswith((".toml", ".xml", ".urdf", ".sdf")):
            continue
        quoted = re.findall(r"[\"']([^\"'\n]+)[\"']", Path(path).read_text("utf-8", errors="replace"))
        above = [Path(path).parent, *(Path(path).parent / name for name in quoted)]
        folders = [folder for folder in dict.fromkeys(above) if folder.is_dir()]
        names = [re.sub(r"(\.py):\w+$", r"\1", name) for name in quoted]
        waiting += sorted({str(folder / name) for folder in folders for name in names})
    return files


def _digest(path: str, algorithm: str) -> str:
    with open(path, "rb") as file:
        return hashlib.file_digest(file, algorithm).hexdigest()


def _srmd(data: Mapping[str, Any], target: str) -> str:
    """Return the metadata of the model's file; its path is relative to the folder of the metadata."""
    ElementTree.register_namespace("srmd", SRMD)
    ElementTree.register_namespace("stc", COMMON)
    attributes = {
        "version": "1.0.0",
        "name": data["model"],
        "description": "what mechsim validate compared, and what it did not",
        "generationTool": f"mechsim {__version__}",
        "generationDateAndTime": data["about"]["made"].replace(" UTC", ":00Z").replace(" ", "T"),
    }
    file = next(iter(data["inputs"]), None)
    if file is not None:
        attributes["data"] = quote(os.path.relpath(file, target).replace(os.sep, "/"))
        attributes |= {"checksum": _digest(file, "sha3_256"), "checksumType": "SHA3-256"}
    root = ElementTree.Element(f"{{{SRMD}}}SimulationResourceMetaData", attributes)
    entries = ElementTree.SubElement(root, f"{{{COMMON}}}Classification")

    def state(keyword: str, texts: Sequence[str]) -> None:
        for text in texts:
            ElementTree.SubElement(entries, f"{{{COMMON}}}ClassificationEntry", keyword=keyword).text = text

    state("intended use", [data["intended_use"] or "not stated"])
    for name, row in data["dimensions"].items():
        if row["source"]:
            state(f"source of {name}", [row["source"]])
    state("outcome", [data["verification"]["outcome"]])
    state("compared", data["compared"])
    state("not covered", data["not_covered"])
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"
