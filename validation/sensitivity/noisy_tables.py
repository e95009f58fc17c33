"""False alarms and detections of `validate --against` with noisy tables.

Tables of positions and of a joint at 60 crank angles have normal errors of 20 um and 0.3 mrad, stated as
standard deviations. Correct tables must fail with a probability of at most 1e-3. Tables of a mechanism with a
link 0.1 mm too short must fail, and the findings must name the link.

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


def evaluation_points(linkage):
    return EvaluationPoints(linkage, ANGLES, np.ones_like(ANGLES), np.zeros_like(ANGLES))


def exact_candidates(solver, columns):
    """Return the exact quantities of a solver, with standard deviations."""
    evaluation, reader = evaluation_points(solver), QuantityReader(solver.mechanism, "the script")
    candidates = []
    for column in columns:
        axes = column.partition(".")[2]
        reader_of = reader.read(column, {"xy": 2, "": 3}.get(axes))
        values = evaluation.exact(reader_of)
        candidates.append(Candidate(reader_of, values, np.full(values.shape, NOISE[reader_of.unit])))
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
        evaluation, correct = evaluation_points(ms.load(name)), exact_candidates(ms.load(name), columns)
        evaluation.conditioning  # noqa: B018 - solved once for all tables
        shortened, detected, named, sigma = exact_candidates(shorter(name, link), columns), 0, 0, []
        rejected = 0
        for _ in range(tables):
            candidates = [noisy(candidate, random) for candidate in correct]
            # the verdict alone, without a diagnosis
            result = agreement(evaluation, candidates, "a correct table", diagnose=False)
            sigma.append(np.mean([noise.total.worst for _, noise in result.measured]))
            rejected += not result.passed
        for _ in range(causes):
            result = agreement(
                evaluation,
                [noisy(candidate, random) for candidate in shortened],
                "a wrong table",
                None,
                parametric_model(name),
            )
            detected += not result.passed
            named += link in [item.what for item in result.findings]
        failed, total = failed + rejected, total + tables
        print(
            f"{name:13s} correct: {rejected} of {tables} rejected, noise of {np.mean(sigma):.3f} sigma; "
            f"{link} 0.1 mm short: {detected} of {causes} rejected, {named} with that cause",
            flush=True,
        )
        assert detected == named == causes
    expected = FALSE_ALARM * total
    print(f"all: {failed} of {total} correct tables rejected, {expected:g} expected at most")
    assert failed <= expected + 4.0 * np.sqrt(expected) + 1.0


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 2500, int(sys.argv[2]) if len(sys.argv) > 2 else 20)
