"""The gallery page: an animated thumbnail, the law and the source of each mechanism; a click opens its 3-D view."""

import contextlib
import html
import io
import json
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from mechsim.cli import main

# gripper, ankle, platforms and the planar classics come first
FIRST = ("parallel_gripper", "humanoid_ankle", "stewart_gough", "delta_robot", "four_bar", "slider_crank")
PICTURE_SIZE = "240x180"
RENDER = f"--size {PICTURE_SIZE} --fps 12 --no-labels"

HEAD = """# Gallery

Each picture opens a 3-D page of its mechanism: turn drivers, change dimensions (not of cams), drag points. Use the name
wherever a command takes a model: `mechsim show klann`. Seven mechanisms have a closed form in the catalogue. The others are TOML
files in `models/gallery`, each with its law as a few lines of Python. The animations take {pictures:.1f} MB together and
load as they come into view; a view takes about {view:.1f} MB. Where reduced motion is preferred, the pictures stand still.

"""

MACHINES = """
## Machines

Files in `models/machines` have forces, and answers that other equations give. Their names are models, too:
`mechsim dynamics statics bicycle_suspension`, `mechsim dynamics forward landing_gear --initial strut.v=-3`.

| name | known answer | source |
|---|---|---|
"""


def write(folder: Path) -> None:
    """Write gallery.md, the pictures and the views; existing pictures and views are kept."""
    for name in ("extra/pictures", "extra/views"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    listed = json.loads(printed("list --json"))
    about = {**listed["mechanisms"], **listed["gallery"]}
    names = sorted(about, key=lambda name: (FIRST.index(name) if name in FIRST else len(FIRST), name))
    with ProcessPoolExecutor(max_workers=2) as pool:
        list(pool.map(_mechanism, [folder / "extra"] * len(names), names))
    cards = "\n".join(card(folder / "extra", name, about[name]) for name in names)
    laws, machines = _table("gallery", "Law"), _table("machines", "Known")
    head = HEAD.format(pictures=megabytes(folder, "*.gif"), view=megabytes(folder, "*.html") / len(names))
    text = f'{head}<div class="gallery">\n{cards}\n</div>\n\n## Laws and sources of the gallery\n\n'
    text += f"| name | law | source |\n|---|---|---|\n{laws}{MACHINES}{machines}"
    page = folder / "gallery.md"
    if not page.is_file() or page.read_text(encoding="utf-8") != text:
        page.write_text(text, encoding="utf-8")


def megabytes(folder: Path, pattern: str) -> float:
    """Return the size of all files of a pattern in [MB]."""
    return sum(path.stat().st_size for path in (folder / "extra").rglob(pattern)) / 1e6


def printed(line: str) -> str:
    """Return what a command prints; raise RuntimeError with its message if it fails."""
    output, messages = io.StringIO(), io.StringIO()
    sys.argv = ["mechsim", *line.split()]
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(messages):
        try:
            main()
        except SystemExit as ended:
            if ended.code:
                raise RuntimeError(f"mechsim {line}: {messages.getvalue()}") from None
    return output.getvalue()


def draw(path: Path, line: str) -> None:
    """Draw a picture by a command unless it exists; a machine without OpenGL draws none."""
    if path.is_file():
        return
    try:
        printed(f"{line} -o {path}")
    except RuntimeError as error:
        if "no picture can be drawn" not in str(error):
            raise
        print(error)


def _mechanism(extra: Path, name: str) -> None:
    """Write the still, the animation and the view of a mechanism; a machine without OpenGL gets the view only."""
    # several drivers follow their motion laws and have no turn
    crank = json.loads(printed(f"show {name} --json")).get("crank_range")
    if not (view := extra / "views" / f"{name}.html").is_file():
        options = f"-o {view}"
        try:
            printed(f"view {name} --live {options}")
        except RuntimeError:
            # dimensions of cams and slotted wheels cannot be changed on a page: their functions are not compiled
            printed(f"view {name} {options}")
    still, motion = extra / "pictures" / f"{name}.png", "--frames-per-turn 24" if crank else ""
    draw(still, f"render {name} --size {PICTURE_SIZE} --no-labels")
    draw(still.with_suffix(".gif"), f"render {name} {RENDER} {motion}")


def card(extra: Path, name: str, about: str) -> str:
    picture = ""
    if (extra / "pictures" / f"{name}.gif").is_file():
        picture = (
            f'<picture><source media="(prefers-reduced-motion: reduce)" srcset="../pictures/{name}.png">'
            f'<img src="../pictures/{name}.gif" alt="{name}" loading="lazy" width="240" height="180"></picture>'
        )
    return f'<a href="../views/{name}.html">{picture}<b>{name}</b><span>{html.escape(about).replace(chr(96), "")}</span></a>'


def _table(folder: str, what: str) -> str:
    """Return rows with name, law or known answer, and source of each file, from the comment at its head."""
    rows = ""
    for path in sorted((Path(__file__).parents[1] / "models" / folder).glob("*.toml")):
        texts, key = {what: "", "Source": ""}, ""
        for line in path.read_text(encoding="utf-8").splitlines():
            if not line.startswith("#"):
                break
            text = line.removeprefix("#").strip()
            key = next((start for start in texts if text.startswith(start)), key)
            if key:
                texts[key] += f" {text.removeprefix(key + ':')}"
        rows += f"| `{path.stem}` | {' | '.join(_escaped(text.strip()) for text in texts.values())} |\n"
    return rows


def _escaped(text: str) -> str:
    for sign in "*_|":
        text = text.replace(sign, "\\" + sign)
    return text
