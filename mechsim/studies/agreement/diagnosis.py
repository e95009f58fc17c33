"""Why a claim differs: every hypothesis fitted, and the one that explains most with the least said."""

from collections.abc import Callable, Iterator

import numpy as np

from mechsim.errors import MechsimError
from mechsim.model.finding import Finding
from mechsim.studies.agreement import dimension_hypotheses, driver_hypotheses, value_hypotheses
from mechsim.studies.agreement.discrepancy import Hypothesis, Miss
from mechsim.studies.agreement.fitting import ODDS, Fitted, fitted

Family = Callable[[Miss], Iterator[Hypothesis]]

# those of a later stage are asked only where none of the stages before explains all: first what has no size,
# then what has one, then places without a name, last what has several sizes
STAGES: tuple[tuple[Family, ...], ...] = (
    (
        value_hypotheses.units,
        value_hypotheses.degrees,
        value_hypotheses.swapped,
        value_hypotheses.mirrored,
        value_hypotheses.senses,
        driver_hypotheses.driver_senses,
        driver_hypotheses.driver_degrees,
        driver_hypotheses.drivers_swapped,
        dimension_hypotheses.assemblies,
        dimension_hypotheses.gear_slips,
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
    (dimension_hypotheses.places,),
    (value_hypotheses.whole_frame,),
)


# what is left, in parts of the bounds and of the miss, that is the rounding of solving again
ROUNDING, OF_MISS = 3e-3, 1e-7
# a cause that explains less is none; one that is sure explains this and leaves nothing beyond the bounds
WORTH, SURE = 0.3, 0.9
MOST = 4
# a difference of fewer bounds is at the level of what is met
LEVEL = 1.5


def diagnosis(miss: Miss) -> tuple[Finding, ...]:
    """Return what explains a miss, the likeliest first; one finding that says so where nothing does."""
    if not miss.noisy and miss.worst(miss.exact) <= LEVEL:
        return (_none("the difference is too near its bound for a cause to be told"),)
    tried = [one for one in _all(miss) if one.explains >= WORTH]
    if not tried:
        return (_none("none of the causes tried explains the difference"),)
    said = _equal(miss, _without_edges(miss, tried))
    sure = said[0].worst <= 1.0 and said[0].explains >= SURE
    found = tuple(_finding(one, len(said), sure and len(said) <= MOST, miss.noisy) for one in said[:MOST])
    if said[0].explains < SURE:
        found += (_none("what is left is explained by none of the causes tried"),)
    return found


def _all(miss: Miss) -> Iterator[Fitted]:
    """Yield hypotheses with their sizes, stage by stage until one leaves nothing."""
    done = False
    for stage in STAGES:
        for family in stage:
            for one in _of_family(miss, family):
                done = done or one.left <= _floor(miss) or (miss.noisy and one.worst <= 1.0)
                yield one
        if done:
            return


def _of_family(miss: Miss, family: Family) -> Iterator[Fitted]:
    try:
        for hypothesis in family(miss):
            one = fitted(miss, hypothesis)
            if one is not None:
                yield one
    except MechsimError:
        # what cannot be asked of this mechanism explains nothing
        return


def _floor(miss: Miss) -> float:
    return max(ROUNDING, OF_MISS * miss.size)


def _without_edges(miss: Miss, tried: list[Fitted]) -> list[Fitted]:
    """Leave out what looks at some instants only, where as much is explained at all of them."""
    whole = [one for one in tried if one.hypothesis.rows is None]
    best = min((one.left for one in whole), default=np.inf)
    return [
        one for one in tried if one.hypothesis.rows is None or not best <= max(_floor(miss), 1.5 * one.left)
    ]


def _equal(miss: Miss, tried: list[Fitted]) -> list[Fitted]:
    """Return the causes that explain as well as the best, and of them those that ask least to be believed."""
    best = min(tried, key=lambda one: one.left)
    floor = _floor(miss)

    def as_good(one: Fitted) -> bool:
        if one.left <= max(floor, best.left):
            return True
        return best.left > floor and 2.0 * one.count * np.log(one.left / best.left) <= ODDS

    among = [one for one in tried if as_good(one)]
    if miss.noisy:
        # noise hides which of them it is: all are reported, the simplest first
        return sorted(among, key=lambda one: (one.worst > 1.0, one.hypothesis.tier, one.left))
    least = min(one.hypothesis.tier for one in among)
    said = [one for one in among if one.hypothesis.tier == least]
    return sorted(said, key=lambda one: (one.worst > 1.0, _moves(one)))


def _moves(one: Fitted) -> float:
    """Return how far a cause is from none: of two that explain alike the smaller change comes first."""
    return float(np.abs(one.sizes).max(initial=0.0))


def _finding(one: Fitted, alike: int, sure: bool, noisy: bool) -> Finding:
    hypothesis = one.hypothesis
    also = f", as {'does another' if alike == 2 else f'do {alike - 1} others'}" if alike > 1 else ""
    beyond = " beyond the noise" if noisy else ""
    said = f"{hypothesis.say(one.sizes)}: explains {_percent(one.explains)} of the difference{beyond}{also}"
    return Finding(
        kind=hypothesis.kind,
        what=hypothesis.what,
        by=hypothesis.by(one.sizes),
        explains=float(one.explains),
        message=said,
        certain=sure,
    )


def _percent(part: float) -> str:
    return f"{100.0 * part:.3g} %" if part < 0.9995 else "all"


def _none(said: str) -> Finding:
    return Finding(kind="none", what="", by=0.0, explains=0.0, message=said)
