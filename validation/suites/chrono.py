"""Joint tests of Project Chrono: one body on one joint or spring, against results of ADAMS.

A case is a model in models/chrono/. A body of 1 kg is released at rest under 9.80665 m/s2 along -z; the
tables have 501 instants of 5 s. ADAMS ran at its default error, so that Chrono's tests accept root mean
squares of differences, which are the tolerances here. Forces of ADAMS are those on the ground, moments about
the joint's point on the ground.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

import mechsim as ms
from validation.published.table import Row
from validation.suites.case import Case, Clone, Suite, kept
from validation.suites.released import MODELS, model_of, run_of

DURATION = 5.0
# rods that rotate, each 40 s of processor time, since C lacks rods: compared with the clone only
SLOW = ("Distance_Case02", "Distance_Case03")
UNITS = {"Pos": "m", "Vel": "m/s", "Acc": "m/s2", "Quat": "1", "Avel": "rad/s", "Aacc": "rad/s2"}
FOLDERS = {
    "Revolute": "revolute_joint",
    "Cylindrical": "cylindrical_joint",
    "Prismatic": "prismatic_joint",
    "Universal": "universal_joint",
    "Spherical": "spherical_joint",
    "Distance": "distance_constraint",
    "RevSpherical": "revsph_constraint",
    "LinActuator": "lin_actuator",
    "RotSpring": "rotspring_force",
    "TranSpring": "transpring_force",
    "TranSpringCB": "transpringcb_force",
}
CASES = sorted(
    (path.stem for path in (MODELS / "chrono").glob("*.toml")),
    key=lambda name: [*FOLDERS].index(name.partition("_")[0]) + 0.01 * int(name[-2:]),
)
# torque of the springs of hinges in [N m], of angle and rate
HINGES = {
    "RotSpring_Case01": lambda q, v: 200.0 * q + 10.0 * v,
    "RotSpring_Case02": lambda q, v: (50.0 + 10.0 * np.abs(q)) * q + 10.0 * v,
}


def forces(case: str, model: ms.dynamics.DynamicModel, run: ms.dynamics.DynamicRun) -> dict:
    """Return forces on the ground and moments about the joint's point on it, named as the files are."""
    joints = {joint.name: joint for joint in model.mechanism.joints}
    if "J" not in joints or joints["J"].kind == "floating":
        # the spring is the only force besides the weight
        return {"Rforce": np.array(model.forces.gravity) - run.motion.links["body"].acceleration}
    reactions = ms.dynamics.joint_reactions(model, run)
    first, end = reactions["J"], joints["J"].a
    moment, axis = -first.moment - np.cross(first.point - np.array(end.point), first.force), end.frame[:, 2]
    if "ball" in joints:
        ball = reactions["ball"]
        names = ("Rforce_Body1", "Rtorque_Body1", "Rforce_Body2", "Rtorque_Body2")
        return dict(zip(names, (-first.force, moment, ball.force, ball.moment), strict=True))
    if run.driving:
        thrust = np.outer(run.driving["J"], axis)
        names = ("RforceP", "RtorqueP", "RforceA", "RtorqueA")
        return dict(zip(names, (-first.force, moment, thrust, 0.0 * thrust), strict=True))
    if case in HINGES:
        # the tables add the torque of spring and damper
        hinge = run.motion.joints["J"]
        moment = moment + np.outer(HINGES[case](hinge.value, hinge.rate), axis)
    return {"Rforce": -first.force, "Rtorque": moment}


@dataclass(frozen=True)
class Table:
    """A quantity of a case: the accepted root mean square, and rows of time and components."""

    accepted: float
    rows: np.ndarray


def tables(clone: Clone | None, case: str) -> dict[str, Table]:
    if clone is None:
        lines = [line for line in kept("chrono") if line[0] == case]
        return {what: Table(SINGLE * float(e), np.array([row], float)) for _, what, e, *row in lines}
    folder, accepted = f"data/testing/joints/{FOLDERS[case.split('_')[0]]}", tolerances(clone)[case]
    result = {}
    for path in clone.paths(folder + "/"):
        match = re.fullmatch(rf"{folder}/{case}_ADAMS_(\w+)\.txt", path)
        if match and match[1] in accepted:
            rows = np.loadtxt(clone.read(path).splitlines()[3:])
            result[match[1]] = Table(accepted[match[1]], rows)
    return result


@cache
def tolerances(clone: Clone) -> dict[str, dict[str, float]]:
    """Return case -> quantity -> root mean square that Chrono's own test accepts."""
    result: dict[str, dict[str, float]] = {}
    for path in clone.paths("src/tests/unit_tests/joints/"):
        # lines that are commented out state what was once accepted
        text, case = re.sub(r"\s*/{2,}\s*", " ", clone.read(path)), ""
        for name, what, value in re.findall(ACCEPTED, text):
            case = name or case
            if what:
                result.setdefault(case, {})[what] = float(value)
    return result


ACCEPTED = r'test_name = "(\w+_Case\d+)"|ValidateReference\([^"]*?"(\w+)",\s*([\d.e-]+)\)'
REASON = "root mean square that Chrono's own test accepts; three times that at a single instant"
# root mean square of positions, in [m], beyond which it is not the rounding of what is printed
PRINTED = 1e-4
# largest deviation at one instant, in root mean squares over all
SINGLE = 3.0


def own_energy(model: ms.dynamics.DynamicModel, reference: Mapping[str, Table]) -> float:
    """Return how much the energy of the tables themselves departs from that at rest, in [J]."""
    position, velocity, rates = (reference[what].rows[:, 1:] for what in ("Pos", "Vel", "Avel"))
    rotation = Rotation.from_quat(reference["Quat"].rows[:, [2, 3, 4, 1]])
    moments = np.diag(np.array(model.mechanism.links[-1].inertia.moments))
    local = rotation.inv().apply(rates)
    kinetic = 0.5 * ((velocity**2).sum(1) + (moments * local**2).sum(1))
    height = position[:, 2] - model.mechanism.guess["body"].position[2]
    return float(np.abs(kinetic - model.forces.gravity[2] * height).max())


def compared(case: str, clone: Clone | None) -> Case:
    """Run a case and compare every quantity of its tables."""
    solver, rows = model_of(f"chrono/{case}"), []
    run, model = run_of(solver, DURATION), ms.dynamics.dynamic_model(solver)
    link, reference = run.motion.links["body"], tables(clone, case)
    values = {
        "Pos": link.position,
        "Vel": link.velocity,
        "Acc": link.acceleration,
        "Quat": link.rotation,
        "Avel": link.angular_velocity,
        "Aacc": link.angular_acceleration,
    } | forces(case, model, run)
    for what, table in reference.items():
        theirs = table.rows[:, 1:]
        if what == "Quat":
            theirs = Rotation.from_quat(theirs[:, [1, 2, 3, 0]]).as_matrix()
        own = values[what][np.rint(table.rows[:, 0] * 100.0).astype(int)]
        error = float(np.sqrt(((own - theirs) ** 2).mean(0)).max())
        unit = UNITS.get(what, "N m" if "torque" in what else "N")
        rows.append(Row(what, error, table.accepted, unit, REASON))
    note = ""
    if next(row.error for row in rows if row.quantity == "Pos") > PRINTED:
        note = f"ADAMS's own energy departs by {own_energy(model, reference):.1e} J"
    return Case(case, tuple(rows), note=note)


def cases(clone: Clone | None) -> Iterator[Case]:
    for case in CASES:
        if clone or case not in SLOW:
            yield compared(case, clone)


SUITE = Suite(
    "Chrono: joint tests against ADAMS",
    "projectchrono/chrono",
    "A body on one joint, spring or actuator, released for 5 s; 501 instants. Licence BSD-3.",
    cases,
)
