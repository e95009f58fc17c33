"""Contacts with curves and cams: the joint that transmits their force, and its normal."""

from dataclasses import dataclass

import numpy as np

from mechsim.mechanism.cams import Cam
from mechsim.mechanism.curves import GuideCurve
from mechsim.numerics.arrays import Array


@dataclass(frozen=True)
class Contact:
    """A contact of link b of a joint with a curve or a cam.

    Attributes:
        carrier: link with the curve or cam, of side a.
        force_joint: name of the joint that transmits the force.
        coordinate: name of the coordinate s of the curve, or q of the cam.
        frame: link in whose frame the normal is given: of the curve, or the guide of a cam.
        shape: the curve, as the point or the roller's centre follows it, or the cam.
        one_sided: whether it can only push.
        restitution: coefficient of restitution where it closes; None for that of the run.
    """

    carrier: str
    force_joint: str
    coordinate: str
    frame: str
    shape: GuideCurve | Cam
    one_sided: bool
    restitution: float | None = None

    @property
    def kind(self) -> str:
        """What link b touches: "cam" or "curve"."""
        return "cam" if isinstance(self.shape, Cam) else "curve"

    @property
    def roller_radius(self) -> float:
        """The radius of the roller of link b, in [m]; 0 for a point."""
        return self.shape.radius if isinstance(self.shape, Cam) else abs(self.shape.offset)

    @property
    def base_radius(self) -> float:
        """The base radius of a cam in [m]; 0 of a curve."""
        return self.shape.base_radius if isinstance(self.shape, Cam) else 0.0

    @property
    def period(self) -> float:
        """Period of the parameter of a closed curve; 0 of other contacts."""
        if isinstance(self.shape, Cam) or not self.shape.closed:
            return 0.0
        low, high = self.shape.interval
        return high - low

    def normals(self, values: Array) -> Array:
        """Return unit normals towards link b at values of the coordinate, (n, 3); of a curve to the left."""
        zero = 0.0 * values
        if isinstance(self.shape, Cam):
            x, y = self.shape.contact(values).normal
        else:
            along = [jet.rate + zero for jet in self.shape.jets(values)[:2]]
            sign = -1.0 if self.shape.offset < 0.0 else 1.0
            x, y = sign * np.array([-along[1], along[0]]) / np.hypot(*along)
        return np.stack([x, y, zero], -1)
