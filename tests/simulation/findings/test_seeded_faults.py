"""Seeded faults in a valid scene: each is found, and the valid scene has no findings."""

import pytest
from valid_scene import changed

from mechsim.simulation.findings import findings
from mechsim.simulation.mjcf_reader.reading import read_model


def seeded(tmp_path, *changes, **options):
    """Return the findings, by kind, of the valid scene with changes to its text."""
    path = tmp_path / "scene.xml"
    path.write_text(changed(*changes))
    result = {}
    for item in findings(read_model(str(path), **options)):
        result.setdefault(item.kind, item)
    return result


def test_a_valid_scene_has_no_findings(tmp_path):
    assert seeded(tmp_path) == {}


def test_a_range_of_two_turns_in_degrees_is_no_finding(tmp_path):
    degrees = ('angle="radian"', 'angle="degree"')
    assert (
        seeded(tmp_path, degrees, ('range="-3 3"', 'range="-720 720"'), ('range="-2 2"', 'range="-99 99"'))
        == {}
    )


AGAIN = '<connect name="again" body1="coupler" body2="rocker" anchor="0.1 0 0"/>'
FLAP = '<body name="flap"><joint name="flap"/><geom size="0.001" pos="0 0.3 0"/></body>'
SOFT = 'solref="0.002 1"\n             solimp="0.9999 0.9999 0.001 0.5 2"'
ROD, FAT_ROD = (f'fromto="0.008 0 0 0.09 0 0" size="{radius}"' for radius in (0.003, 0.02))
# fault -> change of the text; kind, element, and a fragment of the line to be reported
FAULTS = {
    "a loop of distant sites": (
        ('body1="coupler" body2="rocker" anchor="0.1 0 0"', 'site1="B1" site2="B2"'),
        ("gap", "loop", 'name="loop"'),
    ),
    "a loop closed twice": (
        ("  </equality>", f"    {AGAIN}\n  </equality>"),
        ("redundant", "again", 'name="again"'),
    ),
    "links that overlap at their joint": (
        (ROD, FAT_ROD),
        ("collision", "coupler, rocker", 'geom name="coupler"'),
    ),
    "a start outside the limits": (
        ('range="-2 2"', 'range="0.2 2"'),
        ("limit", "rocker", 'joint name="rocker"'),
    ),
    "MuJoCo's default compliance": ((SOFT, ""), ("soft", "loop", 'name="loop"')),
    "a time constant of half a step": (
        ('solref="0.002 1"', 'solref="0.0005 1"'),
        ("refsafe", "loop", 'name="loop"'),
    ),
    "a loop too stiff for the step": (
        ('solref="0.002 1"', 'solref="-4e6 -4000"'),
        ("timestep", "loop", 'name="loop"'),
    ),
    "an inertia of kg mm2": (
        ('diaginertia="5e-6 8e-5 8e-5"', 'diaginertia="5 80 80"'),
        ("inertia", "coupler", 'body name="coupler"'),
    ),
    "moments against the triangle inequality": (
        ('diaginertia="3e-6 3e-5 3e-5"', 'diaginertia="3e-6 3e-5 6e-5"'),
        ("inertia", "rocker", 'body name="rocker"'),
    ),
    "a link without mass": (('mass="0.06"', 'mass="0"'), ("inertia", "rocker", 'body name="rocker"')),
    "a mass in g": (('mass="0.06"', 'mass="60000"'), ("inertia", "rocker", 'body name="rocker"')),
    "a body in mm": (('pos="0.1 0 0.01"', 'pos="100 0 10"'), ("units", "lengths", None)),
    "a range in degrees": (
        ('range="-3 3"', 'range="-180 180"'),
        ("units", "crank", 'joint name="crank"'),
    ),
    "a second servo behind the loop": (
        ("  </actuator>", '    <position name="other" joint="rocker" kp="5"/>\n  </actuator>'),
        ("actuator", "other", 'name="other"'),
    ),
    "a servo with a target away from the start": (
        ('axis="0 0 1" range="-3 3"', 'axis="0 0 1" range="-3 3" ref="0.5"'),
        ("actuator", "servo", 'name="servo"'),
    ),
    "a link outside every loop": (
        ('    <body name="rocker"', f'    {FLAP}\n    <body name="rocker"'),
        ("open", "flap", None),
    ),
}


@pytest.mark.long
@pytest.mark.parametrize("fault", FAULTS)
def test_a_seeded_fault_is_reported_with_element_line_and_remedy(fault, tmp_path):
    change, (kind, what, element) = FAULTS[fault]
    result = seeded(tmp_path, change)
    assert kind in result, {kind: item.message for kind, item in result.items()}
    assert result[kind].object == what
    assert result[kind].remedy
    assert result[kind].value > 0 or fault == "a link without mass"
    lines = changed(change).splitlines()
    assert (result[kind].line is None) == (element is None)
    assert element is None or element in lines[result[kind].line - 1]
