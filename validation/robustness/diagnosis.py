"""How often the diagnosis names the cause of a wrong formula: seeded mistakes in many mechanisms.

    python validation/robustness/diagnosis.py [--cases 500] [--first 0] [--scenes FOLDER] [--show]

Each case takes a mechanism, some of its quantities, and one mistake of one of three sizes. The wrong values
come from another solution or from changed values, never from the code under test. A cause counts as named if
a finding states it, and as first if the first finding does. A wrong cause is stated as certain if every
certain finding is wrong. Correct formulas, with the rounding of another formula, must not be rejected.
"""

import argparse
import json
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from mechsim import catalog, dynamics
from mechsim.errors import MechsimError
from mechsim.io import gallery
from mechsim.io.readers import parametric_model
from mechsim.mechanism.forces import Forces
from mechsim.mechanism.quantities import coordinate_units
from mechsim.studies.agreement.agreement import agreement
from mechsim.studies.agreement.candidate import Candidate, QuantityReader
from mechsim.studies.agreement.evaluation_points import EvaluationPoints, evaluation_points

SPEED = 20.0 * np.pi
SIZES = (1e-4, 3e-3, 5e-2)
SCENES = {
    "g1_ankle.xml": {
        "drive": {
            "left_motor_joint": "0.3*sin(2*pi*0.6*t)",
            "right_motor_joint": "-0.15*sin(2*pi*0.6*t)+0.05*sin(2*pi*1.2*t)",
        },
        "duration": 1.6,
    },
    "robotiq_2f85.xml": {
        "drive": {"right_driver_joint": "0.3*(1-cos(2*pi*t))"},
        "lock": ("right_coupler_joint", "left_coupler_joint"),
    },
}
# of another formula, relative to the quantity
ROUNDING = 1e-13
# slow to solve, with no additional information
OMITTED = ("peaucellier_lipkin",)


@dataclass
class Subject:
    """A mechanism of the study, with values that are computed once."""

    name: str
    options: dict = field(default_factory=dict)

    @cached_property
    def parametric(self):
        """The parametric model."""
        return parametric_model(self.name, **self.options)

    @cached_property
    def solver(self):
        """The solver of its default design."""
        return self.parametric.make({})

    @cached_property
    def evaluation(self) -> EvaluationPoints:
        """Its evaluation points."""
        return evaluation_points(self.solver, SPEED)

    @cached_property
    def reader(self):
        """The reader of its quantities."""
        return QuantityReader(self.solver.mechanism, "the study")

    def evaluated(self, other_solver=None, **changed) -> EvaluationPoints:
        """Return the evaluation points of another solver, or at other driver values."""
        solver = self.solver if other_solver is None else other_solver
        if solver.closed_form is None and self.solver.closed_form is None:
            solver = replace(solver, motion_laws=changed.pop("motion_laws", self.solver.motion_laws))
        points = self.evaluation
        return EvaluationPoints(
            solver,
            changed.get("angle", points.angle),
            changed.get("speed", points.speed),
            points.acceleration,
            points.time,
            dynamic_model=changed.get("dynamic_model"),
        )


@dataclass(frozen=True)
class Mistake:
    """A seeded mistake: its kind, the names of its cause, and the wrong values."""

    kind: str
    causes: tuple[str, ...]
    values: list

    def matches(self, finding) -> bool:
        """Return whether a finding states this cause."""
        if finding.kind != self.kind:
            return False
        return not self.causes or any(
            finding.object == item or finding.object.startswith(f"{item}.") for item in self.causes
        )


def quantities(subject: Subject, random) -> list:
    """Return random quantities of a subject: points, joints, velocities."""
    points = list(subject.solver.mechanism.points)
    point_names = list(random.permutation(points)[: max(2, random.integers(1, 4))])
    requested = [(item, 3) for item in point_names]
    # drivers are excluded
    motion = subject.evaluation.motion
    joints = [
        item
        for item in motion.joints
        if item in coordinate_units(subject.solver.mechanism) and item not in subject.solver.mechanism.drivers
    ]
    if random.random() < 0.6:
        requested += [(item, None) for item in random.permutation(joints)[:2] if item not in points]
    if random.random() < 0.3:
        requested += [(f"{item}.v", 3) for item in point_names[:1]]
    return [subject.reader.read(str(name), width) for name, width in requested]


def wrong_dimension(subject: Subject, readers: list, size_factor: float, random) -> Mistake:
    """Change one dimension."""
    dimensions = [
        dimension for name, dimension in subject.parametric.dimensions.items() if ".tilt." not in name
    ]
    dimension = dimensions[random.integers(len(dimensions))]
    length = subject.solver.mechanism.characteristic_length if dimension.unit == "m" else 1.0
    scale = abs(dimension.value) if abs(dimension.value) > 1e-3 * length else length
    changed = subject.parametric.make(
        {dimension.name: dimension.value + random.choice([-1.0, 1.0]) * size_factor * scale}
    )
    kind = "dimension"
    gear = getattr(subject.solver, "gear", "")
    if gear:
        kind = {gear: "gear", "phase": "phase"}.get(dimension.name, kind)
    elif (
        dimension.unit != "m"
        and subject.solver.mechanism.laws
        and changed.mechanism.joints == subject.solver.mechanism.joints
    ):
        ratios = [law.ratio for law in changed.mechanism.laws]
        kind = "phase" if ratios == [law.ratio for law in subject.solver.mechanism.laws] else "gear"
    names = (dimension.name, dimension.name.split(".")[0]) if ".at." in dimension.name else (dimension.name,)
    return Mistake(kind, names, subject.evaluated(changed).all(readers))


def shifted(subject: Subject, changes: dict) -> EvaluationPoints:
    """Return the evaluation points with changed driver motion: name -> (scale, offset, delay)."""
    motion_laws = subject.solver.motion_laws
    if motion_laws.crank:
        scale, offset, _ = next(iter(changes.values()))
        angle = scale * subject.evaluation.angle + offset
        return subject.evaluated(angle=angle, speed=scale * subject.evaluation.speed)

    def shifted_state(name: str, state):
        scale, offset, delay = changes.get(name, (1.0, 0.0, 0.0))

        def law(t):
            value, rate, acceleration = state(t - delay)
            return scale * value + offset, scale * rate, scale * acceleration

        return law

    states = tuple(
        shifted_state(name, state)
        for name, state in zip(motion_laws.drivers, motion_laws.states, strict=True)
    )
    return subject.evaluated(motion_laws=replace(motion_laws, states=states))


def random_driver(subject: Subject, random) -> str:
    return str(random.choice(list(subject.solver.mechanism.drivers)))


def wrong_offset(subject, readers, size_factor, random) -> Mistake:
    driver = random_driver(subject, random)
    scale = (
        subject.solver.mechanism.characteristic_length
        if subject.solver.mechanism.unit(driver) == "m"
        else 1.0
    )
    return Mistake(
        "offset", (driver,), shifted(subject, {driver: (1.0, size_factor * scale, 0.0)}).all(readers)
    )


def wrong_direction(subject, readers, size_factor, random) -> Mistake:
    driver = random_driver(subject, random)
    return Mistake("sense", (driver,), shifted(subject, {driver: (-1.0, 0.0, 0.0)}).all(readers))


def wrong_angle_unit(subject, readers, size_factor, random) -> Mistake:
    angles = [i for i, item in enumerate(readers) if item.unit == "rad"]
    if not angles:
        driver = random_driver(subject, random)
        if subject.solver.mechanism.unit(driver) == "m":
            raise MechsimError("no angle")
        return Mistake(
            "degrees", (driver,), shifted(subject, {driver: (np.pi / 180.0, 0.0, 0.0)}).all(readers)
        )
    values = subject.evaluation.all(readers)
    for i in angles:
        values[i] = np.rad2deg(values[i])
    return Mistake("degrees", (), values)


def wrong_phase(subject, readers, size_factor, random) -> Mistake:
    motion_laws = subject.solver.motion_laws
    if len(motion_laws.drivers) < 2:
        raise MechsimError("one driver")
    driver = random_driver(subject, random)
    delay = size_factor * motion_laws.duration
    return Mistake("phase", (driver,), shifted(subject, {driver: (1.0, 0.0, delay)}).all(readers))


def delayed(subject, readers, size_factor, random) -> Mistake:
    steps = 1 + SIZES.index(size_factor)
    values = subject.evaluation.all(readers)
    return Mistake(
        "delay", (), [np.concatenate([item[:1].repeat(steps, 0), item[:-steps]]) for item in values]
    )


def wrong_length_unit(subject, readers, size_factor, random) -> Mistake:
    factor = (1000.0, 0.001, 0.01)[SIZES.index(size_factor)]
    values = subject.evaluation.all(readers)
    return Mistake(
        "units",
        (),
        [factor * v if item.unit in ("m", "m/s") else v for item, v in zip(readers, values, strict=True)],
    )


def swapped_points(subject, readers, size_factor, random) -> Mistake:
    positions = [i for i, item in enumerate(readers) if item.kind == "position"]
    if len(positions) < 2 or any(item.kind == "velocity" for item in readers):
        raise MechsimError("one point")
    values = subject.evaluation.all(readers)
    i, j = positions[:2]
    values[i], values[j] = values[j], values[i]
    points = readers[i].subject, readers[j].subject
    return Mistake("swapped", (", ".join(points), ", ".join(points[::-1])), values)


def transformed(subject, readers, matrix, shift) -> list:
    return [
        v @ matrix.T + (shift if item.kind == "position" else 0.0) if item.axes else v
        for item, v in zip(readers, subject.evaluation.all(readers), strict=True)
    ]


def mirrored(subject, readers, size_factor, random) -> Mistake:
    signs = np.ones(3)
    signs[random.integers(3)] = -1.0
    return Mistake("mirror", (), transformed(subject, readers, np.diag(signs), 0.0))


def wrong_frame(subject, readers, size_factor, random) -> Mistake:
    vector = random.normal(size=3)
    vector *= size_factor / np.linalg.norm(vector)
    if random.random() < 0.5:
        return Mistake(
            "frame",
            (),
            transformed(subject, readers, np.eye(3), vector * subject.solver.mechanism.characteristic_length),
        )
    from scipy.spatial.transform import Rotation

    return Mistake("frame", (), transformed(subject, readers, Rotation.from_rotvec(vector).as_matrix(), 0.0))


def other_assembly(subject, readers, size_factor, random) -> Mistake:
    solver = subject.solver
    if solver.closed_form is None:
        raise MechsimError("no closed form")
    selectors = solver.selectors
    angle = float(subject.evaluation.angle[len(subject.evaluation) // 3])
    others = [
        item
        for item in solver.assemblies(angle)
        if {name: getattr(item, name) for name in selectors} != selectors
    ]
    other = others[random.integers(len(others))] if others else None
    if other is None:
        raise MechsimError("one assembly")
    return Mistake("assembly", (), subject.evaluated(other).all(readers))


def wrong_loads(subject, readers, size_factor, random) -> Mistake:
    """Change gravity or the mass of a link behind a torque."""
    forces = Forces(gravity=(0.0, -9.81, 0.0))
    model = dynamics.dynamic_model(subject.solver, forces)
    subject.under = model
    if random.random() < 0.5:
        changed, kind, names = (
            model.with_forces(Forces(gravity=(0.0, -9.81 * (1.0 + size_factor), 0.0))),
            "gravity",
            (),
        )
    else:
        links = list(model.mechanism.links)
        i = random.integers(len(links))
        inertia = links[i].inertia
        moments = tuple(tuple((1.0 + size_factor) * x for x in row) for row in inertia.moments)
        links[i] = replace(
            links[i], inertia=replace(inertia, mass=(1.0 + size_factor) * inertia.mass, moments=moments)
        )
        changed = replace(model, mechanism=replace(model.mechanism, links=tuple(links)))
        kind, names = "mass", (links[i].name,)
    return Mistake(kind, names, subject.evaluated(dynamic_model=changed).all(readers))


KINDS: dict[str, tuple[Callable, int]] = {
    "dimension": (wrong_dimension, 9),
    "offset": (wrong_offset, 4),
    "sense": (wrong_direction, 2),
    "degrees": (wrong_angle_unit, 2),
    "phase": (wrong_phase, 3),
    "delay": (delayed, 2),
    "units": (wrong_length_unit, 2),
    "swapped": (swapped_points, 2),
    "mirror": (mirrored, 2),
    "frame": (wrong_frame, 3),
    "assembly": (other_assembly, 3),
    "loads": (wrong_loads, 3),
}


def subjects(scenes: Path | None) -> Iterator[Subject]:
    for name in [*catalog.MECHANISMS, *gallery.files()]:
        if name not in OMITTED:
            yield Subject(name)
    for file, options in SCENES.items() if scenes else ():
        if (scenes / file).exists():
            yield Subject(str(scenes / file), dict(options))


def diagnose(subject: Subject, readers: list, values: list, random, model=None):
    """Return the report on values with the rounding of another formula."""
    candidates = []
    for item, value in zip(readers, values, strict=True):
        scale = max(1.0, float(np.abs(value).max()))
        candidates.append(Candidate(item, value + ROUNDING * scale * random.normal(size=value.shape)))
    evaluation = subject.evaluation if model is None else replace(subject.evaluation, dynamic_model=model)
    return agreement(evaluation, candidates, "the study", None, subject.parametric)


def run_case(number: int, subjects: list[Subject]) -> dict:
    """Return the result of one case; draw again if a mistake is impossible or has no effect."""
    random = np.random.default_rng(1000 + number)
    kinds = [kind for kind, (_, times) in KINDS.items() for _ in range(times)]
    for _ in range(60):
        kind, size_factor = kinds[random.integers(len(kinds))], SIZES[number % 3]
        subject = subjects[random.integers(len(subjects))]
        loads = kind == "loads"
        try:
            if loads and not (subject.solver.mechanism.has_crank and subject.solver.closed_form is not None):
                continue
            readers = quantities(subject, random)
            if loads:
                crank = subject.solver.mechanism.crank.name
                readers = [subject.reader.read(f"torque:{crank}", None)]
            mistake = KINDS[kind][0](subject, readers, size_factor, random)
        except (MechsimError, KeyError, ValueError, np.linalg.LinAlgError):
            continue
        start = time.process_time()
        result = diagnose(subject, readers, mistake.values, random, subject.under if loads else None)
        if result.passed:
            continue
        findings = [item for item in result.findings if item.kind != "none"]
        matches = [mistake.matches(item) for item in findings]
        return {
            "case": number,
            "subject": Path(subject.name).stem,
            "kind": mistake.kind,
            "what": mistake.causes,
            "size": size_factor,
            "first": bool(matches[:1] and matches[0]),
            "named": any(matches),
            "certain_wrong": any(item.certain for item in findings)
            and not any(right for right, item in zip(matches, findings, strict=True) if item.certain),
            "messages": [item.message for item in result.findings],
            "quantities": [item.name for item in readers],
            "seconds": time.process_time() - start,
        }
    raise SystemExit(f"case {number}: no mistake is possible")


def rejected_correct_formulas(subjects: list[Subject]) -> list[str]:
    """Return the subjects whose correct formula was rejected or has findings."""
    rejected = []
    for k, subject in enumerate(subjects):
        random = np.random.default_rng(k)
        for _ in range(3):
            readers = quantities(subject, random)
            result = diagnose(subject, readers, subject.evaluation.all(readers), random)
            if not result.passed or result.findings:
                rejected.append(subject.name)
    return rejected


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--cases", type=int, default=500)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--scenes", type=Path)
    parser.add_argument("--show", action="store_true", help="print the cases whose cause is not named")
    parser.add_argument("--lines", action="store_true", help="print each case as JSON and nothing else")
    options = parser.parse_args()
    all_subjects = list(subjects(options.scenes))
    rows = []
    for number in range(options.first, options.first + options.cases):
        rows.append(run_case(number, all_subjects))
        if options.lines:
            print(json.dumps(rows[-1]), flush=True)
    rejected = rejected_correct_formulas(all_subjects)
    if options.lines:
        print(json.dumps({"rejected": rejected, "correct": 3 * len(all_subjects)}), flush=True)
        return 0
    return print_summary(rows, rejected, 3 * len(all_subjects), options.show)


def print_summary(rows: list[dict], rejected: list[str], correct: int, show: bool) -> int:
    """Print the results; return 0 if they meet the requirements."""
    by_kind: dict[str, list[dict]] = defaultdict(list)
    for row in rows:
        by_kind[row["kind"]].append(row)
    print(f"{'cause':<12}{'cases':>6}{'named':>7}{'first':>7}{'certain wrong':>14}")
    for kind, group in sorted(by_kind.items()):
        named_count, first_count, wrong_count = (
            count_true(group, name) for name in ("named", "first", "certain_wrong")
        )
        print(f"{kind:<12}{len(group):>6}{named_count:>7}{first_count:>7}{wrong_count:>14}")
    count = len(rows)
    all_named, all_first, all_wrong = (count_true(rows, name) for name in ("named", "first", "certain_wrong"))
    print(f"{'all':<12}{count:>6}{all_named:>7}{all_first:>7}{all_wrong:>14}")
    for size_factor, group in Counter(row["size"] for row in rows).items():
        size_named = sum(row["named"] for row in rows if row["size"] == size_factor)
        print(f"size {size_factor:g}: {size_named} of {group}")
    percentages = [f"{100 * number / count:.1f} %" for number in (all_named, all_first, all_wrong)]
    print(f"named {percentages[0]}, first {percentages[1]}, wrong and certain {percentages[2]}")
    print(f"correct formulas rejected: {len(rejected)} of {correct} {' '.join(sorted(set(rejected)))}")
    print(f"median {np.median([row['seconds'] for row in rows]):.2f} s of processor time a case")
    for row in rows if show else ():
        if not row["named"] or row["certain_wrong"]:
            print({name: value for name, value in row.items() if name not in ("first", "seconds")})
    return 0 if all_named >= 0.95 * count and all_wrong <= 0.01 * count and not rejected else 1


def count_true(rows: list[dict], name: str) -> int:
    return sum(bool(row[name]) for row in rows)


if __name__ == "__main__":
    sys.exit(main())
