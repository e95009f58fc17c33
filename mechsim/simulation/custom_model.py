"""Closed models of specifications: their drivers, locked joints, and the start of a motion."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

import mujoco
import numpy as np

from mechsim.errors import AssemblyError
from mechsim.mechanism.joints import Coupling
from mechsim.mechanism.motion_laws import CrankProfile, MotionLaws
from mechsim.numerics.arrays import Array
from mechsim.simulation import loop_jacobian
from mechsim.simulation.closed_model import ClosedModel
from mechsim.simulation.drivers import find_drivers, with_parameter_joint
from mechsim.simulation.equality_rows import CouplingConstraint, RelativeFunction
from mechsim.simulation.mjcf.compiling import compiled
from mechsim.simulation.mjcf.equalities import lock_joints
from mechsim.simulation.mjcf.joints import CRANK
from mechsim.simulation.mjcf_reader.mjcf_model import MjcfModel
from mechsim.simulation.mobility import immobile_drivers, overdetermined_error
from mechsim.simulation.model_loops import ModelLoops, read_loops
from mechsim.simulation.poses.follow import move_drivers
from mechsim.simulation.recording import add_sensors


def from_file(read: MjcfModel, drivers: Sequence[str] | str | None = None) -> ClosedModel:
    """Return the closed model of an MJCF file, its joints locked, nearest to its initial state.

    Drivers are by default those of its mechanism.
    """
    drivers = read.mechanism.driver if drivers is None else drivers
    spec, locked, start = read.spec.copy(), read.mechanism.locked, read.qpos
    if locked:
        moved = (drivers,) if isinstance(drivers, str) else tuple(drivers)
        loops = closed_loops(spec, (*moved, *(name for name in locked if name not in moved)), {})
        loops, initial_qpos = _closed_at_drivers(loops, start)
        stands = zip(loops.drivers.names, initial_qpos[loops.drivers.addresses].tolist(), strict=True)
        targets = np.array([locked.get(name, value) for name, value in stands])
        start = move_drivers(loops, initial_qpos, targets, "where joints are held")
        start = np.delete(start, loops.crank_address)
        lock_joints(spec, locked)
    return replace(from_spec(spec, tuple(read.mechanism.points), drivers, start=start), custom=True)


def from_spec(
    spec: mujoco.MjSpec,
    points: tuple[str, ...],
    drivers: Sequence[str] | str = CRANK,
    *,
    coordinates: Mapping[str, tuple[str, int | None]] | None = None,
    laws: Mapping[str, Coupling] | None = None,
    start: Array | None = None,
) -> ClosedModel:
    """Return the model of a specification with sensors for the tracked points.

    Args:
        spec: specification of the model.
        points: sites to track.
        drivers: the hinge that is the crank, or the joints that follow motion laws.
        coordinates: joint of the model -> name of its coordinate, as in `Track`.
        laws: equality -> the coupling that it stands for, whose function its polynomial only approximates.
        start: initial state, (nq,); None for the reference configuration.
    """
    track = replace(add_sensors(spec, points), coordinates=coordinates or {})
    loops = closed_loops(spec, drivers, laws or {})
    names = tuple(track.name(name)[0] for name in loops.drivers.names)
    loops = replace(loops, drivers=replace(loops.drivers, names=names))
    loops, closed = _closed_at_drivers(loops, start)
    return ClosedModel(loops, track, closed)


def closed_loops(
    spec: mujoco.MjSpec, drivers: Sequence[str] | str, laws: Mapping[str, Coupling]
) -> ModelLoops:
    """Return the loops of a specification with a crank, or with drivers locked at their reference values."""
    if isinstance(drivers, str):
        loops = read_loops(compiled(spec), drivers)
    else:
        model = compiled(with_parameter_joint(spec))
        loops = read_loops(model, drivers=find_drivers(model, tuple(drivers)))
    return with_functions(loops, laws)


def with_functions(loops: ModelLoops, laws: Mapping[str, Coupling]) -> ModelLoops:
    """Return loops whose couplings are the functions of laws, equality -> law, instead of polynomials."""
    rows: list[CouplingConstraint] = []
    for row in loops.couplings:
        law = laws.get(str(loops.model.equality(row.equality).name))
        if law is not None and law.function is not None and row.right is not None:
            # both sides are relative to the reference
            offset = float(row.right.zeros @ row.right.weights) - law.zeros[1]
            difference = row.coefficients[0] - float(law.function(np.array([offset]))[0][0])
            row = replace(row, function=RelativeFunction(law.function, offset, difference))
        rows.append(row)
    return replace(loops, couplings=rows)


def closed_state(loops: ModelLoops, guess: Array) -> Array:
    """Return the closed state nearest to an initial guess, (nq,).

    Raises:
        MobilityError: for redundant drivers that prevent closure.
    """
    try:
        return loop_jacobian.close(loops, guess[None])[0]
    except AssemblyError:
        locked = () if loops.drivers.crank else immobile_drivers(loops, loops.linearise(guess[None])[1][0])
        if locked:
            raise overdetermined_error(loops, locked, 0.0) from None
        raise


def _closed_at_drivers(loops: ModelLoops, start: Array | None) -> tuple[ModelLoops, Array]:
    """Return loops with the drivers locked as in an initial state, and the nearest closed state, (nq,).

    The initial state, (nq,), is without a path parameter; None is the reference.
    """
    guess = (loops.model.qpos0 if start is None else start).copy()
    if start is not None and not loops.drivers.crank:
        guess = np.insert(guess, loops.crank_address, 0.0)
    loops = replace(loops, drivers=loops.drivers.locked_at(guess[loops.drivers.addresses]))
    return loops, closed_state(loops, guess)


Closed = TypeVar("Closed", bound=ClosedModel)


def parameter_profile(motion_laws: MotionLaws) -> CrankProfile:
    """Return the profile of the path parameter; its cycles define the steps and records of a run.

    Its `fastest` rate is that of the motion laws, which may reverse more or less often than the parameter.
    """
    return replace(motion_laws.path_profile, max_speed=motion_laws.fastest)


def at_initial_state(closed: Closed, motion_laws: MotionLaws) -> Closed:
    """Return a model under motion laws, in their initial state; a model with a crank remains.

    All drivers move to this state together along a straight path in joint space, in the same assembly.

    Raises:
        AssemblyError: if the loops do not close on that path.
    """
    if motion_laws.crank:
        return closed
    loops, drivers = closed.loops, closed.loops.drivers
    target = np.array([motion_laws.first[name] for name in drivers.names])
    start = move_drivers(loops, closed.qpos, target, "the start of the motion laws")
    law, rate = motion_laws.along_path, motion_laws.rate
    loops = replace(loops, drivers=replace(drivers, law=law, text=lambda angle: f"{angle / rate:.6g} s"))
    return replace(closed, loops=loops, qpos=loop_jacobian.close(loops, start[None])[0])
