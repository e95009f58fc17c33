"""The page of the gallery, made from its TOML files: a picture, a page to turn by hand, law and source of each."""

from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import mechsim as ms
from mechsim.analytic import catalog
from mechsim.analytic.forms import Form
from mechsim.errors import MissingToolError
from mechsim.pictures.render import Look, write_picture
from mechsim.pictures.view import page
from mechsim.report.views import mechanism_view
from mechsim.studies.motion_source import motion_of, profile_of
from mechsim.subjects import gallery

SPEED = ms.units.rpm(60)
SIZE = (480, 360)


def write(folder: Path) -> None:
    """Write gallery.md, pictures and pages of all mechanisms; what is there already is kept."""
    for part in ("pictures", "extra/views"):
        (folder / part).mkdir(parents=True, exist_ok=True)
    names = [*catalog.DRIVES, *gallery.files()]
    with ProcessPoolExecutor(max_workers=2) as line:
        list(line.map(_made, [folder] * len(names), names))
    texts = [HEAD]
    texts += ["\n## The catalogue\n\nWith a closed form each.\n"]
    texts += [_entry(folder, name, _about(name)) for name in catalog.DRIVES]
    texts += ["\n## The gallery\n\nIn TOML files, each with its law as a formula of some lines of Python.\n"]
    texts += [_entry(folder, name, told(path)) for name, path in gallery.files().items()]
    text = "".join(texts)
    made = folder / "gallery.md"
    if not made.is_file() or made.read_text(encoding="utf-8") != text:
        made.write_text(text, encoding="utf-8")


HEAD = """# Mechanisms

A name stands wherever a command takes a model: `mechsim show klann`. The link under a picture opens the mechanism
in a page of its own, to be turned by hand; it works offline.
"""


def _about(name: str) -> str:
    """Return what a mechanism of the catalogue says of itself, up to its arguments."""
    said = (catalog.DRIVES[name].__doc__ or "").split("Attributes:")[0]
    return (
        "\n".join(line.strip() for line in said.splitlines()).strip().replace("|", r"\|").replace("*", r"\*")
    )


def told(path: Path) -> str:
    """Return what the comment at the head of a file says, its source and its law in lines of their own."""
    lines = [line.removeprefix("#").strip() for line in _head(path)]
    paragraphs: list[str] = []
    for line in lines:
        if not paragraphs or line.startswith(("Source:", "Law")):
            paragraphs.append(line)
        else:
            paragraphs[-1] += " " + line
    # an asterisk multiplies here
    return "\n\n".join(one.replace("*", r"\*").replace("_", r"\_") for one in paragraphs)


def _head(path: Path) -> list[str]:
    lines = path.read_text(encoding="utf-8").splitlines()
    end = next(i for i, line in enumerate(lines) if not line.startswith("#"))
    return lines[:end]


def _entry(folder: Path, name: str, text: str) -> str:
    shown = ""
    if _picture(folder, name).is_file():
        shown = f"\n```{{image}} pictures/{name}.png\n:alt: {name} with the paths of its points\n:width: 360px\n```\n"
    link = f'<a href="../views/{name}.html">Turn {name} by hand</a>'
    return f"\n### {name}\n\n{text}\n{shown}\n{link}\n"


def _picture(folder: Path, name: str) -> Path:
    return folder / "pictures" / f"{name}.png"


def _made(folder: Path, name: str) -> None:
    """Make the picture and the page of a mechanism, where they are not there."""
    picture, view = _picture(folder, name), folder / "extra" / "views" / f"{name}.html"
    if picture.is_file() and view.is_file():
        return
    form = ms.load(name)
    _draw(form, picture)
    view.write_text(page(mechanism_view(form, SPEED, None)), encoding="utf-8")


def _draw(form: Form, picture: Path) -> None:
    """Draw a mechanism; where this machine has no OpenGL the page goes without."""
    profile = profile_of(form, SPEED, 1.0)
    look = Look(size=SIZE, paths="whole")
    try:
        write_picture(picture, form.mechanism, motion_of(form, "closed", profile, 96), look)
    except MissingToolError as error:
        print(f"{form.name}: {error}")
