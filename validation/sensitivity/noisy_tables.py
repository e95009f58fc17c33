"""How often `validate --against` rejects a right noisy table, and how often it finds a systematic error.

Tables of positions and of a joint at 60 crank angles are made with normal errors of 20 um and 0.3 mrad,
stated as standard deviations. Right tables must fail with a probability of 1e-3 at most; tables of a
mechanism with a link 0.1 mm too short must fail, and the link must be among the causes of the difference.

Run: python validation/sensitivity/noisy_tables.py [TABLES] [CAUSES]
"""

import sys
from dataclasses import replace

import numpy as np

import mechsim as ms
from mechsim.studies.agreement.agreement import agreement
from mechsim.studies.agreement.candidate import Candidate, QuantityReader
from mechsim.studies.agreement.evaluation_points import EvaluationPoints
from mechsim.studies.agreement.noise import FALSE_ALARM
from mechsim.subjects.readers import parametric_model

CASES = (
    ("four_bar", ("B.xy", "C.xy", "rocker.q"), "coupler"),
    ("slider_crank", ("A.xy", "B.x"), "rod"),
    ("rssr", ("P2", "P3"), "coupler"),
    ("klann", ("G.xy",), "DE"),
)
ANGLES = np.linspace(0.1, 6.2, 60)
NOISE = {"m": 2e-5, "rad": 3e-4}
SHORT = 1e-4


def evaluation_points(form):
    return EvaluationPoints(form, ANGLES, np.ones_like(ANGLES), np.zeros_like(ANGLES))


def exact_claims(form, columns):
    """Return what a form does, as claims with standard deviations."""
    evaluation, reader = evaluation_points(form), QuantityReader(form.mechanism, "the script")
    candidates = []
    for column in columns:
        axes = column.partition(".")[2]
        named = reader.read(column, {"xy": 2, "": 3}.get(axes))
        values = evaluation.exact(named)
        candidates.append(Candidate(named, values, np.full(values.shape, NOISE[named.unit])))
    return candidates


def noisy(candidate, random):
    error = candidate.uncertainty * random.standard_normal(candidate.values.shape)
    return replace(candidate, values=candidate.values + error)


def shorter(name, link):
    dimensions = parametric_model(name)
    return dimensions.make({link: dimensions.dimensions[link].value - SHORT})


def main(tables, causes):
    random, failed, total = np.random.default_rng(26), 0, 0
    for name, columns, link in CASES:
        evaluation, right = evaluation_points(ms.load(name)), exact_claims(ms.load(name), columns)
        evaluation.conditioning  # noqa: B018 - solved once for all tables
        wrong, detected, named, sigma = exact_claims(shorter(name, link), columns), 0, 0, []
        rejected = 0
        for _ in range(tables):
            candidates = [noisy(candidate, random) for candidate in right]
            # the verdict alone: what explains a false alarm is not of interest
            result = agreement(evaluation, candidates, "a right table", diagnose=False)
            sigma.append(np.mean([noise.size.worst for _, noise in result.measured]))
            rejected += not result.passed
        for _ in range(causes):
            result = agreement(
                evaluation,
                [noisy(candidate, random) for candidate in wrong],
                "a wrong table",
                None,
                parametric_model(name),
            )
            detected += not result.passed
            named += link in [item.what for item in result.findings]
        failed, total = failed + rejected, total + tables
        print(
            f"{name:13s} right: {rejected} of {tables} rejected, noise of {np.mean(sigma):.3f} sigma; "
            f"{link} 0.1 mm short: {detected} of {causes} rejected, {named} with that cause",
            flush=True,
        )
        assert detected == named == causes
    expected = FALSE_ALARM * total
    print(f"all: {failed} of {total} right tables rejected, {expected:g} expected at the most")
    assert failed <= expected + 4.0 * np.sqrt(expected) + 1.0


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 2500, int(sys.argv[2]) if len(sys.argv) > 2 else 20)
