"""What is told of dynamics as plain data: peaks and where they are, balances, outcomes."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mechsim.dynamics.fluctuation import Fluctuation
from mechsim.dynamics.free import FreeRun
from mechsim.dynamics.prescribed import Study
from mechsim.dynamics.runner import TURN

Array = NDArray[np.float64]


def study_facts(study: Study) -> dict[str, Any]:
    """Return what a study of a prescribed crank comes to; all in SI."""
    balance = study.balance
    size = float(np.abs(study.torque).max()) or 1.0
    sides = study.power_in + study.power_loads - study.power_lost - study.power_stored
    return {
        "torque": _peak(study.torque, study.angle)
        | {"mean": _mean(study.torque, study.angle), "rms": _mean(study.torque**2, study.angle) ** 0.5},
        "routes": float(np.abs(balance.drive - study.torque).max()) / size,
        "reactions": {
            name: {
                "on": one.link,
                "by": one.by,
                "force": _peak(_norm(one.force, one.determined[:3]), study.angle),
                "moment": _peak(_norm(one.moment, one.determined[3:]), study.angle),
                "not_determined": list(one.open),
            }
            for name, one in balance.reactions.items()
        },
        "indeterminacy": balance.indeterminacy,
        "shaking_force": _peak(_norm(study.shaking_force), study.angle),
        "shaking_moment": _peak(_norm(study.shaking_moment), study.angle),
        "inertia": {
            "least": float(study.reduced.inertia.min()),
            "largest": float(study.reduced.inertia.max()),
        },
        "power_balance": float(np.abs(sides).max()),
    }


def _norm(vector: Array, known: NDArray[np.bool_] | None = None) -> Array:
    kept = vector if known is None else np.where(known, vector, 0.0)
    return np.sqrt((kept**2).sum(1))


def _mean(values: Array, angle: Array) -> float:
    """Return the mean over the crank angle; over the instants where the crank swings or stands."""
    if len(angle) < 2 or not (np.diff(angle) * np.sign(angle[-1] - angle[0]) > 0.0).all():
        return float(values.mean())
    return float(np.trapezoid(values, angle) / (angle[-1] - angle[0]))


def _peak(values: Array, angle: Array) -> dict[str, float]:
    at = int(np.argmax(np.abs(values)))
    return {"largest": float(values[at]), "at_angle": float(angle[at])}


def turn_facts(turn: Fluctuation | None) -> dict[str, float] | None:
    """Return the speed fluctuation of a turn."""
    if turn is None:
        return None
    names = ("mean", "coefficient", "torque", "excess", "flywheel")
    return {name: getattr(turn, name) for name in names}


def run_facts(run: FreeRun) -> dict[str, Any]:
    """Return how a free run ended."""
    return {
        "outcome": run.outcome,
        "reason": run.reason,
        "seconds": float(run.time[-1]),
        "turns": float(run.angle[-1] - run.angle[0]) / TURN,
        "speed": float(run.speed[-1]),
        "work": float(run.work[-1]),
        "lost": float(run.lost[-1]),
        "energy_error": run.energy_error,
    }
