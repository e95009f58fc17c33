"""Cost of a design in a sweep by the commands: time, memory, and the time of 1e9 designs.

Targets on two cores: a million `four_bar` designs at 72 angles in 30 s and 1 GB, a million `rssr` in 60 s,
10,000 gallery six-bars in 60 s. Processor time and memory are those of the process of the command, including
its start. Wall time includes other load of the machine.

Run: OPENBLAS_NUM_THREADS=1 python validation/speed/sweep_speed.py [fraction of the designs, such as 0.1]
"""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

# mechanism, designs, target in seconds on two cores, options of the command
SWEEPS = (
    ("four_bar", 1_000_000, 30.0, "--vary crank=29mm:35mm --vary coupler=85mm:95mm --measure range:rocker"),
    ("rssr", 1_000_000, 60.0, "--vary crank=12mm:14mm --vary coupler=44mm:48mm --measure range:rocker"),
    ("watt_six_bar", 10_000, 60.0, "--vary crank=21mm:29mm --vary output=55mm:65mm --measure range:output"),
    ("looper", 2_000, None, "--vary crank=5.9mm:6.1mm --measure stroke:E"),
    ("warp_knitter", 2_000, None, "--vary crank1=8.9mm:9.1mm --measure range:rocker"),
    ("bennett", 2_000, None, "--vary length0=49mm:51mm --measure range:rocker"),
    ("five_bar", 2_000, None, "--vary half=29mm:31mm --measure max:P.x"),
    ("planetary_gear", 2_000, None, "--vary module=1.9:2.1 --measure max:carrier.v"),
    # one design at a time, for its own equations of motion
    ("four_bar", 1_000, None, "--vary crank=29mm:35mm --measure max:torque"),
)


def command_cost(name: str, count: int, options: str) -> tuple[float, float, float]:
    """Return wall and processor time in [s] and the largest memory in [MB] of a command."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out.nc"
        command = f"-m mechsim sweep {name} --sample sobol:{count} {options} -o {out}"
        nothing, start = subprocess.DEVNULL, time.perf_counter()
        process = subprocess.Popen([sys.executable, *command.split()], stdout=nothing, stderr=nothing)
        _, status, used = os.wait4(process.pid, 0)
        wall, status = time.perf_counter() - start, status if out.exists() else 1
        assert status == 0, f"{command} ended with {status}"
    return wall, used.ru_utime + used.ru_stime, used.ru_maxrss / 1e3


def main() -> None:
    fraction = float(sys.argv[1]) if len(sys.argv) > 1 else 1.0
    for name, full_count, target, options in SWEEPS:
        count = max(64, round(fraction * full_count))
        load = os.getloadavg()[0]
        wall, cpu, memory = command_cost(name, count, options)
        target_text = f" (target {target * fraction:g} s on two cores)" if target else ""
        print(
            f"{name:<14} {count:>9,} designs: {wall:6.1f} s at a load of {load:.1f}, processor {cpu:6.1f} s"
            f"{target_text}, {1e6 * cpu / count:7.1f} us a design, {memory:.0f} MB; 1e9 of them: "
            f"{1e9 * cpu / count / 3600.0:.3g} core hours",
            flush=True,
        )


if __name__ == "__main__":
    main()
