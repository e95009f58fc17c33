"""Trial runs: one crank motion under many settings, each against a reference, its time measured apart."""

import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mechsim import mjcf
from mechsim.catalog.base import Drive
from mechsim.errors import InputError
from mechsim.mechanism import Mechanism
from mechsim.mjcf import Loops
from mechsim.motion import Motion
from mechsim.scene import Scene
from mechsim.simulation import Profile, Settings, constant, pose
from mechsim.simulation.record import add_sensors, evaluate
from mechsim.simulation.run import Source, load
from mechsim.simulation.step import Steps, step
from mechsim.tradeoff.accuracy import half_extent, richardson, worst
from mechsim.validate import crank_profile

Array = NDArray[np.float64]
QUANTITIES = ("position", "velocity", "acceleration", "angle", "loop")
SAMPLES = 72
# steps a turn of the runs that make the reference of a model without a closed form
FINE = (3600, 7200, 14400)
# orders of convergence believed, and changes below which two runs are the same
ORDERS, TINY = (1.0, 4.0), 1e-300


@dataclass(frozen=True, slots=True)
class Reference:
    """What a trial is compared with.

    Attributes:
        what: in words.
        at: simulated motion -> the true one at the same instants.
        bar: its own error by quantity, in the units of the errors; rounding for a closed form.
    """

    what: str
    at: Callable[[Motion], Motion]
    bar: Mapping[str, float] = field(default_factory=dict)


class Rig:
    """A model with the crank motion it is put through.

    Attributes:
        profile: of the crank.
        model: compiled; copied for each trial.
    """

    def __init__(self, source: Source, profile: Profile | None, speed: float, scene: Scene | None = None):
        """Generate or load the model and close its loops; without a profile it makes one turn at a speed."""
        spec = load(source, scene)
        points = (
            tuple(source.points)
            if isinstance(source, Mechanism)
            else tuple(site.name for site in spec.sites if site.name and "@" not in site.name)
        )
        if not points:
            raise InputError("the model has no point to track; put a named site at each point of interest")
        self.track = add_sensors(spec, points)
        self.model = mjcf.compiled(spec)
        loops = Loops(self.model)
        self.profile = profile or constant(speed, 1.0, float(self.model.qpos0[loops.crank_place]))
        angles = self.profile.state(np.linspace(0.0, self.profile.duration, SAMPLES + 1))[0]
        qpos = pose.follow(loops, loops.close(self.model.qpos0[None])[0], angles)[:1]
        first = self.profile.state(np.zeros(1))[1]
        self.start = qpos[0], loops.tangent(loops.linearise(qpos)[1])[0] * first[0]

    def stepped(self, settings: Settings) -> tuple[Loops, Steps]:
        """Step through the crank motion once."""
        loops = Loops(copy.copy(self.model))
        samples = min(SAMPLES, settings.steps_per_turn)
        stride = max(1, settings.steps_per_turn // samples)
        total = max(1, round(self.profile.turns * samples)) * stride
        return loops, step(loops, settings, self.profile, self.start, total, stride)

    def motion(self, settings: Settings) -> tuple[Motion | None, float]:
        """Return the motion, None if it diverged, and the processor time of stepping in [s]."""
        loops, steps = self.stepped(settings)
        if steps.diverged:
            return None, steps.processor
        return evaluate(loops, self.track, steps.states, "step", force=steps.force), steps.processor


@dataclass(frozen=True, slots=True)
class Subject:
    """What the trade-off is measured on.

    Attributes:
        name: of the mechanism or file.
        mechanism: where the joints are known, so that others can be cut; else None.
        rig: with the loops cut as the generator chooses.
        reference: what the trials are compared with.
        stroke: half the largest extent of a point's path, in [m].
        speed: largest crank speed, in [rad/s].
    """

    name: str
    mechanism: Mechanism | None
    rig: Rig
    reference: Reference
    stroke: float
    speed: float

    def errors(self, motion: Motion | None) -> dict[str, float]:
        """Return worst errors by quantity.

        Position and loop residual are in units of the stroke, velocity and acceleration of stroke and
        crank speed, angle in [rad]; a motion that diverged has infinite ones.
        """
        if motion is None:
            return dict.fromkeys(QUANTITIES, np.inf)
        return differences(motion, self.reference.at(motion), self.stroke, self.speed)


def differences(motion: Motion, exact: Motion, stroke: float, speed: float) -> dict[str, float]:
    """Return the worst differences of two motions at the same instants, as in `Subject.errors`."""
    found = {
        kind: max(
            worst(np.linalg.norm(getattr(motion.points[name], kind) - getattr(point, kind), axis=1))
            for name, point in exact.points.items()
        )
        / (stroke * speed**power)
        for power, kind in enumerate(QUANTITIES[:3])
    }
    gaps = [
        motion.joints[name].value - joint.value
        for name, joint in exact.joints.items()
        if joint.unit == "rad" and name in motion.joints and name != "crank"
    ]
    turn = 2.0 * np.pi
    found["angle"] = max((worst(gap - turn * np.round(gap / turn)) for gap in gaps), default=0.0)
    found["loop"] = 0.0 if motion.closure is None else worst(motion.closure) / stroke
    return found


def subject_of(drive: Drive, speed: float) -> Subject:
    """Return a catalogue mechanism as a subject: its reference is the closed form."""
    profile = crank_profile(drive, speed)
    angles = profile.state(np.linspace(0.0, profile.duration, 361))[0]
    stroke = half_extent(drive.positions(angles).values())
    mechanism = drive.mechanism
    reference = Reference(
        "closed form", lambda motion: drive.solve(motion.angle, motion.speed, motion.acceleration)
    )
    return Subject(drive.name, mechanism, Rig(mechanism, profile, speed), reference, stroke, abs(speed))


def subject_of_model(source: Source, name: str, speed: float) -> Subject:
    """Return a model of one's own as a subject: its reference is a much finer run, with an error bar.

    Raises:
        AssemblyError: if the crank cannot make a whole turn.
    """
    rig = Rig(source, None, speed)
    runs = [motion for steps in FINE if (motion := rig.motion(Settings(steps_per_turn=steps))[0]) is not None]
    if len(runs) < len(FINE):
        raise InputError(f"{name} diverges at {FINE[-1]} steps a turn: no reference run can be made")
    fine = runs[-1]
    stroke = half_extent(point.position for point in fine.points.values())
    if not stroke > 0.0:
        raise InputError(f"no tracked point of {name} moves; put a named site on a moving body")

    def at(motion: Motion) -> Motion:
        return _every(fine, (len(fine) - 1) // (len(motion) - 1))

    changes = [differences(a, b, stroke, abs(speed)) for a, b in pairwise(runs)]
    bar = {
        kind: _bar(*(change[kind] for change in changes)) for kind in ("position", "velocity", "acceleration")
    }
    # how far its loops stand open says what no halving of the step can
    bar["position"] = max(bar["position"], differences(fine, fine, stroke, abs(speed))["loop"])
    reference = Reference(f"a run of {FINE[-1]} steps a turn", at, bar)
    return Subject(name, None, rig, reference, stroke, abs(speed))


def _bar(before: float, last: float) -> float:
    """Return the error left after the last halving of the step, from what the two halvings changed."""
    order = np.clip(np.log2(max(before, TINY) / max(last, TINY)), *ORDERS)
    return richardson(np.zeros(1), np.array([last]), 2.0, float(order))[1]


def _every(motion: Motion, stride: int) -> Motion:
    """Return every so many instants of a motion's points and joints."""

    def part(of: Any) -> Any:
        values = (getattr(of, field.name) for field in fields(of))
        return type(of)(*(one[::stride] if isinstance(one, np.ndarray) else one for one in values))

    return Motion(
        motion.source,
        motion.angle[::stride],
        motion.speed[::stride],
        motion.acceleration[::stride],
        {name: part(point) for name, point in motion.points.items()},
        joints={name: part(joint) for name, joint in motion.joints.items()},
    )
