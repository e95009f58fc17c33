"""How a loop is best held closed in MuJoCo: integrator, time constant, compliance, and what they cost.

The spatial four-bar at 600 rpm against its closed form over two turns, at the crank angles really
reached. Errors are worst values: rocker angle in rad, place in units of the crank, velocity and
acceleration in units of crank and speed. Time is that of stepping alone, on one core, the least of
three rounds through all settings.

Run: python validation/choices/constraint_settings.py
"""

from dataclasses import replace
from typing import Any

import numpy as np
import study_table as sheet

from mechsim import catalog
from mechsim.simulation import Settings, simulate

SPEED = 20.0 * np.pi
TURNS = 2.0
REPEATS = 3
LADDER = (30, 100, 300, 1000, 3000)
MUJOCO_SOLIMP = (0.9, 0.95, 0.001, 0.5, 2.0)
# softer settings that are compared have MuJoCo's own scale of compliance
PLAIN = Settings(compliance=1.0)


def ladder() -> dict[str, list[Settings]]:
    """Return the settings compared, at each number of steps a turn."""

    def each(make: Any) -> list[Settings]:
        return [make(steps) for steps in LADDER]

    def hard(constant: float | None, **options: Any) -> list[Settings]:
        base = Settings(constant_steps=constant, **options)
        return each(lambda n: replace(base, steps_per_turn=n))

    def fraction(of_turn: float, **options: Any) -> list[Settings]:
        return each(lambda n: Settings(steps_per_turn=n, constant_steps=max(10.0, n * of_turn), **options))

    def direct(integrator: str) -> list[Settings]:
        def make(n: int) -> Settings:
            rate = 1.0 / Settings(steps_per_turn=n).timestep(SPEED)
            return replace(PLAIN, integrator=integrator, steps_per_turn=n, solref=(-(rate**2), -rate))

        return each(make)

    defaults = replace(PLAIN, integrator="Euler", solref=(0.02, 1.0), solimp=MUJOCO_SOLIMP, refsafe=True)
    table = {
        "MuJoCo's defaults (Euler)": each(lambda n: replace(defaults, steps_per_turn=n)),
        "Euler, direct": direct("Euler"),
        "implicitfast, direct": direct("implicitfast"),
        "discrete, direct": direct("discrete"),
    }
    for integrator in ("Euler", "implicitfast", "discrete", "RK4"):
        table[f"{integrator}, 2 steps"] = hard(2.0, integrator=integrator, compliance=1.0)
    table["RK4, 7 steps"] = hard(7.0, compliance=1.0)
    table["RK4, 7 steps, refsafe"] = hard(7.0, compliance=1.0, refsafe=True)
    table["RK4, 7 steps, diagexact"] = hard(7.0, compliance=1.0, diagexact=True)
    for constant in (7.0, 20.0, 40.0):
        table[f"RK4, {constant:.0f} steps, 1e-4"] = hard(constant, compliance=1e-4)
    for compliance in (1.0, 1e-2, 1e-4, 1e-6, 1e-8, 1e-10):
        table[f"RK4, turn/10, {compliance:.0e}"] = fraction(0.1, compliance=compliance)
    for of_turn in (0.2, 0.05, 0.025):
        table[f"RK4, turn/{1 / of_turn:.0f}, 1e-08"] = fraction(of_turn)
    table["RK4, turn/10, 1e-08, diagexact"] = fraction(0.1, diagexact=True)
    return table


def measured(name: str, settings: Settings) -> dict[str, Any]:
    """Return the errors and the cost of one setting."""
    linkage = catalog.make("rssr")
    run = simulate(linkage.mechanism, speed=SPEED, turns=TURNS, settings=settings)
    row: dict[str, Any] = {"settings": name, "steps": settings.steps_per_turn, "outcome": run.outcome}
    motion = run.motion
    exact = linkage.solve(motion.angle, motion.speed, motion.acceleration)
    swing = motion.joints["rocker"].value - exact.joints["rocker"].value
    swing -= 2.0 * np.pi * np.round(swing / (2.0 * np.pi))
    row["angle"] = float(np.abs(swing).max()) if run.outcome != "diverged" else np.inf
    for power, kind in enumerate(("position", "velocity", "acceleration")):
        gap = getattr(motion.points["P3"], kind) - getattr(exact.points["P3"], kind)
        worst = float(np.sqrt((gap**2).sum(1)).max()) / linkage.crank / SPEED**power
        row[kind] = worst if run.outcome != "diverged" else np.inf
    row["ms/turn"] = 1e3 * run.seconds / TURNS
    return row


def main() -> None:
    rows = [measured(name, item) for name, each in ladder().items() for item in each]
    for _ in range(REPEATS - 1):
        again = [measured(name, item) for name, each in ladder().items() for item in each]
        for row, other in zip(rows, again, strict=True):
            row["ms/turn"] = min(row["ms/turn"], other["ms/turn"])
    sheet.show(rows)


if __name__ == "__main__":
    main()
