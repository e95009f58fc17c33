"""What a message repeats is whole words, and a name that is missing is told with what was probably meant."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mechsim.errors import InputError, cut
from mechsim.subjects.readers import load

CHAIN = 30


@given(st.lists(st.text("abcde", min_size=1, max_size=12), min_size=1, max_size=20), st.integers(40, 80))
def test_a_message_is_cut_between_words(words, longest):
    text = " ".join(words)
    short = cut(text, longest)
    assert len(short) <= longest
    kept = short.removesuffix(" ...").split(" ")
    assert kept == words[: len(kept)]
    assert (short == text) == (len(text) <= longest)


def test_one_long_word_is_cut_all_the_same():
    assert cut("x" * 100, 20) == "x" * 16 + " ..."


def test_a_value_that_a_rejection_repeats_ends_with_a_whole_word(file):
    words = "somewhere beyond the farthest corner of the machine where nothing is"
    path = file(f'name = "m"\n[joints.a]\nkind = "{words}"\na = {{link="ground"}}\nb = {{link="l"}}\n')
    with pytest.raises(InputError, match=r"is 'somewhere beyond the farthest corner of the machine \.\.\.; "):
        load(path)


@pytest.fixture
def robot(file):
    """Return a file of many joints and actuators, more than a message lists, and a keyframe."""
    inner = ""
    for i in reversed(range(CHAIN)):
        inner = f'<body name="link{i}"><joint name="joint{i}"/><geom size="0.1" pos="1 0 0"/>{inner}</body>'
    motors = "".join(f'<motor name="motor{i}" joint="joint{i}"/>' for i in range(CHAIN))
    key = f'<key name="home" qpos="{" ".join("0" * CHAIN)}"/>'
    return file(
        f"<mujoco><worldbody>{inner}</worldbody><actuator>{motors}</actuator><keyframe>{key}</keyframe></mujoco>"
    )


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        ("--drive jiont29=1rpm", "'joint29'"),
        ("--lock joint_28", "'joint28'"),
        ("--key hme", "'home'"),
        ("--track lnk27", "'link27'"),
        ("--ctrl moter26=1", "'motor26'"),
    ],
)
def test_a_name_that_is_missing_is_reported_with_what_was_intended(mechsim, robot, words, meant):
    command = "simulate" if "--ctrl" in words else "show"
    reported = mechsim(command, robot, *words.split())
    assert reported.code == 2
    assert f"(did you mean {meant}?); " in reported.err
    assert len(reported.err.splitlines()) == 1
