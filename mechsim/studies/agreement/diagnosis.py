"""The cause of a difference: all hypotheses are fitted; the simplest sufficient one is reported."""

from collections.abc import Callable, Iterator
from contextlib import suppress

import numpy as np

from mechsim.errors import MechsimError
from mechsim.mechanism.finding import Finding
from mechsim.studies.agreement import dimension_hypotheses, driver_hypotheses, value_hypotheses
from mechsim.studies.agreement.misfit import Fitted, Hypothesis, Misfit, fitted

# a later stage is tried only if no earlier stage explains the whole difference: first hypotheses without a
# size, then those with one, then positions without a name, last those with several sizes
STAGES: tuple[tuple[Callable[[Misfit], Iterator[Hypothesis]], ...], ...] = (
    (
        value_hypotheses.units,
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
# twice the log-likelihood ratio above which a worse-fitting cause is dropped
ODDS = 12.0
# ratio of difference to tolerance below which no cause can be determined
TOLERANCE_LEVEL = 1.5


def diagnosis(misfit: Misfit) -> tuple[Finding, ...]:
    """Return the causes of a difference, most likely first; if none fits, one finding that reports so."""
    if misfit.worst(misfit.exact) <= TOLERANCE_LEVEL:
        return (_none("the difference is too close to its tolerance to determine a cause"),)
    floor = max(ROUNDING, RELATIVE_ROUNDING * misfit.magnitude)
    tried = [cause for cause in _all(misfit, floor) if cause.explains >= MIN_EXPLAINED]
    if not tried:
        return (_none("none of the tested causes explains the difference"),)
    # a cause that compares only some instants is dropped if one that compares all explains as much
    whole = min((cause.remaining for cause in tried if cause.hypothesis.rows is None), default=np.inf)
    causes = _equal_causes(
        [
            cause
            for cause in tried
            if cause.hypothesis.rows is None or not whole <= max(floor, 1.5 * cause.remaining)
        ],
        floor,
    )
    certain = causes[0].worst <= 1.0 and causes[0].explains >= CERTAIN
    findings = tuple(
        _finding(cause, len(causes), certain and len(causes) <= MAX_FINDINGS)
        for cause in causes[:MAX_FINDINGS]
    )
    if causes[0].explains < CERTAIN:
        findings += (_none("none of the tested causes explains the rest of the difference"),)
    return findings


def _all(misfit: Misfit, floor: float) -> Iterator[Fitted]:
    """Yield fitted hypotheses stage by stage until one leaves no more errors than a floor."""
    explained = False
    for stage in STAGES:
        for hypotheses in stage:
            # a hypothesis that does not apply to this mechanism explains nothing
            with suppress(MechsimError):
                for result in filter(None, (fitted(misfit, each) for each in hypotheses(misfit))):
                    explained = explained or result.remaining <= floor
                    yield result
        if explained:
            return


def _equal_causes(tried: list[Fitted], floor: float) -> list[Fitted]:
    """Return the causes that explain as much as the best one, reduced to the simplest of them."""
    best = min(cause.remaining for cause in tried)

    def equally_good(cause: Fitted) -> bool:
        if cause.remaining <= max(floor, best):
            return True
        return best > floor and 2.0 * len(cause.errors) * np.log(cause.remaining / best) <= ODDS

    among = [cause for cause in tried if equally_good(cause)]
    least = min(cause.hypothesis.tier for cause in among)
    # of equal explanations the smaller change comes first
    return sorted(
        (cause for cause in among if cause.hypothesis.tier == least),
        key=lambda cause: (cause.worst > 1.0, float(np.abs(cause.sizes).max(initial=0.0))),
    )


def _finding(cause: Fitted, alike: int, confirmed: bool) -> Finding:
    hypothesis, sizes = cause.hypothesis, cause.sizes.tolist()
    also = f", as {'does another' if alike == 2 else f'do {alike - 1} others'}" if alike > 1 else ""
    share = f"{100.0 * cause.explains:.3g} %" if cause.explains < 0.9995 else "all"
    text = hypothesis.text(*sizes) if callable(hypothesis.text) else hypothesis.text
    return Finding(
        kind=hypothesis.kind,
        object=hypothesis.what,
        value=hypothesis.value(*sizes) if callable(hypothesis.value) else hypothesis.value,
        explains=cause.explains,
        message=f"{text}: explains {share} of the difference{also}",
        remedy="correct the one of the two that is wrong",
        certain=confirmed,
    )


def _none(text: str) -> Finding:
    return Finding(kind="none", object="", value=0.0, target=None, message=text)
