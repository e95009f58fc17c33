"""Undetermined DOFs are reported by name before a run."""

import pytest
from model_files import model_text

from mechsim import catalog, simulate
from mechsim.errors import AssemblyError, MobilityError
from mechsim.simulation.mobility import residual_mobility
from mechsim.simulation.source import from_source

FIVE_BAR = model_text("undetermined_dofs_five_bar.xml")
SECOND = '<joint joint1="D" joint2="crank" polycoef="0 1 0 0 0"/></equality>'
TREE = """<mujoco model="tree"><worldbody><body name="a"><joint name="crank" axis="0 0 1"/><geom size=".01"/>
<site name="P" pos=".03 0 0"/><body name="b" pos=".03 0 0"><joint name="loose" axis="0 0 1"/>
<geom size=".01" pos=".02 0 0"/></body></body>EXTRA</worldbody></mujoco>"""
FINGER = model_text("undetermined_dofs_finger.xml")


def gripper():
    """Two fingers of five links each, their drivers coupled: three degrees of freedom and one driver."""
    fingers = "".join(
        FINGER.replace("NAME", n).replace("Y", y) for n, y in (("crank", ".1"), ("left", "-.1"))
    )
    closing = "".join(
        f'<connect body1="{n}_follower" body2="{n}_coupler" anchor="-.01 0 0"/>' for n in ("crank", "left")
    )
    coupled = '<joint joint1="left" joint2="crank" polycoef="0 1 0 0 0"/>'
    return (
        f'<mujoco model="gripper"><worldbody>{fingers}</worldbody>'
        f"<equality>{closing}{coupled}</equality></mujoco>"
    )


def tree(extra=""):
    return TREE.replace("EXTRA", extra)


@pytest.mark.parametrize(
    ("model", "named"),
    [
        (FIVE_BAR, ["joint 'A'", "joint 'D'", "joint 'C'", "point P"]),
        (gripper(), ["joint 'crank spring'", "joint 'left follower'", "point crank tip"]),
        (tree(), ["joint 'loose'"]),
    ],
    ids=["five-bar", "gripper", "tree"],
)
def test_undetermined_poses_are_rejected_with_their_joints(model, named):
    with pytest.raises(MobilityError, match=r"underdetermined.*--method step") as error:
        simulate(model, speed=1.0, turns=0.02, method="pose")
    assert error.value.outcome == "underdetermined"
    assert all(name in str(error.value) for name in named)
    assert simulate(model, speed=1.0, turns=0.002).method == "step"


def test_a_five_bar_with_both_cranks_driven_is_determined():
    model = FIVE_BAR.replace("</equality>", SECOND)
    assert simulate(model, speed=1.0, turns=0.02, method="pose").outcome == "passed"


@pytest.mark.parametrize("method", ["pose", "step"])
def test_more_drivers_than_dofs_are_rejected(method):
    locked = '<joint joint1="A" polycoef="0 0 0 0 0"/><joint joint1="C" polycoef="0 0 0 0 0"/></equality>'
    with pytest.raises(MobilityError, match=r"overdetermined.*crank angle 0 rad") as error:
        simulate(FIVE_BAR.replace("</equality>", locked), speed=1.0, turns=0.02, method=method)
    assert error.value.outcome == "overdetermined"


def test_unconnected_bodies_and_idle_spins_are_not_undetermined():
    free = '<body name="f" pos="1 1 1"><freejoint/><geom size=".01"/><site name="Q"/></body>'
    model = tree(free).replace('<joint name="loose" axis="0 0 1"/>', "")
    assert simulate(model, speed=1.0, turns=0.02, method="pose").outcome == "passed"
    for name in catalog.MECHANISMS:
        result = residual_mobility(from_source(catalog.make(name)))
        assert (result.undetermined, result.immobile_drivers, result.at_change_point) == ((), (), False), name


def test_a_joint_beyond_its_range_is_rejected_by_name():
    limited = FIVE_BAR.replace("</equality>", SECOND).replace(
        'name="C" axis="0 0 1"', 'name="C" axis="0 0 1" limited="true" range="-60 60"'
    )
    assert simulate(limited, speed=1.0, turns=0.002, method="pose").outcome == "passed"
    with pytest.raises(AssemblyError, match=r"joint 'C' would be at .* beyond its range of .* crank angle"):
        simulate(limited, speed=1.0, turns=0.3, method="pose")
