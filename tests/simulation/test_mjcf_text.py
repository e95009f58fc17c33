import mujoco
import pytest
from model_files import model_text

from mechsim.simulation.mjcf.edited_text import (
    EditedText,
    put_comment,
    put_key,
    set_compliance,
    set_options,
)
from mechsim.simulation.mjcf.included_files import moved_to, with_included

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
