"""The settings that `mechsim tradeoff` compares: families of them, each a curve over the number of steps.

A family keeps everything but the step: integrator, time constant of the loops (a number of steps, or a
part of a turn), hardness, impedance, refsafe, diagexact, the joint that is cut.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations

from mechsim.errors import InputError
from mechsim.mechanism import Mechanism
from mechsim.mjcf.tree import cut_loops
from mechsim.simulation.settings import INTEGRATORS, LEAST_CONSTANT, Settings

# each divides into, or is a multiple of, 72 instants a turn
STEPS = (24, 36, 72, 144, 288, 720, 1440, 2880, 7200)
MUJOCO_SOLREF, MUJOCO_SOLIMP = (0.02, 1.0), (0.9, 0.95, 0.001, 0.5, 2.0)
DEFAULTS = "MuJoCo's defaults"
# MuJoCo's own scale of softness
PLAIN = Settings(hardness=1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Family:
    """Settings that differ only in the number of steps.

    Attributes:
        name: for tables and plots.
        base: the settings, but for the number of steps.
        rank: families of low rank are tried first.
        part: time constant of the loops as a part of a turn; None leaves it to `base`.
        direct: whether stiffness and damping are given directly, as 1/step squared and 1/step.
        cut: joints at which the loops are cut; None lets the generator choose.
    """

    name: str
    base: Settings
    rank: int
    part: float | None = None
    direct: bool = False
    cut: tuple[str, ...] | None = None

    def at(self, steps: int, speed: float) -> Settings:
        """Return the settings for a number of steps in a turn at a crank speed in [rad/s]."""
        settings = replace(self.base, steps_per_turn=steps)
        if self.part is not None:
            return replace(settings, constant_steps=max(LEAST_CONSTANT, self.part * steps))
        if self.direct:
            rate = 1.0 / settings.timestep(speed)
            return replace(settings, solref=(-(rate**2), -rate))
        return settings


def families(mechanism: Mechanism | None = None) -> list[Family]:
    """Return all families; those that cut other joints only for a mechanism whose joints are known."""
    found = [
        Family(
            name=DEFAULTS,
            base=replace(PLAIN, integrator="Euler", solref=MUJOCO_SOLREF, solimp=MUJOCO_SOLIMP, refsafe=True),
            rank=0,
        ),
        Family(name="RK4, turn/10, 1e-08", base=Settings(), rank=0, part=0.1),
    ]
    for integrator in INTEGRATORS:
        found += _of(integrator)
    if mechanism is not None:
        chosen = {joint.name for joint in cut_loops(mechanism).cuts}
        found += [
            Family(
                name=f"RK4, turn/10, 1e-08, cut {'+'.join(cut)}", base=Settings(), rank=3, part=0.1, cut=cut
            )
            for cut in cuts_of(mechanism)
            if set(cut) != chosen
        ]
    return found


def _of(integrator: str) -> Iterator[Family]:
    plain = replace(PLAIN, integrator=integrator)
    two, seven = replace(plain, constant_steps=2.0), replace(plain, constant_steps=7.0)

    def family(rank: int, suffix: str, base: Settings, **options: float | bool) -> Family:
        return Family(name=f"{integrator}, {suffix}", base=base, rank=rank, **options)  # pyright: ignore[reportArgumentType]

    yield family(1, "2 steps", two)
    yield family(1, "7 steps", seven)
    yield family(1, "20 steps, 1e-04", replace(plain, constant_steps=20.0, hardness=1e-4))
    if integrator == "RK4":
        yield family(2, "turn/5, 1e-08", Settings(), part=0.2)
        yield family(2, "turn/20, 1e-08", Settings(), part=0.05)
    else:
        yield family(1, "direct", plain, direct=True)
        yield family(1, "turn/10, 1e-08", replace(plain, hardness=1e-8), part=0.1)
    if integrator == "discrete":
        yield family(2, "1e-3 steps", replace(plain, constant_steps=1e-3))
    yield family(2, "turn/10, 1e-04", replace(plain, hardness=1e-4), part=0.1)
    yield family(2, "2 steps, refsafe", replace(two, refsafe=True))
    yield family(2, "7 steps, diagexact", replace(seven, diagexact=True))
    yield family(2, "7 steps, impedance 0.95", replace(seven, solimp=MUJOCO_SOLIMP))
    yield family(2, "2 steps, 1e-08", replace(two, hardness=1e-8))


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
