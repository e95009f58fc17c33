"""A TOML file with the line of each key, for error messages."""

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
MAX_BYTES = 1_000_000
# characters of a value that an error message repeats
MAX_SHOWN = 60

_NAME = r"""(?:[A-Za-z0-9_-]+|"[^"]*"|'[^']*')"""
_DOTTED = rf"{_NAME}(?:\s*\.\s*{_NAME})*"
_HEADER = re.compile(rf"\s*\[\[?\s*({_DOTTED})\s*\]")
_KEY = re.compile(rf"\s*({_DOTTED})\s*=")

KeyPath = tuple[str | int, ...]


class LocatedError(InputError):
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
        names = tuple(name for name in key if isinstance(name, str))
        while names and names not in self.lines:
            names = names[:-1]
        return self.lines.get(names, 1)

    def sibling(self, name: str) -> str:
        """Return the path of a file that is named in this one and looked for beside it."""
        return str(Path(self.path).parent / name.strip())

    def error(self, key: KeyPath, reason: str) -> InputError:
        """Return the error about a key: file, line, key, and why."""
        return LocatedError(f"{self.path}, line {self.line(key)}: {dotted(key)} {reason}")

    @contextmanager
    def error_context(self, key: KeyPath) -> Generator[None]:
        """Give errors raised inside the place of a key, unless they name one."""
        try:
            yield
        except LocatedError:
            raise
        except InputError as error:
            raise LocatedError(f"{self.path}, line {self.line(key)}: {error}") from None


def dotted(key: KeyPath) -> str:
    """Return a key as joints.crank.a.at[1]."""
    text = "".join(f"[{name}]" if isinstance(name, int) else f".{name}" for name in key)
    return text.removeprefix(".") or "the file"


def shown(value: object) -> str:
    """Return a value as a refusal repeats it."""
    return cut(repr(value), MAX_SHOWN)


def suggestion(name: str, known: Iterable[str]) -> str:
    """Return the end of a refusal: what was probably meant, and what there is."""
    listed = list(known)
    close = difflib.get_close_matches(name, listed, n=1)
    hint = f"; did you mean {close[0]!r}?" if close else ";"
    return f"{hint} known are {', '.join(listed) or 'none'}"


def read_source(path: str) -> TomlSource:
    """Return a TOML file.

    Raises:
        InputError: for a file that is not there, is too large, or is no TOML.
    """
    try:
        status = os.stat(path)
        if not stat.S_ISREG(status.st_mode):
            raise InputError(f"{path} is no regular file; name a TOML file")
        if status.st_size > MAX_BYTES:
            raise InputError(f"{path} has {status.st_size} bytes; a mechanism's file has {MAX_BYTES} at most")
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
    lines: dict[tuple[str, ...], int] = {}
    table: tuple[str, ...] = ()
    for number, line in enumerate(text.splitlines(), 1):
        header, key = _HEADER.match(line), _KEY.match(line)
        if header:
            table = _key_names(header[1])
            lines.setdefault(table, number)
        elif key:
            lines.setdefault(table + _key_names(key[1]), number)
    return lines


def _key_names(name: str) -> tuple[str, ...]:
    return tuple(name_.strip().strip("\"'") for name_ in re.findall(_NAME, name))
