"""Lines of elements in included files; MuJoCo reports lines of the main file only."""

from collections.abc import Iterator
from pathlib import Path

from mechsim.model.finding import FilePlace
from mechsim.simulation.mjcf_text.element_spans import Element, elements_of
from mechsim.simulation.mjcf_text.included_files import MAX_DEPTH, find_include, read_text

# tags of equalities, actuators and tendons, by kind; others are kinds themselves
KINDS = {
    **dict.fromkeys(("connect", "weld"), "equality"),
    **dict.fromkeys(("fixed", "spatial"), "tendon"),
    **dict.fromkeys(
        (
            "general",
            "motor",
            "position",
            "velocity",
            "intvelocity",
            "damper",
            "cylinder",
            "muscle",
            "adhesion",
        ),
        "actuator",
    ),
    "freejoint": "joint",
}


def included_lines(path: str | Path) -> dict[tuple[str, ...], FilePlace]:
    """Return (kind, name) -> file and line of the parts in all files that an MJCF file includes.

    An equality is also known by (kind, first end, second end). Of parts of one name the first counts.
    """
    lines: dict[tuple[str, ...], FilePlace] = {}
    for file, text, element in _included(Path(path), Path(path).parent):
        line: FilePlace = {"file": file, "line": text.count("\n", 0, element.start) + 1}
        for key in _keys(element):
            lines.setdefault(key, line)
    return lines


def _included(path: Path, folder: Path, depth: int = 0) -> Iterator[tuple[str, str, Element]]:
    """Yield the included elements: the name of their file, its text, and the element."""
    if depth > MAX_DEPTH:
        return
    for include in elements_of(read_text(path), str(path)).every("include"):
        inner = find_include(include.attributes.get("file", ""), folder, path.parent)
        if inner is not None:
            text = read_text(inner)
            yield from (
                (include.attributes["file"], text, inner_element)
                for inner_element in elements_of(text).every()
            )
            yield from _included(inner, folder, depth + 1)


def _keys(element: Element) -> Iterator[tuple[str, ...]]:
    """Yield by what an element is looked for."""
    attributes = element.attributes
    ends = [
        tuple(attributes.get(f"{end}{i}", "") for i in (1, 2))
        for end in ("body", "site", "joint", "tendon")
        if f"{end}1" in attributes
    ]
    kind = "equality" if ends else KINDS.get(element.tag, element.tag)
    if "name" in attributes:
        yield kind, attributes["name"]
    for pair in ends:
        yield kind, *pair
