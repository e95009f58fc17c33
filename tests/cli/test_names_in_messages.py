"""Messages are cut between words, and an unknown name is reported with the closest known one."""

import pytest

CHAIN = 30


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
    command = {"--ctrl": "simulate", "--track": "solve"}.get(options.split()[0], "show")
    reported = mechsim(command, robot, *options.split())
    assert reported.code == 2
    assert f"(did you mean {suggestion}?); " in reported.err
    assert len(reported.err.splitlines()) == 1
