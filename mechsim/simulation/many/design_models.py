"""The closed models of designs, and their stepping through a turn of the crank, all in one batch."""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from mechsim.model.design_arrays import StartedDesigns
from mechsim.model.forces import Forces
from mechsim.model.links import Pose, Vector
from mechsim.model.masses import with_inertia
from mechsim.model.mechanism import Mechanism
from mechsim.model.scene import Scene
from mechsim.numerics.angles import TURN
from mechsim.numerics.arrays import Array
from mechsim.simulation import closed_model
from mechsim.simulation.closed_model import ClosedModel
from mechsim.simulation.dynamics.loaded_model import loaded_model
from mechsim.simulation.many.design_fields import (
    Fields,
    inertia_fields,
    placeholder_fields,
    seated_fields,
    site_fields,
    with_constants,
)
from mechsim.simulation.mjcf.joints import model_names
from mechsim.simulation.mjcf.loop_cuts import Tree, cut_loops
from mechsim.simulation.model_loops import CLOSED, ModelLoops

Bools = NDArray[np.bool_]
Rows = NDArray[np.intp]
# as one model is closed: Newton steps, and a gap of rounding
MOST_STEPS, ROUNDING = 50, 1e-11


@dataclass(frozen=True)
class LikeModel:
    """The model of one of the designs, which says what all have in common.

    Attributes:
        closed: the model.
        tree: of its loops, cut.
        gravity: in [m/s2], where inertias are real; None where they are placeholders.
    """

    closed: ClosedModel
    tree: Tree
    gravity: Vector | None = None

    @property
    def joints(self) -> dict[str, int]:
        """The coordinates that a state holds, those of joints not cut -> the number of the model's joint."""
        model = self.closed.model
        there = {model.joint(i).name: i for i in range(model.njnt)}
        return {name: there[made] for name, made in model_names(self.tree.mechanism).items() if made in there}


@dataclass(frozen=True)
class DesignModels:
    """Models of d designs, each with its loops closed where its crank stands at first.

    Attributes:
        like: what they have in common.
        fields: of the models, (d, ...) each, as they are compiled.
        qpos: closed states, (d, nq).
        good: of which designs the loops close, (d,).
    """

    like: LikeModel
    fields: Fields
    qpos: Array
    good: Bools


def like_model(mechanism: Mechanism, gravity: Vector | None = None) -> LikeModel | None:
    """Return the model of a mechanism whose designs can be stepped together; None where they cannot.

    For that a crank turns all there is, loops are closed by points, and nothing is coupled or held.

    Args:
        mechanism: one of the designs.
        gravity: in [m/s2], where links are to have real inertias; None gives them placeholders.

    Raises:
        AssemblyError: where its own loops do not close.
    """
    if not mechanism.has_crank or mechanism.laws or mechanism.locked:
        return None
    tree = cut_loops(mechanism, splits=True)
    if gravity is None:
        closed: ClosedModel = closed_model.from_source(mechanism, Scene(level="motion"))
    else:
        closed = loaded_model(mechanism, Forces(gravity=gravity))
    loops = closed.loops
    if tree.mechanism is not mechanism or loops.frames or loops.couplings or closed.undetermined_points.any():
        return None
    # what of the loops' rows says something is looked for once, in a model that is known to close
    loops.tangent(loops.linearise(closed.qpos[None])[1])
    if gravity is not None and loops.has_undetermined_dofs:
        # forces decide how fast what nothing determines begins to spin, and rounding does not
        return None
    return LikeModel(closed, tree, gravity)


def design_models(
    like: LikeModel, started: StartedDesigns, designs: Sequence[Mechanism] = ()
) -> DesignModels:
    """Return the models of designs, generated, compiled and closed as one is, on arrays.

    Args:
        like: what they have in common.
        started: their numbers, and where they begin.
        designs: themselves, where their inertias are real.
    """
    model, tree, arrays = like.closed.model, like.tree, started.arrays
    sites = site_fields(model, tree, arrays)
    fields, qpos = seated_fields(model, tree, arrays, started.guess)
    place = like.closed.loops.crank_address
    start = started.told[tree.mechanism.crank.name]
    turns = TURN * np.round((start - qpos[:, place]) / TURN)
    fields |= {**sites, "qpos0": qpos.copy()}
    fields["qpos0"][:, place] += turns
    qpos[:, place] = start
    loops = like.closed.loops.with_fields(fields)
    qpos, good = closed_states(loops, qpos)
    # links stand in the reference configuration as the closed loops have them
    seated, rest = seated_fields(model, tree, arrays, _poses(loops, tree, qpos))
    rest[:, place] += TURN * np.round((start - rest[:, place]) / TURN)
    real = [with_inertia(one) for one in designs]
    weights = inertia_fields(model, real) if like.gravity is not None else placeholder_fields(model, arrays)
    fields = {**seated, **sites, **weights}
    qpos, closed = closed_states(like.closed.loops.with_fields({**seated, **sites, "qpos0": rest}), rest)
    fields = with_constants(model, fields, rest)
    return DesignModels(like, fields, qpos, good & closed & _as_simple(model, fields))


def _as_simple(model: mujoco.MjModel, fields: Fields) -> Bools:
    """Whether designs leave bodies so that MuJoCo takes the same shorter way with their inertia, (d,)."""
    bodies = np.flatnonzero(model.body_simple)
    joints = np.flatnonzero(np.isin(model.jnt_bodyid, bodies))
    good = (fields["body_ipos"][:, bodies] == model.body_ipos[bodies]).all((1, 2))
    for name in ("jnt_pos", "jnt_axis"):
        good &= (fields[name][:, joints] == getattr(model, name)[joints]).all((1, 2))
    return good


def closed_states(loops: ModelLoops, qpos: Array) -> tuple[Array, Bools]:
    """Return states with their loops closed, their cranks held, (d, nq), and which of them closed.

    As `ModelLoops.close` for each.
    """
    before = np.full(len(qpos), np.inf)
    going = np.ones(len(qpos), dtype=np.bool_)
    gap = before
    for _ in range(MOST_STEPS):
        residual, jacobian = loops.linearise(qpos)
        gap = np.where(going, loops.closure_error(residual), gap)
        going &= ~((gap <= CLOSED) | ((gap < ROUNDING) & (gap >= 0.5 * before)))
        if not going.any():
            break
        before = gap
        step, _ = loops.newton_step(residual, jacobian)
        qpos = np.where(going[:, None], loops.displaced(qpos, step), qpos)
        going &= np.isfinite(qpos).all(1)
    return qpos, gap < ROUNDING


def _poses(loops: ModelLoops, tree: Tree, qpos: Array) -> dict[str, Pose]:
    """Return how links stand at states: link -> (d, 3) and (d, 3, 3)."""
    position, rotation = loops.body_poses(qpos)
    number = {link.name: loops.model.body(link.name).id for link in tree.mechanism.links}
    return {name: Pose(position[:, i], rotation[:, i]) for name, i in number.items()}
