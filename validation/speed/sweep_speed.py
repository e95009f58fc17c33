"""What a design of a sweep costs: processor and wall time, memory, and what 1e9 designs would take.

Wanted on two cores: a million `four_bar` designs by 72 poses under 30 s and 1 GB, a million `rssr` under
60 s, 10,000 gallery six-bars under 60 s. Each sweep runs in a process of its own, so that its memory is
known.

Run: OPENBLAS_NUM_THREADS=1 python validation/speed/sweep_speed.py [part of the designs, such as 0.1]
"""

import json
import subprocess
import sys

SWEEPS = {
    "four_bar": ({"crank": (0.029, 0.035), "coupler": (0.085, 0.095)}, "range:rocker", 1_000_000, 30.0),
    "rssr": ({"crank": (0.012, 0.014), "coupler": (0.044, 0.048)}, "range:rocker", 1_000_000, 60.0),
    "watt_six_bar": ({"crank": (0.021, 0.029), "output": (0.055, 0.065)}, "range:output", 10_000, 60.0),
}
BILLION, HOUR = 1e9, 3600.0
ONE = """
import json, resource, sys, time
import mechsim as ms
name, spans, measure, count = json.loads(sys.argv[1])
ms.sweep(name, spans, measure, sample="sobol:64")
wall, busy = time.perf_counter(), time.process_time()
found = ms.sweep(name, spans, measure, sample=f"sobol:{count}")
wall, busy = time.perf_counter() - wall, time.process_time() - busy
memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
print(json.dumps([wall, busy, memory, int((found["outcome"] == "met").sum())]))
"""


def main() -> None:
    part = float(sys.argv[1]) if len(sys.argv) > 1 else 1.0
    for name, (spans, measure, whole, wanted) in SWEEPS.items():
        count = max(64, round(part * whole))
        asked = json.dumps([name, spans, measure, count])
        done = subprocess.run([sys.executable, "-c", ONE, asked], capture_output=True, text=True, check=True)
        wall, busy, memory, built = json.loads(done.stdout)
        each = busy / count
        print(
            f"{name:<13} {count:>9,} designs, {built:,} built: {wall:6.1f} s, processor {busy:6.1f} s "
            f"(wanted {wanted * part:g} s on two cores), {1e6 * each:7.1f} us a design, {memory:.0f} MB; "
            f"1e9 designs: {BILLION * each / HOUR:.3g} core hours"
        )


if __name__ == "__main__":
    main()
