"""Messages are cut between words, and an unknown name is reported with the closest known one."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mechsim.errors import InputError, cut
from mechsim.subjects.readers import load

CHAIN = 30


@given(st.lists(st.text("abcde", min_size=1, max_size=12), min_size=1, max_size=20), st.integers(40, 80))
def test_a_message_is_truncated_between_words(words, longest):
    text = " ".join(words)
    short = cut(text, longest)
    assert len(short) <= longest
    kept_words = short.removesuffix(" ...").split(" ")
    assert kept_words == words[: len(kept_words)]
    assert (short == text) == (len(text) <= longest)


def test_a_single_long_word_is_truncated():
    assert cut("x" * 100, 20) == "x" * 16 + " ..."


def test_a_quoted_value_is_truncated_between_words(file):
    words = "somewhere beyond the farthest corner of the machine where nothing is"
    path = file(f'name = "m"\n[joints.a]\nkind = "{words}"\na = {{link="ground"}}\nb = {{link="l"}}\n')
    with pytest.raises(InputError, match=r"is 'somewhere beyond the farthest corner of the machine \.\.\.; "):
        load(path)


@pytest.fixture
def robot(file):
    """Return a file with a keyframe and more joints and actuators than a message lists."""
    inner = ""
    for i in reversed(range(CHAIN)):
        inner = f'<body name="link{i}"><joint name="joint{i}"/><geom size="0.1" pos="1 0 0"/>{inner}</body>'
    motors = "".join(f'<motor name="motor{i}" joint="joint{i}"/>' for i in range(CHAIN))
    key = f'<key name="home" qpos="{" ".join("0" * CHAIN)}"/>'
    return file(
        f"<mujoco><worldbody>{inner}</worldbody><actuator>{motors}</actuator><keyframe>{key}</keyframe></mujoco>"
    )


@pytest.mark.parametrize(
    ("options", "suggestion"),
    [
        ("--drive jiont29=1rpm", "'joint29'"),
        ("--lock joint_28", "'joint28'"),
        ("--key hme", "'home'"),
        ("--track lnk27", "'link27'"),
        ("--ctrl moter26=1", "'motor26'"),
    ],
)
def test_an_unknown_name_is_rejected_with_a_suggestion(mechsim, robot, options, suggestion):
    command = "simulate" if "--ctrl" in options else "show"
    reported = mechsim(command, robot, *options.split())
    assert reported.code == 2
    assert f"(did you mean {suggestion}?); " in reported.err
    assert len(reported.err.splitlines()) == 1
