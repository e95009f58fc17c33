"""One thing that may be left out of a scene, as a change of its specification."""

from collections.abc import Callable
from dataclasses import dataclass

import mujoco

from mechsim.simulation.mjcf.compiling import plainly_compiled

Edit = Callable[[mujoco.MjSpec], None]


class NotThere(Exception):  # noqa: N818
    """What was to be left out is no part of the scene any more, or something else needs it."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """One thing that may be left out.

    Attributes:
        family: to which it belongs.
        what: is left out, in words.
        edit: changes a specification in place; raises NotThere where it does not apply.
        pays: whether it is left out only where that saves time, even if it costs no accuracy.
    """

    family: str
    what: str
    edit: Edit
    pays: bool = False


def changed(spec: mujoco.MjSpec, candidate: Candidate) -> mujoco.MjSpec:
    """Return a copy of a specification without a candidate.

    Raises:
        NotThere: where it does not apply, or MuJoCo refuses what is left.
    """
    copy = spec.copy()
    try:
        candidate.edit(copy)
        plainly_compiled(copy)
    except ValueError as error:
        raise NotThere(f"{candidate.what}: {error}") from None
    return copy


def counted(number: int, one: str, many: str | None = None) -> str:
    """Return a number of things in words."""
    return f"{number} {one if number == 1 else many or one + 's'}"


def listed(names: list[str], most: int = 4) -> str:
    """Return names as a line holds them."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more
