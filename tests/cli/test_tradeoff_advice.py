"""Commands suggested by a trade-off are valid, and exported models have the measured settings."""

import shlex
from dataclasses import replace

import mujoco
import pytest

from mechsim.model.scene import Scene
from mechsim.simulation import Settings
from mechsim.simulation.source import assembled, from_mechanism
from mechsim.studies.tradeoff.methods import SteppingMethod
from mechsim.studies.tradeoff.work_precision import Point, exporting
from mechsim.subjects.readers import load

SPEED = 20.0
COMPLIANT = Settings(
    steps_per_turn=288,
    integrator="implicitfast",
    constant_steps=2.0,
    compliance=1.0,
    refsafe=True,
    diagexact=True,
    jacobian="dense",
)


def point(settings):
    return Point(SteppingMethod(name="one", base=settings, rank=0), settings, {})


def test_a_suggested_export_has_the_measured_settings(mechsim, tmp_path):
    options = shlex.split(exporting(point(COMPLIANT), "slider_crank", SPEED))[1:]
    answer = mechsim(*options, "-o", "out.xml")
    assert answer.code == 0, answer.err
    written = mujoco.MjModel.from_xml_path(str(tmp_path / "out.xml"))
    mechanism = load("slider_crank").mechanism
    run = from_mechanism(mechanism, assembled(mechanism, Scene()), (), follows_laws=False).loops
    COMPLIANT.apply(run, COMPLIANT.timestep(SPEED))
    for name in ("timestep", "integrator", "solver", "iterations", "tolerance", "jacobian", "enableflags"):
        assert getattr(written.opt, name) == getattr(run.model.opt, name), name
    assert written.eq_solref == pytest.approx(run.model.eq_solref)
    assert written.eq_solimp == pytest.approx(run.model.eq_solimp)
    safe = int(mujoco.mjtDisableBit.mjDSBL_REFSAFE)
    assert written.opt.disableflags & safe == run.model.opt.disableflags & safe == 0
    assert exporting(point(replace(COMPLIANT, compliance=1e-4)), "slider_crank", SPEED) is None


@pytest.mark.parametrize(
    ("options", "output"),
    [
        ("--compliance 1e-8", "an MJCF file can only contain 1"),
        ("--setting integrator=verlet", "there is no integrator 'verlet'"),
        ("--timestep 1ms --setting steps_per_turn=100", "give only one"),
        ("--setting solref=.1,1 --setting constant_steps=2", "give only one"),
        ("--setting refsafe=1", "give true or false"),
        ("--setting compliance=1", "there is no setting 'compliance'"),
        ("--setting jacobian=none", "there is no jacobian 'none'"),
        ("--tolerance 1um --setting solver=CG", "leave out the others"),
        ("--format toml --setting solver=CG", "leave them out"),
        ("--timestep 0", "give a finite time above 0"),
    ],
)
def test_settings_unsupported_by_files_are_rejected(mechsim, tmp_path, options, output):
    answer = mechsim("export", "four_bar", *options.split(), "-o", "out.xml")
    assert (answer.code, answer.out) == (2, "")
    assert output in answer.err
    assert len(answer.err.strip().splitlines()) == 1
    assert not [*tmp_path.iterdir()]
