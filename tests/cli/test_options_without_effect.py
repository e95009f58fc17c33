"""An option that has no effect in a mode of a command is an error; nothing is computed or written."""

from pathlib import Path

import numpy as np
import pytest
from model_files import model_text
from typed_call import Call

from mechsim.cli.command import Stated
from mechsim.errors import InputError

LOOP = model_text("options_without_effect_loop.xml")

RUN = "dynamics forward four_bar --initial crank.q=30deg --duration 10ms"
STATICS, MODES = "dynamics statics four_bar", "dynamics modes four_bar"
RESPONSE = "dynamics response four_bar crank:rocker"
CASES = [
    (RUN, "--speed 100rpm"),
    (RUN, "--restitution 0.5"),
    ("solve four_bar --json", "--units mm,deg"),
    (RUN, "--actuators nosuch=1"),
    (RUN + " --turns 2", "--drive crank=1rad/s"),
    (RUN + " --turns 2", "--restitution 0.5"),
    (RUN, "--free"),
    (RUN, "--coefficient 0.01"),
    (RUN, "--units mm,deg"),
    (RUN, "--assemblies 3"),
    (RUN, "--method pose"),
    *[
        (mode, option)
        for mode in (STATICS, MODES, RESPONSE)
        for option in (
            "--speed 100rpm",
            "--turns 2",
            "--samples 13",
            "--duration 1s",
            "--until crank.q=90deg",
            "--restitution 0.5",
            "--actuators crank",
            "--units mm,deg",
            "--drive crank=1rad/s",
            "--of distance:A,B",
        )
    ],
    (STATICS, "--track B"),
    (STATICS, "--plot a.svg"),
    ("validate stewart_gough", "--speed 77rpm"),
    ("dynamics inverse four_bar", "--restitution 0.5"),
    ("dynamics inverse four_bar", "--controller crank=-crank.v"),
    ("dynamics inverse four_bar", "--of distance:A,B"),
    ("dynamics inverse four_bar --drive crank=10rad/s", "--speed 100rpm"),
    ("dynamics inverse four_bar --drive crank=10rad/s", "--turns 2"),
    ("dynamics inverse four_bar --drive crank=10rad/s", "--coefficient 0.01"),
    ("dynamics forward four_bar", "--actuators nosuch=1"),
    ("dynamics forward four_bar", "--coefficient 0.01"),
    ("dynamics forward four_bar", "--method pose"),
    ("view four_bar -o a.html --initial crank.q=30deg", "--speed 10rpm"),
    ("view four_bar -o a.html --drive crank=1rad/s", "--speed 10rpm"),
    ("view four_bar -o a.html --mode 1", "--until crank.q=90deg"),
    ("view four_bar -o a.html --mode 1", "--duration 1s"),
    ("render four_bar -o a.png --mode 1", "--track B"),
    ("plot four_bar -o a.svg --kind transmission", "--track B"),
    ("compile four_bar -o a.h", "--drive crank=1rad/s"),
    ("compile four_bar -o a.h", "--duration 1s"),
    ("export four_bar -o a.xml", "--drive crank=1rad/s"),
    ("export five_bar -o a.xml", "--drive left=1rad/s --drive right=1rad/s"),
    ("export four_bar -o a.xml", "--duration 1s"),
    ("certify four_bar", "--track B"),
    ("trace four_bar", "--duration 1s"),
    ("tune loop.xml --tolerance 1mm -o a.xml", "--loops loops.yaml"),
    ("simulate four_bar", "--units mm,deg"),
    ("simulate loop.xml --ctrl m=0.1", "--start crank=0.1"),
    ("simulate loop.xml --ctrl m=0.1", "--lock others"),
    (RUN, "--track B"),
    ("render four_bar -o a.png", "--speed 10rpm"),
    ("render four_bar -o a", "--fps 10"),
    ("render four_bar -o a.png", "--frames-per-turn 10"),
    ("render four_bar -o a.png --drive crank=1rad/s", "--turns 2"),
    ("sweep four_bar --vary crank=25mm:26mm:2 --measure range:rocker -o a.csv", "--set crank=27mm"),
    ("show four_bar --drive crank=1rad/s", "--angle 30deg"),
    ("show four_bar --drive crank=1rad/s", "--driver rocker"),
    ("trace four_bar", "--samples 10"),
    ("trace four_bar", "--units mm,deg"),
    ("simulate four_bar --method pose", "--setting integrator=RK4"),
    ("simulate four_bar --method pose", "--timestep 1ms"),
    ("simulate four_bar --method pose", "--setting island=true"),
    ("simulate loop.xml --ctrl m=0.1", "--set crank=25mm"),
    ("simulate loop.xml --ctrl m=0.1", "--scene dynamics"),
    ("simulate loop.xml --ctrl m=0.1", "--cut knee"),
    ("simulate loop.xml --ctrl m=0.1", "--units mm,deg"),
    ("sweep four_bar --vary crank=25mm:26mm:2 --measure range:rocker -o a.csv", "--speed 10rpm"),
    ("sweep four_bar --vary crank=25mm:26mm:2 --measure peak:rocker -o a.csv", "--samples 9"),
    ("sensitivity four_bar --of B.x --to crank", "--gravity 0,-5,0"),
    ("sensitivity four_bar --of B.x --to crank", "--seed 5"),
    ("validate four_bar --against a.csv", "--budget 1s"),
    ("check loop.xml --json", "--output-format sarif"),
    ("solve four_bar", "--change-point branch"),
    ("simulate four_bar", "--scene dynamics"),
    ("trace four_bar", "--drive crank=1rad/s"),
    ("dynamics forward loop.xml --duration 1ms", "--density 1000"),
]


@pytest.mark.long
@pytest.mark.parametrize(("command", "option"), CASES, ids=[f"{c} {o}" for c, o in CASES])
def test_an_option_without_effect_is_named(mechsim: Call, tmp_path: Path, command: str, option: str):
    (tmp_path / "loop.xml").write_text(LOOP)
    code, out, err = mechsim(*command.split(), *option.split())
    assert (code, out) == (2, "")
    long_name = {"-o": "--output"}.get(option.split()[0], option.split()[0])
    assert long_name in err
    assert [path.name for path in tmp_path.iterdir()] == ["loop.xml"]


def test_only_stated_options_are_excluded():
    stated = Stated({"speed": "--speed"})
    stated.exclude(["samples"], "in a run")
    with pytest.raises(InputError, match="--speed has no effect in a run"):
        stated.exclude(["samples", "speed"], "in a run")


@pytest.mark.parametrize(
    ("function", "reason"),
    [("return {'x': 1.0}", "returns dict"), ("return motion.nosuch", "ends in AttributeError")],
)
def test_a_wrong_measure_ends_a_sweep(mechsim: Call, tmp_path: Path, function: str, reason: str):
    (tmp_path / "m.py").write_text(f"def f(motion):\n    {function}\n")
    sweep = "sweep four_bar --vary crank=3cm:3.1cm:2 --measure m.py:f -o s.csv --samples 9"
    code, _, err = mechsim(*sweep.split())
    assert code == 2
    assert reason in err
    assert not (tmp_path / "s.csv").exists()


def test_a_measure_without_value_at_one_design_does_not_end_a_sweep(mechsim: Call, tmp_path: Path):
    value = "math.sqrt(abs(motion.points['A'].position[0, 0]) - 0.0305)"
    (tmp_path / "m.py").write_text(f"import math\ndef f(motion):\n    return {value}\n")
    # the crank of 30 mm gives sqrt(-0.0005), that of 31 mm sqrt(0.0005)
    sweep = "sweep four_bar --vary crank=3cm:3.1cm:2 --measure m.py:f -o s.csv --samples 9"
    assert mechsim(*sweep.split())[0] == 0
    values = np.genfromtxt(tmp_path / "s.csv", delimiter=",", names=True, dtype=None, encoding=None)["mpyf"]
    assert np.isnan(values[0])
    assert values[1] == pytest.approx(np.sqrt(0.0005), rel=1e-9)


def test_a_sweep_whose_designs_all_fail_fails(mechsim: Call):
    sweep = "sweep four_bar --vary crank=30cm:31cm:2 --measure range:rocker -o s.csv --samples 9"
    code, out, _ = mechsim(*sweep.split())
    assert code == 1
    assert "no design can be measured" in out


def test_empty_tolerances_prove_nothing(mechsim: Call):
    code, out, err = mechsim("certify", "four_bar", "--within", "")
    assert (code, out) == (2, "")
    assert "--within names no tolerance" in err
