"""Whether a model agrees with somebody else's formula or table, and if not, why."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mechsim.analytic.catalog.base import ClosedForm
from mechsim.analytic.closure.loop_form import LoopForm
from mechsim.analytic.forms import Form
from mechsim.errors import InputError
from mechsim.maths.arrays import Array
from mechsim.model.finding import Finding
from mechsim.model.mechanism import Mechanism
from mechsim.model.outcome import Outcome
from mechsim.model.programs import State
from mechsim.studies.agreement.claim import Claim, claimed
from mechsim.studies.agreement.comparison import check, scales_of
from mechsim.studies.agreement.named_quantities import names_of
from mechsim.studies.agreement.situation import Comparand, situation_of
from mechsim.studies.agreement.table_claims import claims_of_table, read_table, tabled_situation
from mechsim.studies.motion_source import programs_of
from mechsim.subjects.python_object import object_of
from mechsim.subjects.subject import load
from mechsim.verdict.checks import Check, concluded

Against = str | Path | Callable[..., Any]
SPEED = 20.0 * np.pi


@dataclass(frozen=True, kw_only=True)
class Agreement:
    """Whether a model and a claim about it agree.

    Attributes:
        form: the model.
        source: what was held against it.
        outcome: met or missed.
        checks: quantity by quantity.
        findings: what explains the difference, the likeliest first; empty where all is met.
        attribution: parts of the distance between a run in time and the claim; empty where none was run.
        situation: the instants compared.
        claims: what was said there.
        exact: what is true there, in the order of the claims.
    """

    form: Form
    source: str
    outcome: Outcome
    checks: tuple[Check, ...]
    findings: tuple[Finding, ...] = ()
    attribution: Mapping[str, Any] = field(default_factory=dict[str, Any])
    situation: Comparand
    claims: tuple[Claim, ...]
    exact: tuple[Array, ...]
    reason: str = ""

    @property
    def passed(self) -> bool:
        """Whether every quantity is within its bound."""
        return self.outcome == "met"

    @property
    def why(self) -> str:
        """One or two sentences: what is off, and what explains it."""
        if self.passed:
            return f"{self.source} agrees with {self.form.name} in {len(self.checks)} quantities"
        said = [one.say for one in self.findings if one.sure] or [one.say for one in self.findings[:1]]
        return "; ".join([self.reason, *said])

    def as_dict(self) -> dict[str, Any]:
        """Return it as `mechsim validate --json` prints it."""
        return {
            "passed": self.passed,
            "outcome": self.outcome,
            "reason": self.reason,
            "why": self.why,
            "against": self.source,
            "checks": [check.as_dict() for check in self.checks],
            "findings": [finding.as_dict() for finding in self.findings],
            "attribution": dict(self.attribution),
        }

    def __str__(self) -> str:
        return "\n".join([f"{self.outcome}: {self.why}", *(f"  {check}" for check in self.checks)])

    __repr__ = __str__


def validate(
    model: str | Form | Mechanism,
    against: Against | None = None,
    *,
    set: Mapping[str, str | float] | None = None,
    drive: Mapping[str, str | State] | None = None,
    duration: str | float | None = None,
    speed: float = SPEED,
    tolerance: float | None = None,
) -> Agreement:
    """Hold a model against somebody's formula or table, and say whether and why they differ.

    Args:
        model: a name, FILE.toml, FILE.xml, FILE.py:OBJECT, or what `load` or `catalog.make` returns.
        against: a function of the drivers' coordinates, FILE.py:FUNC, or FILE.csv; None takes the formula
            that the model's file names. The function is run.
        set: parameter -> its value, as `load` takes it.
        drive: coordinate -> its program, as `load` takes it.
        duration: of the programs, as `load` takes it.
        speed: of a crank, in [rad/s].
        tolerance: bound on places in [m], on other quantities in proportion; None takes 1e-8 of the reach.

    Raises:
        InputError: for a model, a function or a table that cannot be used; one sentence.
        AssemblyError: where the loops of the model close nowhere.
    """
    form = _form(model, set, drive, duration)
    source, situation, claims = _claims(form, against, speed)
    return agreement(situation, claims, source, tolerance)


def agreement(
    situation: Comparand, claims: list[Claim], source: str, tolerance: float | None = None
) -> Agreement:
    """Return whether claims agree with the exact motion of a situation."""
    exact = situation.all([claim.named for claim in claims])
    scales = scales_of(situation, claims)
    checks = tuple(
        check(claim, true, situation, scales, tolerance) for claim, true in zip(claims, exact, strict=True)
    )
    verdict = concluded(checks)
    return Agreement(
        form=situation.form,
        source=source,
        outcome=verdict.outcome,
        checks=checks,
        situation=situation,
        claims=tuple(claims),
        exact=tuple(exact),
        reason=verdict.reason,
    )


def _form(
    model: str | Form | Mechanism,
    set: Mapping[str, str | float] | None,
    drive: Mapping[str, str | State] | None,
    duration: str | float | None,
) -> Form:
    if isinstance(model, str):
        return load(model, set, drive=drive, duration=duration)
    if set or drive or duration is not None:
        raise InputError("set, drive and duration are of a model given by name; give them where it is loaded")
    if isinstance(model, Mechanism):
        return LoopForm(model)
    if isinstance(model, ClosedForm | LoopForm):  # pyright: ignore[reportUnnecessaryIsInstance]
        return model
    raise InputError(
        f"the model is of type {type(model).__name__}; give a name, a file, or what ms.load returns"
    )


def _claims(form: Form, against: Against | None, speed: float) -> tuple[str, Comparand, list[Claim]]:
    """Return what is held against a form: its name, the instants, and what it says there."""
    if against is None:
        against = form.formula if isinstance(form, LoopForm) else ""
        if not against:
            raise InputError(
                f"nothing is held against {form.name}; give a function, FILE.py:FUNC or FILE.csv"
            )
    names = names_of(form.mechanism)
    if isinstance(against, str | Path) and str(against).lower().endswith(".csv"):
        source, table = str(against), read_table(str(against))
        situation, used = tabled_situation(form, table, speed, source)
        return source, situation, claims_of_table(table, used, names, source)
    if isinstance(against, str | Path):
        source, function = str(against), object_of(str(against))
    else:
        source, function = getattr(against, "__name__", "the function"), against
    if not callable(function):
        raise InputError(f"{source} is of type {type(function).__name__}; name a function")
    if programs_of(form) is None and not form.mechanism.has_crank:
        raise InputError(
            f"{form.name}: no program says how {', '.join(form.mechanism.drivers)} move; give each one, as "
            f"drive={{'{form.mechanism.drivers[0]}': '0.3*sin(2*pi*t)'}}"
        )
    situation = situation_of(form, speed)
    parameters = dict(form.parameters) if isinstance(form, LoopForm) else None
    return source, situation, claimed(function, situation, names, source, parameters)
