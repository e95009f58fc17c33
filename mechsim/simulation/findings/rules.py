"""Violations of the rules of `mechsim check` in a file, and repairs."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from mechsim.errors import MechsimError
from mechsim.model.finding import HARMLESS, Finding, Severity
from mechsim.simulation.closed_configurations import StraightPath, driver_ranges, straight_path
from mechsim.simulation.findings import findings_in
from mechsim.simulation.findings.compliance import MAX_IMPEDANCE, MIN_STEPS
from mechsim.simulation.findings.inspected import Inspected, loop_rank
from mechsim.simulation.findings.rule_table import BY_KIND, with_severity
from mechsim.simulation.mjcf.compiling import quiet
from mechsim.simulation.mjcf.edited_text import EditedText, equality_elements, set_options
from mechsim.simulation.mjcf_reader.coordinates import actuator_names
from mechsim.simulation.mjcf_reader.equality_constraints import CONNECT, WELD, is_readable
from mechsim.simulation.mjcf_reader.mjcf_model import MjcfModel
from mechsim.simulation.state import limited_joints

# number of random configurations that test the limits of passive joints, and the seed
DRAWN, SEED = 200, 0
# fraction of closed configurations that a passive joint's limits may reject without a finding
REJECTED = 0.01


@dataclass(frozen=True, slots=True, kw_only=True)
class Violation:
    """A finding of a rule in a file.

    Attributes:
        rule: code of the rule.
        severity: severity of the rule, or "note" if the finding is harmless.
        file: the checked file, or the included file that contains the line.
        line: line number, counted from 1; None if the finding has no single line.
        object: name of the element.
        value: size of the finding, in the unit that the message names; of a step or a time constant its ratio
            to the longest stable or the shortest kept one.
        target: value with which the finding is gone; None where no single value is right.
        gap: value minus target.
        message: one sentence.
        fix, remedy: how to repair it; empty if the finding is harmless.
    """

    rule: str
    severity: Severity
    file: str
    line: int | None
    object: str
    value: float
    target: float | None
    gap: float | None
    message: str
    fix: str
    remedy: str


def violations(read: MjcfModel) -> list[Violation]:
    """Return the violations of all rules in a model, errors first."""
    with quiet():
        scene = Inspected(read)
        path, reported = _closed_path(scene), list(findings_in(scene))
        if path is not None:
            fighting = {finding.what for finding in reported if finding.kind == "actuator"}
            passive = [finding for finding in _passive_actuators(scene, path) if finding.what not in fighting]
            reported += [*passive, *_passive_limits(path), *_loop_joints(path)]
        reported += [*_unchecked(scene), *read.unread]
    order = {"error": 0, "warning": 1, "note": 2}
    result = [_violation(read.path, with_severity(finding)) for finding in reported]
    return sorted(result, key=lambda violation: (order[violation.severity], violation.rule))


def unreadable(path: str, reason: str) -> Violation:
    """Return the violation of a file that cannot be read, one of several."""
    message = reason.removeprefix(f"{path}: ")
    finding = Finding(kind="unreadable", what=path, by=1.0, message=message)
    return _violation(path, with_severity(finding))


def _violation(path: str, finding: Finding) -> Violation:
    rule, remedy = BY_KIND[finding.kind], "" if finding.remedy == HARMLESS else finding.remedy
    return Violation(
        rule=rule.code,
        severity=finding.severity,
        file=finding.file or path,
        line=finding.line,
        object=finding.what,
        value=float(finding.by),
        target=rule.target,
        gap=None if rule.target is None else float(finding.by) - rule.target,
        message=finding.message,
        fix=remedy,
        remedy=remedy,
    )


def _closed_path(scene: Inspected) -> StraightPath | None:
    """Return the straight paths of the actuated joints; None if the model has no loops that close."""
    try:
        return straight_path(scene.model, None, scene.read.qpos if scene.closed is None else scene.closed)
    except (MechsimError, FloatingPointError, np.linalg.LinAlgError):
        return None


def _actuated(path: StraightPath) -> bool:
    """Return whether there are drivers, and an actuator acts on each of them."""
    model = path.loops.model
    on_joint = model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT
    joints = model.dof_jntid[path.drivers]
    return len(joints) > 0 and bool(np.isin(joints, model.actuator_trnid[on_joint, 0]).all())


def _passive_actuators(scene: Inspected, path: StraightPath) -> Iterator[Finding]:
    """Yield motors on joints that the loops determine from other actuated joints."""
    model = path.loops.model
    on_joint = np.flatnonzero(model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT).tolist()
    passive = {int(model.dof_jntid[dof]) for dof in path.passive}
    actuated = {int(model.jnt_dofadr[int(model.actuator_trnid[a, 0])]) for a in on_joint}
    for a in on_joint:
        joint = int(model.actuator_trnid[a, 0])
        if joint in passive and _determined(scene, int(model.jnt_dofadr[joint]), actuated):
            name, joint_name = actuator_names(model)[a], model.joint(joint).name
            locked = _determined(scene, int(model.jnt_dofadr[joint]), set())
            reason = "equalities lock" if locked else "loops determine from the other actuators"
            message = f"actuator {name} acts on {joint_name}, which the {reason}"
            remedy = f"leave {name} out, or give all of them forces that agree"
            yield scene.finding("passive-actuator", None, 1.0, message, remedy, name)


def _determined(scene: Inspected, dof: int, actuated: set[int]) -> bool:
    """Return whether the loops and the other actuated DOFs determine a DOF in every sample state."""
    unit = np.eye(scene.model.nv)
    others = unit[sorted(actuated - {dof})]
    return all(
        loop_rank(np.vstack([jacobian, others, unit[dof]])) == loop_rank(np.vstack([jacobian, others]))
        for jacobian, _ in scene.sample_jacobians
    )


def _passive_limits(path: StraightPath) -> Iterator[Finding]:
    """Yield passive joints whose limits reject closed configurations within the drivers' limits."""
    model = path.loops.model
    limited = np.intersect1d(model.dof_jntid[path.passive], limited_joints(model))
    if not len(limited) or not _actuated(path):
        return
    low, high = driver_ranges(path)
    qpos, closed = path.follow(np.random.default_rng(SEED).uniform(low, high, (DRAWN, len(low))))
    if not closed.any():
        return
    rejected = path.outside(qpos[closed]).mean(0)
    for joint in limited.tolist():
        if rejected[joint] > REJECTED:
            name = model.joint(joint).name
            message = (
                f"the limits of passive joint {name} reject {rejected[joint]:.0%} of the closed "
                "configurations within the limits of the drivers"
            )
            remedy = "move the limit to the drivers, or keep it on purpose"
            by = float(rejected[joint])
            yield Finding(kind="passive-limit", what=name, by=by, message=message, remedy=remedy)


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
    joints = {int(model.dof_jntid[dof]) for dof in path.passive}
    has = {
        "limits": any(model.jnt_limited[joint] for joint in joints),
        "friction": any(model.dof_frictionloss[dof] > 0.0 for dof in path.passive),
        "damping": any(np.any(model.dof_damping[dof] > 0.0) for dof in path.passive),
    }
    if any(has.values()):
        listed = ", ".join(name for name, is_present in has.items() if is_present)
        names, remedy = ", ".join(closing), "add them to a joint next to the closure"
        message = f"loop closures have no {listed}, which other passive joints have: {names}"
        yield Finding(kind="loop-joint", what=names, by=float(len(closing)), message=message, remedy=remedy)


def _unchecked(scene: Inspected) -> Iterator[Finding]:
    """Yield active equalities that are neither joints nor couplings, which most rules do not cover."""
    model = scene.model
    for i in np.flatnonzero(model.eq_active0).tolist():
        if not is_readable(model, i):
            equality = scene.read.spec.equalities[i]
            message = (
                f"{equality.name} is no connect, weld, joint or fixed-tendon equality and was not checked"
            )
            yield scene.finding("unchecked", equality, 1.0, message, HARMLESS)


def fixed_text(text: str, read: MjcfModel, violated: Sequence[Violation]) -> tuple[str, list[str]]:
    """Return the text of a file with repaired loops and time step, and the codes of the repaired rules.

    Time constants become two time steps, and impedances MuJoCo's maximum. A time step that is too long
    becomes the step in the finding.
    """
    edited, repaired = EditedText(text), list[str]()
    codes = {violation.rule for violation in violated}
    elements = equality_elements(edited.root)
    names = [equality.name for equality in read.spec.equalities]
    step = float(read.spec.option.timestep)
    for violation in violated:
        if violation.rule == "MS101":
            step /= violation.value
            set_options(edited, {"timestep": f"{step:.6g}"}, {})
            repaired.append(violation.rule)
    for violation in violated:
        if violation.rule not in ("MS109", "MS110"):
            continue
        for name in violation.object.split(", "):
            if name in names and len(elements) == len(names):
                element = elements[names.index(name)]
                edited.set(element, "solref", f"{MIN_STEPS * step:.6g} 1")
                if "MS110" in codes:
                    edited.set(element, "solimp", f"{MAX_IMPEDANCE:g} {MAX_IMPEDANCE:g} 0.001 0.5 2")
                repaired.append(violation.rule)
    return edited.result, sorted(set(repaired))
