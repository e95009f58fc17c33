"""Profiles of cams as tables, and as drawings in DXF and SVG, in millimetres."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from mechsim import files
from mechsim.errors import InputError
from mechsim.model.cams import Cam, CamContact
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.angles import REVOLUTION
from mechsim.numerics.arrays import Array

# intervals of a revolution: a quarter of a degree; the polygon deviates from an arc by 2.4e-6 of its radius
INTERVALS = 1440
EXTENSIONS = (".csv", ".dxf", ".svg")
MILLIMETRES = 1e3


def cam_on(mechanism: Mechanism, joint: str) -> Cam:
    """Return the cam of a joint of kind cam.

    Raises:
        InputError: for another joint.
    """
    cams = {name: contact.shape for name, contact in mechanism.contacts.items()}
    cam = cams.get(joint)
    if not isinstance(cam, Cam):
        names = ", ".join(name for name, shape in cams.items() if isinstance(shape, Cam))
        raise InputError(
            f"{mechanism.name}: {joint!r} is no joint of kind cam; choose from {names or 'none'}"
        )
    return cam


def cam_table(contact: CamContact) -> dict[str, Array]:
    """Return profile, path of the follower, pressure angle and radius of curvature by cam angle, in SI."""
    (x, y), (pitch_x, pitch_y) = contact.in_cam(contact.point), contact.in_cam(contact.pitch)
    return {
        "q": contact.angle,
        "lift": contact.lift,
        "x": x,
        "y": y,
        "pitch_x": pitch_x,
        "pitch_y": pitch_y,
        "pressure_angle": contact.pressure_angle,
        "curvature_radius": contact.curvature_radius,
    }


def cam_text(cam: Cam, extension: str) -> str:
    """Return the profile of a cam as the text of a file with one of `EXTENSIONS`."""
    contact = cam.contact(np.linspace(0.0, REVOLUTION, INTERVALS + 1))
    if extension == ".csv":
        table = cam_table(contact)
        return files.csv_head(table) + "".join(files.csv_lines(table))
    point = contact.in_cam(contact.point)[:, :-1].T * MILLIMETRES
    return _svg(point) if extension == ".svg" else "\n".join(_dxf(point)) + "\n"


def write_cam(path: Path, cam: Cam) -> None:
    """Write the profile of a cam."""
    with files.atomic_path(path) as temporary:
        temporary.write_text(cam_text(cam, path.suffix.lower()), encoding="utf-8")


def _svg(point: Array) -> str:
    """Return a closed path; the axis of an image points down."""
    x, y = point.T * np.array([[1.0], [-1.0]])
    low, extent = (x.min(), y.min()), (np.ptp(x), np.ptp(y))
    path = " L".join(f"{a:.9g},{b:.9g}" for a, b in zip(x, y, strict=True))
    box = f"{low[0]:.9g} {low[1]:.9g} {extent[0]:.9g} {extent[1]:.9g}"
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{extent[0]:.9g}mm" height="{extent[1]:.9g}mm" '
        f'viewBox="{box}">\n<path d="M{path} Z" fill="none" stroke="black" stroke-width="0.1"/>\n'
        '<circle r="0.5"/>\n</svg>\n'
    )


def _dxf(point: Array) -> Iterator[str]:
    """Yield the lines of a closed polyline in DXF R12 (Autodesk, *DXF Reference*, POLYLINE)."""
    yield from ("0", "SECTION", "2", "ENTITIES", "0", "POLYLINE", "8", "profile", "66", "1", "70", "1")
    for x, y in point.tolist():
        yield from ("0", "VERTEX", "8", "profile", "10", f"{x:.9f}", "20", f"{y:.9f}")
    yield from ("0", "SEQEND", "0", "ENDSEC", "0", "EOF")
