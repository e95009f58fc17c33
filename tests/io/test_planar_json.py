"""Planar linkages in JSON of other programs agree with the catalogue, and invalid files are rejected."""

import copy
import json
from contextlib import suppress

import numpy as np
import pytest
from model_files import model_text

import mechsim as ms
from mechsim.io.model_source import Prescription
from mechsim.io.readers import open_model

GROUND, CRANK, COUPLER, ROCKER = 0.1, 0.04, 0.11, 0.08
ANGLES = np.linspace(0.0, 2.0 * np.pi, 13)
FOUR_BAR = ms.catalog.make("four_bar", ground=GROUND, crank=CRANK, coupler=COUPLER, rocker=ROCKER)
EXPECTED = FOUR_BAR.solve(ANGLES, speed=1.0)
# dimensions of the slider-crank; the slider starts on the line through it
ROD, OFFSET = 0.2, 0.01
SLIDER = CRANK + float(np.sqrt(ROD**2 - OFFSET**2))
SLIDER_CRANK = ms.catalog.make("slider_crank", crank=CRANK, rod=ROD, offset=OFFSET)
PYLINKAGE, PYLINKAGE_SLIDER, PMKS, PMKS_SLIDER, LINKAGE_SIM, LINKAGE_SIM_SLIDER = (
    json.loads(model_text(f"planar_{name}.json"))
    for name in ("pylinkage", "pylinkage_slider", "pmks", "pmks_slider", "linkage_sim", "linkage_sim_slider")
)


@pytest.fixture
def written(tmp_path):
    def write(content, name="linkage.json"):
        path = tmp_path / name
        path.write_text(content if isinstance(content, str) else json.dumps(content))
        return str(path)

    return write


# the slider as a block between two joints
PMKS_BLOCK = copy.deepcopy(PMKS_SLIDER)
PMKS_BLOCK["Joints"][2] |= {"Links": ["block", "rod"], "TypeOfJoint": "R"}
PMKS_BLOCK["Joints"].append(
    {"X": SLIDER, "Y": OFFSET, "Angle": np.pi, "TypeOfJoint": "P", "Links": ["ground", "block"]}
)
# file, ending, its mechanism of the catalogue, and the points at B and halfway from A to B
FILES = {
    "pylinkage": (PYLINKAGE, "json", FOUR_BAR, "B", "half"),
    "PMKS": (PMKS, "pmks", FOUR_BAR, "P3", "P5"),
    "linkage_sim": (LINKAGE_SIM, "json", FOUR_BAR, "coupler.B", "half"),
    "slider of pylinkage": (PYLINKAGE_SLIDER, "json", SLIDER_CRANK, "B", None),
    "slider of PMKS": (PMKS_SLIDER, "pmks", SLIDER_CRANK, "P3", None),
    "block of PMKS": (PMKS_BLOCK, "pmks", SLIDER_CRANK, "P3", None),
    "slider of linkage_sim": (LINKAGE_SIM_SLIDER, "json", SLIDER_CRANK, "pin", None),
}


@pytest.mark.parametrize("case", FILES)
def test_a_file_has_the_motion_of_the_catalogue(written, case):
    content, ending, linkage, pin, middle = FILES[case]
    motion = ms.load(written(content, f"a.{ending}")).solve(ANGLES, speed=1.0)
    exact = linkage.solve(ANGLES, speed=1.0).points
    for quantity in ("position", "velocity", "acceleration"):
        own, right = getattr(motion.points[pin], quantity), getattr(exact["B"], quantity)
        np.testing.assert_allclose(own, right, rtol=0, atol=1e-13)
    if middle:
        half = 0.5 * (exact["A"].position + exact["B"].position)
        np.testing.assert_allclose(motion.points[middle].position, half, rtol=0, atol=1e-13)


def with_masses(keys, block):
    """Return the slider-crank file with masses and moments under the keys of the Python or GUI version."""
    moment, centre = keys
    content = copy.deepcopy(LINKAGE_SIM_SLIDER)
    content["bodies"]["crank"] |= {"mass": 0.5, moment: 0.01, centre: [CRANK / 2, 0]}
    content["bodies"]["rod"] |= {"mass": 1.0, moment: 0.08, centre: [ROD / 2, 0]}
    content["bodies"]["slider"] |= block
    for body in ("ground", "slider"):
        content["bodies"][body]["attachment_points"] |= {
            name: [x, 0] for name, (x, _) in content["bodies"][body]["attachment_points"].items()
        }
    return content


@pytest.mark.parametrize("keys", [("Izz_cg", "cg_local"), ("izz_cg", "ch_local")])
@pytest.mark.parametrize(
    ("block", "mass"),
    [
        ({"mass": 2.0}, 2.0),
        ({"mass": 2.0, "Izz_cg": 0.0}, 2.0),
        ({"mass": 0.0, "point_masses": [{"mass": 1.5, "local_pos": [0.3, 0.1]}]}, 1.5),
        ({"mass": 0.0, "izz_cg": 0.0}, 0.0),
    ],
)
def test_masses_of_both_versions_of_linkage_sim_are_read(written, keys, block, mass):
    links = ms.load(written(with_masses(keys, block))).mechanism.links
    crank, rod, slider = (link.inertia for link in links)
    assert (crank.mass, crank.centre, crank.moments[2][2]) == (0.5, (CRANK / 2, 0.0, 0.0), 0.01)
    assert (rod.mass, rod.centre, rod.moments[2][2]) == (1.0, (ROD / 2, 0.0, 0.0), 0.08)
    # a point has no moment about itself
    assert slider.mass == mass
    assert slider.moments[2][2] == pytest.approx(0.0, abs=1e-30)


def test_point_masses_of_linkage_sim_move_the_centre(written):
    added = [{"mass": 1.0, "local_pos": [0.3, 0]}, {"mass": 2.0, "local_pos": [0, 0.3]}]
    content = changed(LINKAGE_SIM, "bodies", "crank", to={**LINKAGE_SIM["bodies"]["crank"]})
    content["bodies"]["crank"] |= {"mass": 3.0, "cg_local": [0, 0], "Izz_cg": 0.1, "point_masses": added}
    inertia = ms.load(written(content)).mechanism.links[0].inertia
    assert inertia.mass == pytest.approx(6.0)
    assert inertia.centre == pytest.approx((0.05, 0.1, 0.0))
    # 0.1 + sum of m r2 about the frame, less the whole mass about it
    assert inertia.moments[2][2] == pytest.approx(0.1 + 3 * 0.09 - 6 * (0.05**2 + 0.1**2))


def changed(content, *path, to):
    result = copy.deepcopy(content)
    position = result
    for key in path[:-1]:
        position = position[key]
    position[path[-1]] = to
    return result


def entry_paths(content, path=()):
    """Yield the paths of all entries of nested lists and objects."""
    entries = dict(enumerate(content)) if isinstance(content, list) else content
    for key, value in entries.items() if isinstance(entries, dict) else ():
        yield (*path, key)
        yield from entry_paths(value, (*path, key))


@pytest.mark.long
@pytest.mark.parametrize(
    "content", [PYLINKAGE, PYLINKAGE_SLIDER, PMKS_SLIDER, LINKAGE_SIM, LINKAGE_SIM_SLIDER]
)
def test_entries_of_a_wrong_type_are_accepted_or_rejected(written, content):
    for position in entry_paths(content):
        for value in (None, [], {}, [[1]], "x", -1, 1e400, True):
            with suppress(ms.MechsimError):
                open_model(written(changed(content, *position, to=value))).describe({}, Prescription())


def test_a_driver_of_linkage_sim_is_found_between_its_bodies(written):
    content = copy.deepcopy(LINKAGE_SIM)
    del content["joints"]["D1"]
    content["drivers"] = {"D": {"type": "constant_speed", "body_i": "crank", "body_j": "ground", "omega": 10}}
    content["bodies"]["crank"]["mount_points"] = {
        "M": content["bodies"]["crank"]["attachment_points"].pop("A")
    }
    content["joints"]["J2"]["point_i"] = "M"
    solver = ms.load(written(content))
    assert solver.mechanism.drivers == ("J1",)
    expected = EXPECTED.points["A"].position
    np.testing.assert_allclose(
        solver.solve(ANGLES, speed=1.0).points["M"].position, expected, rtol=0, atol=1e-13
    )
    assert solver.facts == ("drivers.omega is not read",)
