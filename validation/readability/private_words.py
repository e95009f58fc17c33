"""Count words that only this project uses, in identifiers, in prose of the sources and on the pages.

    python validation/readability/private_words.py [--list] [PATH ...]

The tables of `private_words.toml` give the term of the field that replaces each word.

"""

import argparse
import ast
import io
import re
import sys
import tokenize
import tomllib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]

_TABLES = tomllib.loads((Path(__file__).parent / "private_words.toml").read_text(encoding="utf-8"))
# rejected in prose and as a part of an identifier: word -> what to write instead
WORDS: dict[str, str] = _TABLES["WORDS"]
# rejected in prose: phrase -> what to write instead
PHRASES: dict[str, str] = _TABLES["PHRASES"]
# rejected as a part of an identifier (between underscores), not in prose
NAME_PARTS: dict[str, str] = _TABLES["NAME_PARTS"]
# rejected as a whole identifier
NAMES: dict[str, str] = _TABLES["NAMES"]
# identifiers that are right where they stand: name -> files
PERMITTED = {name: tuple(row["files"]) for name, row in _TABLES["PERMITTED"].items()}

# terms of the field that contain a private word
TERMS = re.compile("degrees?_of_freedom|feed_forward")
# this file and its test quote every word
QUOTING = ("private_words.py", "test_vocabulary.py")

_PROSE_TERMS = WORDS | PHRASES
_PATTERNS = (re.escape(term).replace(r"\ ", r"\s+") for term in _PROSE_TERMS)
_PROSE = re.compile(r"(?<![\w`./'-])(" + "|".join(_PATTERNS) + r")(?![\w`/(])", re.IGNORECASE)


@dataclass(frozen=True)
class Use:
    """A private word: file, line, the identifier or word, the replacement and the kind of text it is in."""

    path: Path
    line: int
    word: str
    instead: str
    kind: str


def _bound_names(tree: ast.AST) -> Iterator[tuple[str, int]]:
    for node in ast.walk(tree):
        match node:
            case ast.FunctionDef() | ast.AsyncFunctionDef() | ast.ClassDef():
                yield node.name, node.lineno
            case ast.arg():
                yield node.arg, node.lineno
            case ast.Name(ctx=ast.Store()):
                yield node.id, node.lineno
            case ast.Attribute(ctx=ast.Store()):
                yield node.attr, node.lineno
            case ast.alias(asname=str() as name):
                yield name, node.lineno


def private_name(name: str) -> str | None:
    """Return what to write instead of an identifier, or None where it holds no private word."""
    if name in NAMES:
        return NAMES[name]
    stripped = name.lower().strip("_")
    if stripped in NAMES:
        return NAMES[stripped]
    words = re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+", TERMS.sub("", name))
    return next(
        (table[word.lower()] for word in words for table in (WORDS, NAME_PARTS) if word.lower() in table),
        None,
    )


def _prose(text: str, line: int, path: Path, kind: str) -> Iterator[Use]:
    for match in _PROSE.finditer(text):
        instead = _PROSE_TERMS[" ".join(match[1].lower().split())]
        yield Use(path, line + text[: match.start()].count("\n"), match[1], instead, kind)


def python_uses(path: Path) -> Iterator[Use]:
    """Yield the private words of a Python file: its name, bound names, comments, docstrings and strings."""
    text = path.read_text()
    tree = ast.parse(text)
    if instead := private_name(path.stem):
        yield Use(path, 0, path.name, instead, "identifier")
    names = list(_bound_names(tree))
    has_right = any(name.lower() == "right" for name, _ in names)
    for name, line in names:
        if str(path).endswith(PERMITTED.get(name.lower(), ())) or (has_right and name.lower() == "left"):
            continue
        if instead := private_name(name):
            yield Use(path, line, name, instead, "identifier")
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield from _prose(node.value, node.lineno, path, "string")
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            yield from _prose(token.string, token.start[0], path, "comment")


def page_uses(path: Path) -> Iterator[Use]:
    """Yield the private words of a Markdown page."""
    yield from _prose(path.read_text(), 1, path, "page")


def uses(paths: list[Path]) -> list[Use]:
    """Return every private word under files and folders."""
    files = [file for path in paths for file in (sorted(path.rglob("*")) if path.is_dir() else [path])]
    reader_by_suffix = {".py": python_uses, ".md": page_uses}
    # generated pages repeat messages of the package, which are counted there
    sources = [
        file
        for file in files
        if file.suffix in reader_by_suffix and "_generated" not in file.parts and file.name not in QUOTING
    ]
    return [use for file in sources for use in reader_by_suffix[file.suffix](file)]


def main() -> None:
    parser = argparse.ArgumentParser(description="Count words that only this project uses.")
    parser.add_argument(
        "paths", nargs="*", type=Path, default=[ROOT / "mechsim", ROOT / "docs", ROOT / "README.md"]
    )
    parser.add_argument("--list", action="store_true", help="print every use")
    options = parser.parse_args()
    matches = uses(options.paths)
    if options.list:
        for use in matches:
            print(f"{use.path}:{use.line}: {use.kind} {use.word}: {use.instead}")
    kinds = Counter(use.kind for use in matches)
    words = Counter(use.word.lower() for use in matches)
    print(", ".join(f"{kind} {count}" for kind, count in kinds.most_common()), f"; {len(words)} different")
    print(", ".join(f"{word} {count}" for word, count in words.most_common(60)), file=sys.stderr)


if __name__ == "__main__":
    main()
