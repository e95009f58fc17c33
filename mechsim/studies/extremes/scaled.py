"""Axes that change nothing but numbers: steps, speed, size, masses. The same motion must come out."""

from dataclasses import fields, replace
from typing import Any

import numpy as np

from mechsim.analytic.catalog.base import ClosedForm
from mechsim.model.joint_kinds import KINDS
from mechsim.model.scene import Scene
from mechsim.simulation import Settings
from mechsim.simulation.closed_model import assembled
from mechsim.studies.extremes.trial import Trial, attempt
from mechsim.units import rpm

SPEED = rpm(600.0)
# what the issue asks for; beyond it the border is looked for
ASKED = {"speed": (1.0, 1e5), "size": (1e-5, 1e3), "mass ratio": (1e-6, 1e6)}


def steps(drive: ClosedForm, value: float) -> Trial:
    """Steps in a turn; a thousand and more must meet the bound."""
    count = max(4, round(value))
    foretold = "passed" if count >= 1000 else None
    settings = Settings(steps_per_turn=count)
    return attempt("steps", drive, value, drive.mechanism, speed=SPEED, settings=settings, foretold=foretold)


def speed(drive: ClosedForm, value: float) -> Trial:
    """Crank speed in [rpm] at a thousand steps a turn."""
    foretold = "passed" if _asked("speed", value) else None
    return attempt("speed", drive, value, drive.mechanism, speed=rpm(value), foretold=foretold)


def size(drive: ClosedForm, value: float) -> Trial:
    """The whole mechanism made to measure `value` in [m] at its longest."""
    scaled = resized(drive, value / drive.mechanism.size)
    foretold = "passed" if _asked("size", value) else None
    return attempt("size", scaled, value, scaled.mechanism, speed=SPEED, foretold=foretold)


def mass_ratio(drive: ClosedForm, value: float) -> Trial:
    """The coupler's mass beside that of the other links; 0 is a massless rod, which MuJoCo refuses."""
    mechanism = drive.mechanism
    spec = assembled(mechanism, Scene())
    crank = mechanism.crank.b.link
    middle = next(
        link.name for link in mechanism.links if link.name != crank and not _on_ground(drive, link.name)
    )
    body = spec.body(middle)
    body.mass, body.inertia = value * body.mass, value * np.asarray(body.inertia)
    foretold = "passed" if _asked("mass ratio", value) else "cannot assemble" if value == 0.0 else None
    return attempt("mass ratio", drive, value, spec, speed=SPEED, samples=72, foretold=foretold)


def resized(drive: ClosedForm, factor: float) -> ClosedForm:
    """Return the drive with every length multiplied."""
    values: dict[str, Any] = {}
    for field in fields(drive):
        if field.metadata["unit"] == "m":
            value = getattr(drive, field.name)
            many = isinstance(value, tuple)
            values[field.name] = tuple(factor * part for part in value) if many else factor * value
    return replace(drive, **values)


def _on_ground(drive: ClosedForm, link: str) -> bool:
    return any(
        {joint.a.link, joint.b.link} == {"ground", link} and KINDS[joint.kind].hinge
        for joint in drive.mechanism.joints
    )


def _asked(axis: str, value: float) -> bool:
    low, high = ASKED[axis]
    return low <= value <= high
