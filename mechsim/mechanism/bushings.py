"""Bushings: elastic mounts between two frames on two links."""

from dataclasses import dataclass

import numpy as np

from mechsim.errors import InputError
from mechsim.mechanism.joints import End
from mechsim.numerics.arrays import HUGE, Array, numbers

# relative asymmetry, and relative negative eigenvalue, that are rounding of a file
ROUNDED = 1e-9


@dataclass(frozen=True, slots=True)
class Bushing:
    """A stiffness and a damping in six directions between frames on two links.

    In the frame of side a, d is the position of side b's origin and theta the rotation vector of side b,
    shorter than pi. The deflection x = (d, theta) stores x' K x / 2. With the rates y = (d', w) and the
    relative angular velocity w, side a exerts on side b, at b's origin,

        (f, m) = -K x,  force f,  moment J^-T m,  and the damping -C y.

    J is the left Jacobian of SO(3), theta' = J^-1 w; for one stiffness about all axes J^-T m = m. As a spring
    in a revolute joint, it takes the shorter way: at half a revolution theta jumps to the other side.

    Source: MSC Adams, BUSHING (the same with J = 1, for small rotations); Solà, Deray & Atchuthan 2018, "A
    micro Lie theory", eq. (146), for J^-1.

    Attributes:
        name: its name.
        a: frame on the first link: z along the axis, x along the reference.
        b: frame on the second link.
        stiffness: K, 6 x 6, symmetric without negative eigenvalues, in [N/m, N/rad; N, N m/rad].
        damping: C, likewise, per rate.

    Example: `Bushing("mount", End("ground"), End("engine"), diagonal(1e5, 1e5, 2e5, 80, 80, 40))`
    """

    name: str
    a: End
    b: End
    stiffness: tuple[tuple[float, ...], ...]
    damping: tuple[tuple[float, ...], ...] = ((0.0,) * 6,) * 6

    def __post_init__(self) -> None:
        if self.a.link == self.b.link:
            raise InputError(f"bushing {self.name!r} joins link {self.a.link!r} to itself; name two links")
        for what in ("stiffness", "damping"):
            matrix = numbers(getattr(self, what))
            if matrix.shape != (6, 6) or not (np.abs(matrix) < HUGE).all():
                raise InputError(
                    f"{what} of bushing {self.name!r} is not 6 x 6 finite numbers; give 6 rows of 6"
                )
            largest = np.abs(matrix).max()
            if np.abs(matrix - matrix.T).max() > ROUNDED * largest:
                raise InputError(
                    f"{what} of bushing {self.name!r} is not symmetric; give equal values on both sides of "
                    "its diagonal"
                )
            lowest = np.linalg.eigvalsh(matrix)[0]
            if lowest < -ROUNDED * largest:
                raise InputError(
                    f"{what} of bushing {self.name!r} has the negative eigenvalue {lowest:.4g}; give a "
                    "matrix without one"
                )

    @property
    def matrices(self) -> tuple[Array, Array]:
        """K and C."""
        return np.array(self.stiffness), np.array(self.damping)


def diagonal(*values: float) -> tuple[tuple[float, ...], ...]:
    """Return a 6 x 6 matrix from its diagonal."""
    return tuple(tuple(row) for row in np.diag(values).tolist())
