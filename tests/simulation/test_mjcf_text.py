from pathlib import Path

import mujoco
import numpy as np
import pytest
from model_files import model_text

import mechsim as ms
from mechsim.simulation.mjcf.compiling import to_xml
from mechsim.simulation.mjcf.edited_text import (
    EditedText,
    put_comment,
    put_key,
    set_compliance,
    set_options,
)
from mechsim.simulation.mjcf.generator import generate
from mechsim.simulation.mjcf.included_files import moved_to, with_included
from mechsim.simulation.source import assembled

TEXT = model_text("mjcf_text_text.xml")


def test_settings_change_only_their_values():
    edited = EditedText(TEXT)
    set_options(edited, {"timestep": "0.001", "integrator": "RK4"}, {})
    set_compliance(edited, {"solref": "0.002 1", "solimp": "0.99 0.99"})
    before, after = TEXT.splitlines(), edited.result.splitlines()
    assert len(before) == len(after)
    assert [i for i, (a, b) in enumerate(zip(before, after, strict=True)) if a != b] == [3, 6]
    assert after[3] == """  <option timestep='0.001' gravity="0 0 -1" integrator="RK4"/>"""
    assert after[6].endswith("<!-- as measured -->")
    model = mujoco.MjModel.from_xml_string(edited.result)
    assert model.opt.timestep == 0.001
    assert model.eq_solref[0, 0] == 0.002
    assert model.eq_solimp[0, 0] == 0.99


@pytest.mark.parametrize(
    "head",
    ["<option/>", "<default/>", '<default><default class="x"><equality solref="1 1"/></default></default>'],
)
def test_many_equalities_get_their_compliance_from_the_main_default(head):
    body, rows = (
        '<worldbody><body><joint name="j"/><geom size="1"/></body></worldbody>',
        3 * '<joint joint1="j"/>',
    )
    edited = EditedText(f"<mujoco>{head}{body}<equality>{rows}</equality></mujoco>")
    set_compliance(edited, {"solref": "0.002 1"})
    assert edited.result.index("<default") < edited.result.index("<worldbody")
    assert mujoco.MjModel.from_xml_string(edited.result).eq_solref[:, 0].tolist() == [0.002] * 3


@pytest.mark.parametrize(
    "text",
    [
        "<mujoco><worldbody/></mujoco>",
        "<mujoco><option/><worldbody/></mujoco>",
        '<mujoco><option><flag gravity="disable"/></option><worldbody/></mujoco>',
        '<mujoco><option><flag island="enable"/></option><option timestep="1"/></mujoco>',
    ],
)
def test_options_and_flags_are_inserted_into_existing_elements(text):
    edited = EditedText(text)
    set_options(edited, {"timestep": "0.0005"}, {"island": False})
    model = mujoco.MjModel.from_xml_string(edited.result)
    assert model.opt.timestep == 0.0005
    assert model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_ISLAND)
    before = mujoco.MjModel.from_xml_string(text)
    gravity = int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
    assert model.opt.disableflags & gravity == before.opt.disableflags & gravity


def test_an_added_comment_and_keyframe_are_well_formed():
    edited = EditedText(TEXT)
    put_comment(edited, ["first -- line", "second"])
    put_key(edited, "start", {"qpos": "0.25"})
    model = mujoco.MjModel.from_xml_string(edited.result)
    assert model.key("start").qpos[0] == 0.25
    with_second_key = EditedText(edited.result)
    put_key(with_second_key, "later", {"qpos": "0.5"})
    assert mujoco.MjModel.from_xml_string(with_second_key.result).key("later").qpos[0] == 0.5


def test_only_included_files_that_change_are_inlined(tmp_path):
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "loops.xml").write_text('<mujoco><equality><joint joint1="j"/></equality></mujoco>')
    (tmp_path / "parts" / "look.xml").write_text("<mujoco><visual/></mujoco>")
    text = TEXT.replace(
        "<equality>", '<include file="parts/loops.xml"/><include file="parts/look.xml"/><equality>'
    )
    (tmp_path / "main.xml").write_text(text)
    merged, inlined = with_included(text, tmp_path, lambda root: any(root.every("equality")))
    assert inlined == ("parts/loops.xml",)
    assert "loops.xml" not in merged
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    (folder / "main.xml").write_text(moved_to(merged, tmp_path, folder))
    assert mujoco.MjModel.from_xml_path(str(folder / "main.xml")).neq == 2
    assert '"../parts/look.xml"' in (folder / "main.xml").read_text()


def test_asset_paths_are_adapted_to_another_folder(tmp_path):
    (tmp_path / "meshes").mkdir()
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    (tmp_path / "meshes" / "one.obj").write_text(corners)
    text = (
        '<mujoco><compiler meshdir="meshes"/><asset><mesh name="m" file="one.obj"/></asset>'
        '<worldbody><geom type="mesh" mesh="m"/></worldbody></mujoco>'
    )
    folder = tmp_path / "a" / "b"
    folder.mkdir(parents=True)
    (folder / "main.xml").write_text(moved_to(text, tmp_path, folder))
    assert mujoco.MjModel.from_xml_path(str(folder / "main.xml")).nmesh == 1


def test_an_element_is_removed_with_its_line():
    edited = EditedText(TEXT)
    edited.remove(next(edited.root.every("option")))
    assert len(edited.result.splitlines()) == len(TEXT.splitlines()) - 1
    assert "gravity" not in edited.result


def model_of(mechanism: ms.Mechanism, **scene: object) -> mujoco.MjModel:
    return assembled(mechanism, ms.Scene(**scene)).compile()


def test_drive_inertia_and_gravity_depend_on_the_scene_level() -> None:
    mechanism = ms.catalog.make("four_bar").mechanism
    pose, motion, dynamics = (model_of(mechanism, level=level) for level in ("pose", "motion", "dynamics"))
    assert pose.dof_armature[0] == 0.0 < motion.dof_armature[0]
    # the user of a picture scene turns the crank; under dynamics the crank is free
    assert generate(mechanism, ms.Scene(level="picture")).compile().dof_armature[0] == motion.dof_armature[0]
    assert dynamics.dof_armature[0] == 0.0
    assert not motion.opt.gravity.any()
    assert dynamics.opt.gravity.any()


def test_inertia_tensors_round_trip_exactly():
    text = """<mujoco><worldbody><body name="a"><joint name="j"/><inertial pos="0 0 0.1" mass="1"
    fullinertia="0.0123456789012 0.02 0.03 0.001 0.002 0.003"/></body></worldbody></mujoco>"""
    spec = mujoco.MjSpec.from_string(text)
    first, reread = spec.compile(), mujoco.MjModel.from_xml_string(to_xml(spec.copy()))
    for attribute in ("body_inertia", "body_iquat", "body_ipos", "body_mass"):
        assert np.array_equal(getattr(reread, attribute), getattr(first, attribute))


FIELDS = ("body_pos", "body_quat", "body_inertia", "jnt_pos", "jnt_axis", "qpos0", "site_pos", "eq_data")
MODELS = Path(__file__).parents[2] / "models"


@pytest.mark.parametrize("name", ms.catalog.MECHANISMS)
def test_the_model_file_equals_the_generated_model(name: str) -> None:
    written = mujoco.MjModel.from_xml_path(str(MODELS / f"{name}.xml"))
    made = assembled(ms.catalog.make(name).mechanism, ms.Scene()).compile()
    assert (made.names, made.opt.tolerance) == (written.names, written.opt.tolerance)
    for field in FIELDS:
        # assembly ends at rounding, which may differ by a few ulp from one processor to the next
        np.testing.assert_allclose(getattr(written, field), getattr(made, field), rtol=1e-12, atol=1e-15)


def stepped(**options: float) -> np.ndarray:
    """Return the state of the four-bar after 200 steps with options."""
    model = mujoco.MjModel.from_xml_path(str(MODELS / "four_bar.xml"))
    for name, value in options.items():
        setattr(model.opt, name, value)
    data = mujoco.MjData(model)
    data.joint("crank").qvel[0] = 20.0 * np.pi
    mujoco.mj_step(model, data, 200)
    return data.qpos


def test_the_solver_tolerance_of_a_model_keeps_full_accuracy() -> None:
    exact = stepped(tolerance=0.0)
    assert np.abs(stepped() - exact).max() < 1e-12
    assert np.abs(stepped(tolerance=1e-8) - exact).max() > 1e-8
