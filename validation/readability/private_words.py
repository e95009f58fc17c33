"""Count words that only this project uses, in identifiers, in prose of the sources and on the pages.

    python validation/readability/private_words.py [--list] [PATH ...]

The tables `WORDS`, `PHRASES`, `NAME_PARTS` and `NAMES` give the term of the field that replaces each word.

"""

import argparse
import ast
import io
import re
import sys
import tokenize
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]

# rejected in prose and as a part of an identifier: word -> what to write instead
WORDS = {
    "told": "reported, known",
    "tells": "reports, determines",
    "tell": "report, determine",
    "road": "method",
    "roads": "methods",
    "stray": "corrector displacement",
    "lap": "revolution",
    "telling": "significant, reporting",
    "foretold": "predicted, expected",
    "foretell": "predict",
    "foretells": "predicts",
    "nought": "zero",
    "thrice": "three times",
    "whither": "to where",
    "anyhow": "in any case",
    "astray": "beyond the maximum corrector displacement",
    "comparand": "evaluation points",
    "comparands": "evaluation points",
    "hardness": "compliance",
    "softness": "compliance",
    "begun": "initial",
    "mend": "repair",
    "mended": "repaired",
    "mends": "repairs",
    "yardstick": "characteristic length",
    "twins": "mirrored mechanisms",
    "ornaments": "visual-only bodies",
    "knob": "parameter",
    "knobs": "parameters",
    "slopes": "Jacobian, derivatives",
    "beside": "next to, relative to, compared with",
    "sprint": "explicit predictor",
    "overdriven": "overdetermined",
    "superfluous": "redundant",
    "untouching": "contact filtering",
    "refusal": "error",
    "refusals": "errors",
    "meetings": "change points, branch points",
    "dear": "expensive",
    "dearer": "more expensive",
    "houses": "packages",
    "lean": "reduced",
    "leaner": "smaller",
    "slips": "unit warnings",
    "endings": "exit codes",
    "lasting": "duration",
    "yon": "that",
    "aught": "anything",
    "hither": "here",
    "wherefrom": "from which",
    "whereby": "by which",
    "thereof": "of it",
    # phrases
    "went bad": "became invalid, diverged",
    "goes bad": "becomes invalid, diverges",
    "held against": "compared with",
    "as it stands": "nominal, unchanged",
    "so near to": "close to",
}

# rejected in prose: phrase -> what to write instead
PHRASES = {
    "are said": "are reported, are stated",
    "comes round": "repeats",
    "goes bad": "diverges, fails",
    "goes on where": "continues at",
    "how it goes on": "policy, continuation",
    "is wanted": "is requested",
    "it can stand": "its range is, it can be assembled",
    "laid flat": "flat, at a change point",
    "nothing can hold": "is undetermined",
    "of one's own": "custom, user-defined",
    "reckoned": "computed",
    "rubs": "has friction",
    "what is held": "locked coordinates",
    "what is wanted": "the request, the target",
}

# rejected as a part of an identifier (between underscores), not in prose
NAME_PARTS = {
    "tell": "report",
    "said": "message, label, text",
    "say": "message, report",
    "says": "message, report",
    "asked": "options, requested",
    "meant": "target, intended",
    "foretold": "predicted",
    "slope": "jacobian, derivative",
    "stray": "corrector displacement",
    "strays": "corrector displacement",
    "stride": "step",
    "strides": "steps",
    "walk": "trace",
    "walked": "traced",
    "meeting": "branch_point, change_point",
    "road": "method, backend",
    "roads": "methods, backends",
    "room": "package",
    "house": "repository",
    "film": "animation",
    "filming": "animation",
    "refuse": "reject",
    "refused": "rejected",
    "settled": "converged, determined",
    "settle": "converge, determine",
    "nought": "zero",
    "sure": "certain",
    "doubt": "ambiguous",
    "doubts": "ambiguities",
    "tick": "progress",
    "lap": "revolution",
    "laps": "revolutions",
    "blind": "singular_neighbourhood",
    "bent": "curved, nonlinear",
    "bend": "second_derivative, nonlinear",
    "promise": "tolerance_report",
    "promises": "tolerances",
    "held": "locked, constrained, compared",
    "efforts": "forces",
    "machine": "dynamic_model",
    "program": "motion_law",
    "programs": "motion_laws",
    "feed": "control",
    "fed": "control",
    "missed": "failed",
    "judge": "check, verdict",
    "judged": "checked",
    "freed": "disabled",
    "freedom": "dof",
    "freedoms": "dofs",
    "clock": "path_parameter, time",
    "pace": "rate",
    "here": "current",
    "there": "next, present",
    "nowhere": "absent",
    "anywhere": "any",
}

# rejected as a whole identifier
NAMES = {
    "one": "the thing: joint, design, row, check",
    "ones": "the things",
    "found": "solution, motion, roots, report",
    "at": "q, t, s, index",
    "of": "from_..., select",
    "some": "subset",
    "taken": "selected",
    "given": "options, inputs",
    "wanted": "requested, target",
    "seen": "observed, visited",
    "known": "names",
    "gone": "displacement",
    "far": "distance",
    "near": "neighbours, close",
    "left": "remaining (left and right are fine as a pair)",
    "way": "path, distance, direction",
    "place": "position, address, path",
    "places": "positions, addresses, paths",
    "part": "fraction, component, chunk",
    "parts": "fractions, components, chunks",
    "hold": "lock, constrain",
    "good": "valid, converged",
    "turned": "rotated",
    "turn": "angle, revolution",
    "watch": "progress",
    "done": "progress, finished",
    "bound": "tolerance, limit",
    "why": "reason",
    "met": "passed",
    "size": "characteristic length, count",
    "sense": "direction",
    "mark": "reference direction",
    "marks": "reference directions",
    "cell": "segment",
    "cells": "segments",
    "rough": "initial guess",
    "margin": "discriminant",
    "drive": "solver, mechanism, motor",
    "form": "solver",
    "forms": "solvers",
    "family": "parametric model",
    "MOST": "MAX_...",
    "LONGEST": "MAX_...",
    "SAME": "..._TOLERANCE",
    "APART": "MIN_DISTANCE",
    "BENT": "MAX_CURVATURE",
    "CLEAR": "MIN_DISTANCE_FROM_SINGULARITY",
}

# identifiers that are right where they stand: name -> files, and why
PERMITTED = {
    "drive": (
        (
            "cli/options.py",
            "cli/tradeoff.py",
            "simulation/run.py",
            "agreement/agreement.py",
            "studies/validate.py",
            "subjects/model_source.py",
            "subjects/prescription.py",
            "subjects/readers.py",
            "testing/assertion.py",
            "tests/scene_texts.py",
            "certify/test_certify.py",
            "studies/test_reduction.py",
            "choices/reduced_cases.py",
            "published/g1_ankle.py",
        ),
        "`drive=` and `--drive` prescribe a coordinate: public names of the contract",
    ),
    "at": (("cli/motion_warnings.py", "cli/schema.py"), "`at` is a public field of the JSON of `validate`"),
    "why": (
        ("cli/validate.py", "studies/validate.py", "studies/agreement/agreement.py"),
        "`why` of a comparison is a public name of the contract",
    ),
    "size": (
        (
            "render/look.py",
            "report/notebook.py",
            "render/scenery.py",
            "mjcf_reader/repairs.py",
            "pictures/test_ghost_and_arrows.py",
            "pictures/test_label_positions.py",
            "pictures/test_labels_and_legends.py",
            "pictures/test_render.py",
            "pictures/test_shadow.py",
        ),
        "of a picture in pixels, or MuJoCo's field of a geom or site",
    ),
    "mark": (("render/scenery.py",), "MuJoCo's field of a texture"),
    "left": (
        ("model/joints.py", "simulation/equality_rows.py", "view/test_page.py"),
        "left side of an equation, or of a box on a page",
    ),
    "tick": (("pictures/test_plots.py",), "of an axis"),
    "test_a_logarithmic_axis_has_a_tick_at_each_decade": (("pictures/test_plots.py",), "tick of an axis"),
    "cell": (("report/test_notebook.py",), "of a notebook"),
    "cells": (("report/test_notebook.py",), "of a notebook"),
}

# terms of the field that contain a private word
TERMS = re.compile("degrees?_of_freedom|feed_forward")
# this file and its test quote every word
QUOTING = ("private_words.py", "test_vocabulary.py")

_PROSE_TERMS = WORDS | PHRASES
_PATTERNS = (re.escape(term).replace(r"\ ", r"\s+") for term in _PROSE_TERMS)
_PROSE = re.compile(r"(?<![\w`./'-])(" + "|".join(_PATTERNS) + r")(?![\w`/(])", re.IGNORECASE)


@dataclass(frozen=True)
class Use:
    """A private word: file, line, the identifier or word, the replacement and the kind of text it is in."""

    path: Path
    line: int
    word: str
    instead: str
    kind: str


def _bound_names(tree: ast.AST) -> Iterator[tuple[str, int]]:
    for node in ast.walk(tree):
        match node:
            case ast.FunctionDef() | ast.AsyncFunctionDef() | ast.ClassDef():
                yield node.name, node.lineno
            case ast.arg():
                yield node.arg, node.lineno
            case ast.Name(ctx=ast.Store()):
                yield node.id, node.lineno
            case ast.Attribute(ctx=ast.Store()):
                yield node.attr, node.lineno
            case ast.alias(asname=str() as name):
                yield name, node.lineno


def private_name(name: str) -> str | None:
    """Return what to write instead of an identifier, or None where it holds no private word."""
    if name in NAMES:
        return NAMES[name]
    stripped = name.lower().strip("_")
    if stripped in NAMES:
        return NAMES[stripped]
    words = re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+", TERMS.sub("", name))
    return next(
        (table[word.lower()] for word in words for table in (WORDS, NAME_PARTS) if word.lower() in table),
        None,
    )


def _prose(text: str, line: int, path: Path, kind: str) -> Iterator[Use]:
    for match in _PROSE.finditer(text):
        instead = _PROSE_TERMS[" ".join(match[1].lower().split())]
        yield Use(path, line + text[: match.start()].count("\n"), match[1], instead, kind)


def python_uses(path: Path) -> Iterator[Use]:
    """Yield the private words of a Python file: its name, bound names, comments, docstrings and strings."""
    text = path.read_text()
    tree = ast.parse(text)
    if instead := private_name(path.stem):
        yield Use(path, 0, path.name, instead, "identifier")
    names = list(_bound_names(tree))
    has_right = any(name.lower() == "right" for name, _ in names)
    for name, line in names:
        if str(path).endswith(PERMITTED.get(name.lower(), ((),))[0]) or (
            has_right and name.lower() == "left"
        ):
            continue
        if instead := private_name(name):
            yield Use(path, line, name, instead, "identifier")
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield from _prose(node.value, node.lineno, path, "string")
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            yield from _prose(token.string, token.start[0], path, "comment")


def page_uses(path: Path) -> Iterator[Use]:
    """Yield the private words of a Markdown page."""
    yield from _prose(path.read_text(), 1, path, "page")


def uses(paths: list[Path]) -> list[Use]:
    """Return every private word under files and folders."""
    files = [file for path in paths for file in (sorted(path.rglob("*")) if path.is_dir() else [path])]
    reader_by_suffix = {".py": python_uses, ".md": page_uses}
    # generated pages repeat messages of the package, which are counted there
    sources = [
        file
        for file in files
        if file.suffix in reader_by_suffix and "_generated" not in file.parts and file.name not in QUOTING
    ]
    return [use for file in sources for use in reader_by_suffix[file.suffix](file)]


def main() -> None:
    parser = argparse.ArgumentParser(description="Count words that only this project uses.")
    parser.add_argument(
        "paths", nargs="*", type=Path, default=[ROOT / "mechsim", ROOT / "docs", ROOT / "README.md"]
    )
    parser.add_argument("--list", action="store_true", help="print every use")
    options = parser.parse_args()
    matches = uses(options.paths)
    if options.list:
        for use in matches:
            print(f"{use.path}:{use.line}: {use.kind} {use.word}: {use.instead}")
    kinds = Counter(use.kind for use in matches)
    words = Counter(use.word.lower() for use in matches)
    print(", ".join(f"{kind} {count}" for kind, count in kinds.most_common()), f"; {len(words)} different")
    print(", ".join(f"{word} {count}" for word, count in words.most_common(60)), file=sys.stderr)


if __name__ == "__main__":
    main()
