"""The cause of a difference: all hypotheses are fitted; the simplest sufficient one is reported."""

from collections.abc import Callable, Iterator

import numpy as np

from mechsim.errors import MechsimError
from mechsim.mechanism.finding import Finding
from mechsim.studies.agreement import dimension_hypotheses, driver_hypotheses, value_hypotheses
from mechsim.studies.agreement.evaluation_points import Hypothesis
from mechsim.studies.agreement.fitting import ODDS, Fitted, fitted
from mechsim.studies.agreement.misfit import Misfit

HypothesisFamily = Callable[[Misfit], Iterator[Hypothesis]]

# a later stage is tried only if no earlier stage explains the whole difference: first hypotheses without a
# size, then those with one, then positions without a name, last those with several sizes
STAGES: tuple[tuple[HypothesisFamily, ...], ...] = (
    (
        value_hypotheses.units,
        value_hypotheses.degrees,
        value_hypotheses.swapped,
        value_hypotheses.mirrored,
        value_hypotheses.directions,
        driver_hypotheses.driver_directions,
        driver_hypotheses.driver_degrees,
        driver_hypotheses.drivers_swapped,
        dimension_hypotheses.assemblies,
        dimension_hypotheses.gear_mistakes,
        driver_hypotheses.other_gravity,
    ),
    (
        value_hypotheses.zeros,
        value_hypotheses.frame,
        driver_hypotheses.driver_offsets,
        driver_hypotheses.delays,
        dimension_hypotheses.parameters,
        driver_hypotheses.gravity_size,
        driver_hypotheses.masses,
    ),
    (dimension_hypotheses.positions,),
    (value_hypotheses.whole_frame,),
)


# remaining error of rounding: relative to the tolerances, and relative to the difference
ROUNDING, RELATIVE_ROUNDING = 3e-3, 1e-7
# smallest explained fraction of a reported cause, and of a certain one, which also meets every tolerance
MIN_EXPLAINED, CERTAIN = 0.3, 0.9
MAX_FINDINGS = 4
# ratio of difference to tolerance below which no cause can be determined
TOLERANCE_LEVEL = 1.5


def diagnosis(misfit: Misfit) -> tuple[Finding, ...]:
    """Return the causes of a difference, most likely first; if none fits, one finding that reports so."""
    if misfit.worst(misfit.exact) <= TOLERANCE_LEVEL:
        return (_none("the difference is too close to its tolerance to determine a cause"),)
    tried = [cause for cause in _all(misfit) if cause.explains >= MIN_EXPLAINED]
    if not tried:
        return (_none("none of the tested causes explains the difference"),)
    causes = _equal_causes(misfit, _without_edges(misfit, tried))
    certain = causes[0].worst <= 1.0 and causes[0].explains >= CERTAIN
    findings = tuple(
        _finding(cause, len(causes), certain and len(causes) <= MAX_FINDINGS)
        for cause in causes[:MAX_FINDINGS]
    )
    if causes[0].explains < CERTAIN:
        findings += (_none("none of the tested causes explains the rest of the difference"),)
    return findings


def _all(misfit: Misfit) -> Iterator[Fitted]:
    """Yield fitted hypotheses stage by stage until one explains everything."""
    explained = False
    for stage in STAGES:
        for designs in stage:
            for result in _fitted_family(misfit, designs):
                explained = explained or result.remaining <= _floor(misfit)
                yield result
        if explained:
            return


def _fitted_family(misfit: Misfit, designs: HypothesisFamily) -> Iterator[Fitted]:
    try:
        for hypothesis in designs(misfit):
            result = fitted(misfit, hypothesis)
            if result is not None:
                yield result
    except MechsimError:
        # a hypothesis that does not apply to this mechanism explains nothing
        return


def _floor(misfit: Misfit) -> float:
    return max(ROUNDING, RELATIVE_ROUNDING * misfit.magnitude)


def _without_edges(misfit: Misfit, tried: list[Fitted]) -> list[Fitted]:
    """Drop causes that compare only some instants, if a cause that compares all explains as much."""
    whole = [fitted_cause for fitted_cause in tried if fitted_cause.hypothesis.rows is None]
    best = min((fitted_cause.remaining for fitted_cause in whole), default=np.inf)
    return [
        fitted_cause
        for fitted_cause in tried
        if fitted_cause.hypothesis.rows is None
        or not best <= max(_floor(misfit), 1.5 * fitted_cause.remaining)
    ]


def _equal_causes(misfit: Misfit, tried: list[Fitted]) -> list[Fitted]:
    """Return the causes that explain as much as the best one, reduced to the simplest of them."""
    best = min(tried, key=lambda cause: cause.remaining)
    floor = _floor(misfit)

    def equally_good(cause: Fitted) -> bool:
        if cause.remaining <= max(floor, best.remaining):
            return True
        return best.remaining > floor and 2.0 * cause.count * np.log(cause.remaining / best.remaining) <= ODDS

    among = [cause for cause in tried if equally_good(cause)]
    least = min(cause.hypothesis.tier for cause in among)
    simplest = [cause for cause in among if cause.hypothesis.tier == least]
    # of equal explanations the smaller change comes first
    return sorted(
        simplest, key=lambda cause: (cause.worst > 1.0, float(np.abs(cause.sizes).max(initial=0.0)))
    )


def _finding(cause: Fitted, alike: int, confirmed: bool) -> Finding:
    hypothesis = cause.hypothesis
    also = f", as {'does another' if alike == 2 else f'do {alike - 1} others'}" if alike > 1 else ""
    share = f"{100.0 * cause.explains:.3g} %" if cause.explains < 0.9995 else "all"
    text = f"{hypothesis.text(cause.sizes)}: explains {share} of the difference{also}"
    return Finding(
        kind=hypothesis.kind,
        object=hypothesis.what,
        value=hypothesis.by(cause.sizes),
        explains=float(cause.explains),
        message=text,
        remedy="correct the one of the two that is wrong",
        certain=confirmed,
    )


def _none(text: str) -> Finding:
    return Finding(kind="none", object="", value=0.0, target=None, message=text)
