"""What each thing in a scene costs: levels of a scene, equivalent reductions, things left on by mistake.

One turn at 600 rpm, 720 steps, RK4 with hard loops; the worst position error of any tracked point against
the closed solver, in units of the crank. Processor time of a step, the median of interleaved turns.
A step recorded is time, coordinates and rates.

What can be turned on or off in any scene is measured by the product (`mechsim tradeoff FILE.xml --costs`),
here of the exported models, their crank prescribed.

Run: python validation/choices/scene_costs.py [--out DIR]
"""

import tempfile
from dataclasses import asdict
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import study_table as sheet
from step_timing import Bare, Change

from mechsim import catalog
from mechsim.analytic.catalog.base import ClosedForm
from mechsim.model.scene import LEVELS, Scene
from mechsim.simulation import mjcf
from mechsim.simulation.mjcf_reader.parsed_file import parse_file
from mechsim.simulation.recording import add_sensors
from mechsim.simulation.source import assembled
from mechsim.studies.reduction.scene_costs import scene_costs
from mechsim.studies.scene.scene import scene_of
from mechsim.subjects.readers import load

STEPS, ROUNDS = 720, 41
OFF, ON = mujoco.mjtDisableBit, mujoco.mjtEnableBit
# the loops of `Settings()` are this much harder than MuJoCo's own
HARD = 1e-8


def sensors_on(model: mujoco.MjModel) -> None:
    model.opt.disableflags &= ~int(OFF.mjDSBL_SENSOR)


def energy_on(model: mujoco.MjModel) -> None:
    model.opt.enableflags |= int(ON.mjENBL_ENERGY)


def contacts_on(model: mujoco.MjModel) -> None:
    model.opt.disableflags &= ~int(OFF.mjDSBL_CONTACT)


def with_contacts(model: mujoco.MjModel) -> None:
    contacts_on(model)
    # the cost is no longer quadratic: MuJoCo's own number of iterations and tolerance
    model.opt.iterations, model.opt.tolerance = 100, 1e-8


def colliding(linkage: ClosedForm) -> mujoco.MjSpec:
    """Return a picture whose geoms were left as MuJoCo has them: they collide."""
    spec = spec_of(linkage, "picture")
    for geom in spec.geoms:
        geom.contype = geom.conaffinity = 1
    return spec


def hard_rod(model: mujoco.MjModel) -> None:
    # `ModelLoops` knows no equality of this kind: it is compiled inactive
    model.eq_active0[:] = 1
    model.tendon_invweight0[:] *= HARD


def quick_rod(model: mujoco.MjModel) -> None:
    hard_rod(model)
    model.eq_solref[:] = 2.0 * model.opt.timestep, 1.0


def spec_of(linkage: ClosedForm, level: str = "motion") -> mujoco.MjSpec:
    return assembled(linkage.mechanism, Scene(level=level))


def sensed(linkage: ClosedForm) -> mujoco.MjSpec:
    """Return a model with the sensors of a recorded motion."""
    spec = spec_of(linkage)
    add_sensors(spec, tuple(linkage.mechanism.points))
    return spec


def rod_only(linkage: ClosedForm, ends: tuple[str, str]) -> mujoco.MjSpec:
    """Return a model whose coupler is no body, only a length kept between two points of its neighbours."""
    spec = spec_of(linkage)
    for equality in list(spec.equalities):
        spec.delete(equality)
    spec.delete(spec.body("coupler"))
    tendon = spec.add_tendon(name="rod")
    for site in ends:
        tendon.wrap_site(site)
    kind, kind_of_ends = mujoco.mjtEq.mjEQ_TENDON, mujoco.mjtObj.mjOBJ_TENDON
    spec.add_equality(name="rod", type=kind, objtype=kind_of_ends, name1="rod", active=False)
    return spec


def doubly_closed(linkage: ClosedForm) -> mujoco.MjSpec:
    """Return a planar model closed as in space: by a second point along the axis of the cut joint."""
    spec = spec_of(linkage)
    names = []
    for site in list(spec.sites):
        if "@" in site.name:
            position = np.add(site.pos, (0.0, 0.0, linkage.mechanism.characteristic_length))
            names.append(site.parent.add_site(name=f"{site.name}+", pos=position).name)
    kind, kind_of_ends = mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtObj.mjOBJ_SITE
    spec.add_equality(name="second", type=kind, objtype=kind_of_ends, name1=names[0], name2=names[1])
    return spec


def cases(linkage: ClosedForm, ends: tuple[str, str]) -> dict[str, tuple[mujoco.MjSpec, Change | None]]:
    """Return what is compared on a mechanism: name -> specification and a change after the settings."""
    result: dict[str, tuple[mujoco.MjSpec, Change | None]] = {
        f"level {level}": (spec_of(linkage, level), None) for level in LEVELS
    }
    result["motion, sensors on"] = sensed(linkage), sensors_on
    result["motion, energy on"] = spec_of(linkage), energy_on
    result["picture, contacts left on"] = spec_of(linkage, "picture"), contacts_on
    result["picture, geoms collide"] = colliding(linkage), with_contacts
    result["rod as a length"] = rod_only(linkage, ends), hard_rod
    result["rod as a length, 2 steps"] = rod_only(linkage, ends), quick_rod
    if linkage.name == "four_bar":
        result["closed as in space"] = doubly_closed(linkage), None
    for name, variant in linkage.variants().items():
        result[f"variant {name}"] = spec_of(variant), None
    return result


def measured(linkage: ClosedForm, ends: tuple[str, str]) -> list[dict[str, Any]]:
    """Return a row for each case of a mechanism, timed in turn."""
    whole = mjcf.compiled(spec_of(linkage))
    bare: dict[str, Bare] = {}
    for name, (spec, change) in cases(linkage, ends).items():
        like = whole if name.startswith("rod") else None
        bare[name] = Bare(mjcf.compiled(spec), STEPS, change or (lambda _: None), like)
    for _ in range(ROUNDS):
        for item in bare.values():
            item.time_revolution()
    return [_row(linkage, name, item, bare["level motion"].microseconds) for name, item in bare.items()]


def _row(linkage: ClosedForm, name: str, bare: Bare, usual: float) -> dict[str, Any]:
    model = bare.loops.model
    exact = linkage.positions(bare.qpos[:, bare.loops.crank_address])
    return {
        "mechanism": linkage.name,
        "scene": name,
        "freedoms": int(model.nv),
        "rows": bare.rows(),
        "us/step": f"{bare.microseconds:.1f}",
        "of motion": f"{bare.microseconds / usual:.2f}",
        "bytes/step": 8 * (1 + int(model.nq) + int(model.nv)),
        "error": bare.site_error(exact) / linkage.crank,
    }


def turned_on_and_off(name: str, folder: str) -> list[dict[str, Any]]:
    """Return what each thing that can be turned on or off costs in an exported model."""
    path = Path(folder) / f"{name}.xml"
    path.write_text(mjcf.to_xml(assembled(catalog.make(name).mechanism, Scene(level="motion"))))
    solver = load(str(path), drive={"crank": "600rpm"})
    scene = scene_of(
        solver.source,
        solver.mechanism,
        joint_laws=dict(solver.motion_laws.by_name),
        duration=0.1,
        points=solver.mechanism.points,
    )
    return [{"mechanism": name} | asdict(item) for item in scene_costs(scene, parse_file(str(path))[0])]


def plot(rows: list[dict[str, Any]], out: Path) -> None:
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(10, 4.5), layout="constrained")
    for axis, name in zip(axes, dict.fromkeys(row["mechanism"] for row in rows), strict=True):
        mine = [row for row in rows if row["mechanism"] == name][::-1]
        axis.barh([row["scene"] for row in mine], [float(row["us/step"]) for row in mine], color="#0072b2")
        axis.set(xlabel="processor time of a step [us]", title=name)
    figure.savefig(out / "scene_costs.png", dpi=110)


@mjcf.quiet()
def main() -> None:
    out = sheet.folder(__doc__ or "")
    rows = measured(catalog.make("rssr"), ("P2", "P3")) + measured(catalog.make("four_bar"), ("A", "B"))
    sheet.show(rows, out, "scene_costs")
    with tempfile.TemporaryDirectory() as folder:
        rows_too = [row for name in ("rssr", "four_bar") for row in turned_on_and_off(name, folder)]
    sheet.show(rows_too, out, "scene_costs_turned")
    if out is not None:
        plot(rows, out)


if __name__ == "__main__":
    main()
