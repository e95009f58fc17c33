"""Where sparse matrices are quicker than dense ones, and where MuJoCo's sparse ones are wrong.

Rows of four-bars (few freedoms touch each other) and rows of polygons of p hinges whose cranks are geared
to the one before (a polygon's freedoms all touch each other). Then random trees of hinges with random
points pinned together: how often the accelerations of one Newton step differ, which in exact arithmetic
they do not, and what `Settings()` takes there.

Run: python validation/choices/matrices.py
"""

import time
from typing import Any

import mujoco
import numpy as np
import study_table as sheet

from mechsim import catalog
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.simulation import settings
from mechsim.simulation.mjcf.compiling import compiled, quiet

CHAINS = (8, 10, 12, 16, 20, 24, 40)
POLYGONS = ((1, 40), (1, 100), (2, 20), (2, 40), (3, 20), (3, 30), (4, 12), (4, 20), (6, 12), (10, 8))
STEPS, ROUNDS = 100, 15
RANDOM, SEED = 400, 0


def chain(linkage: KinematicSolver, n: int) -> mujoco.MjSpec:
    """Return the model of a chain of n four-bars with its crank at zero."""
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.option.gravity = (0.0, 0.0, 0.0)
    spec.option.disableflags = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    first = linkage.positions(np.zeros(1))
    pin, frame = first["B"][0], np.array([linkage.ground, 0.0, 0.0])
    links = [_link(spec.worldbody, "crank", np.zeros(3), first["A"][0], linkage.crank)]
    for k in range(1, n + 1):
        foot, tip = k * frame, pin + (k - 1) * frame
        rocker = _link(spec.worldbody, f"rocker{k}", foot, tip, linkage.rocker)
        rocker.add_site(name=f"B{k}", pos=(linkage.rocker, 0.0, 0.0))
        before = links[-1]
        arm = linkage.crank if k == 1 else linkage.rocker
        tail = first["A"][0] if k == 1 else tip - frame
        length = linkage.coupler if k == 1 else linkage.ground
        coupler = _link(before, f"coupler{k}", np.array([arm, 0.0, 0.0]), tip - tail, length, before)
        coupler.add_site(name=f"B{k}@coupler", pos=(length, 0.0, 0.0))
        kind, kind_of_ends = mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtObj.mjOBJ_SITE
        spec.add_equality(name=f"B{k}", type=kind, objtype=kind_of_ends, name1=f"B{k}@coupler", name2=f"B{k}")
        links.append(rocker)
    return spec


def _link(
    parent: mujoco.MjsBody,
    name: str,
    position: np.ndarray,
    towards: np.ndarray,
    length: float,
    within: mujoco.MjsBody | None = None,
) -> mujoco.MjsBody:
    """Add a rod of 1 kg, hinged to its parent at a position, towards another position or along a vector."""
    direction = towards - position if within is None else towards
    angle = np.arctan2(direction[1], direction[0]) - (0.0 if within is None else _rotated(within))
    half = 0.5 * angle
    body = parent.add_body(name=name, pos=position, quat=(np.cos(half), 0.0, 0.0, np.sin(half)))
    body.mass, body.ipos = 1.0, (0.5 * length, 0.0, 0.0)
    body.inertia = np.full(3, length**2 / 10.0)
    body.explicitinertial = True
    body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=(0.0, 0.0, 1.0))
    return body


def _rotated(body: mujoco.MjsBody) -> float:
    """Return by what angle about z a body stands turned in its parent."""
    return 2.0 * float(np.arctan2(body.quat[3], body.quat[0]))


def polygons(count: int, sides: int) -> mujoco.MjSpec:
    """Return a row of closed planar polygons of unit links, each with so many hinges before it closes."""
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    half = np.pi / (sides + 1)
    rotation = (np.cos(half), 0.0, 0.0, np.sin(half))
    for k in range(count):
        body = spec.worldbody
        for i in range(sides):
            body = body.add_body(pos=(1.0 if i else 3.0 * k, 0.0, 0.0), quat=rotation)
            _weigh(body, (0.5, 0.0, 0.0))
            body.add_joint(name=f"{k}.{i}", type=mujoco.mjtJoint.mjJNT_HINGE, axis=(0.0, 0.0, 1.0))
        body.add_site(name=f"{k}.end", pos=(1.0, 0.0, 0.0))
        # a regular polygon of one side more than hinges ends where it began, but for its last side
        begin = np.array([3.0 * k, 0.0, 0.0])
        angles = 2.0 * half * np.arange(1, sides + 1)
        end = begin + np.array([np.cos(angles).sum(), np.sin(angles).sum(), 0.0])
        spec.worldbody.add_site(name=f"{k}.foot", pos=end)
        spec.add_equality(
            type=mujoco.mjtEq.mjEQ_CONNECT,
            objtype=mujoco.mjtObj.mjOBJ_SITE,
            name1=f"{k}.end",
            name2=f"{k}.foot",
        )
        if k:
            kind, kind_of_ends = mujoco.mjtEq.mjEQ_JOINT, mujoco.mjtObj.mjOBJ_JOINT
            gear = spec.add_equality(
                type=kind, objtype=kind_of_ends, name1=f"{k}.0", name2=f"{k - 1}.{sides // 2}"
            )
            gear.data[:5] = 0.0, 1.0, 0.0, 0.0, 0.0
    return spec


def tangle(random: np.random.Generator) -> mujoco.MjSpec:
    """Return a random tree of hinges with random points pinned together."""
    spec, count = mujoco.MjSpec(), int(random.integers(5, 60))
    bodies = [spec.worldbody]
    for i in range(count):
        first = max(0, len(bodies) - 4) if random.random() < 0.7 else 0
        body = bodies[random.integers(first, len(bodies))].add_body(name=f"{i}", pos=random.normal(size=3))
        _weigh(body, (0.0, 0.0, 0.0))
        body.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=random.normal(size=3))
        bodies.append(body)
    for _ in range(int(random.integers(1, count))):
        a, b = random.choice(count, 2, replace=False)
        kind, kind_of_ends = mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtObj.mjOBJ_BODY
        spec.add_equality(type=kind, objtype=kind_of_ends, name1=f"{a}", name2=f"{b}").data[:3] = 0.0
    return spec


def _weigh(body: mujoco.MjsBody, centre: tuple[float, float, float]) -> None:
    body.mass, body.ipos, body.inertia, body.explicitinertial = 1.0, centre, np.full(3, 0.1), True


def ready(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Return the model set up as `Settings()` would, but for the choice of matrices."""
    model = compiled(spec)
    disable = mujoco.mjtDisableBit
    model.opt.disableflags |= int(disable.mjDSBL_CONTACT | disable.mjDSBL_ISLAND | disable.mjDSBL_REFSAFE)
    model.opt.gravity[:] = 0.0
    model.opt.integrator = int(mujoco.mjtIntegrator.mjINT_RK4)
    model.opt.timestep, model.opt.iterations, model.opt.tolerance = 1e-3, 1, 0.0
    model.eq_solref[:], model.eq_solimp[:] = (0.1, 1.0), (0.9999, 0.9999, 0.001, 0.5, 2.0)
    return model


def gap(model: mujoco.MjModel) -> tuple[float, float]:
    """Return by how much accelerations differ, in units of the largest; and what part is filled."""
    (dense, filled), (sparse, _) = (settings.accelerations_and_fill(model, kind) for kind in settings.KINDS)
    return float(np.abs(dense - sparse).max() / np.abs(dense).max()), filled


def measured(name: str, spec: mujoco.MjSpec) -> dict[str, Any]:
    """Return a row: the cost of a step either way, timed in alternation."""
    model = ready(spec)
    differ, filled = gap(model)
    times: dict[str, list[float]] = {kind: [] for kind in settings.KINDS}
    for _ in range(ROUNDS):
        for kind, number in settings.KINDS.items():
            model.opt.jacobian = number
            data = mujoco.MjData(model)
            begin = time.process_time()
            mujoco.mj_step(model, data, STEPS)
            times[kind].append(1e6 * (time.process_time() - begin) / STEPS)
    dense, sparse = (float(np.median(times[kind])) for kind in ("dense", "sparse"))
    row = {"model": name, "freedoms": int(model.nv), "filled": f"{filled:.2f}", "differ": differ}
    row |= {"dense us": f"{dense:.0f}", "sparse us": f"{sparse:.0f}", "dense/sparse": f"{dense / sparse:.2f}"}
    return row | {"selected": settings.faster_matrices(model)}


def wrong() -> str:
    """Return how often sparse matrices are wrong in random models, and what is selected there."""
    random = np.random.default_rng(SEED)
    result: list[tuple[float, str]] = []
    for _ in range(RANDOM):
        model = ready(tangle(random))
        result.append((gap(model)[0], settings.faster_matrices(model)))
    bad = [(differ, selected) for differ, selected in result if differ > settings.AGREEMENT_TOLERANCE]
    right = [differ for differ, _ in result if differ <= settings.AGREEMENT_TOLERANCE]
    kinds = [selected for _, selected in bad]
    return (
        f"MuJoCo {mujoco.__version__}, {RANDOM} random models: accelerations differ in {len(bad)}, by "
        f"{min(d for d, _ in bad):.1g} to {max(d for d, _ in bad):.2g} of the largest, in the others by "
        f"{max(right):.1g} at most; sparse selected in {kinds.count('sparse')} of the {len(bad)} and in "
        f"{sum(selected == 'sparse' for _, selected in result)} of all"
    )


@quiet()
def main() -> None:
    linkage = catalog.make("four_bar")
    assert linkage.name == "four_bar"
    rows = [measured(f"{n} four-bars", chain(linkage, n)) for n in CHAINS]
    rows += [measured(f"{count} polygons of {sides}", polygons(count, sides)) for count, sides in POLYGONS]
    sheet.show(rows)
    print(wrong())


if __name__ == "__main__":
    main()
