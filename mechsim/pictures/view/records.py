"""What a page shows, as plain records: sliders, poses on the grid of their nodes, read-outs, marks."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from mechsim.model.mechanism import Mechanism, Up
from mechsim.numerics.arrays import Array
from mechsim.shapes import Shape

# of a slider; "%" goes round a curve of assemblies
SliderUnit = Literal["rad", "m", "s", "%"]


@dataclass(frozen=True, slots=True)
class Mark:
    """A place on a slider that has a name: a dead centre, the least transmission angle.

    Attributes:
        at: in the unit of the slider.
        said: what it is, in a few words.
        kind: "dead" where the motion cannot go on, "meets" where assemblies meet, "note" else.
    """

    at: float
    said: str
    kind: Literal["dead", "meets", "note"] = "note"


@dataclass(frozen=True, slots=True)
class Slider:
    """A driver that is moved by hand.

    Attributes:
        name: of the driver, or "time".
        unit: of its nodes.
        nodes: rising values at which poses are known, (k,) in SI.
        ring: whether the last node is the first again, a period later.
        start: where it stands at first.
        marks: places with a name.
    """

    name: str
    unit: SliderUnit
    nodes: Array
    ring: bool
    start: float
    marks: tuple[Mark, ...] = ()


@dataclass(frozen=True, slots=True)
class Readout:
    """A quantity over the grid, of one or several parts: a point's place, a joint's coordinate.

    Attributes:
        name: of what.
        unit: in SI, "rad", "m", "m/s", "".
        parts: what a part is called -> its values, of the shape of the grid; "" where there is one.
    """

    name: str
    unit: str
    parts: Mapping[str, Array]


@dataclass(frozen=True, slots=True)
class GhostTrack:
    """Where another road puts the links, as differences along the one slider.

    Attributes:
        name: of the road.
        nodes: rising values of the slider, (k,).
        shift: link -> displacement of its first joint, (k, 3) in [m].
        turn: link -> turn as a vector, (k, 3) in [rad].
        by: factor that makes the differences plain to see.
    """

    name: str
    nodes: Array
    shift: Mapping[str, Array]
    turn: Mapping[str, Array]
    by: float


@dataclass(frozen=True, slots=True)
class PoseGrid:
    """One assembly, or one road: poses of all moving links at every node of its sliders.

    Attributes:
        name: as the page offers it.
        sliders: one for each driver; the grid is the product of their nodes.
        position: link -> place of its origin, (*shape, 3) in [m]; NaN where it cannot stand.
        quaternion: link -> its orientation, (*shape, 4), scalar first.
        readouts: what is written beside the picture and drawn as curves.
        ghost: of another road; None where there is none.
        error: largest error of a place between the nodes in [m], measured; NaN where it was not.
        said: more on where it comes from.
    """

    name: str
    sliders: tuple[Slider, ...]
    position: Mapping[str, Array]
    quaternion: Mapping[str, Array]
    readouts: tuple[Readout, ...] = ()
    ghost: GhostTrack | None = None
    error: float = float("nan")
    said: str = ""

    @property
    def shape(self) -> tuple[int, ...]:
        """Nodes along each slider."""
        return tuple(len(slider.nodes) for slider in self.sliders)


@dataclass(frozen=True, slots=True)
class View:
    """All that a page shows.

    Attributes:
        mechanism: whose links are drawn.
        grids: what can be chosen; the first is shown at first.
        title: heading.
        facts: lines that say what it is and where it comes from.
        bodies: link -> its body, as a user's file has it; None draws bodies from the joints.
        up: coordinate axis that points up, as "z" or "-y"; None takes the mechanism's own, else y.
    """

    mechanism: Mechanism
    grids: Sequence[PoseGrid]
    title: str
    facts: Sequence[str] = ()
    bodies: Mapping[str, Sequence[Shape]] | None = None
    up: Up | None = None
