"""What `tradeoff FILE.xml --costs` prints: what each thing in a user's scene costs."""

from mechsim.cli.output import print_json, print_table, progress
from mechsim.cli.scene_options import SceneOptions, user_scene
from mechsim.studies.scenes import spec_of
from mechsim.studies.tradeoff.scene_costs import SceneCost, scene_costs


def print_costs(model: str, asked: SceneOptions, *, as_json: bool) -> None:
    """Measure and print what each thing in a scene costs."""
    scene = user_scene(model, asked)
    with progress("costs", None) as tick:
        found = scene_costs(scene, spec_of(scene), progress=lambda part: tick("timing", part))
    if as_json:
        print_json({"scene": model, "timestep": float(scene.model.opt.timestep), "costs": _rows(found)})
        return
    rows = [
        (
            one.what,
            str(one.freedoms),
            str(one.rows),
            f"{one.step:.3g}",
            f"{one.ratio:.3g}",
            f"{one.error:.1e}" if one.error < float("inf") else "diverges",
        )
        for one in found
    ]
    head = ("scene", "freedoms", "rows", "us/step", "of the scene", "error [m]")
    print_table(f"{model}: what each thing costs", head, rows)


def _rows(found: list[SceneCost]) -> list[dict[str, object]]:
    return [
        {
            "what": one.what,
            "freedoms": one.freedoms,
            "rows": one.rows,
            "us_per_step": one.step,
            "time_ratio": one.ratio,
            "error": one.error,
        }
        for one in found
    ]
