"""Print the number and lengths of the sentences of README and docs.

Run: python validation/readability/sentences.py [PAGE ...]
"""

import re
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
# front matter, code, comments, formulas, headings, table rows and labels are not prose
NOT_PROSE = [
    r"\A---\n.*?\n---\n",
    r"```.*?```",
    r"<!--.*?-->",
    r"\$\$.*?\$\$",
    r"^#.*$",
    r"^\|.*$",
    r"^\(.*\)=$",
    r"!\[[^\]]*\]\([^)]*\)",
]
# a sentence may start with the name of a program
END = re.compile(r"(?<=[.!?:])\s+(?=[A-Zx0-9\"'(]|mechsim|pip|pylinkage)")


def sentences(text: str) -> list[str]:
    """Return the sentences of a Markdown page; code and formulas within a sentence count as one word."""
    for pattern in NOT_PROSE:
        text = re.sub(pattern, "", text, flags=re.DOTALL if ".*?" in pattern else re.MULTILINE)
    text = re.sub(r"`[^`]+`|\$[^$]+\$", "x", text)
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", text)
    text = re.sub(r"[*_>]+", "", text)
    blocks = re.split(r"(?:\n\s*|\A)(?:-|\d+\.)\s+|\n\s*\n", text)
    pieces = [piece for block in blocks for piece in END.split(" ".join(block.split()))]
    return [piece for piece in pieces if piece]


def main() -> None:
    requested = [Path(name) for name in sys.argv[1:]]
    for page in requested or [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]:
        lengths = [len(sentence.split()) for sentence in sentences(page.read_text())]
        if lengths and "_generated" not in page.parts:
            mean = sum(lengths) / len(lengths)
            print(f"{page}: {len(lengths)} sentences, mean {mean:.1f}, longest {max(lengths)}")


if __name__ == "__main__":
    main()
