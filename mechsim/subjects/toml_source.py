"""A TOML file as text: where each key stands, and refusals that say so."""

import difflib
import os
import re
import stat
import tomllib
from collections.abc import Generator, Iterable
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mechsim.errors import InputError, cut

# a file longer than this describes no mechanism
LARGEST = 1_000_000
# characters of a value that a refusal repeats
SHOWN = 60

_NAME = r"""(?:[A-Za-z0-9_-]+|"[^"]*"|'[^']*')"""
_DOTTED = rf"{_NAME}(?:\s*\.\s*{_NAME})*"
_HEADER = re.compile(rf"\s*\[\[?\s*({_DOTTED})\s*\]")
_KEY = re.compile(rf"\s*({_DOTTED})\s*=")

KeyPath = tuple[str | int, ...]


class PlacedError(InputError):
    """An error that names file and line."""


@dataclass(frozen=True)
class TomlSource:
    """A file that was read.

    Attributes:
        path: as it was named.
        document: what it holds.
        lines: key path -> line on which it stands.
    """

    path: str
    document: dict[str, Any]
    lines: dict[tuple[str, ...], int] = field(default_factory=dict[tuple[str, ...], int])

    def line(self, key: KeyPath) -> int:
        """Return the line of a key, or of the table that holds it."""
        names = tuple(part for part in key if isinstance(part, str))
        while names and names not in self.lines:
            names = names[:-1]
        return self.lines.get(names, 1)

    def beside(self, name: str) -> str:
        """Return the path of a file that is named in this one and looked for beside it."""
        return str(Path(self.path).parent / name.strip())

    def refusal(self, key: KeyPath, why: str) -> InputError:
        """Return the error about a key: file, line, key, and why."""
        return PlacedError(f"{self.path}, line {self.line(key)}: {dotted(key)} {why}")

    @contextmanager
    def about(self, key: KeyPath) -> Generator[None]:
        """Give errors raised inside the place of a key, unless they name one."""
        try:
            yield
        except PlacedError:
            raise
        except InputError as error:
            raise PlacedError(f"{self.path}, line {self.line(key)}: {error}") from None


def dotted(key: KeyPath) -> str:
    """Return a key as joints.crank.a.at[1]."""
    text = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in key)
    return text.removeprefix(".") or "the file"


def shown(value: object) -> str:
    """Return a value as a refusal repeats it."""
    return cut(repr(value), SHOWN)


def nearest(name: str, known: Iterable[str]) -> str:
    """Return the end of a refusal: what was probably meant, and what there is."""
    names = list(known)
    close = difflib.get_close_matches(name, names, n=1)
    meant = f"; did you mean {close[0]!r}?" if close else ";"
    return f"{meant} known are {', '.join(names) or 'none'}"


def read_source(path: str) -> TomlSource:
    """Return a TOML file.

    Raises:
        InputError: for a file that is not there, is too large, or is no TOML.
    """
    try:
        about = os.stat(path)
        if not stat.S_ISREG(about.st_mode):
            raise InputError(f"{path} is no regular file; name a TOML file")
        if about.st_size > LARGEST:
            raise InputError(f"{path} has {about.st_size} bytes; a mechanism's file has {LARGEST} at most")
        text = Path(path).read_text(encoding="utf-8-sig")
        return TomlSource(path, tomllib.loads(text), _lines(text))
    except FileNotFoundError:
        raise InputError(f"there is no file {path}; name one that can be read") from None
    except UnicodeDecodeError:
        raise InputError(f"{path} is no text in UTF-8; name a TOML file") from None
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path} is no TOML: {error}; mend that line") from None
    except RecursionError:
        raise InputError(f"{path} nests too deep; a mechanism needs five levels") from None
    except (OSError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"cannot read {path}: {getattr(error, 'strerror', None) or error}") from None


def _lines(text: str) -> dict[tuple[str, ...], int]:
    """Return on which line each key stands; those in inline tables are left to their table."""
    found: dict[tuple[str, ...], int] = {}
    table: tuple[str, ...] = ()
    for number, line in enumerate(text.splitlines(), 1):
        header, key = _HEADER.match(line), _KEY.match(line)
        if header:
            table = _parts(header[1])
            found.setdefault(table, number)
        elif key:
            found.setdefault(table + _parts(key[1]), number)
    return found


def _parts(name: str) -> tuple[str, ...]:
    return tuple(part.strip().strip("\"'") for part in re.findall(_NAME, name))
