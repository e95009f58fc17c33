"""Check closed-loop models by the linter's rules, from files or objects of MuJoCo."""

from collections.abc import Sequence
from dataclasses import replace
from os import PathLike, fspath
from pathlib import Path
from typing import Any

import numpy as np

from mechsim.errors import InputError, MechsimError
from mechsim.io.mujoco_inputs import linted
from mechsim.mechanism.finding import Finding
from mechsim.simulation.findings.rule_table import RULES
from mechsim.simulation.findings.rules import fixed_text, unreadable, violations
from mechsim.simulation.mjcf.included_files import moved_to, read_text
from mechsim.simulation.mjcf_reader.file_text import root_of
from mechsim.simulation.mjcf_reader.mjcf_model import MjcfModel
from mechsim.simulation.mjcf_reader.reading import read_model


def check(
    model: Any,
    *,
    select: Sequence[str] = (),
    ignore: Sequence[str] = (),
    loops: str | PathLike[str] | None = None,
) -> list[Finding]:
    """Return the violations of the linter's rules by a closed-loop model, errors first.

    Args:
        model: an MJCF or URDF file, `mujoco.MjSpec`, `mujoco.MjModel`, or any argument of `load`.
        select: codes of rules, or their beginnings, as "MS1"; empty takes all.
        ignore: likewise, rules to leave out.
        loops: path of a sidecar file with the loop closures of a URDF file.

    Returns:
        Findings with rule, severity, file, line, object, value, target, gap, message and remedy.

    Raises:
        InputError: for a file that MuJoCo rejects, or an unknown rule.

    Example:
        >>> [violation.rule for violation in ms.check("gripper.xml") if violation.severity == "error"]
        []
    """
    return check_each([model], select=select, ignore=ignore, loops=loops)


def check_each(
    models: Sequence[Any],
    *,
    select: Sequence[str] = (),
    ignore: Sequence[str] = (),
    loops: str | PathLike[str] | None = None,
) -> list[Finding]:
    """Return the violations by several models, as `check`; one that cannot be read is a violation of MS100.

    Raises:
        InputError: for an unknown rule, or a single model that cannot be read.
    """
    for code in (*select, *ignore):
        if not code or not any(rule.code.startswith(code) for rule in RULES):
            raise InputError(
                f"there is no rule {code!r}; choose from {', '.join(rule.code for rule in RULES)}"
            )
    result: list[Finding] = []
    for model in models:
        try:
            read, computed = _read(model, loops)
            # the file that is checked, not the name of what it becomes in MuJoCo
            path = fspath(model) if isinstance(model, str | PathLike) else read.path
            result += [
                replace(each, file=path) if each.file == read.path else each
                for each in violations(read)
                if each.rule != "MS104" or each.object not in computed
            ]
        except MechsimError as error:
            if len(models) == 1:
                raise
            result.append(unreadable(str(model), str(error)))
    return [
        violation
        for violation in result
        if (not select or violation.rule.startswith(tuple(select)))
        and not (ignore and violation.rule.startswith(tuple(ignore)))
    ]


def fixed_copy(path: str, target: Path, violated: Sequence[Finding]) -> tuple[str, list[str]]:
    """Return the text of a file with repairs, and the codes of the repaired rules.

    Args:
        path: of the file.
        target: path of the copy, from which the files that it includes are read.
        violated: what to repair.

    Raises:
        InputError: for URDF, which has no equalities or time step to repair.
    """
    if root_of(path) != "mujoco":
        raise InputError(f"--fix repairs MJCF, and {path} is URDF; mechsim export writes it as MJCF")
    text, repaired = fixed_text(read_text(path), _read(path)[0], violated)
    return moved_to(text, Path(path).parent, target.parent), repaired


def _read(model: Any, loops: str | PathLike[str] | None = None) -> tuple[MjcfModel, set[str]]:
    """Return a model as read, and its links of which the file states no moments of inertia."""
    own = linted(model, loops)
    if own is not None:
        return own, set()
    import mujoco

    from mechsim.io.readers import load
    from mechsim.studies.robots.mujoco_models import rounded_angle, spec_and_unlimited

    solver = load(model, still=True)
    names = [name for joint in solver.mechanism.joints for name in joint.coordinates]
    values = {name: solver.initial.get(f"{name}.q") for name in names}
    start = {name: value for name, value in values.items() if isinstance(value, float)}
    if start and solver.closed_form is None:
        solver = load(model, still=True, start=start)
    spec = spec_and_unlimited(solver)[0]
    # actuators of nonlinear springs drive nothing, and those on sites are the loads and couples of the model
    site, spring = mujoco.mjtTrn.mjTRN_SITE, "nonlinear spring "
    for actuator in [each for each in spec.actuators if each.trntype == site or each.name.startswith(spring)]:
        spec.delete(actuator)
    drivers = [name for name in solver.mechanism.drivers if spec.joint(name) is not None]
    read = read_model(spec, drivers=drivers, lint=True)
    inertias = {link.name: link.inertia for link in solver.mechanism.links}
    computed = {name for name, own in inertias.items() if own is None or not np.any(own.moments)}
    return replace(read, unread=(*read.unread, *filter(None, [rounded_angle(model)]))), computed
