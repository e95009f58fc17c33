"""The public Unitree G1 ankle: an independent formula compared with it, and the causes of the error of a run.

    python validation/published/g1_ankle.py FOLDER/g1_ankle.xml

The formula is independent of this package: each rod keeps its length between the foot and its motor's arm,
and Newton's method computes pitch and roll from the two motors. Dimensions are those of the file.
"""

import sys

import numpy as np

import mechsim as ms

# foot: pitch axis at the base, roll axis below it, balls of both rods on it; motors: axes, and arms' ends
ROLL = np.array([0.0, 0.0, -0.017558])
SIDES = {
    "left_motor_joint": ([0.022, 0.015, 0.0079999], [0.022, 0.0, 0.15087], [0.013, 0.016529, -0.0039746]),
    "right_motor_joint": ([0.022, -0.015, 0.0079999], [0.022, 0.0, 0.21587], [0.0175, -0.016359, -0.0046245]),
}


def about_x(angle, vector):
    x, y, z = vector
    return np.array(
        [x + 0 * angle, y * np.cos(angle) - z * np.sin(angle), y * np.sin(angle) + z * np.cos(angle)]
    )


def about_y(angle, vector):
    x, y, z = vector
    return np.array(
        [x * np.cos(angle) + z * np.sin(angle), y + 0 * angle, -x * np.sin(angle) + z * np.cos(angle)]
    )


def rod_residuals(pitch, roll, drivers):
    """Return the error of the squared length of each rod, (2, n)."""
    result = []
    for name, (ball, axis, arm) in SIDES.items():
        rotated = about_x(roll, ball)
        foot = about_y(pitch, rotated + ROLL[:, None])
        end = np.array(axis)[:, None] + about_x(drivers[name], arm)
        length = np.linalg.norm(np.array(axis) + arm - np.array(ball) - ROLL)
        result.append(((foot - end) ** 2).sum(0) - length**2)
    return np.array(result)


def ankle(drivers):
    """Return pitch and roll at the motors' angles, name -> (n,) in [rad]."""
    count = len(drivers["left_motor_joint"])
    x = np.zeros((2, count))
    for _ in range(20):
        gradient = np.empty((count, 2, 2))
        for i in range(2):
            step = x.astype(complex)
            step[i] += 1e-30j
            gradient[:, :, i] = rod_residuals(*step, drivers).imag.T * 1e30
        x = x - np.linalg.solve(gradient, rod_residuals(*x, drivers).T[..., None])[..., 0].T
    return {"pitch_joint": x[0], "roll_joint": x[1]}


def main() -> int:
    for amplitude in (0.3, 1.0):
        drive = {
            "left_motor_joint": f"{amplitude:g}*sin(2*pi*0.6*t)",
            "right_motor_joint": f"{-amplitude / 2:g}*sin(2*pi*0.6*t)",
        }
        model = ms.load(sys.argv[1], drive=drive, duration=1.7)
        result = ms.validate(model, against=ankle)
        print(f"motors by {amplitude:g} rad: {result.why}")
        for check in result.checks:
            print(f"  formula against exact closure, {check.title}: {check.worst:.1e} {check.unit}")
        for quantity in result.attribution["quantities"].values():
            causes = ", ".join(f"{name} {value:.2e}" for name, value in quantity["largest"].items())
            total = sum(quantity[name] for name in ("formula", "compliance", "time step", "drive"))
            print(f"  run against {quantity['quantity']}: {quantity['whole']:.3e} rad, sum {total:.3e}")
            print(f"    largest: {causes}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
