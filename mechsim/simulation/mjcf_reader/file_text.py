"""Checks the text of an MJCF or URDF file before MuJoCo parses it."""

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from math import prod

from mechsim.errors import InputError, cut
from mechsim.files import read_text
from mechsim.simulation.mjcf_reader.file_errors import MAX_SHOWN

# maximum size of a file in bytes
MAX_BYTES = 50_000_000
# what is not closed ends with the text, so that no search is repeated
_COMMENT = re.compile(
    r"<!--.*?(?:-->|\Z)|<\?.*?(?:\?>|\Z)|<!DOCTYPE[^>\[]*(?:\[.*?(?:\]\s*>|\Z)|>|\Z)",
    re.DOTALL | re.IGNORECASE,
)
# reference to an entity that a file declares; its parser would leave it out
_ENTITY = re.compile(r"&(?!(?:amp|lt|gt|quot|apos);)[A-Za-z_][\w.:-]*;")
_ROOT = re.compile(r"\s*<([A-Za-z_][\w.:-]*)")
# first line of a pointer file of Git LFS
_POINTER = "version https://git-lfs"
# names of files, and of the folders of meshes and textures
_FILE = re.compile(r"""\bfile(?:name)?\s*=\s*["']([^"'<>]+)["']""")
_FOLDER = re.compile(r"""\b(?:mesh|texture|asset)dir\s*=\s*["']([^"'<>]+)["']""")

# elements of which MuJoCo makes many, and its attributes with their numbers
_MANY = re.compile(r"<(/?)(replicate|composite|flexcomp|hfield|texture)\b([^>]*?)(/?)>")
_NUMBERS = re.compile(r"""\b(?:count|nrow|ncol|width|height)\s*=\s*["']([\s\d]*)["']""")
# largest number of copies, whose time grows with its square (10 s for 10,000), and of cells of height fields
# and textures, which need 1 GB
MAX_COPIES, MAX_CELLS = 10_000, 8192**2


@dataclass(frozen=True)
class UrdfFile:
    """The path of a URDF file, and that of a sidecar file with loop closures; None without one."""

    path: str
    loops: str | None = None


def root_of(path: str) -> str:
    """Return the root element of a file; reject files that are not text, or neither MJCF nor URDF."""
    text = read_text(path, "an MJCF or URDF file", MAX_BYTES)
    if not text.strip():
        raise InputError(f"{path} is empty; name an MJCF or URDF file")
    bare = _without_comments(text)
    root = match[1] if (match := _ROOT.match(bare)) else None
    if root == "robot" and "<xacro:" in text:
        raise InputError(
            f"{path} contains macros of xacro; expand it into URDF (xacro IN -o OUT.urdf) and name that file"
        )
    if root == "mujocoinclude":
        raise InputError(f"{path} is a part that other files include; name the file that includes it")
    if text.startswith(_POINTER):
        raise InputError(f"{path} is a pointer of Git LFS, not the file itself; fetch it with git lfs pull")
    if root not in ("mujoco", "robot"):
        what = f"begins with <{root}>" if root else "is no XML"
        raise InputError(f"{path} {what}; an MJCF file begins with <mujoco>, URDF with <robot>")
    for source, content in _with_included(path, bare, os.path.dirname(path), {os.path.realpath(path)}):
        if reference := _ENTITY.search(content):
            line = content.count("\n", 0, reference.start()) + 1
            raise InputError(
                f"{source}, line {line}: MuJoCo does not read the entity {cut(reference[0], MAX_SHOWN)} of "
                "the file; write its text in its place"
            )
        _require_few(source, content)
    return root


def _require_few(path: str, content: str) -> None:
    """Reject elements of which MuJoCo would make so many that it needs minutes or the whole memory."""
    enclosing = [1]
    for element in _MANY.finditer(content):
        closes, name, attributes, empty = element.groups()
        if closes:
            enclosing = enclosing[:-1] if name == "replicate" and len(enclosing) > 1 else enclosing
            continue
        numbers = [int(word) for value in _NUMBERS.findall(attributes) for word in value.split()[:3]]
        count, limit = prod(numbers), MAX_CELLS if name in ("hfield", "texture") else MAX_COPIES
        if name == "replicate" and not empty:
            enclosing.append(count := count * enclosing[-1])
        if count > limit:
            line = content.count("\n", 0, element.start()) + 1
            raise InputError(f"{path}, line {line}: <{name}> makes {count:,} parts; give {limit:,} at most")


def _without_comments(text: str) -> str:
    """Return XML without comments, declarations and processing instructions, and with their line ends."""
    return _COMMENT.sub(lambda comment: "\n" * comment[0].count("\n"), text)


def _with_included(path: str, bare: str, folder: str, visited: set[str]) -> Iterator[tuple[str, str]]:
    """Yield a file and those that it includes, with their texts without comments.

    Raises:
        InputError: if it names a device, a pipe or a directory, for which MuJoCo would wait without end.
    """
    yield path, bare
    folders = [folder, os.path.dirname(path), *(os.path.join(folder, name) for name in _FOLDER.findall(bare))]
    for name in dict.fromkeys(_FILE.findall(bare)):
        for inner in dict.fromkeys(os.path.join(directory, name) for directory in folders):
            if os.path.exists(inner) and not os.path.isfile(inner):
                raise InputError(f"{path}: it names {inner}, which is no regular file; name another one")
            included, real = name.lower().endswith(".xml") and os.path.isfile(inner), os.path.realpath(inner)
            if included and real not in visited:
                visited.add(real)
                text = _without_comments(read_text(inner, "an MJCF file", MAX_BYTES))
                yield from _with_included(inner, text, folder, visited)
