"""A model compared with a function or a table: agreement, differences and rejected input."""

import numpy as np
import pytest

import mechsim as ms


def slider(angle):
    x, y = 0.05 * np.cos(angle), 0.05 * np.sin(angle)
    b = x + np.sqrt(0.2**2 - (0.01 - y) ** 2)
    return {"A": np.column_stack([x, y, 0 * x]), "B": np.column_stack([b, 0.01 + 0 * b]), "slide": b}


def test_a_correct_formula_of_points_and_a_joint_agrees():
    result = ms.validate("slider_crank", against=slider)
    assert result.passed, result.why
    assert {candidate.quantity.kind for candidate in result.candidates} == {"position", "joint"}
    assert not result.findings


def test_velocities_accelerations_and_forces_are_compared_by_name():
    model = ms.load("four_bar")
    dynamic_model = ms.dynamics.dynamic_model(model)

    def own(angle, speed):
        motion = model.solve(angle, speed)
        forces = ms.dynamics.prescribed(dynamic_model, angle, speed).forces
        return {
            "B.v": motion.points["B"].velocity,
            "B.a.xy": motion.points["B"].acceleration[:, :2],
            "B.vx": motion.points["B"].velocity[:, 0],
            "torque:crank": forces.torque,
            "force:A": forces.reactions["A"].force,
            "A.q": motion.joints["A"].value,
            "A.v": motion.joints["A"].rate,
        }

    result = ms.validate(model, against=own)
    assert result.passed, result
    assert [check.unit for check in result.checks] == ["m/s", "m/s2", "m/s", "N m", "N", "rad", "rad/s"]


@pytest.mark.long
def test_a_formula_of_several_drivers_gets_them_by_name():
    def tool(drivers):
        left_elbow = -0.03 + 0.06 * np.exp(1j * drivers["left"])
        right_elbow = 0.03 + 0.06 * np.exp(1j * drivers["right"])
        half = (right_elbow - left_elbow) / 2
        up = np.sqrt(0.08**2 / abs(half) ** 2 - 1)
        point = left_elbow + half * (1 + 1j * up)
        return {"P": np.column_stack([point.real, point.imag])}

    assert ms.validate("five_bar", against=tool).passed


def test_two_components_of_a_spatial_point_need_a_named_plane():
    linkage = ms.catalog.make("rssr")

    def own(angle):
        return {"P3.yz": linkage.solve(angle).points["P3"].position[:, 1:]}

    assert ms.validate(linkage, against=own).passed
    with pytest.raises(ms.InputError, match=r"name the plane, as in 'P3\.xy'"):
        ms.validate(linkage, against=lambda angle: {"P3": own(angle)["P3.yz"]})


@pytest.mark.long
def test_the_attributed_error_contributions_add_up():
    result = ms.validate("slider_crank", against=lambda angle: {"B": 1.001 * slider(angle)["B"]}).attribution
    contributions = [result[name] for name in ("formula", "compliance", "time step", "drive")]
    assert result["unit"] == "m"
    assert sum(contributions) == pytest.approx(result["whole"], rel=0.05)
    assert result["formula"] == pytest.approx(2.5e-4, rel=1e-3)
    assert max(map(abs, contributions[1:])) < 1e-8
