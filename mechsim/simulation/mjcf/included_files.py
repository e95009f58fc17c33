"""Files that an MJCF file includes: inserted into its text if they change, with adjusted paths."""

import os
from collections.abc import Callable, Iterator
from pathlib import Path

from mechsim.errors import InputError
from mechsim.mechanism.finding import FilePosition
from mechsim.simulation.mjcf.edited_text import EditedText, Element, elements_of

# largest depth of nested includes; more are an endless recursion
MAX_DEPTH = 20


def read_text(path: str | Path) -> str:
    """Return the text of an MJCF file with its own line ends.

    Raises:
        InputError: for a file that cannot be read.
    """
    try:
        with open(path, encoding="utf-8-sig", newline="") as file:
            return file.read()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot read {path}: {getattr(error, 'strerror', None) or error}") from None


def with_included(
    text: str, folder: Path, selected: Callable[[Element], bool], base: Path | None = None, depth: int = 0
) -> tuple[str, tuple[str, ...]]:
    """Return a text with those included files inserted that change or include a file that changes.

    Args:
        text: of an MJCF file.
        folder: folder of the main file, from which all paths start.
        selected: root of an included file -> whether to insert it.
        base: folder of the including file.
        depth: of nested includes.

    Returns:
        The text, and the paths of the inserted files.
    """
    if depth > MAX_DEPTH:
        raise InputError("files include each other endlessly; correct the includes")
    edited, inserted = EditedText(text), list[str]()
    for include in edited.root.every("include"):
        path = find_include(include.attributes.get("file", ""), folder, base)
        if path is None:
            continue
        original = read_text(path)
        root = elements_of(original, str(path))
        inner, more = with_included(original, folder, selected, path.parent, depth + 1)
        if not more and not selected(root):
            continue
        root = elements_of(inner, str(path))
        edited.edits.append((include.start, include.end, inner[root.opened : root.close].strip()))
        inserted += [os.path.relpath(path, folder), *more]
    return edited.result, tuple(inserted)


def find_include(name: str, folder: Path, base: Path | None) -> Path | None:
    """Return the path of an included file, in the folder of the main or the including file; else None."""
    for directory in (folder, base):
        if directory is not None and (directory / name).is_file():
            return directory / name
    return None


def moved_to(text: str, folder: Path, target: Path) -> str:
    """Return a text with relative paths changed from one folder to another.

    Args:
        text: of an MJCF file.
        folder: its folder.
        target: its new folder.
    """
    relative = os.path.relpath(folder.resolve(), target.resolve())
    if relative == ".":
        return text
    edited = EditedText(text)

    def rebased(path: str) -> str:
        return path if os.path.isabs(path) else Path(os.path.normpath(Path(relative) / path)).as_posix()

    for element in edited.root.every("include"):
        if "file" in element.attributes:
            edited.set(element, "file", rebased(element.attributes["file"]))
    # included files may name assets as well
    if not any("file" in element.attributes for element in edited.root.every()):
        return edited.result
    folders = ("assetdir", "meshdir", "texturedir")
    compilers = edited.root.tagged("compiler")
    settings = [(element, name) for element in compilers for name in folders if name in element.attributes]
    for element, name in settings:
        edited.set(element, name, rebased(element.attributes[name]))
    names = {name for _, name in settings}
    if "assetdir" not in names and not {"meshdir", "texturedir"} <= names:
        missing = [name for name in ("meshdir", "texturedir") if name not in names]
        if compilers:
            for name in missing:
                edited.set(compilers[-1], name, relative)
        else:
            attributes = " ".join(f'{name}="{relative}"' for name in missing)
            edited.put_first(edited.root, f"<compiler {attributes}/>")
    return edited.result


ACTUATORS = "general motor position velocity intvelocity damper cylinder muscle adhesion"
# tags of equalities, actuators and tendons, by kind; others are kinds themselves
KINDS = {
    **dict.fromkeys(("connect", "weld"), "equality"),
    **dict.fromkeys(("fixed", "spatial"), "tendon"),
    **dict.fromkeys(ACTUATORS.split(), "actuator"),
    "freejoint": "joint",
}


def included_lines(path: str | Path) -> dict[tuple[str, ...], FilePosition]:
    """Return (kind, name) -> file and line of the elements in all files that an MJCF file includes.

    An equality also has the key (kind, first end, second end). Of elements with equal names the first counts.
    """
    lines: dict[tuple[str, ...], FilePosition] = {}
    for file, text, element in _included(Path(path), Path(path).parent):
        line: FilePosition = {"file": file, "line": text.count("\n", 0, element.start) + 1}
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
            text, name = read_text(inner), include.attributes["file"]
            yield from ((name, text, element) for element in elements_of(text).every())
            yield from _included(inner, folder, depth + 1)


def _keys(element: Element) -> Iterator[tuple[str, ...]]:
    """Yield the keys of an element."""
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
