"""A candidate for removal: a change of a scene's specification."""

from collections.abc import Callable
from dataclasses import dataclass

import mujoco

from mechsim.simulation.mjcf.compiling import plainly_compiled

Edit = Callable[[mujoco.MjSpec], None]


class NotApplicable(Exception):  # noqa: N818
    """The element is no longer in the scene, or another element needs it."""


@dataclass(frozen=True, slots=True)
class RemovalCandidate:
    """A change of a scene's specification that may reduce it.

    Attributes:
        category: of the element, as "contacts".
        what: description of what is removed.
        edit: changes a specification in place; raises NotThere where it does not apply.
        only_if_faster: whether it is applied only if it saves time, even if it costs no accuracy.
    """

    category: str
    what: str
    edit: Edit
    only_if_faster: bool = False


def with_candidate(spec: mujoco.MjSpec, candidate: RemovalCandidate) -> mujoco.MjSpec:
    """Return a copy of a specification with a candidate applied.

    Raises:
        NotApplicable: if it does not apply, or MuJoCo rejects the result.
    """
    copy = spec.copy()
    try:
        candidate.edit(copy)
        plainly_compiled(copy)
    except ValueError as error:
        raise NotApplicable(f"{candidate.what}: {error}") from None
    return copy


def set_spec_options(spec: mujoco.MjSpec, **values: int) -> None:
    """Set options of a specification, as integrator or disableflags."""
    for name, value in values.items():
        setattr(spec.option, name, value)


def count_text(number: int, singular: str, plural: str | None = None) -> str:
    """Return a count with its noun."""
    return f"{number} {singular if number == 1 else plural or singular + 's'}"


def name_list(names: list[str], limit: int = 4) -> str:
    """Return the first names, comma-separated, and how many more there are."""
    more = f" and {len(names) - limit} more" if len(names) > limit else ""
    return ", ".join(names[:limit]) + more
