"""What a step costs in a chain of N four-bars, N = 1 ... 200, with dense and with sparse matrices.

The first four-bar is that of the catalogue; every further one is a parallelogram on the rocker before
it, so that rocker k turns as the first does and stands k - 1 frames farther on: a closed form for any N,
and never near a dead centre. One turn at 600 rpm in 72 steps, RK4 with hard loops.

Run: python validation/choices/chain_costs.py [--out DIR]
"""

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import study_table as sheet
from step_timing import Bare

from mechsim import catalog
from mechsim.analytic.catalog.four_bar import FourBar
from mechsim.numerics.convergence import observed_order
from mechsim.simulation import mjcf

LENGTHS = (1, 2, 5, 10, 20, 50, 100, 200)
STEPS = 72
# turns timed: fewer where one takes seconds
ROUNDS = {n: 9 if n <= 20 else 3 if n <= 100 else 1 for n in LENGTHS}
# dense and sparse add up in another order: rounding, in units of the crank
EQUAL_TIME = 1e-9
# from this length on a chain costs more than the overhead of a step
LONG = 20
JACOBIANS = {
    "dense": int(mujoco.mjtJacobian.mjJAC_DENSE),
    "sparse": int(mujoco.mjtJacobian.mjJAC_SPARSE),
}


def chain(linkage: FourBar, n: int) -> mujoco.MjSpec:
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


def measured(linkage: FourBar, n: int) -> list[dict[str, Any]]:
    """Return the costs of a chain, dense and sparse, whose results are asserted to be the same."""
    model = chain(linkage, n).compile()
    bare = {name: Bare(model, STEPS, _using(jacobian)) for name, jacobian in JACOBIANS.items()}
    for _ in range(ROUNDS[n]):
        for item in bare.values():
            item.time_revolution()
    positions = [item.loops.posed.site_positions(item.qpos) for item in bare.values()]
    gap = float(np.abs(positions[0] - positions[1]).max()) / linkage.crank
    assert gap <= EQUAL_TIME, f"dense and sparse differ by {gap:.1e} cranks in a chain of {n}"
    rows = []
    for name, item in bare.items():
        pins = linkage.positions(item.qpos[:, item.loops.crank_address])["B"]
        exact = {f"B{k}": np.add(pins, ((k - 1) * linkage.ground, 0.0, 0.0)) for k in range(1, n + 1)}
        row = {"N": n, "matrices": name, "freedoms": int(model.nv), "rows": item.rows()}
        row |= {"us/step": f"{item.microseconds:.3g}", "us/step/N": f"{item.microseconds / n:.3g}"}
        rows.append(row | {"error": item.site_error(exact) / linkage.crank, "dense-sparse": gap})
    return rows


def _using(jacobian: int) -> Any:
    def change(model: mujoco.MjModel) -> None:
        model.opt.jacobian = jacobian

    return change


def exponents(rows: list[dict[str, Any]]) -> list[str]:
    """Return with what power of N a step's cost grows in long chains, a line for each kind of matrices."""
    lines = []
    for name in JACOBIANS:
        mine = [row for row in rows if row["matrices"] == name and row["N"] >= LONG]
        result = observed_order([row["N"] for row in mine], [float(row["us/step"]) for row in mine])
        assert result is not None
        grown = f"{-result.order:.2f} ({-result.high:.2f} to {-result.low:.2f} between neighbours)"
        lines.append(f"{name}: cost a step grows as N to the power {grown} from N = {LONG}")
    return lines


def plot(rows: list[dict[str, Any]], out: Path) -> None:
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    figure, axis = plt.subplots(figsize=(6, 4), layout="constrained")
    for name in JACOBIANS:
        mine = [row for row in rows if row["matrices"] == name]
        axis.loglog([row["N"] for row in mine], [float(row["us/step"]) for row in mine], "o-", label=name)
    axis.set(xlabel="four-bars in the chain", ylabel="processor time of a step [us]")
    axis.grid(alpha=0.3)
    axis.legend()
    figure.savefig(out / "chain_costs.png", dpi=110)


@mjcf.quiet()
def main() -> None:
    out = sheet.folder(__doc__ or "")
    linkage = catalog.make("four_bar")
    assert isinstance(linkage, FourBar)
    rows = [row for n in LENGTHS for row in measured(linkage, n)]
    sheet.show(rows, out, "chain_costs")
    print(*exponents(rows), sep="\n")
    if out is not None:
        plot(rows, out)


if __name__ == "__main__":
    main()
