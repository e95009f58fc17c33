"""The closed forms up to 1e-12 rad from a dead centre, and the published form next to the sound one.

    python validation/robustness/closed_form_at_dead_centres.py --out DIR

Problem: a four-bar, slider-crank, RSSR and RRSRR whose cranks only swing, 1e-1 ... 1e-12 rad inside their
dead centres. Reference: the same circle-and-sphere section with 50 digits by mpmath, at the very crank
angle given, a double; its own error is below 1e-40. An error is judged in units of condition x eps:
the condition is how much the point moves, in units of the longest link, for a relative change of the
crank angle and of each length, summed, by differences in 50 digits. No form that rounds its inputs can
do better than about one unit. Published form: the angle by arc cosine, then paper 000, eqs (10)-(21). A
dead centre as such does it no harm; one near V3x = 0, where it divides by zero (../papers/published_form.py),
does.
"""

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from mpmath import mp
from numpy.typing import NDArray

from mechsim.analytic.catalog import FourBar, Rrsrr, Rssr, SliderCrank
from mechsim.analytic.catalog.two_branch import TwoBranchForm
from mechsim.analytic.vector_method.vectors import column, norm

sys.path.append(str(Path(__file__).parents[1] / "papers"))

from published_form import unit_at_angles_published

Array = NDArray[np.float64]
Vector = Sequence[mp.mpf]
EPS = 2.0**-52
# most units of condition x eps that an error may be; 0.34 measured
MOST = 2.0
DIGITS = 50
DISTANCES = np.geomspace(1e-12, 1e-1, 23)
DRIVES: dict[str, tuple[TwoBranchForm, str]] = {
    "four_bar": (FourBar(rocker=0.035), "B"),
    "slider_crank": (SliderCrank(rod=0.045), "B"),
    "rssr": (Rssr(rocker=0.009), "P3"),
    "rrsrr": (Rrsrr(link=0.055), "S"),
}


def dead_where_v3x_vanishes() -> Rssr:
    """Return the looper layout of papers.md with a coupler that stops the crank just where V3x is zero."""
    drive = Rssr(crank=0.014, rocker=0.024, pivot=(0.039, -0.008, 0.004), gamma1=0.0, gamma2=0.0)
    turned = np.arccos(drive.pivot[1] / drive.crank)
    height = drive.crank * np.sin(turned) - drive.pivot[2]
    return replace(drive, coupler=float(np.hypot(height, drive.pivot[0] - drive.rocker)))


def inputs(drive: TwoBranchForm) -> list[mp.mpf]:
    """Return the numbers that the point depends on, but the crank angle."""
    if isinstance(drive, FourBar):
        values = [drive.ground, drive.crank, drive.coupler, drive.rocker]
    elif isinstance(drive, SliderCrank):
        values = [drive.crank, drive.rod, drive.offset]
    elif isinstance(drive, Rssr):
        values = [drive.crank, drive.coupler, drive.rocker, *drive.pivot, drive.gamma1, drive.gamma2]
    else:
        assert isinstance(drive, Rrsrr)
        values = [drive.crank, drive.coupler, drive.link, *drive.pivot]
    return [mp.mpf(value) for value in values]


def section(drive: TwoBranchForm, f: mp.mpf, given: list[mp.mpf]) -> tuple[Vector, mp.mpf]:
    """Return the driven point and what is under its root, zero at the dead centre, in mpmath numbers."""
    c, s = mp.cos(f), mp.sin(f)
    if isinstance(drive, SliderCrank):
        crank, rod, offset = given
        room = rod**2 - (offset - crank * s) ** 2
        return [crank * c + drive.branch * mp.sqrt(room), offset, mp.mpf(0)], room
    if isinstance(drive, FourBar):
        ground, crank, coupler, rocker = given
        to_a = [crank * c - ground, crank * s, mp.mpf(0)]
        circle = [ground, mp.mpf(0), mp.mpf(0)], [mp.mpf(0), mp.mpf(0), mp.mpf(1)], rocker
        return _met(circle, to_a, coupler, drive.branch)
    if isinstance(drive, Rssr):
        crank, coupler, rocker, *rest = given
        pivot, (g1, g2) = rest[:3], rest[3:]
        # third column of TY(gamma1) TX(gamma2)
        axis = [mp.sin(g1) * mp.cos(g2), -mp.sin(g2), mp.cos(g1) * mp.cos(g2)]
        to_p2 = [-pivot[0], crank * c - pivot[1], crank * s - pivot[2]]
        return _met((pivot, axis, rocker), to_p2, coupler, drive.branch)
    assert isinstance(drive, Rrsrr)
    crank, coupler, link, *pivot = given
    centre, hinge = [mp.mpf(0), crank * c, crank * s], [mp.mpf(0), s, -c]
    to_pivot = [p - q for p, q in zip(pivot, centre, strict=True)]
    return _met((centre, hinge, coupler), to_pivot, link, drive.branch)


def _met(
    circle: tuple[Vector, Vector, mp.mpf], to_sphere: Vector, radius: mp.mpf, sign: int
) -> tuple[Vector, mp.mpf]:
    """Return where a circle (centre, axis, radius) meets a sphere, with p . (d x axis) of that sign."""
    centre, axis, reach = circle
    height = sum(a * d for a, d in zip(axis, to_sphere, strict=True))
    flat = [d - height * a for a, d in zip(axis, to_sphere, strict=True)]
    way2 = sum(d * d for d in flat)
    along = (way2 + reach**2 + height**2 - radius**2) / (2 * mp.sqrt(way2))
    room = reach**2 - along**2
    ahead = [d / mp.sqrt(way2) for d in flat]
    across = [
        ahead[1] * axis[2] - ahead[2] * axis[1],
        ahead[2] * axis[0] - ahead[0] * axis[2],
        ahead[0] * axis[1] - ahead[1] * axis[0],
    ]
    side = sign * mp.sqrt(room)
    return [o + along * a + side * b for o, a, b in zip(centre, ahead, across, strict=True)], room


def angles_near(drive: TwoBranchForm, distances: Array) -> Array:
    """Return doubles so far inside the upper end of the crank's arc, which is found with 50 digits."""
    _, high = drive.crank_range().arcs[0]
    with mp.workdps(DIGITS):
        given = inputs(drive)
        end = mp.findroot(lambda f: mp.re(section(drive, f, given)[1]), (high - 1e-3, high))
        return np.array([float(end - mp.mpf(float(distance))) for distance in distances])


def exact(drive: TwoBranchForm, angle: float) -> tuple[list[mp.mpf], float]:
    """Return the driven point with 50 digits, and its condition."""
    with mp.workdps(DIGITS):
        f, given = mp.mpf(angle), inputs(drive)
        point = list(section(drive, f, given)[0])
        step = mp.mpf(10) ** -25

        def moved(change: Callable[[int], mp.mpf]) -> float:
            other = section(drive, f * change(-1), [x * change(i) for i, x in enumerate(given)])[0]
            return float(mp.sqrt(sum(abs(a - b) ** 2 for a, b in zip(point, other, strict=True))) / step)

        whole = sum(moved(lambda k, i=i: 1 + step if k == i else mp.mpf(1)) for i in range(-1, len(given)))
        return point, whole / longest(drive)


def longest(drive: TwoBranchForm) -> float:
    return drive.mechanism.characteristic_length


def errors(drive: TwoBranchForm, name: str, angles: Array) -> tuple[Array, Array]:
    """Return the closed form's errors in units of the longest link, and the conditions, (n,) each."""
    places = drive.positions(angles)[name]
    known = [exact(drive, float(angle)) for angle in angles]
    gaps = [_gap(place, point) for place, (point, _) in zip(places, known, strict=True)]
    return np.array(gaps) / longest(drive), np.array([condition for _, condition in known])


def published(drive: Rssr, angles: Array) -> Array:
    """Return the errors of P3 by the published form, in units of the longest link, (n,); 1 for no number."""
    result = np.empty(len(angles))
    for i, f in enumerate(angles):
        p2 = drive.crank * np.array([[0.0], [np.cos(f)], [np.sin(f)]])
        to_crank, axis = p2 - column(drive.pivot), column(drive.rocker_frame[:, 2])
        with np.errstate(all="ignore"):
            l1, l2, l3 = drive.rocker, norm(to_crank), drive.coupler
            angle = np.arccos((l1 * l1 + (l2 - l3) * (l2 + l3)) / (2.0 * l1 * l2))
            both = [unit_at_angles_published(to_crank, axis, angle, np.pi / 2, sign) for sign in (1, -1)]
        point, _ = exact(drive, float(f))
        gaps = [_gap(np.asarray(drive.pivot) + drive.rocker * p[:, 0], point) for p in both]
        # the sign is chosen in its favour
        result[i] = min([gap / longest(drive) for gap in gaps if np.isfinite(gap)], default=1.0)
    return result


def _gap(place: Array, point: list[mp.mpf]) -> float:
    if not np.isfinite(place).all():
        return float("nan")
    with mp.workdps(DIGITS):
        return float(mp.sqrt(sum((mp.mpf(float(a)) - b) ** 2 for a, b in zip(place, point, strict=True))))


def draw(path: Path, sound: dict[str, tuple[Array, Array]], others: dict[str, Array]) -> None:
    """Write the picture: errors over the distance, condition x eps as thin lines."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, ax = plt.subplots(figsize=(7, 4.5), layout="constrained")
    for i, (name, (error, condition)) in enumerate(sound.items()):
        ax.loglog(DISTANCES, np.maximum(error, 1e-18), "o", ms=4, mfc="none", color=f"C{i}", label=name)
        ax.loglog(DISTANCES, EPS * condition, lw=0.8, color=f"C{i}")
    for (name, error), mark in zip(others.items(), "x+", strict=True):
        ax.loglog(DISTANCES, error, f"{mark}--", lw=0.8, color="#b00020", label=f"{name}, published form")
    ax.set(xlabel="distance to the dead centre [rad]", ylabel="error / longest link; lines: condition x eps")
    ax.invert_xaxis()
    ax.legend()
    figure.savefig(path, dpi=120)
    plt.close(figure)


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(description="Closed forms near dead centres against 50 digits.")
    parser.add_argument("--out", type=Path, required=True, help="directory of the picture")
    out: Path = parser.parse_args(arguments).out
    out.mkdir(parents=True, exist_ok=True)
    drives = DRIVES | {"rssr, V3x = 0": (dead_where_v3x_vanishes(), "P3")}
    sound, others = {}, {}
    for name, (drive, point) in drives.items():
        angles = angles_near(drive, DISTANCES)
        sound[name] = errors(drive, point, angles)
        if isinstance(drive, Rssr):
            others[name] = published(drive, angles)
    columns = {name: error for name, (error, _) in sound.items()}
    columns |= {f"{name}, published": error for name, error in others.items()}
    print("distance [rad]  " + "  ".join(columns))
    for i in range(0, len(DISTANCES), 2):
        row = "  ".join(f"{error[i]:{len(name)}.1e}" for name, error in columns.items())
        print(f"{DISTANCES[i]:14.1e}  {row}")
    print("worst error in units of condition x eps:")
    units = {name: float((error / condition).max() / EPS) for name, (error, condition) in sound.items()}
    for name, unit in units.items():
        bad = f"; published form {(others[name] / sound[name][1]).max() / EPS:.2g}" if name in others else ""
        print(f"  {name}: {unit:.2g}{bad}")
    draw(out / "closed_form_at_dead_centres.png", sound, others)
    return 0 if max(units.values()) <= MOST else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
