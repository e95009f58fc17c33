"""How often the cause of a wrong formula is named right: seeded mistakes over catalogue, gallery, scenes.

    python validation/robustness/diagnosis.py [--cases 500] [--first 0] [--scenes FOLDER] [--show]

Each case takes a mechanism, some of its quantities, and one mistake at one of three sizes; what would then be
claimed is made by solving anew, or by changing values, never by what is judged. A cause counts as named
where it is said first or said to explain as much as the first; a wrong cause as stated as sure where all that
is said to be sure is wrong. Right formulas, with the rounding of another one, are to be left in peace.
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

from mechsim.analytic import catalog, dynamics
from mechsim.analytic.catalog.base import ClosedForm
from mechsim.analytic.catalog.formulas import SELECTORS
from mechsim.analytic.loops.loop_form import LoopForm
from mechsim.errors import MechsimError
from mechsim.model.forces import Forces
from mechsim.model.quantities import coordinate_units
from mechsim.studies.agreement.agreement import agreement
from mechsim.studies.agreement.candidate import Candidate, QuantityReader
from mechsim.studies.agreement.evaluation_points import EvaluationPoints, evaluation_points
from mechsim.subjects import gallery
from mechsim.subjects.readers import parametric_model

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
# of another formula, as a part of what it measures
ROUNDING = 1e-13
# slow to solve, and not more telling than others
LEFT_OUT = ("peaucellier_lipkin",)


@dataclass
class Subject:
    """A mechanism of the study, and what is kept of it from case to case."""

    name: str
    asked: dict = field(default_factory=dict)

    @cached_property
    def family(self):
        """The mechanism among others."""
        return parametric_model(self.name, **self.asked)

    @cached_property
    def solver(self):
        """What moves."""
        return self.family.make({})

    @cached_property
    def evaluation(self) -> EvaluationPoints:
        """Its instants."""
        return evaluation_points(self.solver, SPEED)

    @cached_property
    def reader(self):
        """Reads names of its quantities."""
        return QuantityReader(self.solver.mechanism, "the study")

    def solved(self, form=None, **changed) -> EvaluationPoints:
        """Return the same instants of something else, or elsewhere, solved anew."""
        made = self.solver if form is None else form
        if isinstance(made, LoopForm) and isinstance(self.solver, LoopForm):
            made = replace(made, motion_laws=changed.pop("motion_laws", self.solver.motion_laws))
        item = self.evaluation
        return EvaluationPoints(
            made,
            changed.get("angle", item.angle),
            changed.get("speed", item.speed),
            item.acceleration,
            item.time,
            dynamic_model=changed.get("dynamic_model"),
        )


@dataclass(frozen=True)
class Mistake:
    """What was claimed, and by which names its cause may be called."""

    kind: str
    what: tuple[str, ...]
    values: list

    def named_by(self, finding) -> bool:
        """Whether a finding is of this cause."""
        if finding.kind != self.kind:
            return False
        return not self.what or any(
            finding.what == item or finding.what.startswith(f"{item}.") for item in self.what
        )


def quantities(subject: Subject, random) -> list:
    """Return some quantities of a subject: points, or points and joints, or with rates."""
    points = list(subject.solver.mechanism.points)
    chosen = list(random.permutation(points)[: max(2, random.integers(1, 4))])
    names = [(item, 3) for item in chosen]
    # of links that stand no one draws a curve
    motion = subject.evaluation.motion
    joints = [
        item
        for item in motion.joints
        if item in coordinate_units(subject.solver.mechanism) and item not in subject.solver.mechanism.drivers
    ]
    if random.random() < 0.6:
        names += [(item, None) for item in random.permutation(joints)[:2] if item not in points]
    if random.random() < 0.3:
        names += [(f"{item}.v", 3) for item in chosen[:1]]
    return [subject.reader.read(str(name), width) for name, width in names]


def of_dimension(subject: Subject, named: list, size: float, random) -> Mistake:
    """One dimension larger or smaller."""
    dimensions = [item for name, item in subject.family.dimensions.items() if ".tilt." not in name]
    item = dimensions[random.integers(len(dimensions))]
    whole = subject.solver.mechanism.characteristic_length if item.unit == "m" else 1.0
    scale = abs(item.value) if abs(item.value) > 1e-3 * whole else whole
    made = subject.family.make({item.name: item.value + random.choice([-1.0, 1.0]) * size * scale})
    kind = "dimension"
    gear = getattr(subject.solver, "gear", "")
    if gear:
        kind = {gear: "gear", "phase": "phase"}.get(item.name, kind)
    elif (
        item.unit != "m"
        and subject.solver.mechanism.laws
        and made.mechanism.joints == subject.solver.mechanism.joints
    ):
        slopes = [law.ratio for law in made.mechanism.laws]
        kind = "phase" if slopes == [law.ratio for law in subject.solver.mechanism.laws] else "gear"
    what = (item.name, item.name.split(".")[0]) if ".at." in item.name else (item.name,)
    return Mistake(kind, what, subject.solved(made).all(named))


def shifted(subject: Subject, change: dict) -> EvaluationPoints:
    """Return a subject whose drivers go otherwise: name -> (scale, offset, late by)."""
    motion_laws = subject.solver.motion_laws
    if motion_laws.crank:
        scale, offset, _ = next(iter(change.values()))
        angle = scale * subject.evaluation.angle + offset
        return subject.solved(angle=angle, speed=scale * subject.evaluation.speed)

    def moved(name: str, state):
        scale, offset, late = change.get(name, (1.0, 0.0, 0.0))

        def other(t):
            value, rate, second = state(t - late)
            return scale * value + offset, scale * rate, scale * second

        return other

    states = tuple(
        moved(name, state) for name, state in zip(motion_laws.drivers, motion_laws.states, strict=True)
    )
    return subject.solved(motion_laws=replace(motion_laws, states=states))


def driver_of(subject: Subject, random) -> str:
    return str(random.choice(list(subject.solver.mechanism.drivers)))


def of_offset(subject, named, size, random) -> Mistake:
    driver = driver_of(subject, random)
    unit = (
        subject.solver.mechanism.characteristic_length
        if subject.solver.mechanism.unit(driver) == "m"
        else 1.0
    )
    return Mistake("offset", (driver,), shifted(subject, {driver: (1.0, size * unit, 0.0)}).all(named))


def of_sense(subject, named, size, random) -> Mistake:
    driver = driver_of(subject, random)
    return Mistake("sense", (driver,), shifted(subject, {driver: (-1.0, 0.0, 0.0)}).all(named))


def of_degrees(subject, named, size, random) -> Mistake:
    angles = [i for i, item in enumerate(named) if item.unit == "rad"]
    if not angles:
        driver = driver_of(subject, random)
        if subject.solver.mechanism.unit(driver) == "m":
            raise MechsimError("no angle")
        return Mistake("degrees", (driver,), shifted(subject, {driver: (np.pi / 180.0, 0.0, 0.0)}).all(named))
    values = subject.evaluation.all(named)
    for i in angles:
        values[i] = np.rad2deg(values[i])
    return Mistake("degrees", (), values)


def of_phase(subject, named, size, random) -> Mistake:
    motion_laws = subject.solver.motion_laws
    if len(motion_laws.drivers) < 2:
        raise MechsimError("one driver")
    driver = driver_of(subject, random)
    late = size * motion_laws.duration
    return Mistake("phase", (driver,), shifted(subject, {driver: (1.0, 0.0, late)}).all(named))


def of_delay(subject, named, size, random) -> Mistake:
    late = 1 + SIZES.index(size)
    values = subject.evaluation.all(named)
    return Mistake("delay", (), [np.concatenate([item[:1].repeat(late, 0), item[:-late]]) for item in values])


def of_units(subject, named, size, random) -> Mistake:
    factor = (1000.0, 0.001, 0.01)[SIZES.index(size)]
    values = subject.evaluation.all(named)
    return Mistake(
        "units",
        (),
        [factor * v if item.unit in ("m", "m/s") else v for item, v in zip(named, values, strict=True)],
    )


def of_swapped(subject, named, size, random) -> Mistake:
    places = [i for i, item in enumerate(named) if item.kind == "position"]
    if len(places) < 2 or any(item.kind == "velocity" for item in named):
        raise MechsimError("one point")
    values = subject.evaluation.all(named)
    i, j = places[:2]
    values[i], values[j] = values[j], values[i]
    both = named[i].subject, named[j].subject
    return Mistake("swapped", (", ".join(both), ", ".join(both[::-1])), values)


def turned(subject, named, matrix, shift) -> list:
    return [
        v @ matrix.T + (shift if item.kind == "position" else 0.0) if item.axes else v
        for item, v in zip(named, subject.evaluation.all(named), strict=True)
    ]


def of_mirror(subject, named, size, random) -> Mistake:
    signs = np.ones(3)
    signs[random.integers(3)] = -1.0
    return Mistake("mirror", (), turned(subject, named, np.diag(signs), 0.0))


def of_frame(subject, named, size, random) -> Mistake:
    vector = random.normal(size=3)
    vector *= size / np.linalg.norm(vector)
    if random.random() < 0.5:
        return Mistake(
            "frame",
            (),
            turned(subject, named, np.eye(3), vector * subject.solver.mechanism.characteristic_length),
        )
    from scipy.spatial.transform import Rotation

    return Mistake("frame", (), turned(subject, named, Rotation.from_rotvec(vector).as_matrix(), 0.0))


def of_assembly(subject, named, size, random) -> Mistake:
    form = subject.solver
    if not isinstance(form, ClosedForm):
        raise MechsimError("no closed form")
    own = {name: getattr(form, name) for name in SELECTORS if hasattr(form, name)}
    middle = float(subject.evaluation.angle[len(subject.evaluation) // 3])
    others = [item for item in form.assemblies(middle) if {name: getattr(item, name) for name in own} != own]
    other = others[random.integers(len(others))] if others else None
    if other is None:
        raise MechsimError("one assembly")
    return Mistake("assembly", (), subject.solved(other).all(named))


def of_loads(subject, named, size, random) -> Mistake:
    """A torque and a reaction under another gravity, or with a link of another mass."""
    forces = Forces(gravity=(0.0, -9.81, 0.0))
    machine = dynamics.dynamic_model(subject.solver, forces)
    subject.under = machine
    if random.random() < 0.5:
        other, kind, what = (
            machine.with_forces(Forces(gravity=(0.0, -9.81 * (1.0 + size), 0.0))),
            "gravity",
            (),
        )
    else:
        links = list(machine.mechanism.links)
        k = random.integers(len(links))
        inertia = links[k].inertia
        rows = tuple(tuple((1.0 + size) * x for x in row) for row in inertia.moments)
        links[k] = replace(links[k], inertia=replace(inertia, mass=(1.0 + size) * inertia.mass, moments=rows))
        other = replace(machine, mechanism=replace(machine.mechanism, links=tuple(links)))
        kind, what = "mass", (links[k].name,)
    return Mistake(kind, what, subject.solved(dynamic_model=other).all(named))


KINDS: dict[str, tuple[Callable, int]] = {
    "dimension": (of_dimension, 9),
    "offset": (of_offset, 4),
    "sense": (of_sense, 2),
    "degrees": (of_degrees, 2),
    "phase": (of_phase, 3),
    "delay": (of_delay, 2),
    "units": (of_units, 2),
    "swapped": (of_swapped, 2),
    "mirror": (of_mirror, 2),
    "frame": (of_frame, 3),
    "assembly": (of_assembly, 3),
    "loads": (of_loads, 3),
}


def subjects(scenes: Path | None) -> Iterator[Subject]:
    for name in [*catalog.DRIVES, *gallery.files()]:
        if name not in LEFT_OUT:
            yield Subject(name)
    for file, asked in SCENES.items() if scenes else ():
        if (scenes / file).exists():
            yield Subject(str(scenes / file), dict(asked))


def judged(subject: Subject, named: list, values: list, random, under=None):
    """Return what is said of claims, with the rounding of another formula on them."""
    candidates = []
    for item, value in zip(named, values, strict=True):
        scale = max(1.0, float(np.abs(value).max()))
        candidates.append(Candidate(item, value + ROUNDING * scale * random.normal(size=value.shape)))
    evaluation = subject.evaluation if under is None else replace(subject.evaluation, dynamic_model=under)
    return agreement(evaluation, candidates, "the study", None, subject.family)


def one_case(number: int, among: list[Subject]) -> dict:
    """Return what came of one case; no verdict where a mistake cannot be made or cannot be seen."""
    random = np.random.default_rng(1000 + number)
    kinds = [kind for kind, (_, times) in KINDS.items() for _ in range(times)]
    for _ in range(60):
        kind, size = kinds[random.integers(len(kinds))], SIZES[number % 3]
        subject = among[random.integers(len(among))]
        loads = kind == "loads"
        try:
            if loads and not (subject.solver.mechanism.has_crank and isinstance(subject.solver, ClosedForm)):
                continue
            named = quantities(subject, random)
            if loads:
                crank = subject.solver.mechanism.crank.name
                named = [subject.reader.read(f"torque:{crank}", None)]
            mistake = KINDS[kind][0](subject, named, size, random)
        except (MechsimError, KeyError, ValueError, np.linalg.LinAlgError):
            continue
        begin = time.process_time()
        result = judged(subject, named, mistake.values, random, subject.under if loads else None)
        if result.passed:
            continue
        findings = [item for item in result.findings if item.kind != "none"]
        named_right = [mistake.named_by(item) for item in findings]
        return {
            "case": number,
            "subject": Path(subject.name).stem,
            "kind": mistake.kind,
            "what": mistake.what,
            "size": size,
            "first": bool(named_right[:1] and named_right[0]),
            "named": any(named_right),
            "sure_wrong": any(item.certain for item in findings)
            and not any(right for right, item in zip(named_right, findings, strict=True) if item.certain),
            "said": [item.message for item in result.findings],
            "quantities": [item.name for item in named],
            "seconds": time.process_time() - begin,
        }
    raise SystemExit(f"case {number}: no mistake could be made")


def right_ones(among: list[Subject]) -> list[str]:
    """Return the subjects whose right formula was accused."""
    accused = []
    for k, subject in enumerate(among):
        random = np.random.default_rng(k)
        for _ in range(3):
            named = quantities(subject, random)
            result = judged(subject, named, subject.evaluation.all(named), random)
            if not result.passed or result.findings:
                accused.append(subject.name)
    return accused


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--cases", type=int, default=500)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--scenes", type=Path)
    parser.add_argument("--show", action="store_true", help="print the cases that were not named")
    parser.add_argument("--lines", action="store_true", help="print each case as JSON and nothing else")
    asked = parser.parse_args()
    among = list(subjects(asked.scenes))
    rows = []
    for number in range(asked.first, asked.first + asked.cases):
        rows.append(one_case(number, among))
        if asked.lines:
            print(json.dumps(rows[-1]), flush=True)
    accused = right_ones(among)
    if asked.lines:
        print(json.dumps({"accused": accused, "right": 3 * len(among)}), flush=True)
        return 0
    return print_summary(rows, accused, 3 * len(among), asked.show)


def print_summary(rows: list[dict], accused: list[str], right: int, show: bool) -> int:
    """Print what came of the cases; 0 where it is what was asked for."""
    by: dict[str, list[dict]] = defaultdict(list)
    for row in rows:
        by[row["kind"]].append(row)
    print(f"{'cause':<12}{'cases':>6}{'named':>7}{'first':>7}{'sure, wrong':>13}")
    for kind, some in sorted(by.items()):
        good, item, bad = (_sum(some, name) for name in ("named", "first", "sure_wrong"))
        print(f"{kind:<12}{len(some):>6}{good:>7}{item:>7}{bad:>13}")
    count = len(rows)
    named, first, wrong = (_sum(rows, name) for name in ("named", "first", "sure_wrong"))
    print(f"{'all':<12}{count:>6}{named:>7}{first:>7}{wrong:>13}")
    for size, some in Counter(row["size"] for row in rows).items():
        right_named = sum(row["named"] for row in rows if row["size"] == size)
        print(f"size {size:g}: {right_named} of {some}")
    parts = [f"{100 * part / count:.1f} %" for part in (named, first, wrong)]
    print(f"named {parts[0]}, first {parts[1]}, wrong and sure {parts[2]}")
    print(f"right formulas accused: {len(accused)} of {right} {' '.join(sorted(set(accused)))}")
    print(f"median {np.median([row['seconds'] for row in rows]):.2f} s of processor time a case")
    for row in rows if show else ():
        if not row["named"] or row["sure_wrong"]:
            print({name: value for name, value in row.items() if name not in ("first", "seconds")})
    return 0 if named >= 0.95 * count and wrong <= 0.01 * count and not accused else 1


def _sum(rows: list[dict], name: str) -> int:
    return sum(bool(row[name]) for row in rows)


if __name__ == "__main__":
    sys.exit(main())
