"""PMKS_Verification, reference-data/v1: six planar linkages by MATLAB and PMKS, dynamics by MATLAB.

Links have the ground's frame in the first configuration. A slider is a pin on a block on the ground.
"""

import csv
import json
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

import mechsim as ms
from mechsim.mechanism.links import GROUND, Pose
from validation.published.table import Row
from validation.suites.case import Case, Clone, Suite

ROOT = "reference-data/v1/cases"
# %.17g, regenerated within 1e-12 of the scale by the same source (its README, second tier)
SAME_SOURCE = 1e-12
Names = dict[str, np.ndarray]


def linkage(case: Mapping[str, Any]) -> ms.Mechanism:
    topology = case["topology"]
    joints, names = [], [link["id"] for link in topology["links"]]
    for joint in topology["joints"]:
        a, b = joint["links"]
        point = (*joint["initial"], 0.0)
        if "guide_axis" in joint:
            # the block between the guide and the pin
            (a,) = {a, b} - {GROUND}
            names.append(b := "block")
            axis = (*joint["guide_axis"], 0.0)
            joints.append(ms.Joint("guide", "prismatic", ms.End(GROUND, point, axis), ms.End(b, point, axis)))
        joints.append(ms.Joint(joint["id"], "revolute", ms.End(a, point), ms.End(b, point)))
    own = {
        joint["id"]: (next(link for link in joint["links"] if link != GROUND), (*joint["initial"], 0.0))
        for joint in topology["joints"]
    }
    own |= {point["id"]: (point["link"], (*point["initial"], 0.0)) for point in topology["points"]}
    masses = {"block" if name == "Piston" else name: mass for name, mass in case["mass_properties"].items()}
    own |= {f"{name} com": (name, (*mass["com_initial"], 0.0)) for name, mass in masses.items()}
    links = tuple(ms.Link(name, inertia=inertia(masses.get(name))) for name in names)
    return ms.Mechanism(
        case["case_id"],
        links,
        tuple(joints),
        case["input"]["joint"],
        own,
        guess={name: Pose(np.zeros(3), np.eye(3)) for name in names},
    )


def inertia(mass: Mapping[str, Any] | None) -> ms.Inertia:
    if mass is None:
        return ms.Inertia(0.0, (0.0, 0.0, 0.0), ((0.0,) * 3,) * 3)
    # moments about axes in the plane have no effect
    moments = np.diag([float(mass["inertia"])] * 3)
    return ms.Inertia(mass["mass"], (*mass["com_initial"], 0.0), tuple(map(tuple, moments)))


def loads(case: Mapping[str, Any], scenario: str) -> ms.Forces:
    load, positions = case["dynamics"]["load"], {j["id"]: j["initial"] for j in case["topology"]["joints"]}
    centre = np.mean([positions[name] for name in load["application_average"]], 0)
    force = ms.load_profile.constant((*map(float, load["force"]), 0.0))
    gravity = (*case["dynamics"]["gravity"], 0.0) if scenario == "newton_gravity" else (0.0, 0.0, 0.0)
    return ms.Forces(gravity=gravity, loads=(ms.Load((load["link"], (*centre, 0.0)), force),))


def table(clone: Clone, path: str) -> Names:
    rows = list(csv.DictReader(clone.read(path).splitlines()))
    numbers = [name for name in rows[0] if name not in ("sample_id", "sweep_id", "eligibility")]
    return {name: np.array([float(row[name]) for row in rows]) for name in numbers}


def row(what: str, own: list[np.ndarray], theirs: list[np.ndarray]) -> Row:
    """Return the largest difference relative to the largest value."""
    error = np.abs(np.array(own) - np.array(theirs)).max() / np.abs(theirs).max()
    return Row(what, float(error), SAME_SOURCE, "", REASON)


REASON = "of the largest value: the limit at which the source repeats itself"
# column of the tables -> attribute of a motion
OF_POINTS = {"": "position", "v": "velocity", "a": "acceleration"}
OF_LINKS = {"omega_rad_s": "angular_velocity", "alpha_rad_s2": "angular_acceleration"}


def kinematics(clone: Clone, folder: str, motion: ms.Motion) -> Iterator[Row]:
    paths = [path.split("/") for path in clone.paths(folder + "/") if "dynamics" not in path]
    tables = {
        (kind, name[:-4]): table(clone, f"{folder}/{kind}/{name}")
        for *_, kind, name in paths
        if kind in ("joints", "points", "com", "links")
    }
    points = {
        name + (" com" if kind == "com" else ""): data
        for (kind, name), data in tables.items()
        if kind in ("joints", "points") or (kind == "com" and name in motion.links)
    }
    for prefix, what in OF_POINTS.items():
        own = [getattr(motion.points[name], what)[:, :2] for name in points]
        yield row(what, own, [np.stack([data[f"{prefix}{c}"] for c in "xy"], 1) for data in points.values()])
    links = {name: data for (kind, name), data in tables.items() if kind == "links"}
    for column, what in OF_LINKS.items():
        own = [getattr(motion.links[name], what)[:, 2] for name in links]
        yield row(what.replace("_", " "), own, [data[column] for data in links.values()])


def dynamics(clone: Clone, folder: str, forces: Any, owners: Mapping[str, Any]) -> Iterator[Row]:
    """Yield torque and joint forces; the tables state which link each force acts on."""
    scenario = folder.rpartition("newton_")[2].replace("_", " ")
    yield row(
        f"torque, {scenario}", [forces.torque], [table(clone, f"{folder}/input_torque.csv")["torque_nm"]]
    )
    own, theirs = [], []
    for name, reaction in forces.reactions.items():
        sign = owners[reaction.link][name] if reaction.link in owners else -owners[reaction.by][name]
        data = table(clone, f"{folder}/joints/{name}.csv")
        own.append(sign * reaction.force[:, :2])
        theirs.append(np.stack([data["fx"], data["fy"]], 1))
    yield row(f"joint forces, {scenario}", own, theirs)


def compared(name: str, clone: Clone) -> Case:
    case = json.loads(clone.read(f"{ROOT}/{name}/case.json"))
    folder = f"{ROOT}/{name}/matlab"
    samples = table(clone, f"{folder}/samples.csv")
    speed = case["input"]["speed_rad_s"] * samples["input_direction"]
    angles = samples["input_angle_rad"] - samples["input_angle_rad"][0]
    solver = ms.load(linkage(case))
    rows = list(kinematics(clone, folder, solver.solve(angles, speed=speed)))
    for scenario in case.get("dynamics", {}).get("scenarios", ()):
        model = ms.dynamics.dynamic_model(solver, loads(case, scenario))
        forces = ms.dynamics.prescribed(model, angles, speed).forces
        owners = case["dynamics"]["reaction_ownership"]
        rows += dynamics(clone, f"{folder}/dynamics/{scenario}", forces, owners)
    return Case(name, tuple(rows))


def cases(clone: Clone | None) -> Iterator[Case]:
    """Yield the cases of a clone; the source has no licence, so that no figures are kept here."""
    if clone:
        for name in sorted({path.split("/")[3] for path in clone.paths(ROOT + "/")}):
            yield compared(name, clone)


SUITE = Suite(
    "PMKS_Verification: planar linkages",
    "PMKS-Web/PMKS_Verification",
    "All rows of MATLAB's tables: joints, points, centres, links, torque and joint forces. No licence is"
    " stated. Its tables with friction hold zeros only.",
    cases,
)
