"""Mechanisms in TOML files: contents are read in their units, and invalid ones are rejected."""

import re

import numpy as np
import pytest
from model_files import model_text

from mechsim import catalog
from mechsim.errors import InputError
from mechsim.subjects.readers import load

FOUR_BAR = model_text("toml_reader_four_bar.toml")


def test_a_four_bar_file_agrees_with_the_closed_form(file):
    read = load(file(FOUR_BAR))
    exact = catalog.make("four_bar", ground=0.1, crank=0.04, coupler=0.12, rocker=0.09)
    angles = np.linspace(-3.0, 7.0, 41)
    result, expected = read.solve(angles, 3.0, -2.0), exact.solve(angles, 3.0, -2.0)
    for name in ("A", "B"):
        np.testing.assert_allclose(result.points[name].position, expected.points[name].position, atol=1e-14)
        np.testing.assert_allclose(
            result.points[name].acceleration, expected.points[name].acceleration, atol=1e-11
        )
    assert read.crank_range().full
    coupler = next(link for link in read.mechanism.links if link.name == "coupler")
    assert coupler.outline[1] == (0.06, 0.03, 0.0)
    assert coupler.inertia is not None
    assert (coupler.inertia.mass, coupler.inertia.centre) == (0.4, (0.06, 0.0, 0.0))
    assert np.diag(coupler.inertia.matrix).tolist() == [1e-6, 3e-6, 3e-6]


@pytest.mark.parametrize(
    ("text", "crank"), [("35mm", 0.035), ("0.035m", 0.035), ("35*1", 0.035), ("ground/4", 0.025)]
)
def test_a_changed_parameter_replaces_that_of_the_file(file, text, crank):
    read = load(file(FOUR_BAR), {"crank": text})
    np.testing.assert_allclose(read.positions([0.0])["A"], [[crank, 0.0, 0.0]], rtol=1e-14)


def test_a_changed_parameter_of_another_unit_is_rejected(file):
    with pytest.raises(InputError, match=r"crank is '30deg', but the file uses it as a length"):
        load(file(FOUR_BAR), {"crank": "30deg"})


CHANGES = {
    "an unknown key": ("kind =", "kimd =", ("line 14", "joints.crank.kimd", "did you mean 'kind'")),
    "an unknown table": ("[points]", "[pionts]", ("line 29", "pionts", "did you mean 'points'")),
    "an unknown force": ("[points]", "[forces]\ngrav = [0, 0, 0]\n[points]", ("line 30", "'gravity'")),
    "friction in no joint": (
        "[points]",
        "[forces.friction]\nhinge = { viscous = 1 }\n[points]",
        ("line 30", "'hinge'", "choose from crank"),
    ),
    "friction of another kind": (
        "[points]",
        '[forces.friction]\ncrank = { viscous = "1 N s/m" }\n[points]',
        ("line 30", "a torsional damping"),
    ),
    "a motor without its numbers": (
        "[points]",
        '[forces]\nmotor = { kind = "dc", voltage = 24 }\n[points]',
        ("line 30", "'resistance'"),
    ),
    "a load on no point": (
        "[points]",
        '[forces.loads.push]\nat = "Q"\nforce = [1, 0, 0]\n[points]',
        ("line 29", "no point 'Q'"),
    ),
    "no name": ('name = "bar"', "", ("has no 'name'",)),
    "another kind": ('"revolute"', '"hinge"', ("joints.crank.kind", "'hinge'", "revolute, prismatic")),
    "a screw without a lead": (
        '[joints.A]\nkind = "revolute"',
        '[joints.A]\nkind = "screw"',
        ("line 17", "lead", "displacement per revolution"),
    ),
    "an unknown parameter": ('"ground + crank/2"', '"grond"', ("line 8", "'grond'", "did you mean 'ground'")),
    "a parameter defined later": (
        "ground = 100",
        'ground = "rocker"',
        ("line 6", "no parameter defined before"),
    ),
    "division by zero": ('"ground + crank/2"', '"1/(crank - crank)"', ("line 8", "divides by zero")),
    "an imaginary number": ('"ground + crank/2"', '"sqrt(-1)"', ("line 8", "finite real number")),
    "code": ('"ground + crank/2"', '"().__class__"', ("line 8", "only arithmetic")),
    "a call": ('"ground + crank/2"', "\"__import__('os')\"", ("line 8", "no known function")),
    "nested powers": ('"ground + crank/2"', '"9**9**9"', ("line 8", "exponent", "64")),
    "a long expression": ('"ground + crank/2"', f'"{"1+" * 400}1"', ("line 8", "801 characters")),
    "a deep expression": ('"ground + crank/2"', f'"{"-" * 200}1"', ("line 8", "50 deep")),
    "a huge position in the guess": ('"crank*cos(10)"', "1e300", ("1e+300", "give at most 1e+30 in SI")),
    "pi in degrees": (
        '"crank*cos(10)"',
        '"crank*cos(pi/18)"',
        ("line 33", "guess.coupler.at[0]", "an argument with pi"),
    ),
    "a parameter in degrees used as a length": (
        '"4 cm"',
        '"4 deg"',
        ("line 7", "parameters.crank", "uses it as a length"),
    ),
    "an angle instead of a length": (
        '"30 mm"',
        '"30 deg"',
        ("line 11", "'30 deg'", "is the wrong kind of unit"),
    ),
    "a huge position of a joint": (
        '["ground", 0, 0] }\nb',
        '["ground", 1e200, 0] }\nb',
        ("line 27", "1e+200", "give at most 1e+30 in SI"),
    ),
    "an empty name": ('A = { link = "crank"', '"" = { link = "crank"', ("a point called ''",)),
    "a cross angle of a hinge": (
        '[joints.A]\nkind = "revolute"',
        '[joints.A]\nkind = "revolute"\ncross_angle = 80',
        ("line 17", "cross angle of revolute joint 'A'", "leave it out"),
    ),
    "two components": ('["ground", 0, 0] }\nb', '["ground", 0] }\nb', ("joints.rocker.a.at", "a list of 3")),
    "a truth value": ("start = 10", "start = true", ("line 4", "start is True")),
    "not finite": ("start = 10", "start = inf", ("line 4", "start is inf")),
    "a huge number": ("start = 10", f"start = 1{'0' * 400}", ("line 4", "start is 1")),
    "a link of one joint": (
        'b = { link = "rocker" }',
        'b = { link = "rokker" }',
        ("line 24", "did you mean 'rokker'"),
    ),
    "an empty list of drivers": ('["crank"]', "[]", ("no joint is driven", "--drive")),
    "a negative duration": ("start = 10", "start = 10\nduration = -1", ("line 5", "duration is -1 s")),
    "an unknown driver": ('["crank"]', '["handle"]', ("line 3", "'handle'", "choose from crank")),
    "one start for two drivers": (
        '["crank"]',
        '["crank", "rocker"]',
        ("line 4", "crank, rocker are driven", "table"),
    ),
    "a start of an unknown driver": (
        "start = 10",
        "start = { handle = 3 }",
        ("line 4", "'handle'", "choose from crank"),
    ),
    "a start with a unit of length": ("start = 10", 'start = { crank = "3 mm" }', ("line 4", "an angle")),
    "a motion law of an unknown joint": (
        "start = 10",
        'start = 10\nprograms = { handle = "600rpm" }',
        ("line 5", "'handle'", "choose from crank"),
    ),
    "a motion law of a passive joint": (
        "start = 10",
        'start = 10\nprograms = { crank = "600rpm", rocker = "600rpm" }',
        ("line 5", "rocker", "not driven", "drivers are crank"),
    ),
    "a motion law of a slide": (
        "start = 10",
        'start = 10\nprograms = { crank = "20mm/s*t" }',
        ("line 5", "'20mm/s*t'", "is a length; give an angle"),
    ),
    "a sum with a missing unit": (
        "start = 10",
        'start = 10\nprograms = { crank = "10deg*t + 3" }',
        ("line 5", "without a unit"),
    ),
    "an unknown locked joint": ("start = 10", "start = 10\nlocked = { handle = 3 }", ("line 5", "'handle'")),
    "a locked driver": ("start = 10", "start = 10\nlocked = { crank = 3 }", ("line 5", "crank")),
    "a coupling with ratio and radius": (
        "[points]",
        '[couplings.c]\ndriver = "crank"\ndriven = "rocker"\nratio = 1\nradius = 2\n[points]',
        ("line 29", "ratio and radius", "give one"),
    ),
    "a coupling without a law": (
        "[points]",
        '[couplings.c]\ndriver = "crank"\ndriven = "rocker"\n[points]',
        ("line 29", "none of ratio", "give one"),
    ),
    "a rack between two angles": (
        "[points]",
        '[couplings.c]\ndriver = "crank"\ndriven = "rocker"\nradius = 2\n[points]',
        ("line 29", "a rack between two coordinates of one unit"),
    ),
    "a coupling of an unknown coordinate": (
        "[points]",
        '[couplings.c]\ndriver = "crank"\ndriven = "roker"\nratio = 2\n[points]',
        ("line 31", "couplings.c.driven", "did you mean 'rocker'"),
    ),
    "a polynomial of degree five": (
        "[points]",
        '[couplings.c]\ndriver = "crank"\ndriven = "A"\ncoefficients = [0, 1, 2, 3, 4, 5]\n[points]',
        ("line 29", "6 coefficients", "1 to 5"),
    ),
    "a phase of a polynomial": (
        "[points]",
        '[couplings.c]\ndriver = "crank"\ndriven = "A"\ncoefficients = [0, 1]\nphase = 1\n[points]',
        ("line 33", "does not go with 'coefficients'"),
    ),
    "a point on no link": ('A = { link = "crank"', 'A = { link = "wheel"', ("'wheel'",)),
    "an unknown unit": ('"mm"', '"furlongz"', ("line 2", "furlongz")),
    "a unit of time": ('"mm"', '"s"', ("line 2", "is the wrong kind of unit")),
    "invalid TOML": ("start = 10", "start == 10", ("no TOML", "line 4")),
    "negative mass": ('"400 g"', '"-400 g"', ("line 10", "mass of a link")),
    "a zero axis": (
        'a = { link = "ground" }',
        'a = { link = "ground", axis = [0, 0, 0] }',
        ("line 13", "zero vector"),
    ),
    "a pressure angle without a pitch point": (
        "[points]",
        '[couplings.c]\ndriven = "A"\ndriver = "crank"\ncoefficients=[0, 1, 2]\npressure_angle=1\n[points]',
        ("couplings.c.pressure_angle", "no pitch point"),
    ),
    "a pressure angle of 90 deg": (
        "[points]",
        '[couplings.c]\ndriver = "crank"\ndriven = "A"\nratio = 2\npressure_angle = "90 deg"\n[points]',
        ("pressure angle of coupling 'crank-A'", "less than 90 deg"),
    ),
    "a table instead of a list": ('["crank"]', "{}", ("line 3", "drivers")),
    "deep nesting": ("start = 10", f"start = {'[' * 5000}{']' * 5000}", ("nests too deep",)),
}


@pytest.mark.parametrize("case", CHANGES)
def test_invalid_contents_are_rejected_in_one_line_with_their_position(file, case):
    old, new, words = CHANGES[case]
    assert old in FOUR_BAR
    path = file(FOUR_BAR.replace(old, new, 1))
    with pytest.raises(InputError) as error:
        load(path)
    output = str(error.value)
    assert "\n" not in output
    assert "model.toml" in output
    for word in words:
        assert re.search(re.escape(word), output), output


@pytest.mark.parametrize(
    ("model", "words"),
    [
        ("nowhere.toml", "there is no file nowhere.toml"),
        (".toml", "there is no file"),
        ("four_barr", "did you mean 'four_bar'"),
        ("scene.xml", "no file"),
        ("a.py", "FILE.py:OBJECT"),
        ("nowhere.py:thing", "there is no file nowhere.py"),
    ],
)
def test_an_unknown_model_is_rejected_by_name(model, words):
    with pytest.raises(InputError, match=re.escape(words)):
        load(model)


def test_a_file_called_like_a_catalogue_mechanism_does_not_shadow_it(tmp_path, monkeypatch):
    (tmp_path / "rssr").write_text(FOUR_BAR)
    monkeypatch.chdir(tmp_path)
    assert load("rssr") == catalog.make("rssr")


def test_an_unknown_parameter_is_rejected_with_the_closest_name(file):
    with pytest.raises(InputError, match="did you mean 'crank'"):
        load(file(FOUR_BAR), {"crnk": "3"})


def test_a_file_that_is_too_large_is_rejected(file):
    with pytest.raises(InputError, match="1000000 at most"):
        load(file(FOUR_BAR + "#" * 1_000_000))


def test_joints_of_an_open_chain_are_the_default_drivers(file):
    arm = model_text("toml_reader_arm.toml")
    assert load(file(arm)).mechanism.drivers == ("shoulder", "elbow")
    pendulum = arm[: arm.index("[joints.elbow]")].replace("[links.lower]", "")
    assert load(file(pendulum)).mechanism.driver == "shoulder"
    # coordinates of a loop, or coupled ones, are not independent
    loop = FOUR_BAR.replace('drivers = ["crank"]\n', "").replace("start = 10\n", "")
    coupled = arm + '[couplings.gear]\ndriver = "shoulder"\ndriven = "elbow"\nratio = 2\n'
    for text in (loop.replace("[joints.crank]", "[joints.handle]"), coupled):
        with pytest.raises(InputError, match="no joint is driven"):
            load(file(text))
