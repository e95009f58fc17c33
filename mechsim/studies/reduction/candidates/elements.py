"""Candidates for removal besides passive chains: bodies, joints, contacts, limits, actuators and others."""

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Literal

import mujoco
import numpy as np

from mechsim.errors import first_names, several
from mechsim.numerics.arrays import Array
from mechsim.simulation.mjcf.compiling import plainly_compiled
from mechsim.simulation.mjcf_reader.fixed_bodies import pose_in_parent
from mechsim.simulation.plain_settings import PlainSettings
from mechsim.simulation.state import SCALAR
from mechsim.studies.reduction.reduced_scene import Evidence

if TYPE_CHECKING:
    import networkx as nx


# number of names in a message
LISTED = 4


class NotApplicable(Exception):  # noqa: N818
    """The element is no longer in the scene, or another element needs it."""


@dataclass(frozen=True, slots=True)
class RemovalCandidate:
    """A change of a scene's specification that may reduce it.

    Attributes:
        category: category of the element, such as "contacts".
        what: description of the removed element.
        edit: changes a specification in place; raises NotApplicable if it does not apply.
        only_if_faster: whether the candidate is applied only if it saves time, even without loss of accuracy.
    """

    category: str
    what: str
    edit: Callable[[mujoco.MjSpec], None]
    only_if_faster: bool = False


def with_candidate(spec: mujoco.MjSpec, candidate: RemovalCandidate) -> mujoco.MjSpec:
    """Return a copy of a specification with a candidate applied.

    Raises:
        NotApplicable: if it does not apply, or MuJoCo rejects the result.
    """
    copy = spec.copy()
    try:
        candidate.edit(copy)
        plainly_compiled(copy)
    except ValueError as error:
        raise NotApplicable(f"{candidate.what}: {error}") from None
    return copy


def existing(spec: mujoco.MjSpec, kind: Literal["joint", "body", "equality"], *names: str) -> list[Any]:
    """Return elements by their names.

    Raises:
        NotApplicable: if one of them is missing.
    """
    elements = [getattr(spec, kind)(name) for name in names]
    if None in elements:
        raise NotApplicable(f"{kind} {names[elements.index(None)]} is removed already")
    return elements


def delete(spec: mujoco.MjSpec, elements: Iterable[Any]) -> None:
    """Delete elements of a specification."""
    for element in list(elements):
        spec.delete(element)


# displacement of a joint above which it is not proposed, in [rad] or characteristic lengths
MAX_DISPLACEMENT = 0.02


def locked_joints(observed: Evidence) -> list[RemovalCandidate]:
    """Propose to lock each hinge and slide that hardly moves, the smallest displacement first."""
    candidates: list[tuple[float, RemovalCandidate]] = []
    length = observed.scene.mechanism.characteristic_length
    for joint in observed.spec.joints:
        if joint.type not in SCALAR or joint.name in observed.scene.joint_laws:
            continue
        values = observed.values(joint.name)
        unit = length if joint.type == mujoco.mjtJoint.mjJNT_SLIDE else 1.0
        displacement = float(np.ptp(values)) / unit
        if displacement > MAX_DISPLACEMENT:
            continue
        middle = 0.5 * float(values.min() + values.max())
        distance = f"{displacement * unit:.2g} {'rad' if unit == 1.0 else 'm'}"
        what = f"joint {joint.name}, which moved by {distance}: locked"
        edit = partial(fuse, name=joint.name, value=np.array([middle]))
        candidates.append((displacement, RemovalCandidate("locked joints", what, edit)))
    return [candidate for _, candidate in sorted(candidates, key=lambda pair: pair[0])]


def fuse(spec: mujoco.MjSpec, name: str, value: Array) -> None:
    """Remove a joint that no element uses; its body keeps the pose at coordinates, (1,) or of a ball (4,).

    Raises:
        NotApplicable: if the joint is missing or in use, or its body has other joints, which would move with
            the body.
    """
    (joint,) = existing(spec, "joint", name)
    require_unused(spec, name)
    model = plainly_compiled(spec)
    data, own = mujoco.MjData(model), model.joint(name)
    address = slice(int(own.qposadr[0]), int(own.qposadr[0]) + len(value))
    body = int(own.bodyid[0])
    if model.body_jntnum[body] > 1 and not np.array_equal(value, model.qpos0[address]):
        raise NotApplicable(f"joint {name} shares its body with others and is not at its rest position")
    data.qpos[address] = value
    mujoco.mj_kinematics(model, data)
    pose = pose_in_parent(model, data, body)
    model.body_pos[body], model.body_quat[body] = pose[:3], pose[3:]
    spec.copy_back(model)
    spec.delete(joint)


def require_unused(spec: mujoco.MjSpec, name: str) -> None:
    """Reject a joint that an actuator, a tendon or a joint equality uses.

    Raises:
        NotApplicable: if an element uses the joint; the message names it.
    """
    for actuator in spec.actuators:
        if actuator.trntype != mujoco.mjtTrn.mjTRN_TENDON and actuator.target == name:
            raise NotApplicable(f"actuator {actuator.name} acts on joint {name}")
    for tendon in spec.tendons:
        if name in joints_of(tendon):
            raise NotApplicable(f"tendon {tendon.name} acts on joint {name}")
    for equality in spec.equalities:
        if equality.type == mujoco.mjtEq.mjEQ_JOINT and name in (equality.name1, equality.name2):
            raise NotApplicable(f"equality {equality.name} couples joint {name}")


def joints_of(tendon: mujoco.MjsTendon) -> dict[str, float]:
    """Return the joints of a fixed tendon and their coefficients; none for a spatial tendon."""
    return {
        wrap.target.name: float(wrap.coef) for wrap in tendon.path if wrap.type == mujoco.mjtWrap.mjWRAP_JOINT
    }


TENDON, JOINT = mujoco.mjtEq.mjEQ_TENDON, mujoco.mjtEq.mjEQ_JOINT


def disconnected_bodies(observed: Evidence) -> list[RemovalCandidate]:
    """Propose to remove all bodies that only the world connects to the tracked or driven bodies."""
    import networkx as nx

    graph = interaction_graph(observed)
    kept = set[str]()
    for name in (*observed.tracked, *needed_bodies(observed)):
        if name in graph:
            kept |= nx.node_connected_component(graph, name)
    names = [observed.model.body(body).name for body in sorted(_fixed_bodies(observed.model)) if body]
    parents = [observed.spec.worldbody, *(observed.spec.body(name) for name in names)]
    moving: list[str] = []
    for body in (body for parent in parents for body in parent.bodies):
        subtree = [body, *body.find_all("body")]
        if not {each.name for each in subtree} & kept and any(each.joints for each in subtree):
            moving.append(body.name)
    if not moving:
        return []
    bodies = several(len(moving), "body", "bodies")
    what = f"{bodies} that no tracked body depends on: {first_names(moving, LISTED)}"

    def edit(spec: mujoco.MjSpec) -> None:
        for name in moving:
            delete(spec, existing(spec, "body", name))

    return [RemovalCandidate("disconnected bodies", what, edit)]


def interaction_graph(observed: Evidence) -> "nx.Graph[str]":
    """Return the graph of bodies that interact, without bodies that cannot move."""
    import networkx as nx

    model, fixed = observed.model, _fixed_bodies(observed.model)
    graph: nx.Graph[str] = nx.Graph()
    for body in range(1, model.nbody):
        parent = int(model.body_parentid[body])
        if body not in fixed:
            graph.add_node(model.body(body).name)
            if parent not in fixed:
                graph.add_edge(model.body(body).name, model.body(parent).name)
    tendons = [_tendon_bodies(tendon) for tendon in observed.spec.tendons]
    for group in (*_equalities(observed.spec), *tendons, touching_bodies(observed)):
        nx.add_path(graph, [name for name in group if name in graph])
    return graph


def touching_bodies(observed: Evidence) -> list[str]:
    """Return the bodies whose geoms were in contact."""
    geoms = [observed.spec.geom(name) for name in observed.touched]
    return [body_of(geom) for geom in geoms if geom is not None]


def needed_bodies(observed: Evidence) -> set[str]:
    """Return the bodies of driven joints and of actuators that have a motion law."""
    spec = observed.spec
    driven = {body_of(spec.joint(name)) for name in observed.scene.joint_laws}
    return driven.union(*(bodies_of(spec, spec.actuator(name)) for name in observed.scene.ctrl))


def bodies_of(spec: mujoco.MjSpec, actuator: mujoco.MjsActuator) -> set[str]:
    """Return the bodies on which an actuator acts."""
    kind = actuator.trntype
    if kind == mujoco.mjtTrn.mjTRN_TENDON:
        return set(_tendon_bodies(spec.tendon(actuator.target)))
    if kind == mujoco.mjtTrn.mjTRN_BODY:
        return {actuator.target}
    if kind in (mujoco.mjtTrn.mjTRN_SITE, mujoco.mjtTrn.mjTRN_SLIDERCRANK):
        return {body_of(spec.site(actuator.target))}
    return {body_of(spec.joint(actuator.target))}


def _equalities(spec: mujoco.MjSpec) -> list[list[str]]:
    """Return the bodies that each equality couples."""

    def bodies(equality: mujoco.MjsEquality, name: str) -> list[str]:
        if equality.type == JOINT:
            return [body_of(spec.joint(name))]
        if equality.type == TENDON:
            return _tendon_bodies(spec.tendon(name))
        return [body_of(spec.site(name)) if equality.objtype == mujoco.mjtObj.mjOBJ_SITE else name]

    return [
        [body for name in (equality.name1, equality.name2) if name for body in bodies(equality, name)]
        for equality in spec.equalities
    ]


def _tendon_bodies(tendon: mujoco.MjsTendon) -> list[str]:
    """Return the bodies on which a tendon acts."""
    return [body_of(wrap.target) for wrap in tendon.path if hasattr(wrap.target, "parent")]


def body_of(element: "mujoco.MjsJoint | mujoco.MjsSite | mujoco.MjsGeom") -> str:
    """Return the body of a joint, a site or a geom."""
    return str(element.parent.name)


def _fixed_bodies(model: mujoco.MjModel) -> set[int]:
    """Return the indices of the bodies that cannot move, including the world."""
    fixed = {0}
    for body in range(1, model.nbody):
        if int(model.body_parentid[body]) in fixed and not model.body_jntnum[body]:
            fixed.add(body)
    return fixed


def fused_bodies(observed: Evidence) -> list[RemovalCandidate]:
    """Propose to fuse all bodies without joints with their parents, except tracked bodies."""
    bodies = list(observed.spec.bodies)[1:]
    count = sum(not body.joints and body.name not in observed.tracked for body in bodies)
    what = f"{several(count, 'body', 'bodies')} without joints, fused with their parents"

    def edit(spec: mujoco.MjSpec) -> None:
        for name in observed.tracked:
            spec.body(name).fuse = 0
        if not spec.fuse_static():
            raise NotApplicable("no body can be fused")

    return [RemovalCandidate("fused bodies", what, edit)] if count else []


CONTACTS_DISABLED = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
# largest force of an actuator at rest, in [N m] or [N]
MAX_FORCE_AT_REST = 1e-12
# field of a joint or tendon -> its value without effect, and its name in messages
SPRING_FIELDS = {
    "frictionloss": (0.0, "Coulomb friction"),
    "stiffness": (np.zeros(3), "spring"),
    "damping": (np.zeros(3), "damper"),
}


def contacts(observed: Evidence) -> list[RemovalCandidate]:
    """Propose to disable contacts if none occurred, otherwise those of geoms without contact."""
    if observed.spec.option.disableflags & CONTACTS_DISABLED:
        return []
    if not observed.touched:
        edit = PlainSettings(contact=False).put_into
        return [RemovalCandidate("contacts", "contact detection (no contacts)", edit)]
    names = [
        geom.name
        for geom in observed.spec.geoms
        if geom.name not in observed.touched and (geom.contype or geom.conaffinity)
    ]
    what = f"contacts of {several(len(names), 'geom')} without contact"

    def edit_geoms(spec: mujoco.MjSpec) -> None:
        for geom in spec.geoms:
            if geom.name in names:
                geom.contype = geom.conaffinity = 0
        delete(spec, (pair for pair in spec.pairs if pair.geomname1 in names or pair.geomname2 in names))

    return [RemovalCandidate("contacts", what, edit_geoms)] if names else []


def visual_elements(observed: Evidence) -> list[RemovalCandidate]:
    """Propose to remove each kind of element that exerts no force: sensors, cameras, geoms, meshes."""
    spec, edits = observed.spec, dict[str, Any]()
    if spec.sensors:
        edits[several(len(spec.sensors), "sensor")] = lambda spec: delete(spec, spec.sensors)
    if count := len(spec.cameras) + len(spec.lights):
        edits[several(count, "camera or light", "cameras and lights")] = lambda spec: delete(
            spec, (*spec.cameras, *spec.lights)
        )
    # tendons wrap around these geoms, or contact pairs name them
    wraps = {
        wrap.target.name
        for tendon in spec.tendons
        for wrap in tendon.path
        if wrap.type in (mujoco.mjtWrap.mjWRAP_SPHERE, mujoco.mjtWrap.mjWRAP_CYLINDER)
    }
    pairs = {name for pair in spec.pairs for name in (pair.geomname1, pair.geomname2)}
    geoms = [geom.name for geom in spec.geoms if geom.name not in wraps | pairs | observed.touched]
    if geoms:
        what = f"{several(len(geoms), 'geom')} without contact, with their meshes and materials"
        edits[what] = partial(_without_geoms, names=geoms)
    elif spec.materials or spec.textures or spec.meshes:
        edits["materials, textures and meshes"] = _without_assets
    return [RemovalCandidate("visual-only elements", what, edit) for what, edit in edits.items()]


def _without_geoms(spec: mujoco.MjSpec, names: Collection[str]) -> None:
    """Remove geoms; bodies keep their inertial properties."""
    for body in list(spec.bodies)[1:]:
        if any(geom.name in names for geom in body.geoms) and not body.explicitinertial:
            spec.adopt_inertial(body)
    delete(spec, (geom for geom in spec.geoms if geom.name in names))
    _without_assets(spec)


def _without_assets(spec: mujoco.MjSpec) -> None:
    """Remove materials, textures and skins, and the meshes and height fields that no geom uses."""
    meshes, fields = {geom.meshname for geom in spec.geoms}, {geom.hfieldname for geom in spec.geoms}
    for element in (*spec.geoms, *spec.sites, *spec.tendons):
        element.material = ""
    delete(spec, (*spec.skins, *spec.materials, *spec.textures))
    delete(spec, (mesh for mesh in spec.meshes if mesh.name not in meshes))
    delete(spec, (field for field in spec.hfields if field.name not in fields))


def _with_value(spec: mujoco.MjSpec, names: Collection[str], field: str, value: Any) -> None:
    """Give a field of joints and tendons another value."""
    for element in (*spec.joints, *spec.tendons):
        if element.name in names:
            setattr(element, field, value)


def limits(observed: Evidence) -> list[RemovalCandidate]:
    """Propose to remove all limits that were never reached, and, one at a time, each of the others."""
    model = observed.model
    names = [model.joint(j).name for j in range(model.njnt) if model.jnt_limited[j]]
    names += [model.tendon(t).name for t in range(model.ntendon) if model.tendon_limited[t]]
    unused = [name for name in names if name not in observed.limited]
    were = "was" if len(unused) == 1 else "were"
    options = {f"{several(len(unused), 'limit')} that {were} never reached": unused} if unused else {}
    options |= {f"limit of {name}": [name] for name in names if name in observed.limited}
    unlimited = partial(_with_value, field="limited", value=int(mujoco.mjtLimited.mjLIMITED_FALSE))
    return [
        RemovalCandidate("limits", what, partial(unlimited, names=group), only_if_faster=group is not unused)
        for what, group in options.items()
    ]


def actuators(observed: Evidence) -> list[RemovalCandidate]:
    """Propose to remove the actuators that no motion law controls and that exerted no force."""
    names = [
        name
        for name, force in observed.forces.items()
        if force <= MAX_FORCE_AT_REST and name not in observed.scene.ctrl
    ]
    what = f"{several(len(names), 'actuator')} at rest: {first_names(names, LISTED)}"

    def edit(spec: mujoco.MjSpec) -> None:
        delete(spec, (actuator for actuator in spec.actuators if actuator.name in names))

    return [RemovalCandidate("actuators", what, edit)] if names else []


def redundant_equalities(observed: Evidence) -> list[RemovalCandidate]:
    """Propose to remove each equality that is inactive or implied by the others."""
    return [
        RemovalCandidate(
            "redundant equalities",
            f"equality {name}, implied by the others",
            lambda spec, name=name: delete(spec, existing(spec, "equality", name)),
        )
        for name in observed.redundant
    ]


def springs(observed: Evidence) -> list[RemovalCandidate]:
    """Propose to remove Coulomb friction, springs and dampers: from all joints and tendons, and from each."""
    candidates: list[RemovalCandidate] = []
    for field, (none, what) in SPRING_FIELDS.items():
        # in a prescribed joint these only change the drive force
        names = [
            element.name
            for element in (*observed.spec.joints, *observed.spec.tendons)
            if np.any(getattr(element, field)) and element.name not in observed.scene.joint_laws
        ]
        options = {f"{what} of all {len(names)} joints that have one": names} if len(names) > 1 else {}
        options |= {f"{what} of {name}": [name] for name in names}
        removed = partial(_with_value, field=field, value=none)
        candidates += [
            RemovalCandidate("springs", text, partial(removed, names=group), only_if_faster=True)
            for text, group in options.items()
        ]
    return candidates
