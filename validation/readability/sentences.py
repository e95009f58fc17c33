"""Print how long the sentences of README and docs are.

python validation/readability/sentences.py [PAGE ...]

"""

import re
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
# front matter, code, comments, formulas, headings, table rows and labels are no prose
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


def sentences(text: str) -> list[str]:
    """Return the sentences of a Markdown page; code and formulas within a sentence count as one word."""
    for pattern in NOT_PROSE:
        text = re.sub(pattern, "", text, flags=re.DOTALL if ".*?" in pattern else re.MULTILINE)
    text = re.sub(r"`[^`]+`|\$[^$]+\$", "x", text)
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", text)
    text = re.sub(r"[*_>]+", "", text)
    blocks = re.split(r"\n\s*\n|\n\s*(?:-|\d+\.)\s+|\A\s*(?:-|\d+\.)\s+", text)
    found = [
        part
        for block in blocks
        for part in re.split(r"(?<=[.!?:])\s+(?=[A-Zx0-9\"'(])", " ".join(block.split()))
    ]
    return [sentence for sentence in found if sentence]


def main() -> None:
    pages = [Path(name) for name in sys.argv[1:]] or [
        ROOT / "README.md",
        *sorted((ROOT / "docs").rglob("*.md")),
    ]
    for page in pages:
        if "_generated" in page.parts or not (found := sentences(page.read_text())):
            continue
        lengths = [len(sentence.split()) for sentence in found]
        print(
            f"{page}: {len(found)} sentences, mean {sum(lengths) / len(lengths):.1f}, longest {max(lengths)}"
        )


if __name__ == "__main__":
    main()
