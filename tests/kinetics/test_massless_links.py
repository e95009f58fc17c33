"""Links without mass or moments of inertia: torques and runs by the energy of the others."""

from dataclasses import replace

import numpy as np
import pytest

import mechsim as ms
from mechsim.simulation.dynamics.prescribed_motion import driven
from mechsim.simulation.mjcf.link_inertias import with_accepted_inertia
from mechsim.studies.dynamics_check import crosscheck_driven

GROUND, CRANK, COUPLER, ROCKER = 0.3, 0.1, 0.3, 0.2
WEIGHT = ms.Forces(gravity=(0.0, -9.81, 0.0))
NOTHING = ms.Inertia(0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
# the crank is a point mass, the coupler has no mass and the rocker only moments
MASS, ARM, MOMENT = 1.2, 0.05, 0.01
CRANK_MASS = ms.Inertia(MASS, (ARM, 0.0, 0.0), (0.0, 0.0, 0.0))
ROCKER_MASS = ms.Inertia(0.0, (0.0, 0.0, 0.0), (0.005, 0.005, MOMENT))


def four_bar(crank, coupler, rocker):
    solver = ms.catalog.make("four_bar", ground=GROUND, crank=CRANK, coupler=COUPLER, rocker=ROCKER)
    links = [
        replace(link, inertia=own)
        for link, own in zip(solver.mechanism.links, (crank, coupler, rocker), strict=True)
    ]
    return replace(solver.mechanism, links=tuple(links))


def rocker_rate(angle):
    """Return the rate of the rocker per rate of the crank, from the closed form of its angle."""

    def rocker(q):
        end = CRANK * np.exp(1j * q) - GROUND
        diagonal = np.sqrt((end * np.conj(end)).real)
        return np.angle(end) - np.arccos((diagonal**2 + ROCKER**2 - COUPLER**2) / (2 * diagonal * ROCKER))

    return (rocker(angle + 1e-5) - rocker(angle - 1e-5)) / 2e-5


def energy(angle, speed):
    """Return kinetic and potential energy of the crank and the rocker in J."""
    kinetic = 0.5 * (MASS * ARM**2 + MOMENT * rocker_rate(angle) ** 2) * speed**2
    return kinetic + MASS * 9.81 * ARM * np.sin(angle)


def test_the_torque_of_a_massless_coupler_is_that_of_the_other_links():
    mechanism = four_bar(CRANK_MASS, NOTHING, ROCKER_MASS)
    model = ms.dynamics.dynamic_model(mechanism, WEIGHT)
    angles = np.linspace(0.2, 6.1, 11)
    study = ms.dynamics.prescribed(model, angles, 12.0)
    expected = (energy(angles + 1e-3, 12.0) - energy(angles - 1e-3, 12.0)) / 2e-3
    assert study.forces.torque == pytest.approx(expected, rel=0, abs=1e-4 * np.abs(expected).max())
    # a massless link with two pins transmits equal forces along the line between them
    first, last = (study.forces.reactions[name].force for name in ("A", "B"))
    assert first == pytest.approx(last, abs=1e-12)
    assert [item.source for item in model.masses] == ["given", "zero", "zero"]
    for method in ("pose", "step"):
        run = driven(model.mechanism, model.forces, speed=12.0, samples=24, method=method)
        assert crosscheck_driven(run, model).passed


def test_a_run_with_a_massless_coupler_keeps_the_energy_of_the_others():
    mechanism = four_bar(CRANK_MASS, NOTHING, ROCKER_MASS)
    crank = mechanism.crank.name
    run = ms.dynamics.run(mechanism, WEIGHT, initial={f"{crank}.q": 0.7, f"{crank}.v": 8.0}, duration=0.4)
    joint = run.motion.joints[crank]
    total = energy(joint.value, joint.rate)
    assert total == pytest.approx(energy(0.7, 8.0), rel=1e-7)
    assert np.ptp(joint.value) > 1.0


def test_a_rod_without_a_moment_about_its_line_has_no_momentum_about_it():
    solver = ms.catalog.make("rssr")
    rod = next(i for i, link in enumerate(solver.mechanism.links) if "coupler" in link.name)

    def torque(along):
        points = [np.array(end.point) for end in solver.mechanism.ends(solver.mechanism.links[rod].name)]
        line = (points[1] - points[0]) / np.linalg.norm(points[1] - points[0])
        moments = 0.01 * np.eye(3) + (along - 0.01) * np.outer(line, line)
        own = ms.Inertia(0.5, tuple((points[0] + points[1]) / 2), tuple(map(tuple, moments)))
        links = list(solver.mechanism.links)
        links[rod] = replace(links[rod], inertia=own)
        mechanism = replace(solver.mechanism, links=tuple(links))
        model = ms.dynamics.dynamic_model(solver, WEIGHT, mechanism=mechanism)
        return ms.dynamics.prescribed(model, np.linspace(0.1, 6.0, 7), 5.0).forces.torque

    # the moment about the line has no effect, as the rod does not turn about it
    assert torque(0.0) == pytest.approx(torque(1e-3), rel=1e-9)


def test_mujoco_has_negligible_masses_in_place_of_zeros():
    links = with_accepted_inertia(four_bar(CRANK_MASS, NOTHING, ROCKER_MASS)).links
    for link in links:
        assert link.inertia.mass > 0.0
        assert np.linalg.eigvalsh(link.inertia.matrix)[0] > 0.0
    assert links[0].inertia.mass == MASS
    assert links[1].inertia.mass < 1e-5 * MASS
    assert links[2].inertia.moments[2][2] == MOMENT
