"""Every error mechsim raises on purpose: one sentence with the thing, the value, the bound, the remedy."""

from collections.abc import Generator
from contextlib import contextmanager
from importlib.util import find_spec


def cut(text: str, longest: int) -> str:
    """Return text of at most so many characters: what is cut ends with a whole word and with " ..."."""
    if len(text) <= longest:
        return text
    words = text[: longest - 3].rpartition(" ")[0]
    # what has no space in its second half is one long word, which must be cut
    return f"{words if 2 * len(words) > longest else text[: longest - 4]} ..."


class MechsimError(Exception):
    """Base of all errors that a user can correct; the command line prints its text and exits with 2."""


class InputError(MechsimError, ValueError):
    """A name, value, unit, file or option that cannot be used as given."""


class AssemblyError(MechsimError, ValueError):
    """The loops cannot be closed at a crank angle that was asked for."""


# what may be done where configurations are not determined, in any command
STEPPED = "let a run in time say (mechsim simulate --method step)"


class MobilityError(MechsimError, ValueError):
    """A mechanism whose motion its drivers do not settle, or that has more drivers than freedoms.

    Attributes:
        outcome: "underdetermined" or "overdetermined".
    """

    def __init__(self, message: str, outcome: str = "underdetermined"):
        super().__init__(message)
        self.outcome = outcome


class BudgetError(MechsimError, RuntimeError):
    """Work that did not end within its budget of processor time."""


class OutputError(MechsimError, OSError):
    """A result cannot be written where it was asked to go."""


class MissingToolError(MechsimError, RuntimeError):
    """This machine lacks something (OpenGL, ffmpeg); the text names the package that brings it."""


@contextmanager
def needs(extra: str) -> Generator[None]:
    """Name the extra of mechsim that brings a library which is imported within and not installed.

    Raises:
        MissingToolError: for such a library.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        library = (error.name or "").partition(".")[0]
        if library in ("", "mechsim"):
            raise
        raise MissingToolError(
            f"{library} is not installed; pip install 'mechsim[{extra}]' brings it"
        ) from None


def require_extra(extra: str, *libraries: str) -> None:
    """Refuse work that would end without a library, before it begins.

    Raises:
        MissingToolError: for the first that is not installed; names the extra of mechsim that brings it.
    """
    for library in libraries:
        with needs(extra):
            if find_spec(library) is None:
                raise ModuleNotFoundError(name=library)
