"""The masses of the links of a mechanism, and where each comes from."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

from mechsim.model.inertia import Inertia
from mechsim.model.mechanism import Mechanism
from mechsim.model.rod_inertia import STEEL

Source = Literal["given", "rod", "zero"]
# names of links that a line of text lists; more are counted
LISTED = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkMass:
    """The mass of a link and its source.

    Attributes:
        link: its name.
        mass: in [kg].
        source: "given" in the file or object; "rod", computed from round rods between its joints, because
            no inertia is given; "zero" where a file gives none to this link but masses to others (a
            negligible mass then stands for zero).
        length: of the rods together in [m]; None unless the source is "rod".
        diameter: of the rods in [m]; None unless the source is "rod".
        density: of the rods in [kg/m3]; None unless the source is "rod".
    """

    link: str
    mass: float
    source: Source
    length: float | None = None
    diameter: float | None = None
    density: float | None = None

    @property
    def text(self) -> str:
        """The source in words."""
        if self.source != "rod":
            return "given" if self.source == "given" else "zero in the file"
        return (
            f"computed: {_material(self.density)} rods, length {self.length:.6g} m, "
            f"diameter {self.diameter:.6g} m"
        )

    def as_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        return asdict(self)


def masses_of(mechanism: Mechanism) -> tuple[LinkMass, ...]:
    """Return the masses of links that have an inertia; links that stand for no body are left out."""
    return tuple(_mass(link.name, link.inertia) for link in mechanism.links if link.inertia and link.seen)


def summary(masses: Sequence[LinkMass]) -> str:
    """Return in one line which masses are used and where they come from; empty without links."""
    parts: list[str] = []
    for source in ("given", "rod", "zero"):
        some = [one for one in masses if one.source == source]
        if some:
            parts.append(f"{_names(some, len(masses))} {_said(source, some)}")
    return f"masses: {'; '.join(parts)}" if parts else ""


def _said(source: Source, some: Sequence[LinkMass]) -> str:
    total = f"{sum(one.mass for one in some):.4g} kg"
    if source == "given":
        return f"given, {total}"
    if source == "zero":
        return "zero in the file"
    rod = some[0]
    return (
        f"computed as round {_material(rod.density)} rods of diameter {rod.diameter:.4g} m, {total}, "
        "because no inertia is given"
    )


def _names(some: Sequence[LinkMass], count: int) -> str:
    if len(some) == count > LISTED:
        return f"all {count} links"
    return ", ".join(one.link for one in some) if len(some) <= LISTED else f"{len(some)} of {count} links"


def _material(density: float | None) -> str:
    return "steel" if density == STEEL else f"{density:.6g} kg/m3"


def _mass(link: str, inertia: Inertia) -> LinkMass:
    rods = inertia.rods
    if rods is not None:
        return LinkMass(
            link=link,
            mass=inertia.mass,
            source="rod",
            length=rods.length,
            diameter=rods.diameter,
            density=rods.density,
        )
    return LinkMass(link=link, mass=inertia.mass, source="zero" if inertia.negligible else "given")
