"""Publish the Markdown of every page next to its HTML, and `llms.txt`, a list of them for programs that read text."""

import json
import re
from pathlib import Path

TITLE = re.compile(r"^# (.+)$", re.MULTILINE)
INCLUDE = re.compile(r"^```\{include\} (\S+)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
FRONT = re.compile(r"\A---\n.*?\n---\n", re.DOTALL)
HEAD = """# mechsim

> Checks models of closed-loop mechanisms. It solves a mechanism analytically and in MuJoCo, compares the two, or a
> user's own model with either, and explains differences. Command line and Python package.

"""


def setup(app):
    """Write after the pages are built."""
    app.connect("build-finished", write)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def write(app, error):
    """Write the sources and the list of them."""
    if error or app.builder.format != "html":
        return
    out = Path(app.outdir)
    lines = []
    for name in sorted(app.env.found_docs, key=_order):
        source = Path(app.env.doc2path(name))
        text = with_included(FRONT.sub("", _text(source)), source.parent)
        page = out / f"{name}.md"
        page.parent.mkdir(parents=True, exist_ok=True)
        page.write_text(text, encoding="utf-8")
        title = TITLE.search(text)
        lines.append(f"- [{title[1] if title else name}]({name}.md){_summary(text)}\n")
    (out / "llms.txt").write_text(HEAD + "".join(lines), encoding="utf-8")


def _text(source: Path) -> str:
    """Return a page as Markdown; a notebook's code becomes code blocks."""
    text = source.read_text(encoding="utf-8")
    if source.suffix != ".ipynb":
        return text
    pieces = [(piece["cell_type"], "".join(piece["source"])) for piece in json.loads(text)["cells"]]
    return "\n\n".join(f"```python\n{body}\n```" if kind == "code" else body for kind, body in pieces)


def with_included(text: str, folder: Path) -> str:
    """Return the text of a page with the files it includes in place of the directives."""

    def included(directive: re.Match[str]) -> str:
        content = (folder / directive[1]).read_text(encoding="utf-8")
        options = dict(re.findall(r':([\w-]+): "?(.*?)"?$', directive[2], re.MULTILINE))
        content = content.split(options["start-after"], 1)[1] if "start-after" in options else content
        return (
            content.split(options["end-before"], 1)[0].strip() if "end-before" in options else content.strip()
        )

    return INCLUDE.sub(included, text)


def _order(name: str) -> tuple[int, str]:
    folders = ("index", "tutorials", "howto", "_generated", "reference", "explanation")
    return folders.index(name.split("/")[0]), name


def _summary(text: str) -> str:
    """Return the first sentence below the title, or nothing."""
    body = text[match.end() :] if (match := TITLE.search(text)) else text
    paragraph = next((text for text in body.split("\n\n") if re.match(r"[A-Z`*]", text.strip())), "")
    sentence = re.split(r"(?<=[.!])\s", " ".join(paragraph.split()))[0]
    return f": {sentence.strip(chr(42))}" if sentence else ""
