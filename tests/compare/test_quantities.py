"""The table of quantities: each row detects its own error and no other, on records of one method."""

from dataclasses import replace

import numpy as np
import pytest

import mechsim as ms
from mechsim.compare import quantities
from mechsim.compare.crosscheck import crosscheck_forces

ANGLES, SPEED = np.linspace(-5.9, -0.1, 31), 20.0
GRAVITY = ms.Forces(gravity=(0.3, -9.81, 0.5), friction=(ms.Friction("crank", 1e-3, 1e-2),))
MODEL = ms.dynamics.dynamic_model(ms.catalog.make("warp_knitter"), GRAVITY)
RECORD = ms.dynamics.prescribed(MODEL, ANGLES, SPEED).forces
# as for a driver with a motion law
EXACT = replace(RECORD, drives={"crank": RECORD.torque})


def failed_kinds(verdict):
    return {check.kind for check in verdict.checks if not check.passed}


def motion_of(name, speed=SPEED):
    motion = ms.catalog.make(name).solve(ANGLES, speed)
    return replace(motion, time=ANGLES / speed, closure=np.zeros(len(ANGLES)))


def changed(mapping, name, **fields):
    """Return a mapping of records with one changed record."""
    return {**mapping, name: replace(mapping[name], **fields)}


def test_motion_by_rounding_alone_does_not_define_the_stroke():
    motion = motion_of("four_bar")
    still = motion.points["A"].position[:1]
    for relative, alike in ((0.0, True), (1e-16, True), (1e-9, False)):
        path = still * (1.0 + relative * np.sin(ANGLES)[:, None])
        stroke = quantities.stroke_of(
            replace(motion, points={"A": replace(motion.points["A"], position=path)})
        )
        reach = max(np.abs(link.position).max() for link in motion.links.values())
        assert (stroke >= 0.5 * reach) == alike


def wrong_motion(kind):
    motion = motion_of("slider_crank")
    off = 1e-3 * np.ones(len(ANGLES))
    if kind in ("position", "velocity", "acceleration"):
        larger = 1.1 * getattr(motion.points["B"], kind)
        return replace(motion, points=changed(motion.points, "B", **{kind: larger}))
    if kind in ("angle", "displacement"):
        unit = {"angle": "rad", "displacement": "m"}[kind]
        name = next(item for item, joint in motion.joints.items() if joint.unit == unit and item != "crank")
        return replace(motion, joints=changed(motion.joints, name, value=motion.joints[name].value + off))
    if kind == "orientation":
        rotated = motion.links["rod"].rotation[:, :, [1, 2, 0]]
        return replace(motion, links=changed(motion.links, "rod", rotation=rotated))
    return replace(motion, closure=off)


@pytest.mark.parametrize("kind", [row.name for row in quantities.MOTION])
def test_every_wrong_quantity_of_a_motion_fails_only_its_check(kind):
    linkage = ms.catalog.make("slider_crank")
    assert ms.crosscheck(motion_of("slider_crank"), linkage, speed=SPEED).passed
    assert failed_kinds(ms.crosscheck(wrong_motion(kind), linkage, speed=SPEED)) == {kind}


def test_a_lagging_crank_fails_its_drive_check():
    motion = motion_of("slider_crank")
    late = replace(motion, time=motion.time * (1.0 + 1e-6))
    assert failed_kinds(ms.crosscheck(late, ms.catalog.make("slider_crank"), speed=SPEED)) == {"drive"}
    assert failed_kinds(ms.crosscheck(motion, ms.catalog.make("slider_crank"), speed=21.0)) == {
        "drive",
        "drive speed",
    }


def wrong_forces(kind):
    fields = {
        "drive torque": "torque",
        "kinetic energy": "kinetic",
        "potential energy": "potential",
        "power loads": "power_loads",
        "power lost": "power_lost",
        "accelerations under these forces": "residual",
    }
    if kind in fields:
        return replace(EXACT, **{fields[kind]: getattr(EXACT, fields[kind]) + 1e-2})
    if kind == "driver effort":
        return replace(EXACT, drives={name: effort + 1e-2 for name, effort in EXACT.drives.items()})
    if kind == "gear torque":
        return replace(EXACT, gears={name: torque + 1e-3 for name, torque in EXACT.gears.items()})
    if kind == "mesh force":
        ((name, mesh),) = EXACT.meshes.items()
        return replace(EXACT, meshes={name: replace(mesh, force=mesh.force + 1.0)})
    wrong = {kind: getattr(EXACT.reactions["A"], kind) + 1.0}
    return replace(EXACT, reactions=changed(EXACT.reactions, "A", **wrong))


def test_zero_potential_energy_is_scaled_by_forces():
    exact = replace(EXACT, potential=np.zeros(len(ANGLES)))
    force, scale = quantities.force_scales(exact)["force"], exact.characteristic_length
    rounded = replace(exact, potential=np.full(len(ANGLES), 1e-16 * force * scale))
    assert crosscheck_forces(rounded, exact, method="pose").passed
    wrong = replace(exact, potential=np.full(len(ANGLES), 1e-12 * force * scale))
    assert failed_kinds(crosscheck_forces(wrong, exact, method="pose")) == {"potential energy"}


@pytest.mark.parametrize("route", ["pose", "step"])
@pytest.mark.parametrize("kind", [row.name for row in quantities.FORCES])
def test_every_wrong_quantity_of_forces_fails_only_its_check(kind, route):
    assert crosscheck_forces(EXACT, EXACT, method=route).passed
    assert failed_kinds(crosscheck_forces(wrong_forces(kind), EXACT, method=route)) == {kind}


def test_a_check_has_a_title_of_variant_method_quantity_and_subject():
    numbers = {"unit": "m", "worst": 1.0, "instant": 0.0, "rms": 1.0, "tolerance": 2.0, "reason": ""}
    check = ms.Check(kind="position", subject="P3", **numbers)
    assert check.title == "position of P3"
    assert replace(check, method="step").title == "step: position of P3"
    assert replace(check, method="step", variant="guided").title == "guided, step: position of P3"
    assert ms.Check(kind="axes and gears", **numbers).title == "axes and gears"
    assert replace(check, kind="loop", subject="").title == "loop residual"
