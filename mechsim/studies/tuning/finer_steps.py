"""A scene run with the file's own step, and with smaller ones and harder loops until a tolerance is kept."""

from dataclasses import replace

from mechsim.model.limits import MAX_SCENE_STEPS
from mechsim.studies.scenes import SceneErrors, SceneRun, UserScene, errors_of, stepped
from mechsim.studies.scenes.plain_settings import PlainSettings
from mechsim.studies.scenes.scene_limit import HARDEST
from mechsim.studies.scenes.scene_run import RECORDS

# steps tried after the file's own, in its steps, and time constant of the loops in steps
RATIOS = (1.0, 0.5, 0.25, 0.1, 0.04, 0.016, 0.006, 0.0025, 0.001)
# which takes springs and servos implicitly, for what another integrator does not bear
IMPLICIT = "discrete"
CONSTANT = 2.0


def finer(
    scene: UserScene,
    settings: PlainSettings,
    tolerance: float,
    *,
    fixed: bool = False,
    records: int | None = None,
) -> tuple[SceneRun, SceneErrors, PlainSettings]:
    """Return a run that keeps a tolerance by closure, or the best there is, with its errors and settings.

    A run that diverges is no reason to stop: it is made again with an integrator that takes stiffness
    implicitly, unless one was asked for, and finer ones follow.

    Args:
        scene: the scene.
        settings: that were asked for; the first run has these and nothing else.
        tolerance: in [m].
        fixed: whether no other settings are tried.
        records: instants recorded after the first.
    """
    found: list[tuple[SceneRun, SceneErrors, PlainSettings]] = []
    own = settings.timestep or float(scene.model.opt.timestep)
    tried = [settings]
    if not fixed:
        ratios = [ratio for ratio in RATIOS if scene.duration / (ratio * own) <= MAX_SCENE_STEPS]
        tried += [_harder(settings, ratio * own) for ratio in ratios]
    for one in tried:
        found.append(_run(scene, one, records))
        if found[-1][0].broken and not fixed and settings.integrator is None:
            found.append(_run(scene, replace(one, integrator=IMPLICIT), records))
        if found[-1][1].closure <= tolerance:
            break
    return min(found, key=lambda each: each[1].closure)


def _run(
    scene: UserScene, settings: PlainSettings, records: int | None
) -> tuple[SceneRun, SceneErrors, PlainSettings]:
    run = stepped(scene, settings.applied(scene.model), records=records or RECORDS)
    return run, errors_of(run), settings


def _harder(settings: PlainSettings, step: float) -> PlainSettings:
    """Return the same settings with a step and loops as hard as it bears."""
    return replace(
        settings,
        timestep=step,
        solver=settings.solver or "Newton",
        solref=settings.solref or (CONSTANT * step, 1.0),
        solimp=settings.solimp or HARDEST,
    )
