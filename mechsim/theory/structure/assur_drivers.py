"""Which links of a planar chain drive and which are stopped, before it falls apart into groups."""

from collections.abc import Iterable, Sequence

from mechsim.errors import InputError
from mechsim.model.links import GROUND
from mechsim.model.mechanism import Mechanism
from mechsim.theory.structure.planar import Pairs, rigid


def inputs(
    mechanism: Mechanism, pairs: Sequence[Pairs], driver: str | Sequence[str] | None, stopped: Sequence[str]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the driving links and the stopped ones; `assur_groups` says how they are chosen.

    Raises:
        InputError: for an unknown link, or one that cannot drive.
    """
    requested = () if driver is None else (driver,) if isinstance(driver, str) else tuple(driver)
    stopped = tuple(stopped)
    _require_links(mechanism, (*requested, *stopped))
    body = rigid(mechanism)
    requested, stopped, driven = (
        tuple(dict.fromkeys(body[link] for link in links if body[link] != GROUND))
        for links in (requested, stopped, driven_links(mechanism))
    )
    if not requested:
        return tuple(link for link in driven if link not in stopped), stopped
    for link in requested:
        if link in stopped:
            raise InputError(f"{mechanism.name}: link {link!r} cannot both drive and stand still; choose one")
        neighbour_links = neighbours(pairs, link)
        if not neighbour_links & {GROUND, *stopped, *requested}:
            stopped += _to_stop(mechanism, link, [other for other in driven if other in neighbour_links])
    dofs = planar_dofs(mechanism, pairs, stopped)
    if dofs < len(requested):
        still = f" with {', '.join(stopped)} stopped" if stopped else ""
        raise InputError(
            f"{mechanism.name}: {', '.join(requested)} cannot drive{still}, which leaves W = {dofs}; "
            f"links on the frame that can: {', '.join(_on_frame(mechanism, pairs))}"
        )
    if len(requested) > 1:
        return requested, stopped
    # the crank yields first: the new driver stands in its place
    rest = [link for link in driven[1:] + driven[:1] if link not in (*requested, *stopped)]
    return (*requested, *rest[: dofs - 1]), stopped


def driven_links(mechanism: Mechanism) -> tuple[str, ...]:
    """Return the links whose place follows from the crank angle alone: the crank, then what is geared to it.

    Raises:
        InputError: if a driven joint hangs on links that the drive does not place.
    """
    names = [joint.name for joint in mechanism.driven_joints]
    while more := [
        name
        for gear in mechanism.gears
        for source, name in ((gear.driver, gear.driven), (gear.driven, gear.driver))
        if source in names and name not in names
    ]:
        names.append(more[0])
    waiting = [mechanism.joint(name) for name in names]
    placed = [GROUND]
    while waiting:
        joint = next((j for j in waiting if (j.a.link in placed) or (j.b.link in placed)), None)
        if joint is None:
            lost = ", ".join(j.name for j in waiting)
            raise InputError(
                f"{mechanism.name}: driven joint {lost} is not on the frame, so its links do not drive; "
                "name the driving link"
            )
        waiting.remove(joint)
        placed += [end.link for end in (joint.a, joint.b) if end.link not in placed]
    return tuple(placed[1:])


def neighbours(pairs: Iterable[Pairs], link: str) -> set[str]:
    """Return the links that have a pair with a link."""
    return {other for pair in pairs if link in pair.links for other in pair.links} - {link}


def planar_dofs(mechanism: Mechanism, pairs: Iterable[Pairs], stopped: Sequence[str]) -> int:
    """Return W = 3n - 2p of the lower pairs alone, stopped links counted as frame."""
    fixed = {GROUND, *stopped}
    dofs = 3 * (len({*rigid(mechanism).values()}) - 1 - len(stopped))
    for pair in pairs:
        unknown = sum(link not in fixed for link in pair.links)
        dofs -= 2 * (unknown - (unknown == len(pair.links)))
    return dofs


def _to_stop(mechanism: Mechanism, link: str, cranks: list[str]) -> tuple[str]:
    """Return the crank whose stopping lets a floating link drive, as paper 003 does it."""
    if not cranks:
        raise InputError(
            f"{mechanism.name}: link {link!r} meets neither the frame nor a driven link, so it cannot drive; "
            "stop a link that it meets, or choose another"
        )
    return (cranks[0],)


def _on_frame(mechanism: Mechanism, pairs: Sequence[Pairs]) -> list[str]:
    neighbour_links = neighbours(pairs, GROUND)
    return [link.name for link in mechanism.links if link.name in neighbour_links]


def _require_links(mechanism: Mechanism, names: Iterable[str]) -> None:
    links = [link.name for link in mechanism.links]
    for name in names:
        if name not in links:
            raise InputError(f"{mechanism.name} has no moving link {name!r}; known are {', '.join(links)}")
