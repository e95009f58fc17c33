"""What `mechsim show` and the report say about a mechanism."""

from collections.abc import Callable
from typing import Any

import numpy as np

from mechsim.analytic import catalog
from mechsim.analytic.catalog.base import ClosedForm
from mechsim.analytic.dynamics.prescribed_motion import InverseDynamics
from mechsim.analytic.forms import Form
from mechsim.analytic.loops.loop_form import LoopForm
from mechsim.analytic.loops.mobility import driver_determinacy
from mechsim.errors import MechsimError
from mechsim.model.efforts import Fluctuation, FreeRun, Reaction
from mechsim.model.meshes import threads_of
from mechsim.numerics.angles import TURN
from mechsim.numerics.arrays import Array

# what there is to say of a mechanism that is not of the catalogue
OWN = "a mechanism of one's own, by its loop equations"


def facts(drive: Form, angle: float | None = None, driver: str | None = None) -> dict[str, Any]:
    """Return all that is known of a mechanism without simulating it, as plain data.

    Of one that no crank alone settles, what does not ask for a crank.

    Args:
        drive: the mechanism.
        angle: crank angle at which assemblies are listed, in [rad]; None takes where assembly starts.
        driver: link that drives, for the Assur groups; None takes the crank.
    """
    from mechsim.theory import structure

    found = _described(drive)
    if isinstance(drive, LoopForm):
        found |= _mobility(drive)
        if not drive.mechanism.has_crank or drive.motion_laws is not None or found["outcome"] != "determined":
            return found
    mechanism = drive.mechanism
    arcs = drive.crank_range()
    at = arcs.start() if angle is None else angle
    ranges = [list(arc) for arc in arcs.arcs]
    freedom = structure.mobility(mechanism)
    groups: list[dict[str, Any]] = []
    explained: list[str] = []
    # racks and polynomials have no place among Assur's groups
    if (freedom.planar and not mechanism.couplings) or driver is not None:
        try:
            apart = structure.assur_groups(mechanism, driver)
            groups, explained = apart.as_dicts(), apart.lines()
        except MechsimError as error:  # holds, and links that repeat others, leave no groups
            if driver is not None:
                raise
            explained = [f"no Assur groups: {error}"]
    return {
        "mobility": freedom.actual,
        **found,
        "mobility_explained": freedom.lines(),
        "crank_range": "full turn" if arcs.full else ranges[0] if len(ranges) == 1 else ranges,
        "crank_ranges": ranges,
        "dead_centres": list(drive.dead_centres()),
        "change_points": list(drive.change_points()),
        "turns_to_come_round": round(drive.period / TURN),
        "transmission_angle": _least_transmission(drive),
        "angle": at,
        "assemblies": assemblies(drive, at),
        "assur_groups": groups,
        "assur_explained": explained,
    }


def _described(drive: Form) -> dict[str, Any]:
    """Return what a mechanism is made of."""
    mechanism = drive.mechanism
    return {
        "name": drive.name,
        "about": (type(drive).__doc__ or "").splitlines()[0] if isinstance(drive, ClosedForm) else OWN,
        "parameters": _parameters(drive),
        "points": list(mechanism.points),
        "links": [link.name for link in mechanism.links],
        "joints": [
            {"name": joint.name, "kind": joint.kind, "links": [joint.a.link, joint.b.link]}
            for joint in mechanism.joints
        ],
        "couplings": [
            {
                "name": law.name,
                "driven": dict(law.left_terms),
                "driver": dict(law.right_terms),
                "coefficients": list(law.coefficients),
            }
            for law in mechanism.laws
        ],
        "locked": dict(mechanism.locked),
    }


def _mobility(drive: LoopForm) -> dict[str, Any]:
    """Return what the drivers of a mechanism settle, and how they go; in words too."""
    mechanism = drive.mechanism
    found = driver_determinacy(mechanism)
    lines = [
        f"{_several(found.dofs, 'freedom')} by the rank of the loop Jacobian, "
        f"{_several(found.redundant_equations, 'redundant constraint')}",
        f"driven: {', '.join(found.drivers) or 'nothing'}",
    ]
    if mechanism.locked:
        lines.append(f"held: {', '.join(mechanism.locked)}")
    if found.undetermined:
        lines.append(
            f"underdetermined: {', '.join(found.undetermined)} can still move; drive, hold or couple them"
        )
    if found.redundant_drivers:
        lines.append(
            f"overdetermined: {', '.join(found.redundant_drivers)} asked for beside what others settle"
        )
    counts = {
        "freedoms": found.dofs,
        "drivers": list(found.drivers),
        "open": list(found.undetermined),
        "superfluous": list(found.redundant_drivers),
        "redundant": found.redundant_equations,
    }
    motion_laws = drive.motion_laws
    told = {} if motion_laws is None else {name: _text(one) for name, one in motion_laws.by_name.items()}
    return {
        "mobility": counts,
        "mobility_explained": lines,
        "outcome": found.outcome,
        "programs": told,
        "duration": None if motion_laws is None else motion_laws.duration,
    }


def _text(program: object) -> str:
    return getattr(program, "text", "a function of time")


def _several(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"


def _parameters(drive: Form) -> dict[str, dict[str, Any]]:
    if not isinstance(drive, ClosedForm):
        return {
            name: {"value": value, "unit": "as written", "doc": ""}
            for name, value in drive.parameters.items()
        }
    return {
        field.name: {
            "value": getattr(drive, field.name),
            "unit": field.metadata["unit"],
            "doc": field.metadata["doc"],
        }
        for field in catalog.parameters(drive.name).values()
    }


def assemblies(drive: Form, angle: float) -> list[dict[str, Any]]:
    """Return every real assembly at a crank angle: what selects it, and its points in [m]."""
    return [
        {**chosen, "points": {name: place.tolist() for name, place in points.items()}}
        for chosen, points in drive.assembly_points(angle)
    ]


def _least_transmission(drive: Form) -> dict[str, float] | None:
    arcs = drive.crank_range().arcs
    if not arcs or not isinstance(drive, ClosedForm):
        return None
    low, high = arcs[0]
    margin = 1e-6 * (high - low)
    angles = np.linspace(low + margin, high - margin, 361)
    values = drive.transmission_angle(angles)
    at = int(np.argmin(values))
    return {"least": float(values[at]), "at_angle": float(angles[at])}


def study_facts(study: InverseDynamics) -> dict[str, Any]:
    """Return what a prescribed crank comes to; all in SI."""
    found, angle = study.efforts, study.efforts.angle
    timed = found.time if found.drives else None

    def peak(values: Array) -> dict[str, float]:
        return _peak(values, angle, timed)

    size, free = float(np.abs(found.torque).max()) or 1.0, found.unbounded

    def carried(one: Reaction) -> dict[str, Any]:
        force, moment = (np.where(free, 0.0, _norm(part)) for part in one.settled(one.force, one.moment))
        return {"force": peak(force), "moment": peak(moment)}

    sides = found.power_in + found.power_loads - found.power_lost - study.power_stored
    return {
        "torque": peak(found.torque)
        | {"mean": _mean(found.torque, angle), "rms": _mean(found.torque**2, angle) ** 0.5},
        "drives": {
            name: peak(effort)
            | {
                "mean": _mean(effort, angle),
                "rms": _mean(effort**2, angle) ** 0.5,
                "unit": "N" if name in found.straight else "N m",
            }
            for name, effort in found.drives.items()
        },
        "routes": float(np.abs(np.where(free, 0.0, study.second_torque - found.torque)).max()) / size,
        "reactions": {
            name: {
                "on": one.link,
                "by": one.by,
                **carried(one),
                "not_determined": list(one.open),
                "partly_determined": list(one.partly),
            }
            for name, one in found.reactions.items()
        },
        "couplings": _coupling_facts(study, peak),
        "indeterminacy": study.indeterminacy,
        "shaking_force": peak(_norm(study.shaking_force)),
        "shaking_moment": peak(_norm(study.shaking_moment)),
        "inertia": {
            "least": float(study.reduced.inertia.min()),
            "largest": float(study.reduced.inertia.max()),
        },
        "power_balance": float(np.abs(sides).max()),
    }


def _coupling_facts(
    study: InverseDynamics, peak: Callable[[Array], dict[str, float]]
) -> dict[str, dict[str, Any]]:
    """Return each coupling's effort on its driven coordinate, and what carries it."""
    found, mechanism = study.efforts, study.machine.mechanism
    threads, facts = threads_of(mechanism), dict[str, dict[str, Any]]()
    for name, law in mechanism.named_laws.items():
        own: dict[str, Any] = {"effort": peak(found.gears[name])}
        own["unit"] = "N" if name in found.straight else "N m"
        own["determined"] = name not in found.undetermined
        mesh = found.meshes.get(name)
        if mesh is not None:
            own |= {"by": "teeth", "links": [mesh.link, mesh.by], "force": peak(_norm(mesh.force))}
        else:
            joints = [joint for joint in mechanism.joints if {*joint.coordinates} & {*law.coordinates}]
            carriers = sorted({joint.a.link for joint in joints})
            own |= {"by": "thread" if name in threads else "ideal transmission", "links": carriers}
        facts[name] = own
    return facts


def _norm(vector: Array) -> Array:
    return np.sqrt((vector**2).sum(1))


def _mean(values: Array, angle: Array) -> float:
    """Return the mean over the crank angle; over the instants where the crank swings or stands."""
    if len(angle) < 2 or not (np.diff(angle) * np.sign(angle[-1] - angle[0]) > 0.0).all():
        return float(values.mean())
    return float(np.trapezoid(values, angle) / (angle[-1] - angle[0]))


def _peak(values: Array, angle: Array, time: Array | None) -> dict[str, float]:
    """Return the largest value and the crank angle at which it is, or under programs the time."""
    at = int(np.argmax(np.abs(values)))
    where = ("at_angle", angle) if time is None else ("at_time", time)
    return {"largest": float(values[at]), where[0]: float(where[1][at])}


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
        "turns": float(run.angle[-1] - run.angle[0]) / (2.0 * np.pi),
        "speed": float(run.speed[-1]),
        "work": float(run.work[-1]),
        "lost": float(run.lost[-1]),
        "energy_error": run.energy_error,
    }
