"""What `mechsim show` and the report say about a mechanism."""

from dataclasses import fields
from typing import Any

import numpy as np

from mechsim.catalog.base import Drive


def facts(drive: Drive, angle: float | None = None, driver: str | None = None) -> dict[str, Any]:
    """Return all that is known of a mechanism without simulating it, as plain data.

    Args:
        drive: the mechanism.
        angle: crank angle at which assemblies are listed, in [rad]; None takes where assembly starts.
        driver: link that drives, for the Assur groups; None takes the crank.
    """
    from mechsim import structure

    mechanism = drive.mechanism
    arcs = drive.crank_range()
    at = arcs.start() if angle is None else angle
    ranges = [list(arc) for arc in arcs.arcs]
    freedom = structure.mobility(mechanism)
    groups: list[dict[str, Any]] = []
    explained: list[str] = []
    if freedom.planar or driver is not None:
        apart = structure.assur_groups(mechanism, driver)
        groups, explained = apart.as_dicts(), apart.lines()
    return {
        "name": drive.name,
        "about": (type(drive).__doc__ or "").splitlines()[0],
        "parameters": {
            field.name: {
                "value": getattr(drive, field.name),
                "unit": field.metadata["unit"],
                "doc": field.metadata["doc"],
            }
            for field in fields(drive)
        },
        "points": list(mechanism.points),
        "links": [link.name for link in mechanism.links],
        "joints": [
            {"name": joint.name, "kind": joint.kind, "links": [joint.a.link, joint.b.link]}
            for joint in mechanism.joints
        ],
        "mobility": freedom.actual,
        "mobility_explained": freedom.lines(),
        "crank_range": "full turn" if arcs.full else ranges[0] if len(ranges) == 1 else ranges,
        "crank_ranges": ranges,
        "dead_centres": list(drive.dead_centres()),
        "transmission_angle": _least_transmission(drive),
        "angle": at,
        "assemblies": assemblies(drive, at),
        "assur_groups": groups,
        "assur_explained": explained,
    }


def assemblies(drive: Drive, angle: float) -> list[dict[str, Any]]:
    """Return every real assembly at a crank angle: what selects it, and its points in [m]."""
    return [
        {**chosen, "points": {name: place.tolist() for name, place in points.items()}}
        for chosen, points in drive.assembly_points(angle)
    ]


def _least_transmission(drive: Drive) -> dict[str, float] | None:
    arcs = drive.crank_range().arcs
    if not arcs:
        return None
    low, high = arcs[0]
    margin = 1e-6 * (high - low)
    angles = np.linspace(low + margin, high - margin, 361)
    values = drive.transmission_angle(angles)
    at = int(np.argmin(values))
    return {"least": float(values[at]), "at_angle": float(angles[at])}
