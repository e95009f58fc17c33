"""Violations of the rules of `mechsim check` in a file, and repairs."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace

import mujoco
import numpy as np

from mechsim.errors import MechsimError
from mechsim.mechanism.finding import HARMLESS, Finding, by_severity
from mechsim.simulation.closed_configurations import (
    StraightPath,
    driver_ranges,
    outside_limits,
    straight_path,
)
from mechsim.simulation.findings import findings_in
from mechsim.simulation.findings.compliance import MAX_IMPEDANCE, MIN_STEPS
from mechsim.simulation.findings.damping import LOSSES
from mechsim.simulation.findings.inspected import Inspected, loop_rank
from mechsim.simulation.findings.rule_table import with_severity
from mechsim.simulation.mjcf.compiling import quiet
from mechsim.simulation.mjcf.edited_text import EditedText, Element, equality_elements, set_options
from mechsim.simulation.mjcf_reader.coordinates import actuator_names
from mechsim.simulation.mjcf_reader.equality_constraints import CONNECT, WELD, is_readable
from mechsim.simulation.mjcf_reader.mjcf_model import MjcfModel
from mechsim.simulation.state import limited_joints

# number of random configurations that test the limits of passive joints, and the seed
DRAWN, SEED = 200, 0
# fraction of closed configurations that a passive joint's limits may reject without a finding
REJECTED = 0.01
# transmission of an actuator that the dynamics leaves out -> what it acts by
TRANSMISSIONS = {
    int(mujoco.mjtTrn.mjTRN_SITE): "the force of a site",
    int(mujoco.mjtTrn.mjTRN_SLIDERCRANK): "a slider-crank of sites",
    int(mujoco.mjtTrn.mjTRN_BODY): "the contacts of a body",
}


def violations(read: MjcfModel) -> list[Finding]:
    """Return the findings of all rules in a model, errors first, with the path of their file."""
    with quiet():
        scene, path = Inspected(read), None
        with suppress(MechsimError, FloatingPointError, np.linalg.LinAlgError):  # no loops, or open ones
            path = straight_path(scene.model, None, scene.sample_states[scene.regular[0]])
        reported = [*findings_in(scene), *_unread_actuators(scene)]
        if path is not None:
            fighting = {finding.object for finding in reported if finding.kind == "actuator"}
            reported += [each for each in _passive_actuators(scene, path) if each.object not in fighting]
            reported += [*_passive_limits(path), *_loop_joints(path)]
        reported += [*_singular_start(scene), *_unchecked(scene), *read.unread]
    return [
        replace(finding, file=finding.file or read.path)
        for finding in by_severity(*sorted(map(with_severity, reported), key=lambda finding: finding.rule))
    ]


def unreadable(path: str, reason: str) -> Finding:
    """Return the finding on a file that cannot be read, one of several."""
    message = reason.removeprefix(f"{path}: ")
    return with_severity(Finding(kind="unreadable", object=path, value=1.0, message=message, file=path))


def _singular_start(scene: Inspected) -> Iterator[Finding]:
    """Yield a finding where the loops have a lower rank at the start than nearby."""
    if 0 not in scene.regular:
        own, regular = (loop_rank(scene.sample_jacobians[i][0]) for i in (0, scene.regular[0]))
        message = f"the start is singular: the equations of the loops have rank {own} there, {regular} nearby"
        remedy = "start away from it, by a keyframe or the poses of the bodies"
        yield Finding(
            kind="singular-start", object="loops", value=regular - own, message=message, remedy=remedy
        )


def _passive_actuators(scene: Inspected, path: StraightPath) -> Iterator[Finding]:
    """Yield motors on joints that the loops determine from other actuated joints."""
    model = path.loops.model
    on_joint = np.flatnonzero(model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT)
    joints, passive = model.actuator_trnid[on_joint, 0], model.dof_jntid[path.passive]
    actuated = {*model.jnt_dofadr[joints].tolist()}
    for a, joint in zip(on_joint.tolist(), joints.tolist(), strict=True):
        dof = int(model.jnt_dofadr[joint])
        if joint in passive and _determined(scene, dof, actuated):
            name, joint_name = actuator_names(model)[a], model.joint(joint).name
            locked = _determined(scene, dof, set())
            reason = "equalities lock" if locked else "loops determine from the other actuators"
            message = f"actuator {name} acts on {joint_name}, which the {reason}"
            remedy = f"leave {name} out, or give all of them forces that agree"
            yield scene.finding("passive-actuator", None, 1.0, message, remedy, name)


def _unread_actuators(scene: Inspected) -> Iterator[Finding]:
    """Yield actuators whose transmission the dynamics leaves out."""
    names, kinds = actuator_names(scene.model), scene.model.actuator_trntype.tolist()
    for name, kind, element in zip(names, kinds, scene.read.spec.actuators, strict=True):
        if kind in TRANSMISSIONS:
            message = f"actuator {name} acts by {TRANSMISSIONS[kind]}, which the dynamics leaves out"
            yield scene.finding("unread", element, 1.0, message, "let it act on a joint or a tendon", name)


def _determined(scene: Inspected, dof: int, actuated: set[int]) -> bool:
    """Return whether the loops and the other actuated DOFs determine a DOF in every regular sample state."""
    unit = np.eye(scene.model.nv)
    others = unit[sorted(actuated - {dof})]
    return all(
        loop_rank(np.vstack([jacobian, others, unit[dof]])) == loop_rank(np.vstack([jacobian, others]))
        for jacobian in (scene.sample_jacobians[number][0] for number in scene.regular)
    )


def _passive_limits(path: StraightPath) -> Iterator[Finding]:
    """Yield passive joints whose limits reject closed configurations within the drivers' limits."""
    model = path.loops.model
    limits = limited_joints(model)
    limited = limits[np.isin(limits, model.dof_jntid[path.passive])]
    on_joint = model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT
    actuated = np.isin(model.dof_jntid[path.drivers], model.actuator_trnid[on_joint, 0])
    if not len(limited) or not len(actuated) or not actuated.all():
        return
    low, high = driver_ranges(path)
    qpos, closed = path.follow(np.random.default_rng(SEED).uniform(low, high, (DRAWN, len(low))))
    if not closed.any():
        return
    rejected = outside_limits(model, qpos[closed]).mean(0)
    for joint in limited.tolist():
        by, name = float(rejected[joint]), model.joint(joint).name
        if by > REJECTED:
            message = (
                f"the limits of passive joint {name} reject {by:.0%} of the closed configurations within the "
                "limits of the drivers"
            )
            remedy = "move the limit to the drivers, or keep it on purpose"
            yield Finding(kind="passive-limit", object=name, value=by, message=message, remedy=remedy)


def _loop_joints(path: StraightPath) -> Iterator[Finding]:
    """Yield a finding on the closing constraints if other passive joints have limits, damping or friction."""
    model = path.loops.model
    closing = [
        model.equality(i).name or f"equality{i + 1}"
        for i in range(model.neq)
        if int(model.eq_type[i]) in (CONNECT, WELD)
    ]
    if not closing:
        return
    has = {
        "limits": model.jnt_limited[model.dof_jntid[path.passive]],
        "friction": model.dof_frictionloss[path.passive] > 0.0,
        "damping": model.dof_damping[path.passive] > 0.0,
    }
    if listed := ", ".join(name for name, values in has.items() if np.any(values)):
        names, by = ", ".join(closing), float(len(closing))
        message = f"loop closures have no {listed}, which other passive joints have: {names}"
        remedy = "add them to a joint next to the closure"
        yield Finding(kind="loop-joint", object=names, value=by, message=message, remedy=remedy)


def _unchecked(scene: Inspected) -> Iterator[Finding]:
    """Yield active equalities that are neither joints nor couplings, which most rules do not cover."""
    model = scene.model
    for i in np.flatnonzero(model.eq_active0).tolist():
        if not is_readable(model, i):
            equality = scene.read.spec.equalities[i]
            what = "is no connect, weld, joint or fixed-tendon equality and was not checked"
            yield scene.finding("unchecked", equality, 1.0, f"{equality.name} {what}", HARMLESS)


def fixed_text(text: str, read: MjcfModel, findings: Sequence[Finding]) -> tuple[str, list[str]]:
    """Return the text of a file with the repairs of findings that have one remedy, and their rules.

    A time step that is too long becomes the step in the finding, or the integrator implicit; time constants
    become two of the file's steps, to which MuJoCo raises them, and impedances its maximum. Negative losses
    become zero. Repeated loops go.
    """
    edited, repaired, options = EditedText(text), set[str](), dict[str, str]()
    own = step = float(read.spec.option.timestep)
    for finding in findings:
        if finding.remedy.startswith('take integrator="implicitfast"'):
            options["integrator"] = "implicitfast"
        elif finding.rule in ("MS101", "MS114"):
            step = min(step, own / finding.value)
            options["timestep"] = f"{step:.6g}"
        else:
            continue
        repaired.add(finding.rule)
    set_options(edited, options, {})
    losses = {finding.object for finding in findings if finding.rule == "MS113"}
    for element in edited.root.every("joint", "freejoint", "fixed", "spatial"):
        if element.attributes.get("name") in losses:
            edited.set_all(element, dict.fromkeys(_negative(read, element), "0"))
            repaired.add("MS113")
    repaired |= _repair_loops(edited, read, findings)
    return edited.result, sorted(repaired)


def _negative(read: MjcfModel, element: Element) -> list[str]:
    """Return the attributes of a joint or tendon whose values are negative, also by a default."""
    own = read.spec.joint if element.tag.endswith("joint") else read.spec.tendon
    item = own(element.attributes["name"])
    values = {name: float(np.ravel(getattr(item, name, 0.0))[0]) for name in LOSSES}
    return [name for name, value in values.items() if value < 0.0]


def _repair_loops(edited: EditedText, read: MjcfModel, findings: Sequence[Finding]) -> set[str]:
    """Remove repeated loops, stiffen soft ones, and return the repaired rules."""
    elements, names = equality_elements(edited.root), [equality.name for equality in read.spec.equalities]
    # loop -> the rules that repair it; included files have further loops
    rules: dict[str, set[str]] = {}
    for finding in findings if len(elements) == len(names) else ():
        repeats = finding.remedy == f"leave out {finding.object}"
        if repeats or finding.rule in ("MS109", "MS110"):
            for name in {*finding.object.split(", ")}.intersection(names):
                rules.setdefault(name, set()).add(finding.rule)
    repaired = set[str]().union(*rules.values())
    for name, own in rules.items():
        element = elements[names.index(name)]
        if "MS107" in own:
            edited.remove(element)
            continue
        edited.set(element, "solref", f"{MIN_STEPS * read.spec.option.timestep:.6g} 1")
        if "MS110" in repaired:
            edited.set(element, "solimp", f"{MAX_IMPEDANCE:g} {MAX_IMPEDANCE:g} 0.001 0.5 2")
    return repaired
