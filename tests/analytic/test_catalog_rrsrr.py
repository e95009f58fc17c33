import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from mpmath import mp
from strategies import angles_of, longest, rrsrrs

from mechsim import catalog
from mechsim.analytic.solvers import KinematicSolver
from mechsim.errors import AssemblyError

SWINGING = catalog.make("rrsrr", pivot=(-0.024, -0.008, 0.040))


def exact(linkage: KinematicSolver, f: float) -> np.ndarray:
    """Return S, u2, v2 by the half-angle roots of A cos v + B sin v = K and two derivatives, (3, 5)."""
    with mp.workdps(50):
        r1, r, link = (mp.mpf(x) for x in (linkage.crank, linkage.coupler, linkage.link))
        px, py, pz = (mp.mpf(x) for x in linkage.pivot)
        g1, g2 = mp.mpf(linkage.gamma1), mp.mpf(linkage.gamma2)
        x0 = [mp.cos(g1), mp.mpf(0), -mp.sin(g1)]
        y0 = [mp.sin(g1) * mp.sin(g2), mp.cos(g2), mp.cos(g1) * mp.sin(g2)]
        z0 = [mp.sin(g1) * mp.cos(g2), -mp.sin(g2), mp.cos(g1) * mp.cos(g2)]

        def everything(angle):
            c, s = mp.cos(angle), mp.sin(angle)
            a = 2 * r * (r1 - py * c - pz * s)
            b = -2 * r * px
            k = link**2 - r**2 - px**2 - (r1 * c - py) ** 2 - (r1 * s - pz) ** 2
            root = mp.sqrt(a * a + b * b - k * k)
            v = next(
                v
                for v in (2 * mp.atan2(b + sign * root, a + k) for sign in (1, -1))
                if linkage.branch * (a * mp.sin(v) - b * mp.cos(v)) > 0
            )
            reach = r1 + r * mp.cos(v)
            position = [r * mp.sin(v), reach * c, reach * s]
            arm = [p - q for p, q in zip(position, (px, py, pz), strict=True)]
            rotated = [mp.fdot(arm, axis) for axis in (x0, y0, z0)]
            return [*position, mp.atan2(rotated[1], rotated[0]), mp.asin(rotated[2] / link)]

        columns = [mp.taylor(lambda angle, i=i: everything(angle)[i], mp.mpf(float(f)), 2) for i in range(5)]
        taylor = np.array([[float(value) for value in column] for column in columns]).T
        return taylor * np.array([[1.0], [1.0], [2.0]])


@given(rrsrrs())
def test_branch_selects_one_of_two_assembly_modes(linkage):
    angles = angles_of(linkage)
    assert (linkage.assembly_sign(linkage.positions(angles)) > 0.0).all()
    other = linkage.with_parameters(branch=-linkage.branch)
    assert (linkage.assembly_sign(other.positions(angles)) < 0.0).all()
    assert [twin.branch for twin in linkage.assemblies(angles[0])] == [1, -1]


@pytest.mark.long
@settings(max_examples=8)
@given(rrsrrs(), st.floats(1.0, 300.0), st.floats(-500.0, 500.0))
def test_the_path_and_the_rocker_motion_agree_with_fifty_digits(linkage, speed, acceleration):
    angles = angles_of(linkage, count=3, lowest_transmission=0.1)
    motion = linkage.solve(angles, speed, acceleration)
    second_hinge = motion.joints["link"].value
    assume(np.cos(second_hinge).min() > 0.1)
    for i, f in enumerate(angles):
        position, first, second = exact(linkage, f)
        first, second = speed * first, acceleration * first + speed**2 * second
        s, hinges = motion.points["S"], (motion.joints["rocker"], motion.joints["link"])
        measured = np.array(
            [
                [*s.position[i], *(joint.value[i] for joint in hinges)],
                [*s.velocity[i], *(joint.rate[i] for joint in hinges)],
                [*s.acceleration[i], *(joint.acceleration[i] for joint in hinges)],
            ]
        )
        unit = np.array([longest(linkage)] * 3 + [1.0] * 2)
        assert (np.abs(measured[0] - position) <= 1e-12 * unit).all()
        for row, expected, power in ((1, first, speed), (2, second, speed**2)):
            scale = np.maximum(np.abs(expected).max(), power * unit)
            assert (np.abs(measured[row] - expected) <= 1e-10 * scale).all()


def test_the_rocker_swings_through_the_published_angles():
    motion = catalog.make("rrsrr").solve(np.linspace(0.0, 2 * np.pi, 3601))
    assert catalog.make("rrsrr").crank_range().full
    assert abs(np.rad2deg(np.ptp(motion.joints["rocker"].value)) - 42.2) <= 0.05
    second = np.rad2deg(motion.joints["link"].value)
    assert abs(second.min() + 10.4) <= 0.05
    assert abs(second.max() - 30.3) <= 0.05


@settings(max_examples=30)
@given(rrsrrs())
def test_both_assembly_modes_coincide_at_dead_centres(linkage):
    for end in linkage.dead_centres():
        before, after = linkage.closed_form.discriminant(np.array([end - 1e-6, end + 1e-6]))
        assert before * after < 0.0
    for low, high in linkage.crank_range().arcs if not linkage.crank_range().full else ():
        close = np.array([low + 1e-8 * (high - low), high - 1e-8 * (high - low)])
        first, second = (linkage.with_parameters(branch=branch).positions(close)["S"] for branch in (1, -1))
        assert np.abs(first - second).max() <= 0.02 * longest(linkage)


def test_the_transmission_angle_follows_from_the_transmitted_force():
    linkage = SWINGING
    low, high = linkage.crank_range().arcs[0]
    angles = low + (high - low) * (np.arange(9) + 0.37) / 9
    motion = linkage.solve(angles)
    for i, angle in enumerate(linkage.transmission_angle(angles)):
        coupler, link = (motion.links[name] for name in ("coupler", "link"))
        rod, arm = coupler.rotation[i][:, 0], link.rotation[i][:, 0]
        # no moment about either hinge: force . (hinge x arm) = 0 twice
        swings = np.stack([np.cross(coupler.rotation[i][:, 2], rod), np.cross(link.rotation[i][:, 2], arm)])
        force = np.linalg.svd(swings)[2][2]
        pushed = np.cross(linkage.closed_form.rocker_frame[:, 2], arm)
        assert abs(np.sin(angle) - abs(force @ pushed) / np.linalg.norm(pushed)) <= 1e-12
    assert linkage.transmission_angle([low + 1e-9, high - 1e-9]).max() <= 1e-3


def test_a_swinging_crank_starts_inside_its_range():
    arcs = SWINGING.crank_range()
    assert not arcs.full
    assert any(low < SWINGING.mechanism.start < high for low, high in arcs.arcs)
    outside = arcs.arcs[0][1] + 1e-3
    with pytest.raises(AssemblyError, match="does not close at crank angle"):
        SWINGING.positions([outside])
    assert SWINGING.assemblies(outside) == []


def test_a_rocker_axis_through_the_spherical_joint_is_rejected():
    default, f = catalog.make("rrsrr"), 0.7
    x, y, z = (default.positions([f])["S"][0] - default.pivot) / default.link
    # the axis TY(gamma1) TX(gamma2) eZ along P02S
    linkage = default.with_parameters(gamma1=np.arctan2(x, z), gamma2=np.arcsin(-y))
    assert np.isfinite(linkage.positions([f])["S"]).all()
    for solve in (linkage.solve, linkage.transmission_angle):
        with pytest.raises(AssemblyError, match="S lies on the rocker axis"):
            solve([0.1, f, 1.0])
    assert abs(linkage.solve([f + 1e-3]).joints["link"].value[0]) < np.pi / 2
