"""Assur groups: a planar chain taken apart into the smallest groups of no mobility."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from mechsim.errors import InputError
from mechsim.model.links import GROUND
from mechsim.model.mechanism import Mechanism
from mechsim.theory.structure.assur_drivers import inputs
from mechsim.theory.structure.assur_matching import Equation, Unit, blocks
from mechsim.theory.structure.planar import planar_pairs, plane_normal, rigid

ROMAN = ("", "I", "II", "III", "IV", "V", "VI", "VII", "VIII", "IX", "X")


@dataclass(frozen=True, slots=True)
class AssurGroup:
    """A group that neither adds nor takes a freedom.

    Attributes:
        class_: Artobolevskii's class, the highest of its contours: 2 for a dyad, 3 with a link of
            three or more pairs, k with a closed changeable contour of k >= 4 sides.
        order: number of outer pairs, by which it hangs on what is already there.
        links: in the order of the mechanism.
        pairs: number of its lower pairs, inner and outer; 3 * links = 2 * pairs.
    """

    class_: int
    order: int
    links: tuple[str, ...]
    pairs: int

    def as_dict(self) -> dict[str, Any]:
        """Return what `mechsim show --json` prints."""
        return {"class": self.class_, "order": self.order, "links": list(self.links)}

    def __str__(self) -> str:
        number = ROMAN[self.class_] if self.class_ < len(ROMAN) else str(self.class_)
        return f"Assur group of class {number}, order {self.order}: {', '.join(self.links)}"


@dataclass(frozen=True, slots=True)
class Decomposition:
    """A planar chain as its drivers and its groups.

    Attributes:
        drivers: links that drive.
        stopped: links stopped in thought, counted as frame.
        groups: in the order of assembly.
    """

    drivers: tuple[str, ...]
    stopped: tuple[str, ...]
    groups: tuple[AssurGroup, ...]

    @property
    def class_(self) -> int:
        """Class of the mechanism: the highest of its groups; 1 if it has none."""
        return max((group.class_ for group in self.groups), default=1)

    def as_dicts(self) -> list[dict[str, Any]]:
        """Return the groups as `mechsim show --json` prints them."""
        return [group.as_dict() for group in self.groups]

    def lines(self) -> list[str]:
        """Return the drivers and each group in words."""
        still = f", with {', '.join(self.stopped)} stopped" if self.stopped else ""
        return [f"driven by {', '.join(self.drivers)}{still}", *(str(group) for group in self.groups)]

    def __str__(self) -> str:
        return "; ".join(self.lines())


def assur_groups(
    mechanism: Mechanism, driver: str | Sequence[str] | None = None, stopped: Sequence[str] = ()
) -> Decomposition:
    """Take a planar chain apart into Assur groups.

    Args:
        mechanism: a planar mechanism.
        driver: link or links that drive. None: the crank and what is geared to it. A link on the
            frame takes the crank's place; the crank becomes an ordinary link. A link that meets no
            frame but a driven link drives with that one stopped, as in paper 003; gears are released
            by such an exchange, and other driven links go on driving as far as there are freedoms.
        stopped: links stopped in thought: they count as frame.

    Returns:
        Drivers, stopped links and groups in the order of assembly.

    Raises:
        InputError: for a spatial mechanism, a link that cannot drive, or a chain whose drivers leave
            a freedom or hold it more than once; names the links.

    Source: Assur 1914; classes after Artobolevskii, Theory of Mechanisms; the exchange of drivers
    in paper 003.
    """
    if plane_normal(mechanism) is None:
        raise InputError(
            f"{mechanism.name} is not planar, and Assur groups are those of planar chains; "
            "look at its mobility instead"
        )
    pairs = planar_pairs(mechanism)
    drivers, stopped = inputs(mechanism, pairs, driver, stopped)
    order = [name for name, first in rigid(mechanism).items() if name == first != GROUND]
    unknown = [link for link in order if link not in (*drivers, *stopped)]
    groups: list[AssurGroup] = []
    for equations, units in blocks(mechanism, pairs, unknown):
        links = tuple(link for link in unknown if Unit(link, 0) in units)
        if links:  # else only a pin's place, on a link already there
            groups.append(_group(links, equations, units))
    return Decomposition(drivers, stopped, tuple(groups))


def _group(links: tuple[str, ...], equations: set[Equation], units: set[Unit]) -> AssurGroup:
    """Return the class and order of a group from its equations."""
    import networkx as nx

    contours: nx.Graph[str | int] = nx.Graph()
    elements = dict.fromkeys(links, 0)
    outer = 0
    for pair, equation_links, row in equations:
        if row:
            continue
        own = [link for link in equation_links if link in elements]
        for link in own:
            elements[link] += 1
        if Unit(pair, 0) in units or len(own) == 2:
            contours.add_edges_from((link, pair) for link in own)
        else:
            outer += 1
    inner = contours.number_of_edges() - sum(isinstance(node, int) for node in contours)
    sides = [len(cycle) // 2 for cycle in nx.minimum_cycle_basis(contours)]
    widest = 3 if max(elements.values()) >= 3 else 2
    return AssurGroup(max([widest, *sides]), outer, links, outer + inner)
