import numpy as np

from mechsim import catalog
from mechsim.analytic.loops.start import with_closed_guess
from mechsim.model.joints import End, Gear, Joint
from mechsim.model.links import Link
from mechsim.model.mechanism import Mechanism
from mechsim.model.scene import Scene
from mechsim.simulation import loop_jacobian
from mechsim.simulation.poses.follow import follow
from mechsim.simulation.poses.trace import MAX_DISPLACEMENT, trace
from mechsim.simulation.source import from_source, initial_guess
from mechsim.studies.extremes.special_designs import special_designs


def test_no_stride_leads_a_joint_farther_than_a_correction_can_be_distinguished_from_a_leap():
    """A wheel geared up twenty times turns a four-bar: the crank's stride would be over a turn of it."""
    ground = {name: End("ground", (x, 0.0, 0.0)) for name, x in (("p", 0.0), ("q", 0.05), ("r", 0.13))}
    joints = (
        Joint("crank", "revolute", ground["p"], End("crank")),
        Joint("wheel", "revolute", ground["q"], End("wheel")),
        Joint("pin", "revolute", End("wheel", (0.02, 0.0, 0.0)), End("rod")),
        Joint("end", "revolute", End("rod", (0.08, 0.0, 0.0)), End("lever", (0.05, 0.0, 0.0))),
        Joint("lever", "revolute", ground["r"], End("lever")),
    )
    links = tuple(Link(name) for name in ("crank", "wheel", "rod", "lever"))
    points = {"P": ("rod", (0.04, 0.0, 0.0))}
    gears = (Gear("crank", "wheel", 20.0),)
    mechanism = Mechanism("geared", links, joints, "crank", points, gears, start=0.02)
    loops, rough = initial_guess(with_closed_guess(mechanism), Scene(level="pose"))
    start = loop_jacobian.close(loops, rough[None])[0]
    states = np.array([start, *trace(loops, start, float(start[loops.crank_address]) + 0.4).states])
    assert np.abs(np.diff(states, axis=0)).max() < 1.5 * MAX_DISPLACEMENT


def test_a_stride_of_rounding_s_length_is_gone_close_to_a_dead_centre_too():
    """A recorded crank angle 50 units of rounding next to a knot of the path once ended in a rejection."""
    drive = catalog.make("four_bar", **special_designs("four_bar").swinging)
    closed = from_source(drive)
    (_, high), place = drive.crank_range().arcs[0], closed.loops.crank_address
    there = follow(closed.loops, closed.qpos, np.array([high - 1e-5]))[0]
    for off in np.geomspace(1.01e-14, 1e-12, 40):
        ends = trace(closed.loops, there, float(there[place]) - off).states
        assert abs(ends[-1][place] - there[place]) > 0.9 * off
        assert np.abs(ends[-1] - there).max() < 1e-8
