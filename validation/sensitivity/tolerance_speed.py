"""Processor time of derivatives and of a Monte Carlo study, and its difference from linear theory.

Each mechanism of the catalogue and klann, or those named, has 73 angles and 100,000 random mechanisms whose
dimensions deviate by 0.02 mm or 0.2 mrad.

Run: python validation/sensitivity/tolerance_speed.py [NAME...]
"""

import sys
import time

import numpy as np

import mechsim as ms
from mechsim import catalog


def timed(call):
    """Return the result of a call, and its processor time in [s]."""
    start = time.process_time()
    return call(), time.process_time() - start


def largest_difference(study, quantity):
    """Return the largest relative difference of random and linear standard deviations that are not small."""
    linear = study.deviation(quantity)
    counted = linear > 0.01 * linear.max()
    return float(np.abs(study.random(quantity)["std"][counted] / linear[counted] - 1.0).max(initial=0.0))


def main():
    for name in sys.argv[1:] or [*catalog.MECHANISMS, "klann"]:
        subject = ms.moved(name)
        point = list(subject.solver.mechanism.points)[-1]
        table, table_time = timed(lambda subject=subject, point=point: ms.sensitivity(subject, [point]))
        limits = {
            item: 2e-5 if dimension.unit == "m" else 2e-4 for item, dimension in table.dimensions.items()
        }
        study, study_time = timed(lambda table=table, limits=limits: ms.tolerance_study(table, limits))
        result, difference = study.sampled, max(largest_difference(study, item) for item in table.values)
        print(
            f"{name:14s} {len(limits):2d} dimensions: derivatives {table_time:.2f} s, {result.samples} "
            f"random mechanisms {study_time:.2f} s, order {result.sampling.order or 'none: each solved'}, "
            f"error of the expansion {result.sampling.expansion_error:.1e} standard deviations, "
            f"random and linear deviation within {100.0 * difference:.1f} %"
        )


if __name__ == "__main__":
    main()
