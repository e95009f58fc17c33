"""Every model of the tests is written and read again: joints, couplings, masses and forces."""

import pytest
from model_files import FOLDER, copied

import mechsim as ms
from mechsim.io.toml_writer import to_toml

# their loads, cams or curves are functions, which compare as objects
BY_FUNCTION = """
backlash_knee cam_export_cam forces_at_rest_bell forces_of_a_file_press guides_model latch_clamp
live_loads_press stability_lift toml_curves_bead toml_curves_shuttle toml_curves_structure
tooth_forces_file undetermined_reactions_shaft
"""
# texts of tables, parts of models, and what cannot be written
OTHERS = """
coupling_functions_model joint_stops_chains load_text_varying
start_of_guess_piston stops_at_rest_arm toml_writer_press undetermined_reactions_door urdf_loops_dialects
window_regulator written_forces
"""
NAMES = [path.stem for path in sorted(FOLDER.glob("*.toml")) if "${" not in path.read_text("utf-8")]
DESCRIBED = ("joints", "couplings", "gears", "links", "points", "driver", "locked")


def assert_described(text, solver):
    """Check that a text describes the mechanism and the forces of a solver."""
    again = ms.load(copied(text), still=True)
    for name in DESCRIBED:
        assert getattr(again.mechanism, name) == getattr(solver.mechanism, name), name
    assert (again.forces, again.ranges) == (solver.forces, solver.ranges)


@pytest.mark.parametrize("name", [name for name in NAMES if name not in (BY_FUNCTION + OTHERS).split()])
def test_a_model_is_written_and_read_again(name):
    solver = ms.load(FOLDER / f"{name}.toml", still=True)
    assert_described(to_toml(solver), solver)


@pytest.mark.parametrize("name", BY_FUNCTION.split())
def test_a_model_with_functions_is_written_equally_again(name):
    text = to_toml(ms.load(FOLDER / f"{name}.toml", still=True))
    assert to_toml(ms.load(copied(text), still=True)) == text


def test_a_lost_force_is_noticed():
    solver = ms.load(FOLDER / "bristle_friction_block.toml", still=True)
    text = to_toml(solver)
    with pytest.raises(AssertionError):
        assert_described(text.replace("viscous = ", "viscous = 1"), solver)
