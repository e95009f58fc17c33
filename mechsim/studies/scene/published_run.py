"""A user's MJCF file run in plain MuJoCo with the file's own settings, and how far its loops open."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import mujoco
import numpy as np

from mechsim.errors import MechsimError
from mechsim.model.finding import Finding
from mechsim.model.motion_laws import CrankProfile, State, steady
from mechsim.numerics.arrays import Array, worst
from mechsim.simulation.mjcf.compiling import plainly_compiled, quiet
from mechsim.studies.scene.run import SceneRun, stepped
from mechsim.studies.scene.scene import UserScene, scene_of
from mechsim.studies.scene.settings import settings_of
from mechsim.subjects.mjcf_source import MjcfForm

# the run is left out where it takes more steps; a minute for a scene of 20 bodies
MOST_STEPS = 2_000_000
# instants compared, about; all steps of a shorter run
RECORDS = 4000
CLOSING = (int(mujoco.mjtEq.mjEQ_CONNECT), int(mujoco.mjtEq.mjEQ_WELD))
EQUALITY = int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
SHOWN = ("integrator", "solver", "iterations", "tolerance", "solref")


@dataclass(frozen=True, slots=True, kw_only=True)
class PublishedRun:
    """What the file does with its own settings.

    Attributes:
        path: of the file.
        settings: time step in [s], integrator, solver, `solref` of the loops (None where they differ).
        driven: how the drivers were moved, in words.
        instants: crank angle in [rad] at each record, or time in [s] where motion laws drive, (n,).
        instants_unit: of them, "rad" or "s".
        gaps: largest distance between the two sides of a connect or weld then, (n,) in [m].
        errors: largest distance of a tracked point from the exact closure at the run's own drivers, (n,).
        note: why there is no run or no finite figure; empty otherwise.
        run: whether something was run.
    """

    path: str
    settings: Mapping[str, Any]
    driven: str = ""
    instants: Array = field(default_factory=lambda: np.zeros(0))
    instants_unit: Literal["rad", "s"] = "rad"
    gaps: Array = field(default_factory=lambda: np.zeros(0))
    errors: Array = field(default_factory=lambda: np.zeros(0))
    note: str = ""
    run: bool = True

    @property
    def gap(self) -> float:
        """The largest of the gaps, in [m]; infinite where the run diverged."""
        return self._worst(self.gaps)

    @property
    def error(self) -> float:
        """The largest of the errors, in [m]; infinite where the run diverged."""
        return self._worst(self.errors)

    def _worst(self, values: Array) -> float:
        if not len(values):
            return np.inf if self.run else np.nan
        return worst(values)

    @property
    def label(self) -> str:
        """The settings in a few words."""
        loops = self.settings.get("solref")
        softness = "" if loops is None else f", solref {' '.join(f'{value:g}' for value in loops)}"
        step = 1e3 * float(self.settings["timestep"])
        return f"timestep {step:g} ms, {self.settings['integrator']}, {self.settings['solver']}{softness}"

    def as_dict(self) -> dict[str, Any]:
        """Return the run as `mechsim validate --json` prints it."""
        return {
            "settings": dict(self.settings),
            "driven": self.driven,
            "loop_closure": self.gap,
            "error": self.error,
            "note": self.note,
        }

    def finding(self) -> Finding:
        """Return what the run comes to as a finding."""
        if not self.run:
            message = f"the file's own settings ({self.label}) are not judged: {self.note}"
            return Finding(kind="published", what=self.path, by=0.0, explains=0.0, message=message)
        if self.note:
            message, remedy = f"with the file's own settings ({self.label}) {self.note}", ""
        else:
            message = (
                f"with the file's own settings ({self.label}) loops open by up to {self.gap:.2g} m, and "
                f"points are up to {self.error:.2g} m from the exact closure"
            )
            remedy = "`mechsim tune` finds settings for a tolerance; --tolerance LENGTH makes this count"
        return Finding(
            kind="published", what=self.path, by=self.gap, explains=0.0, message=message, remedy=remedy
        )


def published_run(form: MjcfForm, profile: CrankProfile) -> PublishedRun:
    """Run a file with its own settings over the motion of its drivers.

    Args:
        form: read from the file.
        profile: motion of the crank; the motion laws of the drivers come first.
    """
    assert form.source is not None
    settings = _settings(plainly_compiled(form.source.spec.copy()))
    steps = _duration(form, profile) / float(settings["timestep"])
    if not steps <= MOST_STEPS:
        note = f"they take {steps:.3g} steps, more than {MOST_STEPS:,}; give a shorter --duration"
        return PublishedRun(path=form.source.path, settings=settings, note=note, run=False)
    try:
        scene, driven = published_scene(form, profile)
    except MechsimError as error:
        return PublishedRun(path=form.source.path, settings=settings, note=str(error), run=False)
    run = stepped(scene, records=RECORDS)
    known = PublishedRun(path=scene.path, settings=settings, driven=driven, note=run.broken)
    if run.broken:
        return known
    errors = scene.closure.errors(run.qpos, run.points).max(1, initial=0.0)
    if form.motion_laws is None:
        known = replace(known, instants=profile.state(run.time)[0])
    else:
        known = replace(known, instants=run.time, instants_unit="s")
    return replace(known, gaps=loop_gaps(run), errors=errors)


def published_scene(form: MjcfForm, profile: CrankProfile | None = None) -> tuple[UserScene, str]:
    """Return the scene of a file over the motion of its drivers, and how these are moved, in words.

    Position servos of the file are fed; drivers without one are moved by flywheels. The run starts where the
    file was read to start, as in a keyframe.

    Args:
        form: read from the file, with motion laws or a crank.
        profile: motion of the crank where there are no motion laws.

    Raises:
        MechsimError: where the scene cannot start.
    """
    assert form.source is not None
    if form.motion_laws is not None:
        laws: dict[str, State] = dict(form.motion_laws.by_name)
    else:
        assert profile is not None
        laws = {form.mechanism.crank.name: profile.state}
    drive, ctrl = _fed(form, laws)
    # joints that are locked stand still by a flywheel, too
    drive |= {name: steady(value, 0.0) for name, value in form.mechanism.locked.items()}
    scene = scene_of(
        form.source,
        form.mechanism,
        joint_laws=drive,
        ctrl=ctrl,
        duration=_duration(form, profile),
        points=form.mechanism.points,
        qpos=form.source.qpos,
    )
    return scene, f"{', '.join(ctrl)} fed" if ctrl else "its drivers carried by flywheels"


def loop_gaps(run: SceneRun) -> Array:
    """Return the largest distance between the two sides of a connect or weld at each record, (n,) in [m]."""
    model, widest = run.model, np.zeros(len(run.qpos))
    data = mujoco.MjData(model)
    with quiet():
        for i, qpos in enumerate(run.qpos):
            data.qpos[:] = qpos
            mujoco.mj_fwdPosition(model, data)
            rows = np.flatnonzero(data.efc_type == EQUALITY)
            loops = data.efc_id[rows]
            for loop in np.unique(loops):
                if int(model.eq_type[loop]) in CLOSING:
                    # of a weld the first three are the displacement
                    own = data.efc_pos[rows[loops == loop][:3]]
                    widest[i] = max(widest[i], float(np.linalg.norm(own)))
    return widest


def _duration(form: MjcfForm, profile: CrankProfile | None) -> float:
    if form.motion_laws is not None:
        return float(form.motion_laws.duration)
    assert profile is not None
    return float(profile.duration)


def _settings(model: mujoco.MjModel) -> dict[str, Any]:
    known = settings_of(model).as_dict()
    return {"timestep": known["timestep"]} | {name: known[name] for name in SHOWN if name in known}


def _fed(form: MjcfForm, laws: Mapping[str, State]) -> tuple[dict[str, State], dict[str, State]]:
    """Return programs of joints that no servo of the scene moves, and of the servos that move the others."""
    assert form.source is not None
    model = plainly_compiled(form.source.spec.copy())
    drive, ctrl = dict(laws), dict[str, State]()
    for actuator, joints in form.source.actuators.items():
        if len(joints) != 1 or joints[0] not in drive:
            continue
        gain = _servo(model, actuator)
        if gain is not None:
            ctrl[actuator] = _scaled(drive.pop(joints[0]), gain)
    return drive, ctrl


def _servo(model: mujoco.MjModel, actuator: str) -> float | None:
    """Return the control that a servo takes for a place of one, or None where it is no servo of a place."""
    try:
        i = model.actuator(actuator).id
    except KeyError:
        return None
    gain, bias = float(model.actuator_gainprm[i, 0]), model.actuator_biasprm[i]
    affine = int(model.actuator_biastype[i]) == int(mujoco.mjtBias.mjBIAS_AFFINE)
    if not (affine and gain and bias[1] < 0.0 and bias[0] == 0.0):
        return None
    return float(-bias[1] / gain * model.actuator_gear[i, 0])


def _scaled(state: State, by: float) -> State:
    def scaled(time: Array) -> tuple[Array, Array, Array]:
        value, rate, second = state(time)
        return by * value, by * rate, by * second

    return scaled
