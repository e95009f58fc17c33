"""Cams against textbook formulas, evaluated with 40 digits."""

import mpmath as mp
import numpy as np
import pytest

from mechsim.mechanism.cams import Cam, SegmentedLaw
from mechsim.mechanism.coupling_functions import WrittenFunction

mp.mp.dps = 40
ANGLES = [0.1, 0.7, 1.3, 2.0, 2.9, 3.6, 4.4, 5.1]
LIFT = mp.mpf("0.01")


def cycloidal(u):
    return u - mp.sin(2 * mp.pi * u) / (2 * mp.pi)


def polynomial(u):
    return 10 * u**3 - 15 * u**4 + 6 * u**5


def modified_sine(u):
    # Norton, Cam Design and Manufacturing Handbook, eqs. 3.14
    if u < mp.mpf(1) / 8:
        return (mp.pi * u - mp.sin(4 * mp.pi * u) / 4) / (4 + mp.pi)
    if u <= mp.mpf(7) / 8:
        return (2 + mp.pi * u - mp.mpf(9) / 4 * mp.sin(mp.pi / 3 + 4 * mp.pi * u / 3)) / (4 + mp.pi)
    return (4 + mp.pi * u - mp.sin(4 * mp.pi * u) / 4) / (4 + mp.pi)


@pytest.mark.parametrize(
    ("name", "formula"),
    [("cycloidal", cycloidal), ("polynomial_345", polynomial), ("modified_sine", modified_sine)],
)
def test_laws_are_those_of_the_textbook(name, formula):
    # a rise in 2 rad, a dwell of 1 rad and a return in the rest of the revolution
    law = SegmentedLaw("law", (name, "dwell", name), (0.0, 2.0, 3.0, 2 * np.pi), (0.0, 0.01, 0.01, 0.0))
    back = 2 * mp.pi - 3

    def lift(q):
        return LIFT * (formula(q / 2) if q < 2 else 1 if q < 3 else 1 - formula((q - 3) / back))

    # instants between the pieces of the modified sine
    angles = [0.1, 0.3, 1.0, 1.7, 1.9, 2.5, 3.2, 4.5, 6.0]
    computed = law(np.array(angles))
    for order in range(3):
        exact = [float(mp.diff(lift, q, order)) for q in angles]
        assert np.abs(computed[order] - exact).max() < 1e-14
    assert np.abs(law(np.array(angles) - 6 * np.pi)[1] - computed[1]).max() < 1e-14


# lift 5 mm (1 - cos q) or the same number in rad, with its derivatives
LAW = WrittenFunction("0.005*(1 - cos(q))")
SWING = WrittenFunction("0.1*(1 - cos(q))")
CAMS = {
    "knife": Cam("c", "knife", "translating", 0.025, LAW, offset=-0.004),
    "roller": Cam("c", "roller", "translating", 0.025, LAW, radius=0.006, offset=0.003),
    "flat": Cam("c", "flat", "translating", 0.025, LAW),
    "swinging roller": Cam(
        "c", "roller", "swinging", 0.025, SWING, radius=0.006, arm=0.06, centre_distance=0.07
    ),
    "swinging flat": Cam("c", "flat", "swinging", 0.025, SWING, offset=0.004, centre_distance=0.07),
}


def lift_of(cam, q):
    return (mp.mpf("0.005") if cam.motion == "translating" else mp.mpf("0.1")) * (1 - mp.cos(q))


def follower_line(cam, q):
    """Return point and direction of a flat face, or the centre of the roller, in the guide's frame."""
    s, r = lift_of(cam, q), mp.mpf(cam.base_radius) + mp.mpf(cam.radius)
    d, e = mp.mpf(cam.centre_distance), mp.mpf(cam.offset)
    if cam.motion == "translating":
        y = r if cam.kind == "flat" else mp.sqrt(r**2 - e**2)
        return mp.matrix([0 if cam.kind == "flat" else e, y + s]), mp.matrix([1, 0])
    if cam.kind == "flat":
        angle = mp.asin((r - e) / d) + s
        normal = mp.matrix([mp.sin(angle), mp.cos(angle)])
        return mp.matrix([d, 0]) + e * normal, mp.matrix([-mp.cos(angle), mp.sin(angle)])
    angle = mp.acos((d**2 + mp.mpf(cam.arm) ** 2 - r**2) / (2 * d * mp.mpf(cam.arm))) + s
    return mp.matrix([d - cam.arm * mp.cos(angle), cam.arm * mp.sin(angle)]), None


def in_cam(vector, q):
    c, s = mp.cos(q), mp.sin(q)
    return mp.matrix([c * vector[0] + s * vector[1], c * vector[1] - s * vector[0]])


def profile(cam, q):
    """Return a point of the profile: the envelope of the roller, or of the face, in the cam's frame."""
    if cam.kind != "flat":
        x, y = (mp.diff(lambda a, i=i: in_cam(follower_line(cam, a)[0], a)[i], q) for i in (0, 1))
        normal = mp.matrix([-y, x]) / mp.hypot(x, y)
        return in_cam(follower_line(cam, q)[0], q) - mp.mpf(cam.radius) * normal

    def distance(a):
        point, along = (in_cam(entry, a) for entry in follower_line(cam, a))
        return along[0] * point[1] - along[1] * point[0]

    def direction(a):
        along = in_cam(follower_line(cam, a)[1], a)
        return mp.matrix([-along[1], along[0]])

    # n . p = h and n' . p = h'
    h, dh = distance(q), mp.diff(distance, q)
    n = direction(q)
    dn = mp.matrix([mp.diff(lambda a, i=i: direction(a)[i], q) for i in (0, 1)])
    return mp.lu_solve(mp.matrix([[n[0], n[1]], [dn[0], dn[1]]]), mp.matrix([h, dh]))


@pytest.mark.long
@pytest.mark.parametrize("name", CAMS)
def test_profile_and_curvature_are_those_of_the_envelope(name):
    cam, q = CAMS[name], np.array([0.1, 1.3, 2.9, 4.4])
    contact = cam.contact(q)
    points = contact.in_cam(contact.point)
    for i, angle in enumerate(q.tolist()):
        exact = profile(cam, mp.mpf(angle))
        assert max(abs(points[0, i] - exact[0]), abs(points[1, i] - exact[1])) < 1e-15
        rates = [mp.diff(lambda a, k=k: profile(cam, a)[k], angle) for k in (0, 1)]
        seconds = [mp.diff(lambda a, k=k: profile(cam, a)[k], angle, 2, h=mp.mpf("1e-8")) for k in (0, 1)]
        # clockwise around the cam, so positive where it bends to the right
        curvature = rates[1] * seconds[0] - rates[0] * seconds[1]
        radius = mp.hypot(*rates) ** 3 / curvature
        assert abs(contact.curvature_radius[i] / radius - 1) < 1e-12
    assert np.abs(contact.lift - [float(lift_of(cam, angle)) for angle in q]).max() < 1e-16


def test_pressure_angles_are_those_of_the_textbook():
    q = np.array(ANGLES)
    s, rate = 0.005 * (1 - np.cos(q)), 0.005 * np.sin(q)
    # Norton, eq. 7.1d, for a roller with offset
    roller = np.arctan((rate - 0.003) / (np.sqrt(0.031**2 - 0.003**2) + s))
    assert np.abs(CAMS["roller"].contact(q).pressure_angle - roller).max() < 1e-15
    assert not CAMS["flat"].contact(q).pressure_angle.any()
    # radius of curvature of a flat face, Norton, eq. 7.20c
    flat = 0.025 + s + 0.005 * np.cos(q)
    assert np.abs(CAMS["flat"].contact(q).curvature_radius - flat).max() < 1e-16
    # swinging: between the normal of the path of the roller in the cam and its velocity across the arm
    cam, swing = CAMS["swinging roller"], 0.1 * np.sin(q)
    angle = cam.start + 0.1 * (1 - np.cos(q))
    # the normal passes through the instantaneous centre of cam and follower (McCarthy & Soh, ch. 1)
    centre = np.array([0.07 - 0.07 / (1.0 + swing), 0.0 * q])
    roller = np.array([0.07 - 0.06 * np.cos(angle), 0.06 * np.sin(angle)])
    normal = (roller - centre) / np.hypot(*(roller - centre))
    across = np.array([np.sin(angle), np.cos(angle)])
    exact = np.arcsin(across[0] * normal[1] - across[1] * normal[0])
    assert np.abs(cam.contact(q).pressure_angle - exact).max() < 1e-14
