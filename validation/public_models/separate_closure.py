"""Closed configurations, inverse kinematics and Jacobians of public models, against closures solved apart.

Problem: `ms.sample` draws configurations of each model of `models.txt` in FOLDER. Reference: the closure in
maximal coordinates (`robustness/mjcf_closure_oracle.py`), which shares no equation with mechsim, is
solved by least squares at the same driver positions from a start that is 1e-3 off. "apart" is the largest
distance of a body's origin over the size, or difference of a rotation matrix, among bodies that the loops and
drivers determine; "remaining" is what the reference itself leaves, in the same units.

"inverse": a body's coordinates are prescribed over time (`ms.load(model, drive={"body.x": ...})`), as many as
the model has drivers; the closure apart at the resulting driver positions must have the body there.
"jacobian": derivatives of `ms.joint_map` against differences of `ms.closed_qpos`, extrapolated three times.

    python validation/public_models/separate_closure.py FOLDER [WORD]

Exits with 1 if fewer than 20 models are compared or a bound is missed.
"""

import sys
from itertools import combinations, pairwise
from pathlib import Path

import mujoco
import numpy as np

import mechsim as ms
from mechsim.errors import MechsimError
from mechsim.simulation.closed_configurations import compiled_model, straight_path
from mechsim.simulation.mjcf.compiling import quiet

sys.path.insert(0, str(Path(__file__).parents[1] / "robustness"))
from mjcf_closure_oracle import ZERO_SINGULAR_VALUE, Closure, rotated

LISTED = Path(__file__).with_name("models.txt")
STATES, OFF = 8, 1e-3
# over the size, in rad, and of Jacobians; least number of models
CLOSED, JACOBIAN, MODELS = 1e-12, 1e-9, 20
# first step of the differences, in rad or sizes
FIRST_STEP = 0.02
MOVED = 1e-7


def bodies_at(closure, x):
    """Return positions over the size, (nbody - 1, 3), and rotation matrices, (nbody - 1, 3, 3)."""
    own = x[: closure.first_qpos].reshape(-1, 7)
    columns = [rotated(own[:, 3:], np.broadcast_to(axis, own[:, :3].shape)) for axis in np.eye(3)]
    return own[:, :3] / closure.length, np.stack(columns, -1)


def determined(closure, x):
    """Return which bodies nothing leaves open, (nbody - 1,)."""
    _, values, right = np.linalg.svd(closure.slope(x, 0.0))
    loose = right[int((values > ZERO_SINGULAR_VALUE * values[0]).sum()) :, : closure.first_qpos]
    return np.abs(loose).max(0, initial=0.0).reshape(-1, 7).max(-1) < MOVED


class FixedClosure(Closure):
    """A closure whose coordinates at some addresses of qpos have prescribed values."""

    def __init__(self, model, length, qpos, addresses):
        super().__init__(model, length, {})
        self.addresses, self.values = addresses, qpos[addresses]

    def residual(self, x, t):
        coordinates = x[..., self.first_qpos :]
        return np.concatenate([super().residual(x, t), coordinates[..., self.addresses] - self.values], -1)


def fixed_addresses(model, path):
    """Return the addresses in qpos of drivers and free joints."""
    free = model.jnt_qposadr[model.jnt_type == int(mujoco.mjtJoint.mjJNT_FREE)]
    return np.concatenate([path.addresses, (free[:, None] + np.arange(7)).ravel()]).astype(int)


def solved_apart(model, path, qpos, random):
    """Return the closure at the driver positions of qpos, from another start: itself and its unknowns."""
    closure = FixedClosure(model, path.loops.characteristic_length, qpos, fixed_addresses(model, path))
    start = closure.initial(qpos)
    x = closure.solve(start + OFF * random.normal(size=len(start)) * np.abs(start).max(), 0.0)
    return closure, x


def worst_apart(model, path, states, random):
    """Return the largest differences from the closure solved apart, and its own residual."""
    worst, remaining = np.nan, 0.0
    for qpos in states:
        closure, x = solved_apart(model, path, qpos, random)
        (position, rotation), (own, own_rotation) = (
            bodies_at(closure, x),
            bodies_at(closure, closure.initial(qpos)),
        )
        fixed = determined(closure, x)
        if fixed.any():
            worst = np.nanmax([worst, np.abs(position - own)[fixed].max()])
            worst = np.nanmax([worst, np.abs(rotation - own_rotation)[fixed].max()])
        remaining = max(remaining, float(np.abs(closure.residual(x, 0.0)).max()))
    return worst, remaining


def coordinates(model, path):
    """Return coordinates of one body that the drivers move well, and the drivers that they replace.

    Up to three drivers are replaced all, of more of them one.
    """
    count = len(path.drivers)
    if not count:
        return None
    jacobian = path.loops.linearise(path.reference[None])[1][0]
    rates = np.zeros((model.nv, count))
    rates[path.drivers] = np.diag(path.loops.units[path.drivers])
    rates[path.passive] = np.linalg.lstsq(jacobian[:, path.passive], -jacobian @ rates, rcond=None)[0]
    data = mujoco.MjData(model)
    data.qpos[:] = path.reference
    mujoco.mj_fwdPosition(model, data)
    best = (0.0, None)
    for body in range(1, model.nbody):
        point = np.zeros((3, model.nv))
        mujoco.mj_jacBody(model, data, point, None, body)
        for axes in combinations(range(3), min(count, 3) if count < 4 else 1):
            moved = point[list(axes)] @ rates
            replaced = list(range(count)) if count < 4 else [int(np.argmax(np.abs(moved[0])))]
            least = float(np.linalg.svd(moved[:, replaced])[1][-1])
            if model.body(body).name and least > best[0]:
                best = (least, (body, axes, replaced, data.xpos[body].copy()))
    return best[1] if best[0] > 0.05 * path.loops.characteristic_length else None


def swing(start, reach):
    """Return a motion law from a start by a reach and back."""
    w = 2.0 * np.pi
    return lambda t: (
        start + 0.5 * reach * (1.0 - np.cos(w * t)),
        0.5 * reach * w * np.sin(w * t),
        0.5 * reach * w**2 * np.cos(w * t),
    )


def inverse(file, model, path, names, random):
    """Return how far a body is from where it was prescribed, over the size; nan where none was."""
    chosen = coordinates(model, path) if np.abs(path.reference - model.qpos0).max() < 1e-6 else None
    if chosen is None:
        return np.nan
    body, axes, replaced, start = chosen
    times, length, reason = np.linspace(0.0, 1.0, 9), path.loops.characteristic_length, ""
    values = zip(names, path.reference[path.addresses], strict=True)
    still = {n: swing(value, 0.0) for i, (n, value) in enumerate(values) if i not in replaced}
    free = (model.jnt_type == int(mujoco.mjtJoint.mjJNT_FREE)).any()
    for reach in (0.02 * length, -0.02 * length):  # one way a limit may stop it
        laws = {axis: swing(start[axis], reach) for axis in axes}
        drive = {f"{model.body(body).name}.{'xyz'[axis]}": law for axis, law in laws.items()} | still
        try:
            motion = ms.load(file, drive=drive, fix_base=bool(free), duration=1.0).solve(t=times)
            drivers = np.stack([motion.joints[n].value for n in names], 1)
            states = ms.closed_qpos(model, dict(zip(names, drivers.T, strict=True)))
            break
        except (MechsimError, KeyError) as error:
            reason = str(error)
    else:
        print(f"      inverse: {reason[:150]}")
        return np.nan
    worst = 0.0
    for t, qpos in zip(times, states, strict=True):
        closure, x = solved_apart(model, path, qpos, random)
        position = closure.body(x, body)[0]
        worst = max(worst, *(abs(position[axis] - laws[axis](t)[0]) / length for axis in axes))
    return worst


def differences(model, names, start_values, steps, addresses):
    """Return derivatives of joints by drivers by differences extrapolated three times, (m, k)."""
    columns = []
    for i, step in enumerate(steps):
        table = []
        for h in step / 2.0 ** np.arange(4):
            values = np.repeat(start_values[None], 2, 0)
            values[:, i] += [h, -h]
            low_high = ms.closed_qpos(model, dict(zip(names, values.T, strict=True)))[:, addresses]
            table.append((low_high[0] - low_high[1]) / (2.0 * h))
        for order in range(1, 4):
            table = [(4**order * b - a) / (4**order - 1) for a, b in pairwise(table)]
        columns.append(table[0])
    return np.stack(columns, -1)


def worst_jacobian(model, path, names, states):
    """Return the largest difference of a map's Jacobians from differences, over their largest entry or 1."""
    scalar = np.isin(model.jnt_type, [2, 3])
    passive = [int(j) for j in np.unique(model.dof_jntid[path.passive]) if scalar[j]]
    if not passive or len(names) > 3:
        return np.nan
    outputs, addresses = [model.joint(j).name for j in passive], model.jnt_qposadr[passive]
    driven = states[:, path.addresses]
    middle = driven[0]
    steps = FIRST_STEP * path.loops.units[path.drivers]
    unlimited = compiled_copy_without_limits(model)
    ranges = {n: (float(v), float(v + s)) for n, v, s in zip(names, middle, steps, strict=True)}
    table = ms.joint_map(unlimited, ranges, outputs, points=2)
    worst = 0.0
    for start_values, jacobian in zip(table.input, table.jacobian, strict=True):
        expected = differences(unlimited, names, start_values, steps, addresses)
        worst = max(worst, float(np.abs(expected - jacobian).max() / max(1.0, np.abs(jacobian).max())))
    return worst


def compiled_copy_without_limits(model):
    """Return a model that stops nowhere: differences step across limits."""
    from copy import copy

    changed = copy(model)
    changed.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
    return changed


@quiet()
def compared(file):
    """Return the figures of one model."""
    model = compiled_model(file)
    path, random = straight_path(model, None), np.random.default_rng(1)
    names = [model.joint(int(model.dof_jntid[dof])).name for dof in path.drivers]
    states = ms.sample(model, STATES).qpos
    apart, remaining = worst_apart(model, path, states, random)
    prescribed = jacobian = np.nan
    if all(names):
        try:
            prescribed = inverse(file, model, path, names, random)
            jacobian = worst_jacobian(model, path, names, states)
        except MechsimError as error:
            print(f"      jacobian: {str(error)[:150]}")
    return apart, remaining, prescribed, jacobian


def main(folder, word):
    """Print the table and return whether all bounds hold."""
    rows = []
    print("   apart     remaining  inverse jacobian  model")
    for line in LISTED.read_text().splitlines():
        path = Path(folder) / line
        if line.startswith("#") or word not in line or not path.exists():
            continue
        try:
            result = compared(str(path))
        except (MechsimError, np.linalg.LinAlgError) as error:
            result = str(error)
        if isinstance(result, str):
            print(f"{'':10s}{line}: {result[:120]}", flush=True)
            continue
        rows.append(result)
        print(" ".join(f"{value:8.1e}" for value in result), "", line, flush=True)
    table = np.array(rows).reshape(-1, 4)
    # loops with rounded redundant constraints close only to rounding, by either method
    rounded = table[:, 1] > CLOSED
    differ = table[rounded, 0].max(initial=0.0)
    print(f"{rounded.sum()} models with rounded redundant constraints, apart by {differ:.1e}")
    table = table[~rounded]
    # nothing compared is no success
    apart, remaining, prescribed, jacobian = np.where(np.isnan(table), 0.0, table).max(0, initial=0.0)
    count = np.sum(~np.isnan(table), axis=0)
    print(f"{apart:8.1e} {remaining:8.1e} {prescribed:8.1e} {jacobian:8.1e}  worst of {count} models")
    enough = count[0] >= MODELS or bool(word)
    return enough and apart <= CLOSED and prescribed <= CLOSED and jacobian <= JACOBIAN


if __name__ == "__main__":
    sys.exit(0 if main(sys.argv[1], sys.argv[2] if len(sys.argv) > 2 else "") else 1)
