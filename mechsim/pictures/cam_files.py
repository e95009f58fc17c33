"""Profiles of cams as tables, and as drawings in DXF and SVG, in millimetres."""

from pathlib import Path

import numpy as np

from mechsim import files
from mechsim.errors import InputError
from mechsim.mechanism.cams import Cam, CamContact
from mechsim.mechanism.masses import RELATIVE_DIAMETER
from mechsim.mechanism.mechanism import Mechanism
from mechsim.numerics.arrays import REVOLUTION, Array
from mechsim.pictures.flat_plates import CHORDS, MILLIMETRES, Plate, closed_line, cross, drawing_text

EXTENSIONS = (".csv", ".dxf", ".svg")


def cam_on(mechanism: Mechanism, joint: str) -> Cam:
    """Return the cam of a joint of kind cam.

    Raises:
        InputError: for another joint.
    """
    shapes = {name: contact.shape for name, contact in mechanism.contacts.items()}
    cams = {name: shape for name, shape in shapes.items() if isinstance(shape, Cam)}
    if joint not in cams:
        raise InputError(
            f"{mechanism.name}: {joint!r} is no joint of kind cam; choose from {', '.join(cams) or 'none'}"
        )
    return cams[joint]


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
    contact = cam.contact(np.linspace(0.0, REVOLUTION, CHORDS + 1))
    if extension == ".csv":
        table = cam_table(contact)
        return files.csv_head(table) + "".join(files.csv_lines(table))
    profile = closed_line(MILLIMETRES * contact.in_cam(contact.point)[:, :-1].T)
    axle = cross(np.zeros(2), MILLIMETRES * RELATIVE_DIAMETER * cam.base_radius)
    return drawing_text([Plate("profile", (profile,), np.zeros((0, 2)), axle, 0.0)], extension[1:])


def write_cam(path: Path, cam: Cam) -> None:
    """Write the profile of a cam."""
    files.write_content(path, cam_text(cam, path.suffix.lower()))
