from mechsim.mechanism.finding import Finding


def test_a_finding_is_printed_in_one_line_with_position_and_remedy():
    result = Finding(
        kind="gap",
        object="c1",
        value=0.002,
        explains=0.0,
        message="c1 has a gap of 2 mm",
        remedy="move it",
        line=7,
    )
    assert result.one_line == "line 7: c1 has a gap of 2 mm; move it"
    bare = Finding(kind="open", object="tip", value=1, explains=0.0, message="tip can move")
    assert bare.one_line == "tip can move"
