"""Reference pages of the command line, one for each command, written from the application itself."""

import inspect
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

from mechsim.cli import COMMANDS, load_command

HEAD = """# Command line

`mechsim COMMAND --help` prints the same in a terminal. MODEL is a name from `mechsim list`, or a file: `FILE.toml`,
`FILE.xml` (MJCF), `FILE.urdf`, `FILE.sdf`, or `FILE.py:OBJECT`. Numbers without a unit are in SI.

| exit code | meaning |
|---|---|
| 0 | every check passed |
| 1 | a check failed, or a run diverged |
| 2 | the input is invalid; one line states why, and nothing is written |
| 70 | an internal error of mechsim |
| 128 + n | ended by signal n |

"""


def commands() -> dict[str, Any]:
    """Return every command of the application by its name."""
    return {name: load_command(name) for name in COMMANDS}


def write(folder: Path) -> None:
    """Write command_line.md, a list of all commands, and a page of each command into a folder."""
    named = commands()
    first = {name: (named[name].help or "").partition("\n\n")[0] for name in named}
    summary = "".join(f"| [`{name}`](#{_anchor(name)}) | {_line(first[name])} |\n" for name in named)
    contents = (
        "\n```{toctree}\n:hidden:\n" + "".join(f"commands/{_anchor(name)}\n" for name in named) + "```\n"
    )
    pages = {folder / "command_line.md": f"{HEAD}| command | does |\n|---|---|\n{summary}{contents}"}
    pages |= {folder / "commands" / f"{_anchor(name)}.md": _page(name, named[name]) for name in named}
    (folder / "commands").mkdir(parents=True, exist_ok=True)
    for page, text in pages.items():
        if not page.is_file() or page.read_text(encoding="utf-8") != text:
            page.write_text(text, encoding="utf-8")


class Sections(click.HelpFormatter):
    """Collect the tables and lines that a command writes into its help, each under its heading."""

    def __init__(self) -> None:
        super().__init__()
        self.tables: dict[str, list[tuple[str, str]]] = {}
        self.lines: list[str] = []
        self.heading = ""

    @contextmanager
    def section(self, name: str) -> Iterator[None]:
        """Set the heading of what follows."""
        self.heading = name
        yield

    def write_dl(self, rows: Any, col_max: int = 30, col_spacing: int = 2) -> None:
        """Collect the rows of a table."""
        self.tables.setdefault(self.heading, []).extend(rows)

    def write(self, string: str) -> None:
        """Collect a line of the examples."""
        self.lines.append(string.strip())


def _page(name: str, command: Any) -> str:
    """Return the page of a command: its text, usage, options in groups, and examples."""
    context = click.Context(command, info_name=f"mechsim {name}")
    usage = " ".join(command.collect_usage_pieces(context))
    text = _escaped(inspect.cleandoc(command.help or "").partition("\nExamples:\n")[0].strip())
    sections = Sections()
    command.format_options(context, sections)
    rows = [
        f"| **{heading}** | |\n" + "".join(_row(*row) for row in table)
        for heading, table in sections.tables.items()
    ]
    table = "| option | meaning |\n|---|---|\n" + "".join(rows)
    lines = "\n".join(line for line in sections.lines if line)
    examples = f"\nExamples:\n\n```text\n{lines}\n```\n" if lines else ""
    head = f"({_anchor(name)})=\n# mechsim {name}\n\n{text}\n\n```text\nmechsim {name} {usage}\n```\n"
    return f"{head}{examples}\n{table}"


def _anchor(name: str) -> str:
    return f"mechsim-{name.replace(' ', '-')}"


def _row(name: str, meaning: str) -> str:
    return f"| `{name.strip().replace('|', chr(92) + '|')}` | {_line(meaning)} |\n"


def _line(text: str | None) -> str:
    return " ".join(_escaped(text or "").split())


def _escaped(text: str) -> str:
    """Return text in which Markdown reads nothing but text."""
    for sign in "*_|<[":
        text = text.replace(sign, "\\" + sign)
    return text
