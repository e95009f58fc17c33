"""Wrong masses and gravity, where torques or reactions are claimed."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from mechsim.analytic import dynamics
from mechsim.model.inertia import Inertia
from mechsim.numerics.arrays import Array
from mechsim.studies.agreement.hypotheses.hypothesis import DISCRETE, NAMED, Hypothesis
from mechsim.studies.agreement.miss import Miss, Values

EFFORTS = ("torque", "force", "moment")
EARTH = 9.81


def _machine(miss: Miss) -> dynamics.Machine:
    return miss.comparand.machine or dynamics.machine(miss.comparand.form, miss.comparand.form.forces)


def _of_efforts(miss: Miss) -> bool:
    return any(claim.named.kind in EFFORTS for claim in miss.claims)


def _under(miss: Miss, vector: Array) -> Values:
    machine = _machine(miss)
    forces = replace(machine.forces, gravity=tuple(vector.tolist()))
    return miss.predicted(replace(miss.comparand, machine=machine.with_forces(forces)))


def _gravity(miss: Miss) -> tuple[Array, float]:
    own = np.asarray(_machine(miss).forces.gravity)
    return own, float(np.linalg.norm(own))


def other_gravity(miss: Miss) -> Iterator[Hypothesis]:
    """Gravity left out, reversed or along another axis."""
    if not _of_efforts(miss):
        return
    own, size = _gravity(miss)
    others = [sign * (size or EARTH) * np.eye(3)[i] for i in range(3) for sign in (1.0, -1.0)]
    was = ", ".join(f"{one:g}" for one in own)
    for vector in [np.zeros(3), *others]:
        if np.allclose(vector, own):
            continue
        said = ", ".join(f"{one:g}" for one in vector)
        yield Hypothesis(
            "gravity",
            said,
            DISCRETE,
            lambda _, v=vector: _under(miss, v),
            lambda _, s=said: f"gravity is ({s}) m/s2 instead of ({was})",
            by=lambda _, v=vector: float(np.linalg.norm(v)),
        )


def gravity_size(miss: Miss) -> Iterator[Hypothesis]:
    """Gravity of another size."""
    if not _of_efforts(miss):
        return
    own, size = _gravity(miss)
    if size:
        yield Hypothesis(
            "gravity",
            "",
            NAMED,
            lambda p: _under(miss, (1.0 + p[0]) * own),
            lambda p: f"gravity is {(1 + p[0]) * size:.6g} m/s2 instead of {size:.6g}",
            starts=((0.0,),),
            steps=(1e-3,),
        )


def masses(miss: Miss) -> Iterator[Hypothesis]:
    """One link's mass, with its moments of inertia or without, or all of them."""
    if not _of_efforts(miss):
        return
    machine = _machine(miss)
    links = machine.mechanism.links

    def heavier(names: set[str], factor: float, moments: bool) -> Values:
        changed = tuple(
            replace(link, inertia=_scaled(link.inertia, factor, moments))
            if link.name in names and link.inertia is not None
            else link
            for link in links
        )
        mechanism = replace(machine.mechanism, links=changed)
        other = replace(machine, mechanism=mechanism)
        return miss.predicted(replace(miss.comparand, machine=other))

    every = {link.name for link in links}
    for what, names in [("", every), *((name, {name}) for name in every)]:
        of = f"link {what}" if what else "all links"
        for moments in (True, False):
            also = " and its moments" if moments else ", not its moments,"
            yield Hypothesis(
                "mass",
                what,
                NAMED + (0.0 if moments else 0.1),
                lambda p, n=names, m=moments: heavier(n, 1.0 + float(p[0]), m),
                lambda p, of=of, also=also: f"the mass of {of}{also} is {100 * p[0]:+.4g} % different",
                starts=((0.0,),),
                steps=(1e-3,),
            )


def _scaled(inertia: Inertia, factor: float, moments: bool) -> Inertia:
    rows = (
        tuple(tuple(factor * one for one in row) for row in inertia.moments) if moments else inertia.moments
    )
    return replace(inertia, mass=factor * inertia.mass, moments=rows)
