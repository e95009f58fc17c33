"""Properties of a mechanism for `mechsim show` and the report."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from mechsim.compare.record_errors import lengths
from mechsim.errors import MechsimError, SingularStartError, several
from mechsim.kinematics.loops.mobility import driver_determinacy
from mechsim.kinematics.loops.start import start_poses
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.belts import belts_of
from mechsim.mechanism.force_record import ForceRecord, Reaction
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.meshes import threads_of
from mechsim.mechanism.motion_laws import make_motion_laws, steady
from mechsim.numerics.arrays import REVOLUTION, ROUNDING, Array

if TYPE_CHECKING:
    from mechsim.kinematics.assur import AssurGroup
    from mechsim.kinetics.prescribed_motion import InverseDynamics


def facts(solver: KinematicSolver, angle: float | None = None, *, searched: bool = True) -> dict[str, Any]:
    """Return all properties of a mechanism that need no simulation, for JSON.

    For several drivers: only properties that need no crank.

    Args:
        solver: the mechanism.
        angle: crank angle at which assemblies are listed, in [rad]; None takes the start of the assembly.
        searched: whether assemblies are searched from random starts where nothing else lists them.
    """
    from mechsim.kinematics.assur import assur_groups
    from mechsim.kinematics.mobility_count import mobility

    record = _described(solver)
    if solver.closed_form is None:
        record |= _mobility(solver)
        determined, driven = record["outcome"] == "determined", not solver.motion_laws.crank
        if not solver.mechanism.has_crank or driven or not determined:
            if not determined or not solver.mechanism.drivers:
                return record
            return record | assembly_facts(solver if driven else _moved_from_start(solver), 0.0, searched)
    mechanism, start = solver.mechanism, solver.mechanism.start
    try:
        arcs = solver.crank_range()
    except SingularStartError as error:
        return {**record, "mobility_explained": [*record["mobility_explained"], str(error)]}
    if angle is None:
        # a screw does not return after a revolution
        angle = start if abs(start) > REVOLUTION else arcs.start()
    ranges = [list(arc) for arc in arcs.arcs]
    count = mobility(mechanism)
    groups: Sequence[AssurGroup] = ()
    explained: list[str] = []
    # racks and polynomial couplings belong to no Assur group
    if count.in_plane and not mechanism.couplings:
        try:
            apart = assur_groups(mechanism)
            groups, explained = apart.groups, apart.lines()
        except MechsimError as error:  # locked joints and redundant links leave no groups
            explained = [f"no Assur groups: {error}"]
    return {
        "mobility": count.actual,
        **record,
        "mobility_explained": count.lines(),
        "crank_range": "full turn" if arcs.full else ranges[0] if len(ranges) == 1 else ranges,
        "crank_ranges": ranges,
        "dead_centres": list(solver.dead_centres()),
        "change_points": list(solver.change_points()),
        "turns_to_come_round": round(solver.period / REVOLUTION),
        "transmission_angle": _least_transmission(solver),
        "angle": angle,
        **assembly_facts(solver, angle, searched),
        "assur_groups": groups,
        "assur_explained": explained,
    }


def _moved_from_start(solver: KinematicSolver) -> KinematicSolver:
    """Return the solver with motion laws from the start for drivers without any, which are no crank."""
    mechanism = solver.mechanism
    values = start_poses(mechanism)[1]
    laws = {name: steady(values[name], 1.0) for name in mechanism.drivers}
    return replace(solver, motion_laws=make_motion_laws(mechanism, laws, 1.0))


def _described(solver: KinematicSolver) -> dict[str, Any]:
    """Return the components of a mechanism."""
    mechanism = solver.mechanism
    limits = {**solver.ranges, **({} if solver.forces is None else solver.forces.stop_ranges)}
    rows = solver.parameter_rows.items()
    return {
        "name": solver.name,
        "about": about(solver),
        "parameters": {name: {"value": value, "unit": unit, "doc": doc} for name, (value, unit, doc) in rows},
        "points": list(mechanism.points),
        "links": [link.name for link in mechanism.links if link.is_body],
        "joints": mechanism.written_joints,
        "couplings": [law for law in mechanism.laws if not mechanism.contact_of(law)],
        "belts": {b.name: {"length": b.length, "wraps": b.wraps.tolist()} for b in belts_of(mechanism)},
        "locked": dict(mechanism.locked),
        "limits": {
            name: [None if abs(end) == np.inf else end for end in ends] for name, ends in limits.items()
        },
    }


def about(solver: KinematicSolver) -> str:
    """Return the description of a catalogue mechanism, or of a TOML file; empty for others."""
    return solver.comment if solver.closed_form is None else solver.closed_form.declared.about


def _mobility(solver: KinematicSolver) -> dict[str, Any]:
    """Return the mobility of a mechanism and the motion of its drivers, also as text."""
    mechanism = solver.mechanism
    determinacy = driver_determinacy(mechanism)
    lines = [
        f"W = {determinacy.dofs} by the rank of the loop Jacobian, "
        f"{several(determinacy.redundant_equations, 'redundant constraint')}",
        f"driven: {', '.join(determinacy.drivers) or 'nothing'}",
    ]
    if mechanism.locked:
        lines.append(f"locked: {', '.join(mechanism.locked)}")
    if determinacy.undetermined:
        lines.append(
            f"underdetermined: {', '.join(determinacy.undetermined)} can still move; "
            "drive, lock or couple them"
        )
    if determinacy.redundant_drivers:
        lines.append(
            f"overdetermined: the other drivers already determine {', '.join(determinacy.redundant_drivers)}"
        )
    motion_laws = solver.motion_laws
    laws = motion_laws.by_name.items()
    return {
        "mobility": determinacy,
        "mobility_explained": lines,
        "outcome": determinacy.outcome,
        "motion_laws": {name: getattr(law, "text", "a function of time") for name, law in laws},
        "duration": None if motion_laws.crank else motion_laws.duration,
    }


def assembly_facts(solver: KinematicSolver, angle: float, searched: bool) -> dict[str, Any]:
    """Return every assembly at a crank angle, with the parameters that select it and its points in [m]."""
    from mechsim.studies.assemblies import assemblies

    every = assemblies(solver, angle, searched=searched)
    return {
        "assemblies": [
            {**chosen, "points": {name: position.tolist() for name, position in points.items()}}
            for chosen, points in zip(every.selectors, every.points, strict=True)
        ],
        "assemblies_complete": every.complete,
        "assemblies_reason": every.reason,
        "assembly_families": every.families,
    }


def _least_transmission(solver: KinematicSolver) -> dict[str, float] | None:
    arcs = solver.crank_range().arcs
    if not arcs:
        return None
    low, high = arcs[0]
    clearance = 1e-6 * (high - low)
    angles = np.linspace(low + clearance, high - clearance, 361)
    values = solver.transmission_angle(angles)
    if values is None:
        return None
    worst = int(np.argmin(values))
    return {"least": float(values[worst]), "at_angle": float(angles[worst])}


VECTORS = ("force", "moment")


def study_facts(study: "InverseDynamics") -> dict[str, Any]:
    """Return peaks and means of a prescribed motion; all in SI."""
    result, angle = study.forces, study.forces.angle
    name, instants = "at_angle", angle
    if result.drives and result.time is not None:
        name, instants = "at_time", result.time

    def peak(values: Array) -> dict[str, float]:
        # the largest value and its crank angle, or under motion laws its time
        index = int(np.argmax(np.abs(values)))
        return {"largest": float(values[index]), name: float(instants[index])}

    def statistics(values: Array) -> dict[str, float]:
        return peak(values) | {"mean": _mean(values, angle), "rms": _mean(values**2, angle) ** 0.5}

    def by_coordinate(forces: Mapping[str, Array]) -> dict[str, dict[str, Any]]:
        units = study.model.mechanism.effort_unit
        return {name: statistics(values) | {"unit": units(name)} for name, values in forces.items()}

    sides = result.power_in + result.power_loads - result.power_lost - study.power_stored
    inertia = study.reduced.inertia
    return {
        "torque": statistics(result.torque),
        "drives": by_coordinate(result.drives),
        "actuators": by_coordinate(result.actuators),
        **_reaction_facts(result, peak, study.model.mechanism),
        "couplings": _coupling_facts(study, peak),
        "indeterminacy": study.indeterminacy,
        "shaking_force": peak(lengths(study.shaking_force)),
        "shaking_moment": peak(lengths(study.shaking_moment)),
        "inertia": {"least": float(inertia.min()), "largest": float(inertia.max())},
        "power_balance": float(np.abs(sides).max()),
    }


def _reaction_facts(
    result: ForceRecord, peak: Callable[[Array], dict[str, float]], mechanism: Mechanism
) -> dict[str, Any]:
    """Return the peaks of reactions, and of sums of undetermined ones between the same two links."""
    largest = max(
        (float(lengths(reaction.force).max()) for reaction in result.reactions.values()), default=0.0
    )
    least = ROUNDING * np.array([largest, largest * result.characteristic_length])
    free = result.unbounded

    def carried(reaction: Reaction) -> dict[str, Any]:
        facts: dict[str, Any] = {"on": reaction.link, "by": reaction.by}
        vectors = reaction.force, reaction.moment
        for kind, vector, projected, rounding in zip(
            VECTORS, vectors, reaction.project(*vectors), least, strict=True
        ):
            rest = np.where(free, 0.0, lengths(vector - projected))
            facts[kind] = peak(np.where(free, 0.0, lengths(vector)))
            facts[kind]["determined"] = bool((rest <= rounding).all())
        return facts | {
            "not_determined": list(reaction.undetermined),
            "partly_determined": list(reaction.partly_undetermined),
        }

    inner = mechanism.inner_joints
    reactions = {name: carried(own) for name, own in result.reactions.items() if name not in inner}
    undetermined = [
        {own["on"], own["by"]}
        for own in reactions.values()
        if not all(own[kind]["determined"] for kind in VECTORS)
    ]
    sums: dict[str, Any] = {}
    for name, reaction in result.sums.items():
        if {reaction.link, reaction.by} in undetermined:
            force, moment = reaction.project(reaction.force, reaction.moment)
            sums[name] = carried(replace(reaction, force=force, moment=moment))
    return {"reactions": reactions, "sums": sums}


def _coupling_facts(
    study: "InverseDynamics", peak: Callable[[Array], dict[str, float]]
) -> dict[str, dict[str, Any]]:
    """Return each coupling's force on its driven coordinate, and its reactions."""
    result, mechanism = study.forces, study.model.mechanism
    threads, facts = threads_of(mechanism), dict[str, dict[str, Any]]()
    for name, law in mechanism.named_laws.items():
        if mechanism.contact_of(law):
            continue
        own: dict[str, Any] = {"effort": peak(result.gears[name])}
        own["unit"] = "N" if name in result.straight else "N m"
        own["determined"] = name not in result.undetermined
        if mesh := result.meshes.get(name):
            own |= {"by": "teeth", "links": [mesh.link, mesh.by], "force": peak(lengths(mesh.force))}
        else:
            joints = [joint for joint in mechanism.joints if {*joint.coordinates} & {*law.coordinates}]
            carriers = sorted({joint.a.link for joint in joints})
            own |= {"by": "thread" if name in threads else "ideal transmission", "links": carriers}
        facts[name] = own
    return facts


def _mean(values: Array, angle: Array) -> float:
    """Return the mean over the crank angle; over the instants if the crank swings or is at rest."""
    if len(angle) < 2 or not (np.diff(angle) * np.sign(angle[-1] - angle[0]) > 0.0).all():
        return float(values.mean())
    return float(np.trapezoid(values, angle) / (angle[-1] - angle[0]))
