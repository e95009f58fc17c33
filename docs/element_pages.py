"""A page for each machine element, from the comment at the head of its TOML file in `elements/`.

The comment has the title, `Law:` in LaTeX, `Source:`, sentences, `Check:` with Python, and `Wrong: TEXT -> TEXT`, a
change of the file that mechsim rejects. The code runs when the page is written, in one process for many pages: a
notebook would start a process for each.
"""

import contextlib
import tempfile
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import repeat
from pathlib import Path

import numpy as np
from gallery_page import draw

import mechsim as ms

ELEMENTS = Path(__file__).parent / "elements"
PICTURE_SIZE = "480x360"

HEAD = """# Machine elements

Each page has the formula of an element with its source, a file that runs, a check by another equation, and a wrong
input with the sentence that rejects it.

| element | formula |
|---|---|
"""


@dataclass(frozen=True)
class Element:
    """A machine element.

    Attributes:
        name: of its file.
        title: its name in words.
        law: its formula in LaTeX.
        source: where the formula stands.
        text: sentences on its keys.
        check: what the code checks, in words.
        code: Python that checks the file; `FILE` is its path, `model` the loaded file.
        wrong: text of the file, and what replaces it.
        toml: the file without its comment.
    """

    name: str
    title: str
    law: str
    source: str
    text: str
    check: str
    code: str
    wrong: tuple[str, str]
    toml: str

    @property
    def wrong_toml(self) -> str:
        """The file with the change that is rejected."""
        return self.toml.replace(*self.wrong)


def elements() -> list[Element]:
    """Return the elements of all files, by title."""
    return sorted(map(_read, ELEMENTS.glob("*.toml")), key=lambda element: element.title)


def _read(path: Path) -> Element:
    lines = path.read_text(encoding="utf-8").splitlines()
    count = next(i for i, line in enumerate(lines) if not line.startswith("#"))
    title, *comment = [line.removeprefix("# ") for line in lines[:count]]
    stated = {key: text.strip() for key, _, text in (line.partition(":") for line in comment)}
    old, _, new = stated["Wrong"].partition(" -> ")
    keys = ("Law:", "Source:", "Check:", "Wrong:", "  ")
    return Element(
        path.stem,
        title,
        stated["Law"],
        stated["Source"].removesuffix("."),
        " ".join(line for line in comment if not line.startswith(keys)),
        stated["Check"],
        "\n".join(line[2:] for line in comment if line.startswith("  ")),
        (old, new),
        "\n".join(lines[count:]) + "\n",
    )


def page(element: Element, rejection: str) -> str:
    """Return the page of an element, with the sentence that rejects its wrong file."""
    file = f"{element.name}.toml"
    check = f": {element.check}" if element.check else ""
    return f"""# {element.title}

$$ {element.law} $$

{element.text} Source: {element.source}.

<img src="../../pictures/elements/{element.name}.png" alt="{element.title}" width="480" height="360">

`{file}`:

```toml
{element.toml}```

The check uses another equation{check}.

```python
import numpy as np
import mechsim as ms

FILE = "{file}"
model = ms.load(FILE, still=True)
{element.code}
```

With `{element.wrong[1]}` instead of `{element.wrong[0]}` the file is rejected:

```text
{rejection}
```
"""


def write(folder: Path) -> None:
    """Write elements.md, the page of each element, and the pictures that do not exist yet."""
    pictures = folder / "extra" / "pictures" / "elements"
    for made in (folder / "elements", pictures):
        made.mkdir(parents=True, exist_ok=True)
    listed = elements()
    rows = "".join(f"| [{item.title}](elements/{item.name}.md) | ${item.law}$ |\n" for item in listed)
    contents = "".join(f"elements/{item.name}\n" for item in listed)
    with ProcessPoolExecutor(max_workers=2) as pool:
        rejections = list(pool.map(run_and_draw, listed, repeat(pictures)))
    pages = {
        folder / "elements.md": f"{HEAD}{rows}\n```{{toctree}}\n:hidden:\n{contents}```\n",
        **{
            folder / "elements" / f"{item.name}.md": page(item, rejection)
            for item, rejection in zip(listed, rejections, strict=True)
        },
    }
    for path, text in pages.items():
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def run_and_draw(element: Element, pictures: Path) -> str:
    """Run the check of an element and draw its picture; return the sentence that rejects its wrong file."""
    picture = pictures.absolute() / f"{element.name}.png"
    with tempfile.TemporaryDirectory() as scratch, contextlib.chdir(scratch):
        file = Path(f"{element.name}.toml")
        file.write_text(element.toml, encoding="utf-8")
        exec(element.code, {"np": np, "ms": ms, "FILE": str(file), "model": ms.load(file, still=True)})
        draw(picture, f"render {file} --size {PICTURE_SIZE}")
        Path("wrong.toml").write_text(element.wrong_toml, encoding="utf-8")
        try:
            ms.load("wrong.toml", still=True)
        except ms.InputError as error:
            return str(error)
    raise RuntimeError(f"{element.name}: the wrong file was accepted")
