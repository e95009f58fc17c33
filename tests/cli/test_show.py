"""Output of `mechsim show` for user-defined mechanisms."""

import pytest
from model_files import model_text

# a parallelogram that is collinear at the start, with couplings that constrain it
CAMS = model_text("show_cams.toml")


def test_rounding_is_printed_as_zero_and_negative_terms_with_minus(mechsim, tmp_path):
    (tmp_path / "cams.toml").write_text(CAMS)
    output = mechsim("show", "cams.toml")
    assert output.code == 0, output.err
    assert "0.3 crank - 0.02 crank^2" in output.out
    assert "cam - O4" in output.out
    row = next(line for line in output.out.splitlines() if " B " in line and "0.151" in line)
    assert row.split()[-3:] == ["0.151", "0", "0"]


@pytest.mark.long
def test_a_start_at_a_change_point_has_no_range(mechsim, tmp_path):
    """A four-bar that starts collinear: it leaves its start in two assembly modes."""
    collinear = model_text("show_collinear.toml")
    (tmp_path / "collinear.toml").write_text(collinear)
    code, out, _ = mechsim("show", "collinear.toml")
    assert code == 0
    assert "crank range" not in out
    assert "dead centre or a change point" in " ".join(out.split())
    for command in (("view", "-o", "view.html"), ("dynamics statics", "--gravity", "0,0,0")):
        code, _, error = mechsim(*command[0].split(), "collinear.toml", *command[1:])
        assert code == 2
        assert "change point" in error
        assert not (tmp_path / "view.html").exists()


def test_a_mechanism_is_described_by_the_comment_of_its_own_file(mechsim, tmp_path):
    """It has the name of one of the gallery, whose description is another."""
    (tmp_path / "klann.toml").write_text("# A lid; it opens. Twice.\n" + model_text("show_cams.toml"))
    own, gallery = mechsim("show", "klann.toml").out, mechsim("show", "klann").out
    assert own.splitlines()[1] == "A lid."
    assert gallery.splitlines()[1] == "Klann's leg: one crank moves a foot with a flat step."
