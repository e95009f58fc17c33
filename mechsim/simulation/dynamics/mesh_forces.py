"""Tooth forces of couplings as MuJoCo's bodies carry them, and the efforts of threads in screws."""

from collections.abc import Iterator

import numpy as np

from mechsim.model.efforts import MeshForce
from mechsim.model.joints import Joint
from mechsim.model.meshes import Mesh, meshes_of, threads_of
from mechsim.numerics.arrays import Array
from mechsim.simulation.dynamics.applied import Fields, add_force
from mechsim.simulation.dynamics.loaded_model import AppliedForces, LoadedModel


def coupling_forces(
    loaded: LoadedModel, fields: Fields, jacobian: Array, multipliers: Array
) -> AppliedForces:
    """Return the forces of couplings and holds: of teeth at their pitch points, of others on coordinates.

    A tooth force on a wheel, and its reverse on the body that carries it, do the work of the coordinate's
    effort; those on the carrier cancel.
    """
    forces = loaded.nothing(len(multipliers))
    meshes, first = meshes_of(loaded.mechanism), loaded.loops.coupled_rows.start
    toothed = [first + i for i, name in enumerate(loaded.mechanism.named_laws) if name in meshes]
    plain = np.setdiff1d(np.arange(multipliers.shape[1])[loaded.loops.coupled_rows], toothed)
    forces.generalised[:] += np.einsum("nm,nmv->nv", multipliers[:, plain], jacobian[:, plain])
    for row, mesh in zip(toothed, meshes.values(), strict=True):
        force, point = _at_pitch_point(loaded, fields, mesh, multipliers[:, row])
        for own, sign in ((mesh.driven, 1.0), (mesh.driver, -1.0)):
            near, far = loaded.ends(own.joint)
            wheel, carrier = (far, near) if own.sign > 0.0 else (near, far)
            add_force(forces.wrenches, fields, loaded.body(wheel), point, sign * force)
            add_force(forces.wrenches, fields, loaded.body(carrier), point, -sign * force)
    return forces


def mesh_forces(loaded: LoadedModel, fields: Fields, multipliers: Array) -> dict[str, MeshForce]:
    """Return the tooth force of each coupling that has a pitch point."""
    names, first = [*loaded.mechanism.named_laws], loaded.loops.coupled_rows.start
    found: dict[str, MeshForce] = {}
    for name, mesh in meshes_of(loaded.mechanism).items():
        effort = multipliers[:, first + names.index(name)]
        force, point = _at_pitch_point(loaded, fields, mesh, effort)
        found[name] = MeshForce(link=mesh.driven.link, by=mesh.driver.link, force=force, point=point)
    return found


def thread_efforts(loaded: LoadedModel, joint: Joint, multipliers: Array) -> Iterator[tuple[Array, Array]]:
    """Yield force along and moment about the axis of a screw on its link b, (n,) each; nothing of others."""
    threads, first = threads_of(loaded.mechanism), loaded.loops.coupled_rows.start
    for i, (name, law) in enumerate(loaded.mechanism.named_laws.items()):
        if threads.get(name) == joint:
            yield multipliers[:, first + i], -law.slope * multipliers[:, first + i]


def _at_pitch_point(loaded: LoadedModel, fields: Fields, mesh: Mesh, effort: Array) -> tuple[Array, Array]:
    """Return the force on the driven one and the pitch point, in the ground frame, (n, 3) each."""
    body = loaded.body(mesh.carrier)
    axes = fields["xmat"][:, body].reshape(-1, 3, 3)
    own = np.outer(effort, mesh.tangential) + np.outer(np.abs(effort), mesh.separating)
    return (axes @ own[..., None])[..., 0], fields["xpos"][:, body] + axes @ mesh.point
