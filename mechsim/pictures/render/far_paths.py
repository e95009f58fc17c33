"""Paths that go so far beyond the links that a picture of them whole would not show these: they are cut."""

from dataclasses import dataclass, replace

import numpy as np

from mechsim.numerics.arrays import Array
from mechsim.pictures.render.frame_poses import FramePoses

# a path that goes farther from the middle of the links than so many of their spans is cut, at so many
FAR, CUT = 12.0, 6.0


@dataclass(frozen=True, slots=True)
class FarPaths:
    """Which paths are cut, and where.

    Attributes:
        low: corner of the box beyond which nothing of them is drawn, (3,) in [m].
        high: the opposite one.
        names: tracked point -> how many spans of the links it goes away; empty where none goes far.
    """

    low: Array
    high: Array
    names: dict[str, float]

    def cut(self, frames: FramePoses) -> FramePoses:
        """Return frames whose far points stay at the box, outside the picture, and bear no arrow."""
        if not self.names:
            return frames
        paths, points = (
            {
                name: np.clip(place, self.low, self.high) if name in self.names else place
                for name, place in places.items()
            }
            for places in (frames.paths, frames.points)
        )
        return replace(
            frames,
            paths=paths,
            points=points,
            starts={name: at for name, at in frames.starts.items() if name not in self.names},
            vectors={
                kind: {name: one for name, one in vectors.items() if name not in self.names}
                for kind, vectors in frames.vectors.items()
            },
        )

    @property
    def told(self) -> str:
        """What a picture says of it, in one line; empty where no path goes far."""
        far = ", ".join(f"{name} ({times:,.0f} times as far)" for name, times in self.names.items())
        return f"framed on the links; cut: the path of {far}" if far else ""


def far_paths(frames: FramePoses, centres: Array, radii: Array) -> FarPaths:
    """Return which paths go far beyond the balls that hold the links, (k, 3) and (k,)."""
    low, high = (centres - radii[:, None]).min(0), (centres + radii[:, None]).max(0)
    middle, span = 0.5 * (low + high), float((high - low).max())
    away = {name: float(np.abs(path - middle).max()) / span for name, path in frames.paths.items()}
    names = {name: times for name, times in away.items() if times > FAR}
    return FarPaths(middle - CUT * span, middle + CUT * span, names)
