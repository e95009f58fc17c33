"""Settings that no exported file contains are rejected."""

import pytest


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
