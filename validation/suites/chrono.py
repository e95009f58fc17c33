"""Joint tests of Project Chrono: one body on one joint or spring, against results of ADAMS.

A body of 1 kg is released at rest under 9.80665 m/s2 along -z; the tables have 501 instants of 5 s. ADAMS ran
at its default error, so that Chrono's tests accept root mean squares of differences, which are the
tolerances here. Forces of ADAMS are those on the ground, moments about the joint's point on the ground.
"""

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cache, partial

import numpy as np
from scipy.spatial.transform import Rotation

import mechsim as ms
from mechsim.model.links import GROUND, Pose
from validation.published.table import Row
from validation.suites.case import Case, Clone, Suite, kept

GRAVITY, HALF = 9.80665, np.pi / 2
WEIGHT = ms.Forces(gravity=(0.0, 0.0, -GRAVITY))
NOTHING = ms.Inertia(0.0, (0.0, 0.0, 0.0), ((0.0,) * 3,) * 3)
MOMENTS = (0.04, 0.1, 0.1)
UPRIGHT, ORIGIN = np.eye(3), np.zeros(3)
X, Y, Z = UPRIGHT
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


def rotated(axis: np.ndarray, angle: float) -> np.ndarray:
    return Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)).as_matrix()


@dataclass(frozen=True)
class Setting:
    """A case: mechanism, forces, and which coordinate is driven."""

    mechanism: ms.Mechanism
    forces: ms.Forces = WEIGHT
    laws: dict[str, str] = field(default_factory=dict)


def body(moments: tuple[float, ...] = MOMENTS) -> ms.Link:
    return ms.Link("body", inertia=ms.Inertia(1.0, (0.0, 0.0, 0.0), tuple(map(tuple, np.diag(moments)))))


def mechanism(*joints: ms.Joint, moments=MOMENTS, points=None, driver=(), **guess: tuple) -> ms.Mechanism:
    links = [ms.Link(name, inertia=NOTHING) for name in guess if name != "body"]
    poses = {name: Pose(np.asarray(origin, float), np.asarray(r)) for name, (origin, r) in guess.items()}
    return ms.Mechanism("case", (*links, body(moments)), joints, driver, points or {}, guess=poses)


def on_joint(kind, origin, rotation, arm=X, moments=MOMENTS, axes=(Z, Z), driver=()) -> ms.Mechanism:
    """Return a body 2 m along an arm of its own frame from a joint; axes in that frame."""
    joint = ms.Joint(
        "J",
        kind,
        ms.End(GROUND, tuple(origin), tuple(rotation @ axes[0])),
        ms.End("body", tuple(-2.0 * arm), tuple(axes[1])),
    )
    return mechanism(joint, moments=moments, driver=driver, body=(origin + rotation @ (2.0 * arm), rotation))


def pendulum(kind: str, origin, rotation) -> Setting:
    return Setting(on_joint(kind, np.asarray(origin, float), rotation))


def universal(rotation) -> Setting:
    return Setting(on_joint("universal", ORIGIN, rotation, -Z, (0.1, 0.1, 0.04), (X, Y)))


def rod(origin, point, centre, rotation=UPRIGHT) -> Setting:
    origin, point, centre = (np.asarray(v, float) for v in (origin, point, centre))
    end = ms.End("body", tuple(rotation.T @ (point - centre)))
    joint = ms.Joint("J", "distance", ms.End(GROUND, tuple(origin)), end, length=2.0)
    return Setting(mechanism(joint, body=(centre, rotation)))


def arm_and_ball(origin, axis, point, centre) -> Setting:
    origin, point, centre = (np.asarray(v, float) for v in (origin, point, centre))
    hinge = ms.Joint("J", "revolute", ms.End(GROUND, tuple(origin), axis), ms.End("arm", axis=axis))
    end = ms.End("body", tuple(point - centre))
    ball = ms.Joint("ball", "spherical", ms.End("arm", tuple(point - origin)), end)
    poses = {"arm": (origin, UPRIGHT), "body": (centre, UPRIGHT)}
    return Setting(mechanism(hinge, ball, moments=(0.1, 0.04, 0.1), **poses))


def actuator(rotation, speed: float) -> Setting:
    joint = ms.Joint("J", "prismatic", ms.End(GROUND, axis=rotation[:, 2]), ms.End("body"))
    plate = mechanism(joint, moments=(1.0, 1.0, 1.0), driver=("J",), body=(ORIGIN, rotation))
    return Setting(plate, laws={"J": f"{speed}*t"})


def hinge_with(forces: ms.Forces) -> Setting:
    return Setting(on_joint("revolute", ORIGIN, rotated(X, -HALF), driver=("J",)), forces)


def free_on_spring(height: float, stiffness: float, damping: float) -> Setting:
    joint = ms.Joint("J", "floating", ms.End(GROUND), ms.End("body"))
    points = {"P": ("body", (0.0, 0.0, 0.0))}
    free = mechanism(joint, points=points, body=((0.0, height, 0.0), UPRIGHT))
    spring = ms.Spring((GROUND, (0.0, 0.0, 0.0)), "P", stiffness, height, damping)
    return Setting(free, replace(WEIGHT, springs=(spring,)))


def nonlinear_spring(origin, point, centre, rotation, axes) -> Setting:
    """Return a body on a telescope without mass, whose force is that of the spring."""
    origin, point, centre = (np.asarray(v, float) for v in (origin, point, centre))
    joints = (
        ms.Joint("U", "universal", ms.End(GROUND, tuple(origin), axes[0]), ms.End("tube", axis=axes[1])),
        ms.Joint("P", "prismatic", ms.End("tube", axis=Y), ms.End("piston", axis=Y)),
        ms.Joint("S", "spherical", ms.End("piston"), ms.End("body", tuple(rotation.T @ (point - centre)))),
    )
    poses = {"tube": (origin, UPRIGHT), "piston": (point, UPRIGHT), "body": (centre, rotation)}
    law = ms.Controller("P", "-50*(P.q-2) - 10*abs(P.q-2)*(P.q-2) - 5*P.v")
    return Setting(mechanism(*joints, **poses), replace(WEIGHT, controllers=(law,)))


LINEAR = replace(
    WEIGHT,
    joint_springs=(ms.JointSpring("J", 200.0, 0.0),),
    friction=(ms.Friction("J", viscous=10.0),),
)
NONLINEAR = replace(WEIGHT, controllers=(ms.Controller("J", "-(50+10*abs(J.q))*J.q - 10*J.v"),))
GROUND_POINT, ALONG = (1.0, 2.0, 3.0), (0.0, 0.5**0.5, 0.5**0.5)
SIDE, SLANTED = rotated(X, -HALF), rotated(X, -HALF / 2)
CASES: Mapping[str, Callable[[], Setting]] = {
    "Revolute_Case01": partial(pendulum, "revolute", ORIGIN, SIDE),
    "Revolute_Case02": partial(pendulum, "revolute", GROUND_POINT, SLANTED),
    "Cylindrical_Case01": partial(pendulum, "cylindrical", ORIGIN, UPRIGHT),
    "Cylindrical_Case02": partial(pendulum, "cylindrical", ORIGIN, SIDE),
    "Cylindrical_Case03": partial(pendulum, "cylindrical", GROUND_POINT, SLANTED),
    "Prismatic_Case01": partial(pendulum, "prismatic", ORIGIN, UPRIGHT),
    "Prismatic_Case02": partial(pendulum, "prismatic", GROUND_POINT, SLANTED),
    "Prismatic_Case03": partial(pendulum, "prismatic", GROUND_POINT, SIDE),
    "Universal_Case01": partial(universal, rotated(X, HALF)),
    "Universal_Case02": partial(universal, rotated(Y, HALF)),
    "Universal_Case03": partial(universal, rotated(X - Y, HALF)),
    "Spherical_Case01": partial(pendulum, "spherical", ORIGIN, UPRIGHT),
    "Spherical_Case02": partial(pendulum, "spherical", GROUND_POINT, SLANTED),
    "Distance_Case01": partial(rod, ORIGIN, (0, 2, 0), (0, 2, 0)),
    "Distance_Case02": partial(rod, GROUND_POINT, (1, 4, 3), (-1, 4, 3)),
    "Distance_Case03": partial(rod, ORIGIN, (0, 2, 0), (0, 4, 0), rotated(Z, -HALF)),
    "RevSpherical_Case01": partial(arm_and_ball, ORIGIN, (0.0, 0.0, 1.0), (2, 0, 0), (2, 2, 0)),
    "RevSpherical_Case02": partial(arm_and_ball, GROUND_POINT, ALONG, (3, 2, 3), (3, 4, 3)),
    "LinActuator_Case01": partial(actuator, UPRIGHT, 1.0),
    "LinActuator_Case02": partial(actuator, rotated(Y, HALF / 2), 0.5),
    "RotSpring_Case01": partial(hinge_with, LINEAR),
    "RotSpring_Case02": partial(hinge_with, NONLINEAR),
    "TranSpring_Case01": partial(free_on_spring, 0.0, 10.0, 0.5),
    "TranSpring_Case02": partial(free_on_spring, 2.0, 100.0, 5.0),
    "TranSpringCB_Case01": partial(free_on_spring, 0.0, 10.0, 0.5),
    "TranSpringCB_Case02": partial(free_on_spring, 2.0, 100.0, 5.0),
    "TranSpringCB_Case03": partial(nonlinear_spring, GROUND_POINT, (1, 4, 3), (-1, 4, 3), UPRIGHT, (Z, X)),
    "TranSpringCB_Case04": partial(nonlinear_spring, ORIGIN, (0, 2, 0), (0, 4, 0), rotated(Z, -HALF), (X, Z)),
}


def run_of(setting: Setting) -> tuple[ms.dynamics.DynamicModel, ms.dynamics.DynamicRun]:
    source = ms.load(setting.mechanism, drive=setting.laws) if setting.laws else setting.mechanism
    run = ms.dynamics.run(source, setting.forces, prescribed=tuple(setting.laws), duration=5.0, samples=500)
    if run.outcome != "done":
        raise ms.InputError(run.reason)
    return ms.dynamics.dynamic_model(source, setting.forces), run


def forces(setting: Setting, model: ms.dynamics.DynamicModel, run: ms.dynamics.DynamicRun) -> dict:
    """Return forces on the ground and moments about the joint's point on it, named as the files are."""
    joints = {joint.name: joint for joint in model.mechanism.joints}
    if "J" not in joints or joints["J"].kind == "floating":
        # the spring is the only force besides the weight
        return {"Rforce": np.array(WEIGHT.gravity) - run.motion.links["body"].acceleration}
    reactions = ms.dynamics.joint_reactions(model, run)
    first, end = reactions["J"], joints["J"].a
    moment, axis = -first.moment - np.cross(first.point - np.array(end.point), first.force), end.frame[:, 2]
    if "ball" in joints:
        ball = reactions["ball"]
        names = ("Rforce_Body1", "Rtorque_Body1", "Rforce_Body2", "Rtorque_Body2")
        return dict(zip(names, (-first.force, moment, ball.force, ball.moment), strict=True))
    if setting.laws:
        thrust = np.outer(run.driving["J"], axis)
        names = ("RforceP", "RtorqueP", "RforceA", "RtorqueA")
        return dict(zip(names, (-first.force, moment, thrust, 0.0 * thrust), strict=True))
    if setting.forces != WEIGHT:
        # the tables add the torque of spring and damper
        q, v = run.motion.joints["J"].value, run.motion.joints["J"].rate
        stiffness = 200.0 if setting.forces == LINEAR else 50.0 + 10.0 * np.abs(q)
        moment = moment + np.outer(stiffness * q + 10.0 * v, axis)
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


def own_energy(setting: Setting, reference: Mapping[str, Table]) -> float:
    """Return how much the energy of the tables themselves departs from that at rest, in [J]."""
    position, velocity, rates = (reference[what].rows[:, 1:] for what in ("Pos", "Vel", "Avel"))
    rotation = Rotation.from_quat(reference["Quat"].rows[:, [2, 3, 4, 1]])
    moments = np.diag(np.array(setting.mechanism.links[-1].inertia.moments))
    local = rotation.inv().apply(rates)
    kinetic = 0.5 * ((velocity**2).sum(1) + (moments * local**2).sum(1))
    height = position[:, 2] - setting.mechanism.guess["body"].position[2]
    return float(np.abs(kinetic + GRAVITY * height).max())


def compared(case: str, clone: Clone | None) -> Case:
    """Run a case and compare every quantity of its tables."""
    setting, rows = CASES[case](), []
    model, run = run_of(setting)
    link, reference = run.motion.links["body"], tables(clone, case)
    values = {
        "Pos": link.position,
        "Vel": link.velocity,
        "Acc": link.acceleration,
        "Quat": link.rotation,
        "Avel": link.angular_velocity,
        "Aacc": link.angular_acceleration,
    } | forces(setting, model, run)
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
        note = f"ADAMS's own energy departs by {own_energy(setting, reference):.1e} J"
    return Case(case, tuple(rows), note=note)


def cases(clone: Clone | None) -> Iterator[Case]:
    for case in CASES:
        yield compared(case, clone)


SUITE = Suite(
    "Chrono: joint tests against ADAMS",
    "projectchrono/chrono",
    "A body on one joint, spring or actuator, released for 5 s; 501 instants. Licence BSD-3.",
    cases,
)
