"""Each option of each command: does it change the output or a file, or is it rejected?

    .venv/bin/python validation/robustness/options_without_effect.py [COMMAND ...]

An option that is accepted and changes nothing is printed. Some have no effect for a good reason, such as a value that
equals the model's own; each line is to be judged.
"""

import os
import re
import shutil
import signal
import sys
import tempfile
from pathlib import Path

from mechsim.cli import COMMANDS, load_command, main

MUTATED = Path(__file__).parent / "mutated"
SCENE = """<mujoco><option timestep="0.002"/><worldbody>
<body name="c" pos="0 0 1"><joint name="crank" axis="0 1 0" damping="1"/><geom type="capsule" fromto="0 0 0 .1 0 0" size=".01"/>
 <body name="k" pos=".1 0 0"><joint name="rod" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .3 0 0" size=".01"/><site name="P" pos=".1 0 0"/></body></body>
<body name="r" pos=".4 0 .8"><joint name="rocker" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0 0 .2" size=".01"/></body>
<body name="arm" pos="1 0 1"><joint name="arm" axis="0 1 0" range="-60 60" limited="true"/><geom type="capsule" fromto="0 0 0 0 0 .2" size=".01"/></body>
</worldbody><equality><connect body1="k" body2="r" anchor=".3 0 0"/></equality>
<contact><exclude body1="k" body2="r"/></contact>
<actuator><position name="m" joint="crank" kp="100"/><position name="n" joint="arm" kp="10"/></actuator>
<keyframe><key name="bent" qpos="0 0 0 0.5"/></keyframe></mujoco>"""
# command -> words of runs to which options are added; a file ends in one of `FILES`
BASES = {
    "": ("four_bar", "machine.toml", "scene.xml"),
    "check": ("scene.xml", "loop.urdf"),
    "export": ("four_bar", "machine.toml --format toml", "scene.xml", "scene.xml --format toml"),
    "solve": ("four_bar -o o.csv", "machine.toml -o o.csv", "scene.xml --drive crank=0.1*sin(t) --drive arm=0.1*sin(t)"),
    "trace": ("four_bar -o o.csv", "scene.xml --lock arm -o o.csv"),
    "simulate": ("four_bar --samples 5 -o o.csv", "machine.toml --samples 5 -o o.csv", "scene.xml --ctrl m=0.1 --duration 0.2s -o o.csv"),
    "sample": ("scene.xml -n 3 -o o.npz", "loop.urdf -n 3 -o o.npz"),
    "map": ("scene.xml --from crank=-0.2:0.2 --to rocker --points 3 -o o.npz",),
    "dynamics inverse": ("four_bar --samples 9", "machine.toml --samples 9 --method none", "scene.xml --drive arm=0.1*sin(t) --drive crank=0.1*sin(t) --method none"),
    "dynamics forward": ("four_bar --duration 0.02s --method none", "machine.toml --duration 0.1s", "scene.xml --duration 0.1s --method none"),
    "dynamics statics": ("four_bar", "scene.xml"),
    "validate": ("machine.toml",),
    "certify": ("four_bar", "machine.toml"),
    "tradeoff": ("four_bar --budget 2s",),
    "extremes": ("four_bar --quick",),
    "tune": ("scene.xml --tolerance 1mm --budget 3s --duration 0.2s --ctrl m=0.1 -o t.xml",),
    "reduce": ("scene.xml --tolerance 1mm --duration 0.2s --ctrl m=0.1 -o t.xml",),
    "sweep": ("four_bar --vary crank=3cm:3.2cm:3 -o s.csv", "machine.toml --vary rod=8cm:9cm:3 -o s.csv"),
    "sensitivity": ("four_bar --of B.x --samples 100", "machine.toml --of B.x --tolerances crank=0.1mm --samples 100"),
    "fit": ("machine.toml --to measured.csv --vary crank",),
    "synthesize": ("looper --through 12.9,30mm --tilt 1.4deg --length 4mm",),
    "compile": ("four_bar -o o.h", "machine.toml -o o.h"),
    "plot": ("four_bar -o o.svg", "machine.toml -o o.svg --kind torque", "scene.xml -o o.svg --kind poses"),
    "render": ("four_bar -o o.png --size 160x120", "machine.toml -o o.gif --size 64x48", "scene.xml -o o.png --size 160x120"),
    "view": ("four_bar -o o.html", "scene.xml -o o.html"),
    "schema": ("solve",),
    "list": ("",), "doctor": ("",), "mcp": (),
}  # fmt: skip
# option -> values; others are in `BY_TYPE`
VALUES = {
    "lock": ("arm=0.2rad", "arm"), "start": ("rocker=0.4rad",), "key": ("bent",), "loops": ("loops.yaml",),
    "drive": ("crank=30rpm", "crank=0.2rad*sin(2*pi*t)"), "track": ("B", "P"), "duration": ("0.05s",), "set": ("crank=3.1cm",),
    "angle": ("40deg",), "angles": ("10deg:50deg:10deg",), "speed": ("77rpm",), "samples": ("7",), "turns": ("0.5",),
    "units": ("mm", "file"), "output": ("out.csv", "out.xml"), "plot": ("out.svg",), "at": ("at.csv",), "profile": ("profile.csv",),
    "tolerance": ("0.5mm", "0.5"), "timestep": ("1ms",), "setting": ("integrator=implicit",), "compliance": ("1e-6",),
    "drive-inertia": ("10",), "ctrl": ("m=0.2", "n=0.1"), "scene": ("pose", "dynamics"), "cut": ("A",),
    "change-point": ("branch",), "method": ("step", "pose", "none"), "gravity": ("0,-5,0",), "load": ("loads.csv",),
    "friction": ("crank=0.1,0.1",), "spring": ("crank=1,0.1rad",), "damper": ("crank=1",), "flywheel": ("0.1",),
    "density": ("1000",), "diameter": ("2mm",), "coefficient": ("0.1",), "actuators": ("crank,rocker",), "motor": ("constant:1",),
    "gear": ("3",), "controller": ("crank=-crank.q",), "initial": ("crank.q=0.3rad",), "until": ("crank.q=10deg",),
    "restitution": ("0.5",), "of": ("B.x", "crank,rocker"), "budget": ("1s", "50"), "select": ("MS1",), "ignore": ("MS110",),
    "output-format": ("json",), "target": ("urdf",), "fix": ("fixed.xml",), "format": ("toml", "urdf"), "style": ("menagerie",),
    "independent": ("arm",), "all": ("folder",), "driver": ("r", "wheel"), "against": ("measured.csv",), "report": ("folder",),
    "within": ("1deg",), "by": ("velocity", "torque"), "allow": ("contacts",), "python": ("run.py",), "vary": ("crank=3cm:3.1cm:2", "rod"),
    "design": ("grid", "sobol"), "sample": ("5",), "measure": ("max:B.x",), "check": ("1",), "scheduler": ("",), "to": ("crank", "arm"),
    "tolerances": ("crank=0.1mm",), "distribution": ("normal",), "through": ("12.8,30mm",), "tilt": ("2deg",), "length": ("5mm",),
    "test": ("t.c",), "points": ("B", "4"), "from": ("simulated", "crank=-0.1:0.1"), "stopped": ("crank1",), "response": ("crank:B.x",),
    "kind": ("reactions", "poses"), "fps": ("10",), "frames-per-turn": ("5",), "slow": ("3",), "size": ("80x60",), "camera": ("30,20", "top"),
    "backend": ("osmesa",), "labels": ("B",), "direction": ("x", "0,1,1"), "project": ("xz",), "positions": ("3",), "arrows": ("velocity", "force"),
    "magnify": ("2",), "up": ("x",), "mode": ("1",), "degree": ("2",), "seed": ("5",), "n": ("4",), "starts": ("50",), "offset": ("",),
}  # fmt: skip
LIMIT = 90  # [s] a run: longer ones are counted as changed


def outcome(words: list[str]) -> tuple[int, list[str]]:
    """Return exit code and words of the output and files of a command, run in a child process."""
    folder = Path(tempfile.mkdtemp())
    for path in MUTATED.iterdir():
        shutil.copy(path, folder)
    (folder / "scene.xml").write_text(SCENE)
    before = {path.name for path in folder.iterdir()} | {"printed"}
    if (child := os.fork()) == 0:
        signal.alarm(LIMIT)
        os.chdir(folder)
        printed = os.open("printed", os.O_CREAT | os.O_WRONLY)
        os.dup2(printed, 1), os.dup2(printed, 2)
        sys.argv = ["mechsim", *words]
        try:
            main()
        except SystemExit as end:
            sys.stdout.flush()
            os._exit(end.code if isinstance(end.code, int) else 0)
        sys.stdout.flush()
        os._exit(0)
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    written = [path for path in sorted(folder.rglob("*")) if path.is_file() and path.name not in before]
    text = "\n".join(path.read_bytes().decode("latin-1") for path in [folder / "printed", *written])
    shutil.rmtree(folder)
    return code, re.split(r"[\s,]+", text)


def check(command: str, base: str) -> None:
    """Print the options that a run accepts without an effect."""
    words = [*command.split(), *base.split()]
    (code, first), (_, second) = outcome(words), outcome(words)
    if code not in (0, 1):
        return print(f"{' '.join(words)}: exit code {code}: {' '.join(first)[:200]}", flush=True)
    # times of the computer differ between equal runs
    equal = [a == b for a, b in zip(first, second, strict=False)]
    for parameter in load_command(command).params:
        name = max(parameter.opts, key=len).lstrip("-")
        option = max(parameter.opts, key=len)
        given = option in words or (name == "output" and "-o" in words) or (name == "n" and "-n" in words)
        if parameter.param_type_name != "option" or name in ("json", "help", "verbose") or given:
            continue
        for value in [None] if parameter.is_flag else VALUES[name]:
            tried = [*words, option, *([] if value in (None, "") else [value])]
            changed, now = outcome(tried)
            same = len(now) == len(first) and all(
                a == b for a, b, e in zip(first, now, equal, strict=False) if e
            )
            if changed not in (0, 1, 2, -signal.SIGALRM) or (changed == code and same):
                print(f"{' '.join(tried)}: exit code {changed}", flush=True)


if __name__ == "__main__":
    for command in sys.argv[1:] or COMMANDS:
        for base in BASES.get(command, BASES[""]):
            check(command, base)
