"""Worked examples of textbooks with printed answers, in the books' units; dimensions and answers are facts.

Norton, Design of Machinery; Shigley, Mechanical Engineering Design; Khurmi & Gupta, Theory of Machines; Beer
& Johnston, Vector Mechanics for Engineers; Meriam & Kraige, Dynamics; Hibbeler, Dynamics.
"""

from collections.abc import Callable, Iterator, Mapping
from functools import partial

import numpy as np

import mechsim as ms
from mechsim.mechanism.joints import Gear
from mechsim.mechanism.links import GROUND, Pose
from validation.suites.case import Case, Clone, Suite, printed_case
from validation.suites.released import entries

NOTHING = ms.Inertia(0.0, (0.0, 0.0, 0.0), ((0.0,) * 3,) * 3)
RPM = np.pi / 30.0
# quantity of a motion: columns of links or points
OF_LINKS = {"omega": "angular_velocity", "alpha": "angular_acceleration"}
OF_POINTS = {"v": "velocity", "a": "acceleration", "x": "position"}
Result = ms.Motion | Mapping[str, float]


def about(degrees: float) -> np.ndarray:
    c, s = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def along(degrees: float, length: float) -> np.ndarray:
    return length * about(degrees)[:2, 0]


def planar(joints: Mapping[str, tuple], driver=(), inertias=None, points=None, gears=()) -> ms.Mechanism:
    """Return a linkage of joints name -> (link a, link b, point, direction of a slide), in one frame."""
    own, built = [], []
    for name, (a, b, point, *axis) in joints.items():
        own += [link for link in (a, b) if link != GROUND and link not in own]
        direction = (*axis[0], 0.0) if axis else (0.0, 0.0, 1.0)
        ends = (ms.End(link, (*point, 0.0), direction) for link in (a, b))
        built.append(ms.Joint(name, "prismatic" if axis else "revolute", *ends))
    links = tuple(ms.Link(name, inertia=(inertias or {}).get(name, NOTHING)) for name in own)
    tracked = {name: (link, (*point, 0.0)) for name, (link, point) in (points or {}).items()}
    poses = {name: Pose(np.zeros(3), np.eye(3)) for name in own}
    return ms.Mechanism("example", links, tuple(built), driver, tracked, gears, poses)


def four_bar(a, b, c, d, speed: float, acceleration: float = 0.0, angle: float = 0.0) -> ms.Motion:
    pins = {"crank": (GROUND, "2", a), "B": ("2", "3", b), "C": ("3", "4", c), "D": (GROUND, "4", d)}
    return ms.load(planar(pins, "crank")).solve([angle], speed=speed, acceleration=acceleration)


def slider(b, c, axis=(1.0, 0.0), middle=0.5, inertias=None) -> ms.Mechanism:
    """Return a crank from the origin to b, a rod to c, and its point G at a fraction of its length."""
    pins = {"crank": (GROUND, "2", (0.0, 0.0)), "B": ("2", "3", b), "C": ("3", "block", c)}
    points = {"C": ("block", c), "G": ("3", b + middle * (c - b))}
    return planar(pins | {"guide": (GROUND, "block", c, axis)}, "crank", inertias, points)


def engine(crank: float, rod: float, degrees: float, speed: float, middle: float = 0.5) -> ms.Motion:
    b = along(degrees, crank)
    c = np.array([b[0] + np.sqrt(rod**2 - b[1] ** 2), 0.0])
    return ms.load(slider(b, c, middle=middle)).solve([0.0], speed=speed * RPM)


def train(arm: float, fixed: float, **ratios: tuple[str, float]) -> dict[str, float]:
    """Return speeds in rpm of wheels on an arm: the first has a given one, others a ratio to another."""
    (first, _), *_ = ratios.values()
    wheels = [first, *ratios]
    joints = {name: ("arm", name, (i, 0.0)) for i, name in enumerate(wheels)}
    gears = tuple(Gear(driver, driven, ratio) for driven, (driver, ratio) in ratios.items())
    whole = planar({"arm": (GROUND, "arm", (0.0, 0.0))} | joints, ("arm", first), gears=gears)
    laws = {"arm": f"{arm}rpm", first: f"{fixed - arm}rpm"}
    motion = ms.load(whole, drive=laws).solve(t=[0.0])
    return {f"speed of {name}": float(motion.links[name].angular_velocity[0, 2]) / RPM for name in wheels}


def geneva() -> ms.Motion:
    distance = 50.0 * np.sqrt(2.0)
    pin = np.array([distance, 0.0]) + along(150.0, 50.0)
    joints = {"crank": (GROUND, "D", (distance, 0.0)), "P": ("D", "block", pin)}
    joints |= {"slot": ("block", "S", pin, pin / np.hypot(*pin)), "O": (GROUND, "S", (0.0, 0.0))}
    return ms.load(planar(joints, "crank")).solve([0.0], speed=10.0)


def rod(mass: float, length: float, centre) -> ms.Inertia:
    moment = mass * length**2 / 12.0
    return ms.Inertia(mass, (*centre, 0.0), tuple(map(tuple, np.diag([moment] * 3))))


def rod_on_tracks() -> dict[str, float]:
    a, b = np.zeros(2), along(150.0, 4.0)
    joints = {"A": (GROUND, "a", a, (1.0, 0.0)), "a": ("a", "rod", a)}
    joints |= {"B": (GROUND, "b", b, (1.0, -1.0)), "b": ("b", "rod", b)}
    falling = planar(joints, inertias={"rod": rod(50.0 / 32.2, 4.0, b / 2.0)})
    weight = ms.Forces(gravity=(0.0, -32.2, 0.0))
    run = ms.dynamics.run(falling, weight, duration=0.01, samples=1)
    forces = ms.dynamics.joint_reactions(ms.dynamics.dynamic_model(falling, weight), run)
    sizes = {f"force at {name.upper()}": float(np.hypot(*forces[name].force[0, :2])) for name in "ab"}
    return {"alpha rod": float(run.motion.links["rod"].angular_acceleration[0, 2])} | sizes


def rods_released() -> dict[str, float]:
    b, c = along(60.0, 0.75), np.array([0.75, 0.0])
    rods = {"2": rod(6.0, 0.75, b / 2.0), "3": rod(6.0, 0.75, (b + c) / 2.0)}
    weight = ms.Forces(gravity=(0.0, -9.81, 0.0))
    linkage = slider(b, c, inertias=rods)
    motion = ms.dynamics.run(linkage, weight, duration=2.0, until="crank.q=-40deg").motion
    return {"omega AB": motion.joints["crank"].rate[-1], "vx D": motion.points["C"].velocity[-1, 0]}


def collars() -> ms.Motion:
    joints = {"crank": (GROUND, "c", (0.0, 0.0), (0.0, -1.0)), "C": ("c", "CB", (0.0, 0.0))}
    joints |= {"B": ("CB", "b", (0.2, -0.2)), "guide": (GROUND, "b", (0.2, -0.2), (1.0, 0.0))}
    pair = planar(joints, ("crank",), points={"B": ("b", (0.2, -0.2))})
    return ms.load(pair, drive={"crank": "2m/s"}).solve(t=[0.0])


def upright_engine() -> ms.Motion:
    b = along(135.0, 0.25)
    c = np.array([0.0, b[1] + np.sqrt(0.75**2 - b[0] ** 2)])
    return ms.load(slider(b, c, (0.0, 1.0))).solve([0.0], speed=-10.0, acceleration=-20.0)


def lengths(crank: float, rod: float, rocker: float, fixed: float, degrees: float) -> list[np.ndarray]:
    """Return the pins of an open four-bar, by the law of cosines."""
    b, d = along(degrees, crank), np.array([fixed, 0.0])
    reach = float(np.hypot(*(d - b)))
    angle = np.arccos((rod**2 + reach**2 - rocker**2) / (2.0 * rod * reach))
    c = b + along(np.rad2deg(angle + np.arctan2(*(d - b)[::-1])), rod)
    return [np.zeros(2), b, c, d]


def norton() -> dict[str, float]:
    """Return directions of rod and rocker in deg, rates, accelerations, 20 deg from the stated pins."""
    pins = lengths(40.0, 120.0, 80.0, 100.0, 60.0)
    motion = four_bar(*pins, 25.0, 15.0, np.deg2rad(-20.0))
    rates = {f"{what} {link}": value(motion, f"{what} {link}") for what in OF_LINKS for link in "34"}
    return rates | {
        f"theta {link}": direction(motion, link, pins[2] - start)
        for link, start in (("3", pins[1]), ("4", pins[3]))
    }


def direction(motion: ms.Motion, link: str, at_start: np.ndarray) -> float:
    """Return the direction in deg of a line of a link."""
    x, y = (motion.links[link].rotation[0, :2, :2] @ at_start).tolist()
    return float(np.rad2deg(np.arctan2(y, x)))


def offset_slider() -> dict[str, float]:
    """Return position and rod's direction of a slider at -20, 30 deg from the stated pins."""
    b = along(90.0, 40.0)
    c = np.array([np.sqrt(120.0**2 - 60.0**2), -20.0])
    motion = ms.load(slider(b, c)).solve([np.deg2rad(-30.0)])
    return {"d": float(motion.points["C"].position[0, 0]), "theta 3": direction(motion, "3", b - c)}


def hooke(angle: float, speed: float, inertia: float) -> dict[str, float]:
    """Return the largest acceleration of the driven shaft in rad/s2, and its torque."""
    out = np.array([np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle)), 0.0])
    joints = (
        ms.Joint("crank", "revolute", ms.End(GROUND, axis=(1, 0, 0)), ms.End("in", axis=(1, 0, 0))),
        ms.Joint("cross", "universal", ms.End("in", axis=(0, 0, 1)), ms.End("out", axis=(0, 1, 0))),
        ms.Joint("driven", "revolute", ms.End(GROUND, axis=tuple(out)), ms.End("out", axis=(1, 0, 0))),
    )
    links = tuple(ms.Link(name, inertia=NOTHING) for name in ("in", "out"))
    guess = {"in": Pose(np.zeros(3), np.eye(3)), "out": Pose(np.zeros(3), about(angle))}
    shafts = ms.load(ms.Mechanism("shafts", links, joints, "crank", {}, guess=guess))
    motion = shafts.solve(np.linspace(0.0, np.pi, 3601), speed=speed * RPM)
    largest = float(np.abs(motion.joints["driven"].acceleration).max())
    return {"alpha": largest, "torque": inertia * largest}


def slotted_lever() -> dict[str, float]:
    """Return the swing of a lever to either side and the ratio of times; the crank turns 120 below it."""
    pin = np.array([120.0, 240.0])
    joints = {"crank": (GROUND, "2", (0.0, 240.0)), "pin": ("2", "block", pin)}
    joints |= {"slot": ("block", "4", pin, pin / np.hypot(*pin)), "pivot": (GROUND, "4", (0.0, 0.0))}
    angles = np.linspace(0.0, 2.0 * np.pi, 3601)
    swing = ms.load(planar(joints, "crank")).solve(angles).joints["pivot"].value
    side = 0.5 * np.ptp(swing)
    apart = float(np.rad2deg(abs(angles[swing.argmax()] - angles[swing.argmin()])))
    return {"side": float(np.rad2deg(side)), "ratio": max(apart, 360.0 - apart) / min(apart, 360.0 - apart)}


BAR = along(60.0, 0.2)
WHEEL = BAR + np.array([0.2, 0.0])
# name of the example in models/textbooks.toml -> its result
EXAMPLES: dict[str, Callable[[], Result]] = {
    "Norton, Ferguson's paradox": lambda: train(
        100.0, 0.0, P=("two", -100 / 20), three=("P", -20 / 99), four=("P", -20 / 101)
    ),
    "Shigley 13-6, planetary train": lambda: train(
        -20.0, 0.0, four=("ring", 80 / 30), sun=("four", -30 / 20)
    ),
    "Khurmi 8.1, engine": lambda: engine(0.15, 0.6, 45.0, -300.0),
    "Khurmi 13.4, A fixed": lambda: train(150.0, 0.0, B=("A", -36 / 45)),
    "Khurmi 13.4, A driven": lambda: train(150.0, -300.0, B=("A", -36 / 45)),
    "Khurmi 13.5, reverted train": lambda: train(-100.0, 0.0, DE=("B", -75 / 45), C=("DE", -90 / 30)),
    "Khurmi 13.6, epicyclic train": lambda: train(18.0, 0.0, B=("A", 72 / 20), C=("B", -20 / 32)),
    "Beer 15.3, engine": lambda: engine(0.25, 8 / 12, 40.0, -2000.0),
    "Beer 15.7, engine": lambda: engine(0.25, 8 / 12, 40.0, -2000.0),
    "Beer 15.8, four-bar": lambda: four_bar((0, 0), (8, 14), (20, 17), (37, 0), 20.0),
    "Beer 15.9, Geneva wheel": geneva,
    "Beer 15.10, Geneva wheel": geneva,
    "Beer 16.10, rod on two tracks": rod_on_tracks,
    "Beer 17.5, two rods released": rods_released,
    "Meriam 5/8, four-bar": lambda: four_bar((250, 50), (175, 50), (0, 100), (0, 0), 2.0),
    "Meriam 5/14, four-bar": lambda: four_bar((250, 50), (175, 50), (0, 100), (0, 0), 2.0),
    "Meriam 5/9, engine": lambda: engine(5 / 12, 14 / 12, 60.0, -1500.0, 4 / 14),
    "Meriam 5/15, engine": lambda: engine(5 / 12, 14 / 12, 60.0, -1500.0),
    "Hibbeler 16.8, two collars": collars,
    "Hibbeler 16.9, bar and wheel": lambda: four_bar((0, 0), BAR, WHEEL, WHEEL + np.array([0.0, 0.1]), -30.0),
    "Norton 4-1, four-bar": norton,
    "Norton 6-7, four-bar": norton,
    "Norton 7-1, four-bar": norton,
    "Norton 4-2, offset slider": offset_slider,
    "Khurmi 5.1, quick return": slotted_lever,
    "Khurmi 7.1, four-bar": lambda: four_bar(*lengths(40.0, 150.0, 80.0, 150.0, 60.0), 120.0 * RPM),
    "Khurmi 7.2, engine": lambda: engine(0.5, 2.0, 45.0, -180.0, 0.25),
    "Khurmi 9.9, Hooke's joint": lambda: hooke(20.0, 1500.0, 12.0 * 0.1**2),
    "Khurmi 13.1, gearing of a machine tool": lambda: train(
        0.0, 975.0, BC=("A", -20 / 50), DE=("BC", -25 / 75), F=("DE", -26 / 65)
    ),
    "Hibbeler 16.18, engine": upright_engine,
}


def value(result: Result, quantity: str) -> float:
    """Return a quantity: 'omega LINK', 'v POINT' (size), 'vx POINT', or a key of the result."""
    if not isinstance(result, ms.Motion):
        return float(result[quantity])
    kind, name = quantity.split()
    if kind in OF_LINKS:
        return float(getattr(result.links[name], OF_LINKS[kind])[0, 2])
    vector = getattr(result.points[name], OF_POINTS[kind[0]])[0, :2]
    return float(np.hypot(*vector) if kind in "va" else vector["xy".index(kind[-1])])


def cases(_: Clone | None) -> Iterator[Case]:
    for name, entry in entries("textbooks").items():
        yield printed_case(name, entry, partial(value, EXAMPLES[name]()))


SUITE = Suite(
    "Textbooks: worked examples",
    "",
    "Typed from memory, so the book decides; Khurmi 13.4, 13.6 and Beer 16.10, 17.5 were looked up.",
    cases,
)
