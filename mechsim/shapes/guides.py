"""Curves, profiles of cams and the rollers on them."""

from itertools import pairwise

import numpy as np

from mechsim.mechanism.cams import Cam
from mechsim.mechanism.contacts import Contact
from mechsim.mechanism.joints import End
from mechsim.mechanism.links import GROUND, VIRTUAL_PREFIX
from mechsim.mechanism.mechanism import Mechanism
from mechsim.numerics.arrays import REVOLUTION, Array
from mechsim.shapes.body import Canvas
from mechsim.shapes.shape import HOUSING, STEEL, pale, plate_of

# ends of the names of joints that prescribe the pose of a point or link (`subjects.pose_drivers`)
CHAIN = (".x", ".y", ".z", ".rx", ".ry", ".rz")
# chords of a drawn curve
CHORDS = 90


def hidden_links(mechanism: Mechanism) -> set[str]:
    """Return the massless links of contacts and of driven points and links: equations and no bodies."""
    ends = ("", ".guide", ".s")
    chains = {f"{VIRTUAL_PREFIX}{joint.name}" for joint in mechanism.joints if joint.name.endswith(CHAIN)}
    return chains | {f"{VIRTUAL_PREFIX}{name}{end}" for name in mechanism.contacts for end in ends}


def draw_contacts(canvas: Canvas) -> None:
    """Draw each curve and profile of a cam on its link, and the roller on the link that follows it."""
    for name, contact in canvas.mechanism.contacts.items():
        colour = canvas.colours.get(contact.carrier, HOUSING)
        points = contact_points(canvas.mechanism.joint(name).a, contact, CHORDS)
        if canvas.normals:
            points = points + canvas.level(contact.carrier) * canvas.normals[contact.carrier]
        if isinstance(contact.shape, Cam):
            end = canvas.mechanism.joint(name).a
            axis = canvas.normals[contact.carrier] if canvas.normals else np.asarray(end.axis)
            canvas.out[contact.carrier].append(plate_of(points[:-1], 0.5 * canvas.r * axis, pale(colour)))
        for frm, to in pairwise(points):
            canvas.add(contact.carrier, "capsule", frm, to, 0.6 * canvas.r, colour)
        end = canvas.mechanism.joint(contact.force_joint).b
        radius = contact.roller_radius
        if radius and end.link != GROUND:
            upright = canvas.upright(end)
            height = canvas.level(contact.carrier) if canvas.normals else 0.0
            canvas.disc(end.link, upright, height - 0.6 * canvas.r, height + 0.6 * canvas.r, radius, STEEL)


def contact_points(end: End, contact: Contact, chords: int) -> Array:
    """Return points of a curve without its offset, or of a profile, in its link's frame, (n, 3) in [m]."""
    shape = contact.shape
    if isinstance(shape, Cam):
        profile = shape.contact(np.linspace(0.0, REVOLUTION, chords + 1))
        x, y = profile.in_cam(profile.point)
        # the joint rotates about minus the axis of the cam
        return np.asarray(end.point) + np.stack([x, -y, 0.0 * x], -1) @ end.frame.T
    s = np.linspace(*shape.interval, chords + 1)
    axes = [axis(s)[0] + 0.0 * s for axis in shape.axes]
    return np.stack([*axes, 0.0 * s][:3], -1)
