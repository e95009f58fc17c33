from dataclasses import replace

import mechanisms
import numpy as np
import pytest
from model_files import stated_mechanism

import mechsim as ms
from mechsim.mechanism.links import GROUND
from mechsim.mechanism.motion_plane import plane_normals


def test_a_mechanism_is_planar_if_no_joint_leaves_the_plane():
    planar = [ms.catalog.make(name).mechanism for name in ("four_bar", "slider_crank")]
    planar.append(stated_mechanism("driven_mechanisms_boom.toml"))  # a cylinder drives it
    assert all(plane_normals(item) for item in [*planar, mechanisms.geared_five_bar()])
    spatial = [ms.catalog.make("rssr").mechanism, mechanisms.bennett(), mechanisms.rsup()]
    assert not any(plane_normals(item) for item in spatial)


@pytest.mark.parametrize("tilt", [1e-3, 1e-8])
def test_a_four_bar_with_a_slightly_tilted_axis_is_not_planar(tilt):
    mechanism = ms.catalog.make("four_bar").mechanism
    tilted = [
        replace(joint, b=replace(joint.b, axis=(tilt, 0.0, 1.0))) if joint.name == "rocker" else joint
        for joint in mechanism.joints
    ]
    assert plane_normals(replace(mechanism, joints=tuple(tilted))) is None


def test_plane_normals_are_expressed_in_the_frame_of_each_link():
    normals = plane_normals(stated_mechanism("motion_plane_arm.toml"))
    assert normals is not None
    assert {link: tuple(np.round(normal, 12) + 0.0) for link, normal in normals.items()} == {
        "arm": (0.0, 0.0, 1.0),
        GROUND: (0.0, -1.0, 0.0),
        "slider": (0.0, 1.0, 0.0),
    }
