"""What derivatives and a Monte Carlo of 100,000 mechanisms cost, and how far it is from linear theory.

Prints processor time for every mechanism of the catalogue and klann, or those named: 73 angles, every
dimension off by 0.02 mm or 0.2 mrad.

Run: python validation/sensitivity/tolerance_speed.py [NAME...]
"""

import sys
import time

import numpy as np

import mechsim as ms
from mechsim.analytic import catalog


def spent(call):
    """What a call returns, and the processor time it took in [s]."""
    start = time.process_time()
    return call(), time.process_time() - start


def apart(study, quantity):
    """By how much random and linear standard deviations differ, where they are not small."""
    linear = study.deviation(quantity)
    large = linear > 0.01 * linear.max()
    return float(np.abs(study.random(quantity)["std"][large] / linear[large] - 1.0).max(initial=0.0))


def main():
    for name in sys.argv[1:] or [*catalog.DRIVES, "klann"]:
        subject = ms.moved(name)
        point = list(subject.form.mechanism.points)[-1]
        table, derived = spent(lambda subject=subject, point=point: ms.sensitivity(subject, [point]))
        bounds = {item: 2e-5 if of.unit == "m" else 2e-4 for item, of in table.dimensions.items()}
        study, taken = spent(lambda table=table, bounds=bounds: ms.tolerance_study(table, bounds))
        result, most = study.sampled, max(apart(study, item) for item in table.values)
        print(
            f"{name:14s} {len(bounds):2d} dimensions: derivatives {derived:.2f} s, {result.samples} random "
            f"mechanisms {taken:.2f} s, to order {result.order or 'none: each solved'}, solved ones "
            f"{result.miss:.1e} deviations off, "
            f"random and linear deviation within {100.0 * most:.1f} %"
        )


if __name__ == "__main__":
    main()
