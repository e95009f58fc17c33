"""IVP test set and IFToMM library: Andrews' squeezer, with digits over processor time, and A01 to A05."""

import time
from collections.abc import Iterator

import mechsim as ms
from validation.published import a01_pendulum, a02_four_bars, a04_bricard, a05_governor, rsup
from validation.published.a03_squeezer import END, NAMES, digits, forces, squeezer
from validation.published.table import Row
from validation.suites.case import Case, Clone, Suite

# relative tolerance of a step -> correct digits (scd) that the worst angle must have
DIGITS = {1e-6: 5.0, 1e-8: 7.0, 1e-10: 9.0, 3e-13: 9.0}
REASON = "ten steps' tolerance, and the reference's 1e-9"
# of the governor
GOVERNOR = 1e-9
BY_HAND = "of DOP853 with equations derived by hand"
# by MuJoCo; the last row of A02 is a time
STEPPED = {
    "A01, pendulum, 10 periods": a01_pendulum.rows,
    "A02, two four-bars, 10 s": lambda: a02_four_bars.rows(2, 10.0, 2.5e-4, 1e-4, 1e-4)[:-1],
    "A04, Bricard, 10 s": a04_bricard.rows,
    "spatial slider-crank, 5 s": rsup.rows,
}


def cases(_: Clone | None) -> Iterator[Case]:
    for tolerance, least in DIGITS.items():
        before = time.process_time()
        motion = ms.dynamics.run(squeezer(), forces(), duration=END, samples=1, tolerance=tolerance).motion
        seconds = time.process_time() - before
        scd = digits([motion.joints[name].value[-1] for name in NAMES])
        row = Row("worst angle", 10.0**-scd, 10.0**-least, "", REASON)
        note = f"scd {scd:.1f} in {1e3 * seconds:.0f} ms"
        yield Case(f"squeezer, step tolerance {tolerance:g}", (row,), note=note)
    errors = a05_governor.compare(1.0)
    units = {"shaft": "rad", "arm": "rad", "slider": "m"}
    rows = (Row(what, getattr(errors, what), GOVERNOR, unit, BY_HAND) for what, unit in units.items())
    yield Case("A05, stiff flyball governor, 1 s", tuple(rows))
    for name, rows in STEPPED.items():
        yield Case(name, tuple(rows()))
    yield Case("IVP slider-crank", rejected="its connecting rod is flexible")
    yield Case("IFToMM bicycle", rejected="rolling constrains velocities")


SUITE = Suite(
    "IVP test set and IFToMM library",
    "",
    "Andrews' squeezer: relative error of the worst of seven angles at 0.03 s, and processor time.",
    cases,
)
