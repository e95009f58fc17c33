"""Impossible masses and inertias, and numbers in a wrong unit."""

from collections.abc import Iterator

import mujoco
import numpy as np

from mechsim.mechanism.finding import Finding
from mechsim.mechanism.links import GROUND
from mechsim.numerics.arrays import ROUNDING, Array
from mechsim.simulation.findings.inspected import Inspected
from mechsim.simulation.mjcf.joints import UNLIMITED
from mechsim.simulation.state import HINGE, SLIDE, gravity

# largest plausible radius of gyration, in characteristic lengths; 10 times this for the centre of mass
MAX_SPREAD = 3.0
# largest plausible density in [kg/m3]: osmium has 22,600, invented masses of weightless scenes reach 2e7,
# and a mass in g with an inertia in kg m2 multiplies the density by 1e3**2.5
MAX_DENSITY = 1e8
# fraction of the heaviest moving body's mass at or below which a body counts as massless
MASSLESS = 1e-7


def impossible(scene: Inspected) -> Iterator[Finding]:
    """Yield the moving bodies with an impossible mass or inertia."""
    model = scene.model
    moving = np.flatnonzero(model.body_weldid)
    heaviest = float(model.body_mass[moving].max(initial=0.0))
    carried = carried_masses(scene)
    for b in moving.tolist():
        name = str(model.body(b).name)
        mass, moments = float(model.body_mass[b]), np.sort(model.body_inertia[b])
        element = scene.read.spec.body(name)
        problem = _triangle_violation(_moments(element)) if element.explicitinertial else None
        if not problem and element.explicitinertial and element.mass < 0.0:
            problem = float(element.mass), f"has a mass of {element.mass:g} kg", "no body has it: weigh it"
        if not problem and mass > MASSLESS * heaviest:
            problem = _implausible_size(scene, mass, moments, float(np.linalg.norm(model.body_ipos[b])))
        by = float(carried[b])
        if not problem and model.body_jntnum[b] and by <= MASSLESS * heaviest:
            what = f"has a mass of {by:.2g} kg with all it carries, negligible next to {heaviest:.2g} kg"
            problem = by, what, "weigh it"
        if problem:
            by, what, remedy = problem
            yield scene.finding("inertia", element, abs(by), f"body {name} {what}", remedy)


def carried_masses(scene: Inspected) -> Array:
    """Return the masses of the bodies with their subtrees, (nbody,) in [kg]; masses in the file precede."""
    model = scene.model
    stated = {body.name: float(body.mass) for body in scene.read.spec.bodies if body.explicitinertial}
    masses = enumerate(model.body_mass.tolist())
    total = np.array([stated.get(str(model.body(b).name), mass) for b, mass in masses])
    # MuJoCo numbers a body after its parent
    for b in range(model.nbody - 1, 0, -1):
        total[model.body_parentid[b]] += total[b]
    return total


def _moments(body: mujoco.MjsBody) -> Array:
    """Return the principal moments of a body in the file, ascending, (3,) in [kg m2]."""
    full = np.array(body.fullinertia)
    if not np.isfinite(full).all():
        return np.sort(body.inertia)
    xx, yy, zz, xy, xz, yz = full
    return np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _triangle_violation(moments: Array) -> tuple[float, str, str] | None:
    """Return size, problem and remedy if ascending moments violate the triangle inequality, else None."""
    low, middle, high = (float(value) for value in moments)
    listed = ", ".join(f"{value:.4g}" for value in (low, middle, high))
    if not low >= 0.0:
        return low, f"has a negative moment of inertia ({listed} kg m2)", "correct its inertia"
    if high > (low + middle) * (1.0 + ROUNDING) + 1e-300:
        return (
            high / (low + middle) if low + middle else np.inf,
            f"has moments of inertia {listed} kg m2, of which the largest exceeds the sum of the others",
            "no body has them: look for exchanged or mistyped moments",
        )
    return None


def _implausible_size(
    scene: Inspected, mass: float, moments: Array, offset: float
) -> tuple[float, str, str] | None:
    """Return size, problem and remedy of a mass and moments implausible for the scene's size, else None."""
    radius = float(np.sqrt(moments[2] / mass))
    if radius > MAX_SPREAD * max(scene.length, offset):
        return (
            radius,
            f"has a radius of gyration of {radius:.3g} m, in a scene of {scene.length:.3g} m",
            "its inertia looks like kg mm2 or g mm2: write kg m2",
        )
    if offset > MAX_SPREAD * 10.0 * scene.length:
        return (
            offset,
            f"has its centre of mass {offset:.3g} m from its origin, in a scene of {scene.length:.3g} m",
            "its position looks like mm: write m",
        )
    # volume of the solid sphere with the largest moment; rods have less
    volume = 4.0 / 3.0 * np.pi * (2.5**0.5 * radius) ** 3
    if volume > 0.0 and mass / volume > MAX_DENSITY:
        return (
            mass / volume,
            f"has moments of inertia so small for its mass that it is {mass / volume:.2g} kg/m3 dense",
            "its mass looks like g, or its inertia like that of another body: write kg and kg m2",
        )
    return None


# length of a link in [m], and ratio of a body's distance from its parent to the median distance, above
# which lengths look like mm
MAX_LENGTH, MAX_RATIO = 10.0, 100.0
# largest plausible end of the range of a slide in a loop, in characteristic lengths: no loop reaches so far,
# and mm taken for m are a thousand times as far
MAX_STROKE = 50.0
# density in [kg/m3] of osmium, the densest material, and least radius, in characteristic lengths, of a ball
# of it that a body must outweigh: point masses and invented inertias of 1 kg in 0.1 m are accepted
MAX_MATERIAL_DENSITY, LEAST_RADIUS = 22_600.0, 0.25
# range of a hinge of a loop in [rad] above which it looks like degrees; ranges of all hinges in degrees up to
# which they look like rad
WIDE_RANGE, NARROW_RANGE = 10.0, 2.0 * np.pi
# multiples of pi that are written as ranges in rad, and the relative rounding to three digits
FRACTIONS_OF_PI, THREE_DIGITS = np.array([1 / 6, 1 / 4, 1 / 3, 1 / 2, 2 / 3, 3 / 4, 1.0, 3 / 2, 2.0]), 6e-4


def mistaken_units(scene: Inspected) -> Iterator[Finding]:
    """Yield lengths, masses and angles that look like values in another unit."""
    yield from _lengths(scene)
    yield from _strokes(scene)
    yield from _masses(scene)
    yield from _angles(scene)


def _lengths(scene: Inspected) -> Iterator[Finding]:
    model, longest = scene.model, _longest_link(scene)
    if longest > MAX_LENGTH:
        message = f"links are up to {longest:.3g} m long: their lengths look like mm"
        remedy = "MuJoCo takes gravity as 9.81 in the units of lengths: write m"
        yield scene.finding("units", None, longest, message, remedy, "lengths")
        return
    distances = {b: _distance(scene, b) for b in np.flatnonzero(model.body_weldid).tolist()}
    lengths = sorted(by for by in distances.values() if by > 0.0) or [0.0]
    middle = 0.5 * (lengths[(len(lengths) - 1) // 2] + lengths[len(lengths) // 2])
    for b, by in distances.items():
        if middle > 0.0 and by > MAX_RATIO * middle and by > 1.0:
            name = str(model.body(b).name)
            message = f"body {name} is {by:.3g} m from the next, others {middle:.2g} m: it looks like mm"
            yield scene.finding("units", scene.read.spec.body(name), by, message, "write m")


def _longest_link(scene: Inspected) -> float:
    """Return the largest extent of the joints of a moving link in [m]; ground pivots may be far apart."""
    ends = [end for joint in scene.read.mechanism.joints for end in (joint.a, joint.b) if end.link != GROUND]
    points = {end.link: [other.point for other in ends if other.link == end.link] for end in ends}
    return max((float(np.linalg.norm(np.ptp(own, axis=0))) for own in points.values()), default=0.0)


def _distance(scene: Inspected, b: int) -> float:
    """Return the distance in [m] of a body from its parent, or from the next tree if that is the ground."""
    model = scene.model
    if model.body_weldid[model.body_parentid[b]] != 0:
        return float(np.linalg.norm(model.body_pos[b]))
    others = (model.body_weldid != 0) & (model.body_rootid != model.body_rootid[b])
    away = np.linalg.norm(scene.started.xpos[others] - scene.started.xpos[b], axis=1)
    return float(away.min()) if len(away) else 0.0


def _strokes(scene: Inspected) -> Iterator[Finding]:
    """Yield slides of loops with ranges far beyond the size of the mechanism."""
    model = scene.model
    for j in np.flatnonzero(model.jnt_limited & (model.jnt_type == SLIDE)).tolist():
        low, high = (float(end) for end in model.jnt_range[j])
        by = max(abs(end) for end in (low, high, 0.0) if abs(end) < UNLIMITED)
        name = str(model.joint(j).name)
        if by > MAX_STROKE * scene.length and _in_loop(scene, j):
            message = (
                f"{name} of a loop has the range {low:g} to {high:g} m in a mechanism of "
                f"{scene.length:.2g} m: it looks like mm"
            )
            remedy = 'write m, or limited="false" if nothing limits it'
            yield scene.finding("units", scene.read.spec.joint(name), by, message, remedy)


def _masses(scene: Inspected) -> Iterator[Finding]:
    """Yield the bodies that are too heavy, if they hold most of the mass; weightless scenes invent masses."""
    model = scene.model
    moving = np.flatnonzero(model.body_weldid)
    mass, moment = model.body_mass[moving], model.body_inertia[moving].max(1, initial=0.0)
    # of all bodies with a mass and a largest moment, a ball of uniform density takes the least space
    radius = np.maximum(np.sqrt(2.5 * moment / np.maximum(mass, 1e-300)), LEAST_RADIUS * scene.length)
    most = MAX_MATERIAL_DENSITY * 4.0 / 3.0 * np.pi * radius**3
    if not any(gravity(model)) or not mass[mass > most].sum() > 0.5 * mass.sum():
        return
    names = [str(model.body(b).name) for b in moving[mass > most].tolist()]
    i = int(np.argmax(mass * (mass > most)))
    name = str(model.body(moving[i]).name)
    message = (
        f"body {name} weighs {mass[i]:.3g} kg, more than a ball of osmium of its size, {most[i]:.2g} kg: "
        "masses look like g"
    )
    body, remedy = scene.read.spec.body(name), "write kg, and kg m2 for inertias"
    yield scene.finding("units", body, float(mass[i]), message, remedy, ", ".join(names))


def _angles(scene: Inspected) -> Iterator[Finding]:
    model, spec = scene.model, scene.read.spec
    hinges = np.flatnonzero((model.jnt_limited != 0) & (model.jnt_type == HINGE)).tolist()
    ends = np.where(np.abs(model.jnt_range) < UNLIMITED, np.abs(model.jnt_range), 0.0)
    widths = {j: float(ends[j].max()) for j in hinges}
    wide = [j for j, width in widths.items() if width > WIDE_RANGE and _in_loop(scene, j)]
    # a range of several revolutions in degrees is intended
    if wide and not spec.compiler.degree:
        names = ", ".join(str(model.joint(j).name) for j in wide)
        low, high = model.jnt_range[max(wide, key=lambda j: widths[j])]
        joint, by = spec.joint(model.joint(wide[0]).name), max(widths[j] for j in wide)
        message = f"{names} of a loop have the range {low:g} to {high:g} rad, which looks like degrees"
        remedy = 'write rad, or angle="degree" for the whole file'
        yield scene.finding("units", joint, by, message, remedy, names)
    narrow = [j for j, width in widths.items() if 0.0 < np.rad2deg(width) <= NARROW_RANGE]
    all_narrow = len(narrow) == len(hinges) > 1
    suspicious = [j for j in narrow if all_narrow or _has_fraction_of_pi(np.rad2deg(model.jnt_range[j]))]
    if spec.compiler.degree and suspicious:
        j = max(suspicious, key=lambda j: widths[j])
        what = "no hinge" if all_narrow else f"hinge {model.joint(j).name}"
        names = "angles" if all_narrow else ", ".join(str(model.joint(j).name) for j in suspicious)
        message = f"{what} may turn by more than {np.rad2deg(widths[j]):.3g} deg: the ranges look like rad"
        remedy = 'angles are degrees unless the file says <compiler angle="radian"/>'
        yield scene.finding("units", spec.joint(model.joint(j).name), widths[j], message, remedy, names)


def _has_fraction_of_pi(values: Array) -> bool:
    """Return whether one of some numbers is a usual fraction of pi, rounded to three digits or more."""
    fractions = np.pi * FRACTIONS_OF_PI
    return bool((np.abs(np.abs(values)[:, None] - fractions) <= THREE_DIGITS * fractions).any())


def _in_loop(scene: Inspected, j: int) -> bool:
    """Return whether a joint changes the loops."""
    jacobian, _ = scene.generic
    return bool(np.abs(jacobian[:, int(scene.model.jnt_dofadr[j])]).max(initial=0.0) > 0.0)
