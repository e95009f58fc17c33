"""Many designs stepped through a turn of the crank in one batch, and how far they are from solved poses."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mechsim.model.finding import POSITION_TOLERANCE
from mechsim.numerics.angles import TURN
from mechsim.numerics.arrays import Array
from mechsim.simulation.driven_run import LOST
from mechsim.simulation.many.design_fields import Fields, loosened
from mechsim.simulation.many.design_models import Bools, DesignModels, Rows, closed_states
from mechsim.simulation.mjcf import quiet
from mechsim.simulation.model_loops import CLOSED, ModelLoops
from mechsim.simulation.settings import Settings, drive_inertia
from mechsim.simulation.stepping import TIME

# steps in one call into C: longer ones are remembered in parts, so that a long run needs little memory
BLOCK = 1024
# places in a turn, and its end, at which states are held against solved poses
JUDGED = 8
# what tells where links are
PLACES = ("body_pos", "body_quat", "jnt_pos", "jnt_axis", "site_pos", "qpos0")
# even steps in which a turn is followed where a run went wrong
ROUND = 36
# part of a first Newton step to a solved pose that a second one may be
SECOND = 0.01


@dataclass(frozen=True)
class SteppedDesigns:
    """Designs that were stepped.

    Attributes:
        models: of them.
        fields: of the models as they were stepped, (d, ...) each.
        loops: of one of them, its model as it was stepped.
        time: of the records, (p,) in [s].
        qpos: at the records, (d, p, nq).
        qvel: (d, p, nv).
        whole: which designs' states stayed good and whose cranks were kept, (d,).
    """

    models: DesignModels
    fields: Fields
    loops: ModelLoops
    time: Array
    qpos: Array
    qvel: Array
    whole: Bools

    def over(self, rows: Rows, repeat: int) -> ModelLoops:
        """Return the loops of some designs at so many states each, one design after another."""
        return self.loops.with_fields(_wide(self.fields, [*self.fields], rows, repeat))

    def places_over(self, rows: Rows, repeat: int) -> ModelLoops:
        """Return them fit to tell where links are, and no more."""
        closed = self.models.like.closed
        return closed.loops.with_fields(_wide(self.fields, PLACES, rows, repeat))


def _wide(fields: Fields, names: Sequence[str], rows: Rows, repeat: int) -> Fields:
    return {name: np.repeat(fields[name][rows], repeat, 0) for name in names}


@quiet()
def stepped_designs(
    models: DesignModels, settings: Settings, speed: float, total: int, stride: int
) -> SteppedDesigns:
    """Step designs through a turn of their cranks at constant speed.

    As `stepping.step` steps one; every design is stepped on one thread, that which calls.

    Args:
        models: of the designs.
        settings: how to step.
        speed: of the cranks in [rad/s].
        total: steps in the turn.
        stride: steps from one record to the next; it divides the total.
    """
    timestep = TURN / abs(speed) / total
    like = models.like.closed
    loops = like.loops.with_model_copy()
    settings.apply(loops, timestep)
    fields = _hardened(models, loops, settings)
    loosened(loops.model, fields)
    own = loops.with_fields(fields)
    rates = own.tangent(own.linearise(models.qpos)[1]) * speed
    sims = own.posed.simulations(loops.model, len(rates), 1)
    sims.bind("qpos")[:], sims.bind("qvel")[:] = models.qpos, rates
    parts = [(np.zeros((len(rates), 1, 1)), models.qpos[:, None], rates[:, None])]
    for first in range(0, total, stride * max(1, BLOCK // stride)):
        count = min(stride * max(1, BLOCK // stride), total - first)
        out = sims.rollout(count, record=(TIME, "qpos", "qvel"))
        parts.append(tuple(out[name][:, stride - 1 :: stride] for name in (TIME, "qpos", "qvel")))
    clock, qpos, qvel = (np.concatenate(one, 1) for one in zip(*parts, strict=True))
    time = timestep * stride * np.arange(clock.shape[1])
    meant = models.qpos[:, [loops.crank_address]] + speed * time
    # MuJoCo sets a bad state back to time zero
    whole = (np.abs(clock[..., 0] - time) < 0.5 * timestep).all(1) & ~sims.warning[..., 1].any(-1)
    whole &= np.isfinite(qpos).all((1, 2)) & np.isfinite(qvel).all((1, 2))
    whole &= (np.abs(qpos[..., loops.crank_address] - meant) < LOST).all(1)
    return SteppedDesigns(models, fields, loops, time, qpos, qvel, whole & models.good)


def _hardened(models: DesignModels, loops: ModelLoops, settings: Settings) -> Fields:
    """Return the fields of designs as `Settings.apply` sets them in the model of one."""
    fields, model = dict(models.fields), models.like.closed.model
    count, crank = len(models.qpos), loops.crank
    for name in ("body_invweight0", "dof_invweight0", "dof_M0", "dof_armature"):
        fields[name] = fields.get(name, np.repeat(getattr(model, name)[None], count, 0)).copy()
    fields["body_invweight0"] *= settings.compliance_used
    fields["dof_invweight0"] *= settings.compliance_used
    size = models.like.closed.loops.with_fields(fields).characteristic_lengths
    heavy = settings.drive_inertia or drive_inertia(
        fields["body_mass"], fields["body_inertia"], size, settings.compliance_used
    )
    fields["dof_M0"][:, crank] += heavy - fields["dof_armature"][:, crank]
    fields["dof_armature"][:, crank] = heavy
    return fields


@dataclass(frozen=True)
class JudgedDesigns:
    """How far stepped designs are from solved poses.

    Attributes:
        estimate: the worst distance of any tracked point at the places looked at, (d,) in [m].
        tolerance: bound on it, (d,) in [m]: a ten-thousandth of the stroke.
        kept: which designs were for sure in the assembly they began in, (d,).
    """

    estimate: Array
    tolerance: Array
    kept: Bools


def judged(stepped: SteppedDesigns) -> JudgedDesigns:
    """Hold stepped designs against the poses solved at their own crank angles, at some places of the turn.

    A design whose state changes the side of the loops' determinant left its assembly; one for which a single
    Newton step does not lead to the solved pose is far from it, and not said to be kept.
    """
    d, p = stepped.qpos.shape[:2]
    places = np.unique(np.round(np.linspace(0, p - 1, JUDGED + 1)).astype(int))
    k = len(places)
    closed = stepped.models.like.closed
    loops = stepped.places_over(np.arange(d), k)
    qpos = stepped.qpos[:, places].reshape(d * k, -1)
    sites = [closed.model.site(name).id for name in closed.track.points]
    with np.errstate(all="ignore"):
        here = loops.site_positions(qpos)[:, sites]
        residual, jacobian = loops.linearise(qpos)
        side = loops.determinant_sign(jacobian).reshape(d, k)
        near = loops.displaced(qpos, loops.newton_step(residual, jacobian)[0])
        solved = loops.site_positions(near)[:, sites]
        left = loops.closure_error(loops.residual(near))
        gap = loops.closure_error(residual)
        distance = np.sqrt(((here - solved) ** 2).sum(-1)).max(1).reshape(d, k)
    sure = ((left <= SECOND * gap) | (left <= 100.0 * CLOSED)).reshape(d, k).all(1)
    kept = sure & (side == side[:, :1]).all(1) & (side[:, 0] != 0.0) & np.isfinite(distance).all(1)
    spans = np.ptp(solved.reshape(d, k, len(sites), 3), axis=1)
    tolerance = np.maximum(
        POSITION_TOLERANCE * 0.5 * spans.max((1, 2)),
        CLOSED * loops.characteristic_lengths.reshape(d, k)[:, 0],
    )
    return JudgedDesigns(distance.max(1), tolerance, kept)


def parted(stepped: SteppedDesigns, rows: Rows) -> Array:
    """Return the crank angle at which the loops of designs first do not close, (k,) in [rad]; else NaN.

    Each is followed round the turn in even steps, along the tangent and closed by Newton's method.
    """
    loops = stepped.places_over(rows, 1)
    place = loops.crank_address
    qpos = stepped.models.qpos[rows]
    first = qpos[:, place].copy()
    found = np.where(stepped.models.good[rows], np.nan, 0.0)
    with np.errstate(all="ignore"):
        for turned in TURN / ROUND * np.arange(1.0, ROUND + 1.0):
            try:
                tangent = loops.tangent(loops.linearise(qpos)[1])
                ahead = loops.displaced(qpos, tangent * (TURN / ROUND))
                ahead[:, place] = first + turned
                ahead, closed = closed_states(loops, ahead)
            except np.linalg.LinAlgError:
                break
            found[~closed & np.isnan(found)] = turned
            qpos = np.where(closed[:, None], ahead, qpos)
    return first + found
