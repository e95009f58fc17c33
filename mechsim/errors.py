"""All intended errors of mechsim: one sentence with the object, the value, the limit and the remedy."""

import json
import os
from collections.abc import Collection, Generator, Iterable, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from typing import Literal


def several(count: int, noun: str, plural: str = "") -> str:
    """Return a number of things in words."""
    return f"{count} {noun if count == 1 else plural or noun + 's'}"


# number of names in a message, about three lines
LISTED = 40


def first_names(names: Collection[str], most: int = LISTED, others: str = "more") -> str:
    """Return at most so many names, separated by commas, and the number of the others.

    Example:
        >>> first_names(["A", "B", "C"], most=1)
        'A and 2 more'
    """
    more = f" and {len(names) - most} {others}" if len(names) > most else ""
    return ", ".join([*names][:most]) + more


def cut(text: str, longest: int) -> str:
    """Return text shortened to at most `longest` characters; it then ends after a word with " ..."."""
    if len(text) <= longest:
        return text
    words = text[: longest - 3].rpartition(" ")[0]
    # text without a space in its second half has a long word, which must be cut
    return f"{words if 2 * len(words) > longest else text[: longest - 4]} ..."


class MechsimError(Exception):
    """Base of all errors that a user can correct; the command line prints the message and exits with 2."""


class InputError(MechsimError, ValueError):
    """A name, value, unit, file or option that is invalid."""


class AssemblyError(MechsimError, ValueError):
    """The loops cannot be closed at a requested configuration."""


class SingularStartError(AssemblyError):
    """A motion that cannot leave its start: a dead centre, or a change point, where assemblies meet."""


# remedy if configurations are undetermined, for any command
STEPPED = "use time stepping instead (mechsim simulate --method step)"


class MobilityError(MechsimError, ValueError):
    """A mechanism with too few drivers to determine its motion, or more than its degrees of freedom.

    Attributes:
        outcome: "underdetermined" or "overdetermined".
    """

    def __init__(self, message: str, outcome: str = "underdetermined"):
        super().__init__(message)
        self.outcome = outcome


class FrictionError(MechsimError, ValueError):
    """Friction by the load of joints without a unique solution.

    Attributes:
        outcome: "jammed" or "undetermined".
    """

    def __init__(self, message: str, outcome: Literal["jammed", "undetermined"]):
        super().__init__(message)
        self.outcome: Literal["jammed", "undetermined"] = outcome


class BudgetError(MechsimError, RuntimeError):
    """Work that exceeded its budget of processor time."""


class OutputError(MechsimError, OSError):
    """A result that cannot be written to its destination."""


class MissingToolError(MechsimError, RuntimeError):
    """A tool that this machine lacks (OpenGL, ffmpeg); the message names the package that provides it."""


def require_once(where: str, names: Sequence[str]) -> None:
    """Raise InputError if an option, a table or an entry names something twice."""
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise InputError(f"{where} names {twice} twice; give it once")


def require_known(lacking: str, stated: Iterable[str], accepted: Collection[str]) -> None:
    """Raise InputError for a name that is not accepted, of what is lacking, as "a picture has no option"."""
    for name in (each for each in stated if each not in accepted):
        raise InputError(f"{lacking} {name!r}; choose from {first_names(accepted)}")


def install_command(extra: str) -> str:
    """Return the command that installs an extra of mechsim, from the sources if mechsim comes from there."""
    # local imports, which take longer than all of mechsim.errors
    from importlib import metadata
    from urllib.parse import urlsplit
    from urllib.request import url2pathname

    origin = json.loads(metadata.distribution("mechsim").read_text("direct_url.json") or "{}")
    if "dir_info" not in origin:
        return f"pip install 'mechsim[{extra}]'"
    folder = url2pathname(urlsplit(origin["url"]).path)
    editable = "-e " if origin["dir_info"].get("editable") else ""
    return f"pip install {editable}'{'.' if folder == os.getcwd() else folder}[{extra}]'"


@contextmanager
def needs(extra: str) -> Generator[None]:
    """Turn a failed import inside the block into an error that names the extra of mechsim with the library.

    Raises:
        MissingToolError: if the library is not installed.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        library = (error.name or "").partition(".")[0]
        if library in ("", "mechsim"):
            raise
        raise MissingToolError(f"{library} is not installed; {install_command(extra)} installs it") from None


def require_extra(extra: str, *libraries: str) -> None:
    """Raise MissingToolError if a library is not installed.

    Raises:
        MissingToolError: for the first missing library; names the extra of mechsim with it.
    """
    for library in libraries:
        with needs(extra):
            if find_spec(library) is None:
                raise ModuleNotFoundError(name=library)
