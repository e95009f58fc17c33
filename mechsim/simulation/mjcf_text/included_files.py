"""Files that an MJCF file includes: put into its text where they must change, paths kept right."""

import os
from collections.abc import Callable
from pathlib import Path

from mechsim.errors import InputError
from mechsim.simulation.mjcf_text.edited_text import EditedText
from mechsim.simulation.mjcf_text.element_spans import Element, elements_of

# files within files, before they are taken to include each other for ever
DEEPEST = 20


def read_text(path: str | Path) -> str:
    """Return the text of an MJCF file, its line ends as they are.

    Raises:
        InputError: where it cannot be read.
    """
    try:
        with open(path, encoding="utf-8-sig", newline="") as file:
            return file.read()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot read {path}: {getattr(error, 'strerror', None) or error}") from None


def with_included(
    text: str, folder: Path, concerned: Callable[[Element], bool], base: Path | None = None, depth: int = 0
) -> tuple[str, tuple[str, ...]]:
    """Return a text with those included files put into it that are concerned, or include one that is.

    Args:
        text: of an MJCF file.
        folder: in which the main file lies: paths of all files are from there.
        concerned: root of an included file -> whether it is to be put in.
        base: in which the including file lies.
        depth: of files within files.

    Returns:
        The text, and the paths of the files that were put in.
    """
    if depth > DEEPEST:
        raise InputError("files include each other without end; mend the file")
    edited, put_in = EditedText(text), list[str]()
    for one in edited.root.every("include"):
        path = found_include(one.attributes.get("file", ""), folder, base)
        if path is None:
            continue
        inner = read_text(path)
        root = elements_of(inner, str(path))
        inner, more = with_included(inner, folder, concerned, path.parent, depth + 1)
        if not more and not concerned(root):
            continue
        root = elements_of(inner, str(path))
        edited.edits.append((one.start, one.end, inner[root.opened : root.close].strip()))
        put_in += [os.path.relpath(path, folder), *more]
    return edited.result, tuple(put_in)


def found_include(name: str, folder: Path, base: Path | None) -> Path | None:
    """Return where an included file lies: beside the main file, or beside the one that includes it."""
    for place in (folder, base):
        if place is not None and (place / name).is_file():
            return place / name
    return None


def moved_to(text: str, folder: Path, place: Path) -> str:
    """Return a text whose relative paths, right from one folder, are right from another.

    Args:
        text: of an MJCF file.
        folder: in which it lay.
        place: the folder in which it will lie.
    """
    there = os.path.relpath(folder.resolve(), place.resolve())
    if there == ".":
        return text
    edited = EditedText(text)

    def from_there(path: str) -> str:
        return path if os.path.isabs(path) else Path(os.path.normpath(Path(there) / path)).as_posix()

    for one in edited.root.every("include"):
        if "file" in one.attributes:
            edited.set(one, "file", from_there(one.attributes["file"]))
    if not any("file" in one.attributes for one in edited.root.every() if one.tag != "include"):
        return edited.result
    folders = ("assetdir", "meshdir", "texturedir")
    compilers = [one for one in edited.root.children if one.tag == "compiler"]
    told = [(one, name) for one in compilers for name in folders if name in one.attributes]
    for one, name in told:
        edited.set(one, name, from_there(one.attributes[name]))
    names = {name for _, name in told}
    if "assetdir" not in names and not {"meshdir", "texturedir"} <= names:
        missing = [name for name in ("meshdir", "texturedir") if name not in names]
        if compilers:
            for name in missing:
                edited.set(compilers[-1], name, there)
        else:
            said = " ".join(f'{name}="{there}"' for name in missing)
            edited.put_first(edited.root, f"<compiler {said}/>")
    return edited.result
