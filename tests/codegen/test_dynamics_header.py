"""A header of the motion under forces gives mechsim's own run, without allocation, and its test can fail."""

import re
import subprocess
from dataclasses import replace

import numpy as np
import pytest

import mechsim as ms
from mechsim.codegen.dynamics_header import dynamics_header, dynamics_test
from mechsim.codegen.fmu_dynamics import dynamic_fmu
from mechsim.kinetics.model import dynamic_model

WEIGHT = ms.Forces(gravity=(0.0, -9.81, 0.0))
# damping fast enough for the implicit method
STIFF = replace(WEIGHT, friction=(ms.Friction("rocker", viscous=3.0),))
STRICT = "-std=c99", "-Wall", "-Wextra", "-Werror"
SANITIZED = "-fsanitize=address,undefined", "-fno-sanitize-recover"


def outcome(folder, compiler, *flags):
    """Return the exit code and the text of a compiled program."""
    made = subprocess.run(
        [compiler, *STRICT, *flags, "test.c", "-o", "test", "-lm"], cwd=folder, capture_output=True, text=True
    )
    assert made.returncode == 0, made.stderr
    result = subprocess.run(["./test"], cwd=folder, capture_output=True, text=True)
    return result.returncode, result.stdout + result.stderr


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "forces", "initial"),
    [
        ("four_bar", STIFF, {"A.q": "30deg"}),
        # ball joints, whose rotations are quaternions
        ("rssr", WEIGHT, {"crank.q": "20deg"}),
    ],
)
def test_its_own_test_passes_and_rejects_another_motion(tmp_path, name, forces, initial):
    model = dynamic_model(ms.load(name), forces)
    made = dynamic_fmu(model, initial)
    (tmp_path / "model.h").write_text(dynamics_header(made))
    (tmp_path / "test.c").write_text(dynamics_test(made, model, initial, "model.h"))
    code, text = outcome(tmp_path, "clang", *SANITIZED)
    assert (code, "done; largest error" in text) == (0, True), text
    # what allocates is not called
    code, text = outcome(tmp_path, "gcc")
    assert code == 0, text
    symbols = subprocess.run(["nm", "-u", "test"], cwd=tmp_path, capture_output=True, text=True).stdout
    assert "memcpy" in symbols
    assert not re.search("malloc|calloc|free", symbols)
    heavier = dynamic_model(ms.load(name), replace(forces, gravity=(0.0, -9.81 * (1 + 1e-7), 0.0)))
    (tmp_path / "test.c").write_text(dynamics_test(made, heavier, initial, "model.h"))
    assert outcome(tmp_path, "gcc")[0] == 1


@pytest.mark.long
def test_values_are_set_by_number_and_errors_leave_the_motion(tmp_path):
    spring = ms.JointSpring("rocker", 0.7, 0.2)
    model = dynamic_model(ms.load("four_bar"), replace(WEIGHT, joint_springs=(spring,)))
    made = dynamic_fmu(model, {"A.q": "30deg"})
    (tmp_path / "model.h").write_text(dynamics_header(made))
    (tmp_path / "test.c").write_text(
        """
#define four_bar_IMPLEMENTATION
#include "model.h"
#include <stdio.h>
static int number(const char *name) {
    for (int i = 0; i < four_bar_VALUES; i++) if (!strcmp(four_bar_names[i], name)) return i;
    return -1;
}
int main(void) {
    four_bar_motion motion, before;
    four_bar_start(&motion);
    motion.value[number("rocker.stiffness [N.m/rad]")] = 1.1;
    if (four_bar_begin(&motion)) return 1;
    before = motion;
    printf("%s\\n", four_bar_advance(&motion, 0.0));
    if (memcmp(&before, &motion, sizeof motion)) return 2;
    if (four_bar_advance(&motion, 1.0) || four_bar_evaluate(&motion)) return 3;
    printf("%.17g %.17g\\n", motion.value[number("A.q [rad]")], motion.value[number("C.x [m]")]);
    motion.value[four_bar_INPUT] = NAN;
    if (!four_bar_advance(&motion, 2.0)) return 4;
    four_bar_start(&motion);
    motion.value[number("A.q [rad]")] += 0.1;
    printf("%s\\n", four_bar_begin(&motion));
    return 0;
}
"""
    )
    code, text = outcome(tmp_path, "gcc", *SANITIZED)
    assert code == 0, text
    late, values, open_loops = text.splitlines()
    assert late == "the end is not later"
    assert open_loops == "the start values of the coordinates do not close the loops"
    other = model.with_forces(replace(WEIGHT, joint_springs=(ms.JointSpring("rocker", 1.1, 0.2),)))
    run = ms.dynamics.run(other, initial={"A.q": "30deg"}, duration="1s")
    exact = run.motion.joints["A"].value[-1], run.motion.points["C"].position[-1, 0]
    np.testing.assert_allclose([float(value) for value in values.split()], exact, rtol=1e-9)
