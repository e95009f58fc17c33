"""Whether stated uncertainties of fitted dimensions are true: how many of many noisy tables hold the truth.

For each mechanism, tables of places and of a joint at 24 instants are made with normal errors of 20 um and
0.3 mrad, with and without telling them, and with an unknown zero of the crank; dimensions are fitted, and it
is counted how often the truth lies within the 95 % that are stated. Of 3 dimensions and 200 tables that is
right within 93 to 97 % (1.5 % of binomial spread for one dimension alone).

Run: python validation/sensitivity/fit_coverage.py [TABLES] [NAME...]
"""

import sys

import numpy as np

import mechsim as ms

CASES = (
    ("four_bar", ("C.x", "C.y", "rocker.q"), ("coupler", "rocker", "arm_angle"), False),
    ("four_bar", ("C.x", "C.y", "rocker.q"), ("crank", "coupler", "rocker"), True),
    ("slider_crank", ("B.x",), ("crank", "rod"), True),
    ("rssr", ("P3.x", "P3.y", "P3.z"), ("coupler", "pivot.z", "gamma2"), True),
    ("klann", ("G.x", "G.y"), ("DE", "EG", "BH"), False),
)
ANGLES = np.linspace(0.2, 6.0, 24)
NOISE = {"m": 2e-5, "rad": 3e-4}
ZERO = 0.02
PART = 0.95


def covered(name, columns, vary, offset, errors_known, tables):
    """How many of all fitted dimensions lie within what is stated, and the mean of squares next to one."""
    subject = ms.moved(name, angles=ANGLES)
    exact = subject.values(columns, {subject.offset: ZERO if offset else 0.0})
    true = {item: subject.designs.dimensions[item].value for item in vary}
    true |= {subject.offset: ZERO} if offset else {}
    random, hits, squares = np.random.default_rng(7), [], []
    for _ in range(tables):
        table = {"angle": ANGLES}
        for column, values in exact.items():
            size = NOISE["rad" if column.endswith(".q") else "m"]
            table[column] = values + size * random.standard_normal(len(values))
            if errors_known:
                table[f"{column}±"] = np.full(len(values), size)
        result = ms.fit(subject, table, vary, offset=offset)
        assert result.outcome == "fitted"
        within = result.within(PART)
        hits.append([abs(result.values[item] - value) <= within[item] for item, value in true.items()])
        squares.append(result.spread**2)
    return np.mean(hits), np.mean(squares)


def main(tables, names):
    for case in (item for item in CASES if not names or item[0] in names):
        # of several units alike errors are wanted where none are reported
        for errors_known in (True, False) if len({item.endswith(".q") for item in case[1]}) == 1 else (True,):
            share, square = covered(*case, errors_known, tables)
            words = f"{case[0]:13s} {', '.join(case[2])}{', crank.offset' if case[3] else ''}"
            print(
                f"{words}: {100.0 * share:.1f} % within 95 %, errors {'known' if errors_known else 'unknown'}"
                + (f", mean square {square:.2f}" if errors_known else ""),
                flush=True,
            )
            assert 0.93 <= share <= 0.97 or tables < 200


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 200, sys.argv[2:])
