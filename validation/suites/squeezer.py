"""Andrews' squeezer of the IVP test set as a work-precision diagram: correct digits over processor time."""

import time
from collections.abc import Iterator

import mechsim as ms
from validation.published.a03_squeezer import END, NAMES, digits, forces, squeezer
from validation.published.table import Row
from validation.suites.case import Case, Clone, Suite

# relative tolerance of a step -> correct digits (scd) that the worst angle must have
DIGITS = {1e-6: 5.0, 1e-8: 7.0, 1e-10: 9.0, 3e-13: 9.0}
REASON = "ten steps' tolerance, not below the 1e-9 to which the reference is certain"


def cases(_: Clone | None) -> Iterator[Case]:
    for tolerance, least in DIGITS.items():
        before = time.process_time()
        motion = ms.dynamics.run(squeezer(), forces(), duration=END, samples=1, tolerance=tolerance).motion
        seconds = time.process_time() - before
        scd = digits([motion.joints[name].value[-1] for name in NAMES])
        row = Row("worst angle", 10.0**-scd, 10.0**-least, "", REASON)
        yield Case(f"step tolerance {tolerance:g}", (row,), note=f"scd {scd:.1f} in {1e3 * seconds:.0f} ms")


SUITE = Suite(
    "IVP test set: Andrews' squeezer",
    "",
    "Relative error of the worst of seven angles at 0.03 s, and processor time of the whole call.",
    cases,
)
