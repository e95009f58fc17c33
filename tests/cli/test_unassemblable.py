"""Every command rejects a mechanism whose loops close at no crank angle in one line."""

import pytest

MEASURED = "angle,C.x,C.y\n0,0.1,0.1\n1,0.1,0.12\n"


@pytest.mark.parametrize(
    "arguments",
    [
        ("show",),
        ("solve", "--angles", "0"),
        ("simulate", "--method", "pose"),
        ("dynamics inverse",),
        ("validate",),
        ("validate", "--against", "measured.csv"),
        ("sensitivity", "--of", "C", "--to", "rocker"),
        ("sweep", "--vary", "rocker=70mm:78mm:3", "--measure", "range:rocker", "-o", "out.csv"),
        ("trace",),
        ("fit", "--to", "measured.csv", "--vary", "coupler", "-o", "out.json"),
        ("tradeoff",),
        ("plot", "-o", "out.svg"),
        ("render", "-o", "out.png"),
        ("view", "-o", "out.html"),
        ("export", "-o", "out.xml"),
    ],
    ids=" ".join,
)
def test_an_unassemblable_mechanism_is_rejected_with_the_remedy(arguments, mechsim, tmp_path):
    (tmp_path / "measured.csv").write_text(MEASURED)
    answer = mechsim(*arguments[0].split(), "four_bar", *arguments[1:], "--set", "crank=1")
    assert (answer.code, answer.out) == (2, "")
    assert answer.err.count("\n") == 1
    assert "close" in answer.err
    assert "change the dimensions" in answer.err
    assert [item.name for item in tmp_path.iterdir()] == ["measured.csv"]
