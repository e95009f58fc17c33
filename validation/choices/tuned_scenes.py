"""`mechsim tune` on twenty scenes and more: does a run from outside keep the tolerance, and for how long?

Problem: models of the catalogue and the gallery as `mechsim export` writes them, and public closed-loop
files, each tuned for 1e-5 of its size by closure over a second of its own motion.
Reference: the file that was written and the lines of Python that run it, stepped by `mj_step` in a loop,
over a motion half as long again; each of its states against the loop equations. For the time: the best of
an exhaustive grid (integrator, step, time constant, impedance, solver) that keeps it, timed side by side.

    python validation/choices/tuned_scenes.py [FOLDER] [--only NAME,...] [--exhaustive]

FOLDER holds clones of the repositories named below; a file that is not there is skipped. Exits with 1 where a
tolerance is not kept, or the time is more than 1.5 times the best.
"""

import argparse
import importlib.util
import itertools
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from mechsim.cli.scene_options import SceneOptions, expressions, user_scene
from mechsim.errors import MechsimError
from mechsim.model.scene import Scene
from mechsim.pictures.render.exported_scene import exported
from mechsim.simulation import mjcf
from mechsim.simulation.mjcf.silence import quiet
from mechsim.studies.scenes import errors_of, step_times, stepped
from mechsim.studies.scenes.plain_settings import PlainSettings
from mechsim.studies.scenes.scene_limit import HARDEST
from mechsim.studies.tuning.run_lines import python_of
from mechsim.studies.tuning.search import tuned
from mechsim.studies.tuning.step_ladder import quickest, steps_of
from mechsim.studies.tuning.tuned_file import tuned_text, written
from mechsim.subjects.subject import load

CRANKS = (
    *("four_bar", "slider_crank", "rssr", "rrsrr", "looper", "bennett", "jansen", "klann", "hoeken"),
    *("quick_return", "watt_six_bar", "stephenson_six_bar", "spherical_four_bar", "rsur"),
    "chebyshev_lambda",
)
SEVERAL = ("five_bar", "planar_3rrr", "humanoid_ankle")
PUBLIC = {
    "2F-85": ("robotiq_2f85.xml", {"ctrl": (("fingers_actuator", "255*(0.5-0.5*cos(2*pi*t))"),)}, 1e-5),
    "G1 ankle": (
        "g1_ankle.xml",
        {
            "ctrl": (
                ("left_motor_joint", "0.3*sin(2*pi*0.6*t)"),
                ("right_motor_joint", "-0.15*sin(2*pi*0.6*t)"),
            )
        },
        1e-5,
    ),
    "Tiangong ankle": ("feidedao_Parallel_Ankle_Joint/5_tiangong/urdf/TG10-00.xml", None, None),
    "planar-2dof": ("Rhoban_onshape-to-robot-examples/planar-2dof/robot.xml", None, None),
    "delta robot": ("jurmy24_delta-simulation/simulation/delta-robot/robot.xml", None, None),
    "xArm gripper": ("Kcygt_mujoco_menagerie/ufactory_xarm7/hand.xml", None, None),
}
INTEGRATORS = ("Euler", "implicitfast", "discrete", "RK4")
# tolerance in parts of the size; how much longer the run from outside is; the most that is paid over the best
TOLERANCE, LONGER, DEARER = 1e-5, 1.5, 1.5


def swing(name, start, reach):
    """Return a program that swings a joint from its start by a reach and back."""
    return name, f"{start!r} + {0.5 * reach!r}*(1-cos(2*pi*t))"


def options_of(path, mechanism):
    """Return what moves a file: a turn of the crank, or a swing of every driver."""
    if mechanism.drivers == ("crank",):
        return SceneOptions(drive=(("crank", "60rpm"),))
    form = load(str(path), drive=dict.fromkeys(mechanism.drivers, "0.1*t"))
    counted, limits = form.mechanism.counted, form.source.limits
    drive = []
    for name in form.mechanism.drivers:
        # three drivers at once would pass a singular pose
        reach = (
            0.3 / len(form.mechanism.drivers)
            if form.mechanism.unit(name) == "rad"
            else 0.1 * form.mechanism.size
        )
        low, high = limits.get(name, (-np.inf, np.inf))
        reach = reach if counted[name] + reach <= high else -min(reach, counted[name] - low)
        drive.append(swing(name, counted[name], reach))
    return SceneOptions(drive=tuple(drive))


def scenes(folder, work):
    """Yield name, scene and tolerance."""
    for name in (*CRANKS, *SEVERAL):
        mechanism, path = load(name).mechanism, work / f"{name}.xml"
        path.write_text(mjcf.to_xml(exported(mechanism, Scene())))
        yield name, path, options_of(path, mechanism), None
    for name, (file, asked, tolerance) in PUBLIC.items():
        path = folder / file if folder else None
        if path is None or not path.is_file():
            print(f"{name}: {file} is not there: skipped")
            continue
        options = SceneOptions(**asked) if asked else options_of(path, load(str(path)).mechanism)
        yield name, path, options, tolerance


def from_outside(scene, script, duration):
    """Return the worst closure error of what a script's steps leave, at every step."""
    spec = importlib.util.spec_from_file_location("tuned_run", script)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    states = np.array([data.qpos.copy() for data in module.steps(duration)])
    places = replace(stepped(scene, records=2), qpos=states).points
    return float(scene.closure.errors(states, places).max(initial=0.0))


def exhaustive(scene, tolerance):
    """Return the quickest settings on a grid that keep a tolerance, by one run each."""
    found, safe = [], 0.5 * quickest(scene.model)
    constants, solvers = (1.5, 2.0, 4.0, 10.0, None), (None, "Newton")
    grid = [*itertools.product(INTEGRATORS, constants, (HARDEST, None), solvers)]
    for step in steps_of(scene)[::2]:
        if len(found) > 40:
            break
        for integrator, constant, impedance, solver in grid:
            if constant == 1.5 and step > safe:
                continue
            settings = PlainSettings(
                timestep=step,
                integrator=integrator,
                solver=solver,
                solref=None if constant is None else (constant * step, 1.0),
                solimp=impedance,
                refsafe=False if constant == 1.5 else None,
                island=False,
                tolerance=None if scene.model.opt.tolerance > 0.0 else scene.usual_tolerance,
            )
            run = stepped(scene, settings.applied(scene.model))
            if errors_of(run).closure <= tolerance:
                found.append((run.seconds_per_second, settings))
    return [settings for _, settings in sorted(found, key=lambda one: one[0])[:6]]


def judged(name, path, asked, tolerance, work, against_all):
    """Tune one scene, run what was written from outside, and return whether all was kept."""
    scene = user_scene(str(path), asked)
    tolerance = tolerance or float(f"{TOLERANCE * scene.size:.2g}")
    found = tuned(scene, tolerance)
    best = found.chosen or found.beyond
    if best is None:
        print(f"{name:20} {tolerance:8.2g}  nothing keeps it; closest {found.closest.errors.closure:.2g}")
        return False, None
    file, script = work / f"{name}-tuned.xml".replace(" ", "-"), work / f"{name}-run.py".replace(" ", "-")
    in_file = replace(best.settings, hardness=None)
    outside = written(scene, in_file, tuned_text(scene, in_file, [], work).after, file)
    stands = replace(outside, model=best.settings.applied(outside.model))
    changed = {} if best.settings.in_file else {"hardness": best.settings.hardness}
    script.write_text(python_of(stands, file, expressions(scene), changed=changed))
    error = from_outside(scene, script, LONGER * scene.duration)
    ratio = np.nan
    if against_all:
        grid = exhaustive(scene, tolerance)
        models = [(scene, one.applied(scene.model)) for one in (best.settings, *grid)]
        own, *others = step_times(models)
        ratio = own / min(others, default=np.inf)
    kept = error <= tolerance
    before = found.published
    said = "" if best.settings.in_file else "by Python"
    print(
        f"{name:20} {tolerance:8.2g} {before.errors.closure:9.2g} {1e3 * before.seconds:8.3g} {error:9.2g} "
        f"{1e3 * best.seconds:8.3g} {ratio:6.2f} {found.seconds:6.1f} {len(found.tried):5} "
        f"{said if kept else 'NOT KEPT'}",
        flush=True,
    )
    return kept, ratio


@quiet()
def main():
    """Tune every scene and count."""
    asked = argparse.ArgumentParser()
    asked.add_argument("folder", nargs="?", type=Path)
    asked.add_argument("--only", default="")
    asked.add_argument("--exhaustive", action="store_true")
    told = asked.parse_args()
    only = {one for one in told.only.split(",") if one}
    head = ("T in m", "published", "ms/s", "outside", "ms/s", "/best", "s", "tried")
    print("scene".ljust(20), *(one.rjust(w) for one, w in zip(head, (8, 9, 8, 9, 8, 6, 6, 5), strict=True)))
    kept, ratios = [], []
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        for name, path, options, tolerance in scenes(told.folder, work):
            if only and name not in only:
                continue
            try:
                fine, ratio = judged(name, path, options, tolerance, work, told.exhaustive)
            except MechsimError as error:
                print(f"{name:20} {error}")
                fine, ratio = False, None
            kept.append(fine)
            ratios += [ratio] if ratio is not None and np.isfinite(ratio) else []
    print(f"kept: {sum(kept)} of {len(kept)}")
    if ratios:
        print(f"time over the best of the grid: median {np.median(ratios):.2f}, worst {max(ratios):.2f}")
    return int(not all(kept) or max(ratios, default=0.0) > DEARER)


if __name__ == "__main__":
    sys.exit(main())
