"""The vector method: rotations, triangle angles and unit vectors at given angles, on arrays of vectors.

It is public as `mechsim.vectors`: a user's own formula may import it, as those of the gallery do.

Vectors are stored component first, shape (3,) or (3, n): operations on whole arrays of a component make the
closed forms fast. Angles are in [rad]. Arguments of type `Values` can be jets.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from mechsim.numerics.arrays import Array
from mechsim.numerics.jets import Values, cos_sin, jet_product, jet_where, values, with_value

Sign = Literal[1, -1]

# a negative squared sine above minus this is rounding at a dead centre
ROUNDING = 16.0 * np.finfo(np.float64).eps
# a sine below this determines its angle better than the cosine does
SMALL_SINE = 0.5
# cyclic successors of the three components
NEXT = np.array([1, 2, 0])


def dot(a: Values, b: Values) -> Any:
    """Return the scalar product of vectors, (3, ...) and (3, ...) -> (...)."""
    return jet_product(array_dot, a, b)


def cross(a: Values, b: Values) -> Any:
    """Return the vector product of vectors, (3, ...) and (3, ...) -> (3, ...)."""
    return jet_product(array_cross, a, b)


def norm(a: Values) -> Any:
    """Return the length of vectors, (3, ...) -> (...)."""
    return np.sqrt(dot(a, a))


def column(v: Any) -> Array:
    """Return a vector as a (3, 1) column that broadcasts against (3, n); for many designs (3, n)."""
    if any(isinstance(component, np.ndarray) and component.ndim for component in v):
        return np.stack(np.broadcast_arrays(*v)).astype(np.float64, copy=False)
    return np.asarray(v, dtype=np.float64).reshape(3, 1)


def rotation(axis: Literal["x", "y", "z"], angle: Any) -> Array:
    """Return the matrix T_X, T_Y or T_Z of a rotation about a coordinate axis, (3, 3) or (3, 3, n).

    Source: Dvorzhak (2016, docs/explanation/sources.md), eq. (9).
    """
    c, s = np.cos(angle), np.sin(angle)
    i = "xyz".index(axis)
    j, k = (i + 1) % 3, (i + 2) % 3
    matrix = np.zeros((3, 3, *np.shape(angle)))
    matrix[i, i] = 1.0
    matrix[j, j] = matrix[k, k] = c
    matrix[k, j], matrix[j, k] = s, -s
    return matrix


def rotation_product(first: Array, second: Array) -> Array:
    """Return the product of two rotations, (3, 3) each or (3, 3, n) for many designs."""
    if first.ndim == second.ndim == 2:
        return first @ second
    wide = [matrix if matrix.ndim == 3 else matrix[..., None] for matrix in (first, second)]
    return (wide[0][:, :, None] * wide[1][None]).sum(1)


def rotate(reference: Array, axis: Array, angle: Values) -> Any:
    """Return a unit vector rotated about an axis perpendicular to it, (3, n).

    Args:
        reference: the vector at angle zero, (3, 1).
        axis: unit vector, (3, 1).
        angle: anticlockwise seen from the tip of the axis, (n,) in [rad].
    """
    c, s = cos_sin(angle)
    return c * reference + s * cross(axis, reference)


def triangle_angle(side1: ArrayLike, side2: ArrayLike, opposite: ArrayLike) -> Array:
    """Return the angle between two sides of a triangle, (n,) in [rad]; NaN if the sides form none.

    cos A = (a2 + b2 - c2) / (2 a b) for sides a, b and the opposite c, in the form
    tan2(A/2) = (c - a + b)(c + a - b) / ((a + b - c)(a + b + c)), which keeps the digits of small angles and
    of angles near pi.

    Args:
        side1: length of a side, scalar or (n,).
        side2: length of the other side, scalar or (n,).
        opposite: length of the side opposite the angle, scalar or (n,).

    Source: Dvorzhak (2016), the function Tcos; W. Kahan, "Miscalculating area and angles of a needle-like
        triangle" (2014), for the form.
    """
    a, b, c = np.broadcast_arrays(side1, side2, opposite)
    with np.errstate(invalid="ignore"):
        return 2.0 * np.arctan2(np.sqrt((c - (a - b)) * (c + (a - b))), np.sqrt((a + b - c) * (a + b + c)))


def unit_at_angles(v1: Values, v2: Values, angle1: ArrayLike, angle2: ArrayLike, sign: Sign) -> Any:
    """Return the unit vector at `angle1` to `v1` and `angle2` to `v2`.

    Args:
        v1: first direction, of any length but zero, (3,) or (3, n).
        v2: second direction, not parallel to the first, (3,) or (3, n).
        angle1: angle to `v1` in [rad], scalar or (n,).
        angle2: angle to `v2` in [rad], scalar or (n,).
        sign: selects one of two solutions p: the sign of p . (v1 x v2).

    Returns:
        Unit vectors, (3,) or (3, n); NaN where no vector has these angles.

    Accuracy: the angles are exact to a few ulp divided by the sine of the angle between `v1` and `v2`; unlike
    the published form, this one does not depend on the coordinate frame.

    Source: Dvorzhak (2016), eqs (10)-(21), in the numerically stable form of
        docs/explanation/vector_method.md.
    """
    u1, u2 = v1 / norm(v1), v2 / norm(v2)
    g = dot(u1, u2)
    n = cross(u1, u2)
    s2 = dot(n, n)
    c1, c2 = np.cos(angle1), np.cos(angle2)
    a, b = (c1 - g * c2) / s2, (c2 - g * c1) / s2
    h2 = 1.0 - (a * a + b * b + 2.0 * a * b * g)
    h = np.sqrt(_possible(h2) / s2)
    return a * u1 + b * u2 + sign * h * n


def circle_sphere(
    centre: Values,
    axis: Values,
    radius: float,
    sphere_centre: Values,
    sphere_radius: float,
    sign: Sign,
    across: Values | None = None,
) -> Any:
    """Return the intersection of a circle and a sphere.

    Args:
        centre: centre of the circle, (3, 1) or (3, n).
        axis: unit normal of its plane, (3, 1) or (3, n).
        radius: radius of the circle.
        sphere_centre: centre of the sphere, (3, n).
        sphere_radius: radius of the sphere.
        sign: selects one of two points: the sign of p . (d x axis), where p points from the circle's centre
            to the point and d to the sphere's centre.
        across: p . (d x axis) times twice the radius, (n,), of either sign, if it is known more accurately
            than from the lengths; then `sign` is not used.

    Returns:
        Unit vectors p from the circle's centre to the point, (3, n), NaN without intersection.

    Accuracy: the point lies on both to a few ulp of the largest length, also at a dead centre, where a miss
        by rounding counts as contact. If the sphere's centre is near the axis, where p is ill-conditioned, p
        leaves the plane by an ulp times the length of d divided by their distance.
    """
    d = sphere_centre - centre
    height = dot(d, axis)
    flat = d - height * axis
    reach = norm(flat)
    # 1 - cosine of the angle between p and flat: keeps a short sphere radius, which squares would lose
    off = ((sphere_radius - height) * (sphere_radius + height) - (reach - radius) ** 2) / (
        2.0 * radius * reach
    )
    ahead = flat / reach
    if across is not None:
        sine = across / (2.0 * radius * reach)
        sine_values = values(sine)
        cosine = np.where(values(off) < 1.0, 1.0, -1.0) * np.sqrt(1.0 - sine * sine)
        usual = np.where(sine_values < 0.0, -1.0, 1.0) * np.sqrt(_possible(off * (2.0 - off)))
        small = np.abs(sine_values) < SMALL_SINE
        return jet_where(small, cosine, 1.0 - off) * ahead + jet_where(small, sine, usual) * cross(
            ahead, axis
        )
    return (1.0 - off) * ahead + sign * np.sqrt(_possible(off * (2.0 - off))) * cross(ahead, axis)


def sine_of(cosine: Values) -> Any:
    """Return the positive sine of a cosine; NaN if the cosine exceeds +-1 by more than rounding."""
    return np.sqrt(_possible((1.0 - cosine) * (1.0 + cosine)))


def _possible(square: Values) -> Any:
    """Return a squared sine without negative rounding; NaN if it is negative by more."""
    number = values(square)
    return with_value(square, np.where(number >= -ROUNDING, np.maximum(number, 0.0), np.nan))


def array_dot(a: Array, b: Array) -> Array:
    """Return scalar products, (3, n) or (3, 1) each: (n,) or (1,)."""
    return np.add.reduce(a * b, 0)


def array_cross(a: Array, b: Array) -> Array:
    """Return vector products, (3, n) or with more axes in between."""
    preceding = a * b.take(NEXT, 0)
    preceding -= a.take(NEXT, 0) * b
    return preceding.take(NEXT, 0)
