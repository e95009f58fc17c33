"""Public closed-loop MJCF files, solved by the loop equations and compared with MuJoCo's own constraints.

Problem: each file of `public_mjcf.toml` next to this script moves for a second over one swing of its drivers.
References, both to 1e-9 of the size. MuJoCo: our poses are put into its qpos, and it says how far its
equality constraints stand open there (`efc_pos`, "worst"); it takes no step and solves nothing. A closure
solved separately (`mjcf_closure_oracle.py`): how far positions ("apart", over the size) and axes ("turned")
of the determined bodies differ from it, and its own loop-closure error ("left"). A file whose rounded
dimensions let its loops close in no pose has a loop-closure error of as much as they had to be moved.

    python validation/robustness/public_mjcf.py FOLDER

FOLDER holds clones of the repositories named in the list; a file that is not there is skipped. None of
them lies in this repository.
"""

import sys
import tomllib
from pathlib import Path

import mujoco
import numpy as np
from mjcf_closure_oracle import worst_difference

from mechsim.analytic.loops.start import assembled
from mechsim.errors import MechsimError
from mechsim.model.motion_laws import make_motion_laws
from mechsim.simulation.mjcf.compiling import quiet
from mechsim.simulation.mjcf_reader import states_of
from mechsim.subjects.mjcf_source import MjcfForm, read_mjcf

# a file whose digits contradict each other stands open somewhere: by a few times what was moved of it
SAMPLES, BOUND, TIMES = 101, 1e-9, 10.0
# every so manieth pose is compared with the closure solved apart
THIN = 5


def swing(start, reach):
    """Return the program of one swing from a start by a reach and back, in a second."""
    w = 2.0 * np.pi
    return lambda t: (
        start + 0.5 * reach * (1.0 - np.cos(w * t)),
        0.5 * reach * w * np.sin(w * t),
        0.5 * reach * w**2 * np.cos(w * t),
    )


def reaches(form: MjcfForm, asked):
    """Return by how much each driver swings: 0.3 rad or a tenth of the size, to where limits leave room."""
    mechanism, result = form.mechanism, {}
    for name in mechanism.drivers:
        far = 0.3 if mechanism.unit(name) == "rad" else 0.1 * mechanism.characteristic_length
        low, high = form.source.limits.get(name, (-np.inf, np.inf))
        at = mechanism.guess_coordinates[name]
        up, down = high - at, at - low
        result[name] = asked.get(name, min(far, up) if up >= min(far, down) else -min(far, down))
    return result


@quiet()
def worst_opening(form: MjcfForm, motion):
    """Return how far MuJoCo's equality constraints stand open at our poses, the worst of all."""
    model = form.source.spec.copy().compile()
    data, worst = mujoco.MjData(model), 0.0
    for row in states_of(model, motion):
        data.qpos[:] = row
        mujoco.mj_fwdPosition(model, data)
        rows = data.efc_pos[data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)]
        worst = max(worst, float(np.abs(rows).max(initial=0.0)))
    return worst


@quiet()
def apart(form: MjcfForm, motion):
    """Return how far our links are from a closure solved apart: over the size, in rad, and its residual."""
    model = form.source.spec.copy().compile()
    instants = np.linspace(0.0, form.motion_laws.duration, SAMPLES)[::THIN]
    state = {
        name: (lambda t, s=s: float(s(np.array([t]))[0][0])) for name, s in form.motion_laws.by_name.items()
    }
    held = {name: (lambda t, v=v: v) for name, v in form.mechanism.locked.items()}
    links = {name: (link.position[::THIN], link.rotation[::THIN]) for name, link in motion.links.items()}
    return worst_difference(
        model, form.mechanism.characteristic_length, form.source.qpos, state | held, instants, links
    )


def judged(path, options):
    """Return the row of one file."""
    known = ("drivers", "fix_base", "key", "track")
    holds = dict.fromkeys(options.get("holds", ()))
    form = read_mjcf(str(path), lock=holds, **{name: options[name] for name in known if name in options})
    loops, at = assembled(form.mechanism)
    gradient = loops.linearise(at)[1][..., 0]
    rank = int(np.linalg.matrix_rank(gradient, tol=1e-9)) if gradient.size else 0
    start = {name: float(at.values[loops.tree.index_of[name], 0]) for name in form.mechanism.drivers}
    far = reaches(form, options.get("reach", {}))
    bound = make_motion_laws(form.mechanism, {name: swing(start[name], far[name]) for name in start}, 1.0)
    moved = MjcfForm(form.mechanism, motion_laws=bound, source=form.source)
    motion = moved.solve(t=np.linspace(0.0, bound.duration, SAMPLES))
    worst, size = worst_opening(form, motion), form.mechanism.characteristic_length
    far, turned, left = apart(moved, motion)
    moved, bent = form.corrected
    line = (
        f"{loops.tree.count - rank:8d} {len(start):7d} {loops.rows:4d} {rank:4d} {form.source.gap:8.1e} "
        f"{moved:8.1e} {worst:8.1e} {far:8.1e} {turned:8.1e} {left:8.1e} {size:7.3f}"
    )
    # what is left of the closure apart says by how much the file contradicts itself
    given = TIMES * (moved / size + bent + left)
    return line, worst <= size * (BOUND + given) and max(far, turned) <= BOUND + given


def main(folder):
    """Print the table and return whether all files met the bound."""
    listed = tomllib.loads(Path(__file__).with_suffix(".toml").read_text())["model"]
    print(
        f"{'model':30s} freedoms drivers rows rank      gap    moved    worst "
        "   apart   turned     left   size [m]"
    )
    good = True
    for options in listed:
        path = Path(folder) / options["file"]
        if not path.exists():
            print(f"{options['name']:30s} not there: {path}")
            continue
        try:
            line, met = judged(path, options)
        except MechsimError as error:
            line, met = str(error), False
        good &= met
        print(f"{options['name']:30s} {line}{'' if met else '  MISSED'}", flush=True)
    return good


if __name__ == "__main__":
    sys.exit(0 if main(sys.argv[1]) else 1)
