"""Forward runs agree with Taylor series of 25 digits, and these with published values and closed forms."""

import csv
import subprocess
import sys
import tomllib
from pathlib import Path

import mujoco
import numpy as np
import pytest
from mpmath import mp, mpf

import mechsim as ms

ROOT = Path(__file__).resolve().parents[2]
REFERENCE = ROOT / "reference"
RUNS = tomllib.loads((REFERENCE / "runs.toml").read_text())


def rows(name):
    with (REFERENCE / "forward" / f"{name}.csv").open() as file:
        return list(csv.DictReader(file))


def run(name, **changes):
    path, stated = REFERENCE / "forward" / f"{name}.toml", RUNS[name]
    source = ms.load(path, set=changes, still=True) if changes else path
    return ms.dynamics.run(
        source,
        duration=f"{stated['duration']} s",
        samples=stated["rows"],
        restitution=float(stated.get("restitution", 0)),
    )


def columns(result):
    for name, joint in result.motion.joints.items():
        yield f"{name}.q", joint.value
        yield f"{name}.v", joint.rate
    for name, point in result.motion.points.items():
        for rate, vectors in (("", point.position), ("v", point.velocity), ("a", point.acceleration)):
            yield from ((f"{name}.{rate}{axis}", vectors[:, i]) for i, axis in enumerate("xyz"))


def largest_error(name, **changes):
    """Return the largest error of a run, of the largest value of each vector and angle."""
    exact = {key: np.array([float(row[key]) for row in rows(name)]) for key in rows(name)[0]}
    both = {key: value for key, value in columns(run(name, **changes)) if key in exact}
    assert {*both} == {*exact} - {"t"}
    scales = dict.fromkeys((key.rstrip("xyz") for key in both), 0.0)
    for key in both:
        scales[key.rstrip("xyz")] = max(scales[key.rstrip("xyz")], float(np.abs(exact[key]).max()))
    return max(
        float(np.abs(value - exact[key]).max()) / scales[key.rstrip("xyz")] for key, value in both.items()
    )


@pytest.mark.parametrize("name", RUNS)
def test_forward_runs_agree_with_taylor_series(name):
    assert largest_error(name) < 1e-10


def test_another_rod_departs_from_the_series():
    assert largest_error("four_bar", crank="32.001 mm") > 1e-6


def test_the_pendulum_agrees_with_jacobi_functions():
    with mp.workdps(35):
        # theta from the vertical: sin(theta/2) = k sn(K - sqrt(g) t), k = sin(45 deg)
        modulus = mpf("0.5")
        for row in rows("pendulum"):
            phase = mp.ellipk(modulus) - mp.sqrt(mpf("9.81")) * mpf(row["t"])
            theta = 2 * mp.asin(mp.sqrt(modulus) * mp.ellipfun("sn", phase, m=modulus))
            assert abs(theta - mp.pi / 2 - mpf(row["crank.q"])) < mpf(10) ** -24


@pytest.mark.long
@pytest.mark.parametrize(("name", "digits"), [("pendulum", 33)])
def test_the_script_reproduces_released_motion_without_mechsim(name, digits):
    script = (
        "import sys; sys.modules['mechsim'] = None; sys.path.insert(0, sys.argv[1]); import make;"
        "(pairs, _) = make.released(sys.argv[2], int(sys.argv[3]));"
        "print(make.written(list(pairs[-1][1].values())[0]))"
    )
    again = subprocess.run(
        [sys.executable, "-c", script, str(REFERENCE), name, str(digits)],
        capture_output=True,
        text=True,
        check=True,
    )
    key = list(rows(name)[-1])[1]
    with mp.workdps(35):
        assert abs(mpf(again.stdout) - mpf(rows(name)[-1][key])) < mpf(10) ** -22


@pytest.mark.parametrize("name", RUNS)
def test_mjcf_and_sdf_have_the_masses_of_the_toml_file(name):
    bodies = ms.load(REFERENCE / "forward" / f"{name}.toml", still=True).mechanism.links
    masses = sorted(link.inertia.mass for link in bodies)
    model = mujoco.MjModel.from_xml_path(str(REFERENCE / "models" / f"{name}.xml"))
    assert sorted(model.body_mass[1:]) == pytest.approx(masses, rel=1e-12)
    scene = ms.load(REFERENCE / "models" / f"{name}.sdf", still=True).mechanism
    assert sorted(link.inertia.mass for link in scene.links) == pytest.approx(masses, rel=1e-12)


def test_the_squeezer_has_its_published_angles():
    path = ROOT / "validation" / "external_data" / "andrews_squeezer.csv"
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    last = rows("squeezer")[-1]
    for row in csv.DictReader(lines):
        assert float(last[f"{row['name']}.q"]) == pytest.approx(float(row["angle"]), rel=1e-9)
