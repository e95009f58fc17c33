"""Stepping methods that `mechsim tradeoff` compares, each a curve over the number of steps.

A method keeps everything but the step: integrator, time constant of the loops (in steps, or as a fraction of
a revolution), compliance, impedance, refsafe, diagexact, and the model: its cuts, level, drive, reductions.
"""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any, Literal

from mechsim.errors import InputError
from mechsim.model.mechanism import Mechanism
from mechsim.model.scene import LEVELS, Level, Scene
from mechsim.simulation.mjcf.alternatives import add_servo, gear_to_motor, rod_as_length, rod_of
from mechsim.simulation.mjcf.loop_cuts import cut_loops
from mechsim.simulation.settings import INTEGRATORS, LEAST_CONSTANT, Settings
from mechsim.simulation.source import Model, load

CrankDrive = Literal["drive_inertia", "geared", "servo"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Build:
    """How a model is made.

    Attributes:
        cut: joints at which the loops are cut; None lets the generator choose.
        level: of the scene.
        crank_drive: virtual drive inertia on the crank; the same on a motor that an equality gears to the
            crank; or a velocity servo.
        gain: of the servo, in units of the inertia felt at the crank over the time step.
        rod: link made a constant length between two joints; None leaves all links bodies.
        variant: of the mechanism, with the same motion of its tracked points; None is the mechanism itself.
    """

    cut: tuple[str, ...] | None = None
    level: Level = "motion"
    crank_drive: CrankDrive = "drive_inertia"
    gain: float = 1.0
    rod: str | None = None
    variant: str | None = None

    def as_dict(self) -> dict[str, str]:
        """Return the columns of the CSV that describe the model."""
        reduction = f"{self.rod} as a length" if self.rod else self.variant or ""
        return {
            "cut": "+".join(self.cut or ()),
            "level": self.level,
            "drive": self.crank_drive,
            "reduction": reduction,
        }

    def made(self, source: Model, variants: Mapping[str, Mechanism]) -> Any:
        """Return MuJoCo's specification of a mechanism or of a custom model."""
        if self.variant is not None:
            source = variants[self.variant]
        spec = load(source, Scene(level=self.level, cut=self.cut))
        if self.rod is not None:
            assert isinstance(source, Mechanism)
            rod_as_length(spec, source, self.rod)
        if self.crank_drive == "geared":
            gear_to_motor(spec)
        elif self.crank_drive == "servo":
            add_servo(spec)
        return spec


# each divides into, or is a multiple of, 72 instants a turn
STEPS = (24, 36, 72, 144, 288, 720, 1440, 2880, 7200)
MUJOCO_SOLREF, MUJOCO_SOLIMP = (0.02, 1.0), (0.9, 0.95, 0.001, 0.5, 2.0)
DEFAULTS = "MuJoCo's defaults"
HARD = "RK4, turn/10, 1e-08"
# MuJoCo's own compliance scale
PLAIN = Settings(compliance=1.0)
BUILD = Build()


@dataclass(frozen=True, slots=True, kw_only=True)
class SteppingMethod:
    """Settings that differ only in the number of steps.

    Attributes:
        name: for tables and plots.
        base: the settings, but for the number of steps.
        rank: methods of low rank are tried first.
        turn_fraction: time constant of the loops as a fraction of a revolution; None leaves it to `base`.
        direct: whether stiffness and damping are 1/step squared and 1/step.
        build: of the model.
    """

    name: str
    base: Settings
    rank: int
    turn_fraction: float | None = None
    direct: bool = False
    build: Build = BUILD

    def settings(self, steps: int, speed: float) -> Settings:
        """Return the settings for a number of steps per revolution at a crank speed in [rad/s]."""
        settings = replace(self.base, steps_per_turn=steps)
        if self.turn_fraction is not None:
            return replace(settings, constant_steps=max(LEAST_CONSTANT, self.turn_fraction * steps))
        if self.direct:
            rate = 1.0 / settings.timestep(speed)
            return replace(settings, solref=(-(rate**2), -rate))
        return settings


def stepping_methods(
    mechanism: Mechanism | None = None, variants: Iterable[str] = ()
) -> list[SteppingMethod]:
    """Return all methods; those with other models only for a mechanism.

    Args:
        mechanism: the mechanism; None for a custom model.
        variants: names of its variants with the same motion.
    """
    defaults = replace(PLAIN, integrator="Euler", solref=MUJOCO_SOLREF, solimp=MUJOCO_SOLIMP, refsafe=True)
    hard = SteppingMethod(name=HARD, base=Settings(), rank=0, turn_fraction=0.1)
    methods = [SteppingMethod(name=DEFAULTS, base=defaults, rank=0), hard]
    for integrator in INTEGRATORS:
        methods += _of_integrator(integrator)
    builds = {"geared crank": Build(crank_drive="geared"), "servo": Build(crank_drive="servo", gain=0.5)}
    if mechanism is not None:
        builds |= _other_builds(mechanism, variants)
    named = [replace(hard, name=f"{HARD}, {name}", rank=3, build=build) for name, build in builds.items()]
    methods += [*named[:2], *_implicit_servos(), *named[2:]]
    rod = None if mechanism is None else rod_of(mechanism)
    if rod is not None:
        # MuJoCo leaves out a tendon's second rate, so that only a stiff constraint keeps its length
        name = f"RK4, 2 steps, 1e-08, {rod} as a length"
        stiff = replace(Settings(), constant_steps=2.0)
        methods.append(SteppingMethod(name=name, base=stiff, rank=3, build=Build(rod=rod)))
    return methods


def _implicit_servos() -> Iterator[SteppingMethod]:
    """Yield methods with servo gains that only an implicit integrator bears (validation/choices/drive.py)."""
    soft = replace(PLAIN, constant_steps=2.0)
    for integrator, gain in (("implicitfast", 1e4), ("discrete", 10.0)):
        base, build = replace(soft, integrator=integrator), Build(crank_drive="servo", gain=gain)
        yield SteppingMethod(name=f"{integrator}, 2 steps, servo", base=base, rank=3, build=build)


def _other_builds(mechanism: Mechanism, variants: Iterable[str]) -> dict[str, Build]:
    """Return models with other cuts, with more elements, or reduced, by name."""
    own = {joint.name for joint in cut_loops(mechanism).cuts}
    builds = {f"cut {'+'.join(cut)}": Build(cut=cut) for cut in possible_cuts(mechanism) if set(cut) != own}
    builds |= {f"level {level}": Build(level=level) for level in LEVELS if level != BUILD.level}
    builds |= {variant: Build(variant=variant) for variant in variants}
    rod = rod_of(mechanism)
    return builds if rod is None else builds | {f"{rod} as a length": Build(rod=rod)}


def _of_integrator(integrator: str) -> Iterator[SteppingMethod]:
    plain = replace(PLAIN, integrator=integrator)
    two, seven = replace(plain, constant_steps=2.0), replace(plain, constant_steps=7.0)

    def method(
        rank: int, suffix: str, base: Settings, turn_fraction: float | None = None, direct: bool = False
    ) -> SteppingMethod:
        name = f"{integrator}, {suffix}"
        return SteppingMethod(name=name, base=base, rank=rank, turn_fraction=turn_fraction, direct=direct)

    yield method(1, "2 steps", two)
    yield method(1, "7 steps", seven)
    yield method(1, "20 steps, 1e-04", replace(plain, constant_steps=20.0, compliance=1e-4))
    if integrator == "RK4":
        yield method(2, "turn/5, 1e-08", Settings(), 0.2)
        yield method(2, "turn/20, 1e-08", Settings(), 0.05)
    else:
        yield method(1, "direct", plain, direct=True)
        yield method(1, "turn/10, 1e-08", replace(plain, compliance=1e-8), 0.1)
    if integrator == "discrete":
        yield method(2, "1e-3 steps", replace(plain, constant_steps=1e-3))
    yield method(2, "turn/10, 1e-04", replace(plain, compliance=1e-4), 0.1)
    yield method(2, "2 steps, refsafe", replace(two, refsafe=True))
    yield method(2, "7 steps, diagexact", replace(seven, diagexact=True))
    yield method(2, "7 steps, impedance 0.95", replace(seven, solimp=MUJOCO_SOLIMP))
    yield method(2, "2 steps, 1e-08", replace(two, compliance=1e-8))


def possible_cuts(mechanism: Mechanism) -> list[tuple[str, ...]]:
    """Return every set of joints whose cutting leaves a tree that MuJoCo can close."""
    loops = len(mechanism.joints) - len(mechanism.links)
    cuts: list[tuple[str, ...]] = []
    for names in combinations([joint.name for joint in mechanism.joints], loops):
        with suppress(InputError):
            cut_loops(mechanism, names)
            cuts.append(names)
    return cuts
