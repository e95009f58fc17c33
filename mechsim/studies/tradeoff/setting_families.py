"""The settings that `mechsim tradeoff` compares: families of them, each a curve over the number of steps.

A family keeps everything but the step: integrator, time constant of the loops (a number of steps, or a
part of a turn), compliance, impedance, refsafe, diagexact, and how the model is built: the joint that is
cut, the scene's level, what drives the crank, reductions.
"""

from collections.abc import Iterable, Iterator, Mapping
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
        drive: what turns the crank: a flywheel on it; an equality with a flywheel beside the mechanism; a
            velocity servo.
        gain: of the servo, in units of the inertia felt at the crank over the time step.
        rod: link made a constant length between two joints; None leaves all links bodies.
        variant: of the mechanism, with the same motion of its tracked points; None is the mechanism itself.
    """

    cut: tuple[str, ...] | None = None
    level: Level = "motion"
    drive: CrankDrive = "drive_inertia"
    gain: float = 1.0
    rod: str | None = None
    variant: str | None = None

    def as_dict(self) -> dict[str, str]:
        """Return the columns of the CSV that say how the model was made."""
        reduction = f"{self.rod} as a length" if self.rod else self.variant or ""
        return {
            "cut": "+".join(self.cut or ()),
            "level": self.level,
            "drive": self.drive,
            "reduction": reduction,
        }

    def made(self, source: Model, variants: Mapping[str, Mechanism]) -> Any:
        """Return MuJoCo's specification, made of a mechanism or of a model of one's own."""
        if self.variant is not None:
            source = variants[self.variant]
        spec = load(source, Scene(level=self.level, cut=self.cut))
        if self.rod is not None:
            assert isinstance(source, Mechanism)
            rod_as_length(spec, source, self.rod)
        if self.drive == "geared":
            gear_to_motor(spec)
        elif self.drive == "servo":
            add_servo(spec)
        return spec


# each divides into, or is a multiple of, 72 instants a turn
STEPS = (24, 36, 72, 144, 288, 720, 1440, 2880, 7200)
MUJOCO_SOLREF, MUJOCO_SOLIMP = (0.02, 1.0), (0.9, 0.95, 0.001, 0.5, 2.0)
DEFAULTS = "MuJoCo's defaults"
HARD = "RK4, turn/10, 1e-08"
# MuJoCo's own scale of softness
PLAIN = Settings(compliance=1.0)
BUILD = Build()


@dataclass(frozen=True, slots=True, kw_only=True)
class Family:
    """Settings that differ only in the number of steps.

    Attributes:
        name: for tables and plots.
        base: the settings, but for the number of steps.
        rank: families of low rank are tried first.
        part: time constant of the loops as a part of a turn; None leaves it to `base`.
        direct: whether stiffness and damping are given directly, as 1/step squared and 1/step.
        build: how the model is made.
    """

    name: str
    base: Settings
    rank: int
    part: float | None = None
    direct: bool = False
    build: Build = BUILD

    def at(self, steps: int, speed: float) -> Settings:
        """Return the settings for a number of steps in a turn at a crank speed in [rad/s]."""
        settings = replace(self.base, steps_per_turn=steps)
        if self.part is not None:
            return replace(settings, constant_steps=max(LEAST_CONSTANT, self.part * steps))
        if self.direct:
            rate = 1.0 / settings.timestep(speed)
            return replace(settings, solref=(-(rate**2), -rate))
        return settings


def families(mechanism: Mechanism | None = None, variants: Iterable[str] = ()) -> list[Family]:
    """Return all families; those that build the model otherwise only where its joints are known.

    Args:
        mechanism: where there is one; None for a model of one's own.
        variants: names of variants of it with the same motion.
    """
    found = [
        Family(
            name=DEFAULTS,
            base=replace(PLAIN, integrator="Euler", solref=MUJOCO_SOLREF, solimp=MUJOCO_SOLIMP, refsafe=True),
            rank=0,
        ),
        Family(name=HARD, base=Settings(), rank=0, part=0.1),
    ]
    for integrator in INTEGRATORS:
        found += _of(integrator)
    found += _driven()
    return found + list(_built(mechanism, variants)) if mechanism is not None else found


def _driven() -> Iterator[Family]:
    """Yield families whose crank is not turned by a flywheel on it."""
    hard = Family(name=HARD, base=Settings(), rank=3, part=0.1)
    yield replace(hard, name=f"{HARD}, geared crank", build=Build(drive="geared"))
    yield replace(hard, name=f"{HARD}, servo", build=Build(drive="servo", gain=0.5))
    soft = replace(PLAIN, constant_steps=2.0)
    # a gain that only an implicit integrator bears (validation/choices/drive.py)
    for integrator, gain in (("implicitfast", 1e4), ("discrete", 10.0)):
        build = Build(drive="servo", gain=gain)
        name = f"{integrator}, 2 steps, servo"
        yield Family(name=name, base=replace(soft, integrator=integrator), rank=3, build=build)


def _built(mechanism: Mechanism, variants: Iterable[str]) -> Iterator[Family]:
    """Yield families whose model is cut elsewhere, holds more, or is reduced."""
    hard = Family(name=HARD, base=Settings(), rank=3, part=0.1)
    chosen = {joint.name for joint in cut_loops(mechanism).cuts}
    for cut in cuts_of(mechanism):
        if set(cut) != chosen:
            yield replace(hard, name=f"{HARD}, cut {'+'.join(cut)}", build=Build(cut=cut))
    for level in LEVELS:
        if level != Build().level:
            yield replace(hard, name=f"{HARD}, level {level}", build=Build(level=level))
    for variant in variants:
        yield replace(hard, name=f"{HARD}, {variant}", build=Build(variant=variant))
    rod = rod_of(mechanism)
    if rod is not None:
        build = Build(rod=rod)
        yield replace(hard, name=f"{HARD}, {rod} as a length", build=build)
        # MuJoCo leaves out a tendon's second rate, so that only a quick constraint keeps its length
        quick = replace(Settings(), constant_steps=2.0)
        yield Family(name=f"RK4, 2 steps, 1e-08, {rod} as a length", base=quick, rank=3, build=build)


def _of(integrator: str) -> Iterator[Family]:
    plain = replace(PLAIN, integrator=integrator)
    two, seven = replace(plain, constant_steps=2.0), replace(plain, constant_steps=7.0)

    def family(rank: int, suffix: str, base: Settings, **options: float | bool) -> Family:
        return Family(name=f"{integrator}, {suffix}", base=base, rank=rank, **options)  # pyright: ignore[reportArgumentType]

    yield family(1, "2 steps", two)
    yield family(1, "7 steps", seven)
    yield family(1, "20 steps, 1e-04", replace(plain, constant_steps=20.0, compliance=1e-4))
    if integrator == "RK4":
        yield family(2, "turn/5, 1e-08", Settings(), part=0.2)
        yield family(2, "turn/20, 1e-08", Settings(), part=0.05)
    else:
        yield family(1, "direct", plain, direct=True)
        yield family(1, "turn/10, 1e-08", replace(plain, compliance=1e-8), part=0.1)
    if integrator == "discrete":
        yield family(2, "1e-3 steps", replace(plain, constant_steps=1e-3))
    yield family(2, "turn/10, 1e-04", replace(plain, compliance=1e-4), part=0.1)
    yield family(2, "2 steps, refsafe", replace(two, refsafe=True))
    yield family(2, "7 steps, diagexact", replace(seven, diagexact=True))
    yield family(2, "7 steps, impedance 0.95", replace(seven, solimp=MUJOCO_SOLIMP))
    yield family(2, "2 steps, 1e-08", replace(two, compliance=1e-8))


def cuts_of(mechanism: Mechanism) -> list[tuple[str, ...]]:
    """Return every set of joints whose cutting leaves a tree that MuJoCo can close."""
    loops = len(mechanism.joints) - len(mechanism.links)
    found: list[tuple[str, ...]] = []
    for names in combinations([joint.name for joint in mechanism.joints], loops):
        try:
            cut_loops(mechanism, names)
        except InputError:
            continue
        found.append(names)
    return found
