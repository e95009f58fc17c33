"""What `mechsim dynamics` prints with --json of a run from an initial state, statics, modes and responses."""

from typing import TypedDict

from mechsim.cli.schema import CheckJson
from mechsim.model.finding import Outcome
from mechsim.model.masses import LinkMass


class Extent(TypedDict):
    """Least, largest and last value of a quantity over a run."""

    least: float
    largest: float
    final: float


class QuantityJson(Extent):
    """A quantity over a run."""

    unit: str


class ForwardRunJson(TypedDict):
    """End and energies of a run from an initial state, and the comparison with MuJoCo; None without one."""

    mechanism: str
    masses: list[LinkMass]
    outcome: Outcome
    reason: str
    duration: float
    energy_error: float
    work: float
    lost: float
    events: list[float]
    steps: int
    final: dict[str, float]
    quantities: dict[str, QuantityJson]
    passed: bool | None
    checks: list[CheckJson]


class ModeJson(TypedDict):
    """A mode of vibration; amplitudes of the joints are numbers, or real and imaginary parts."""

    frequency: float
    damping_ratio: float
    shape: dict[str, float | list[float]]


class EquilibriumJson(TypedDict):
    """A configuration at rest, its potential in [J], and the modes about it."""

    q: dict[str, float]
    stable: bool
    potential: float
    modes: list[ModeJson]


class StaticsJson(TypedDict):
    """Equilibria, and the effort in each driver that holds the initial configuration."""

    mechanism: str
    masses: list[LinkMass]
    equilibria: list[EquilibriumJson]
    holding: dict[str, float]


class ModesJson(EquilibriumJson):
    """The equilibrium next to the initial configuration."""

    mechanism: str
    masses: list[LinkMass]


class ResponseColumns(TypedDict):
    """Columns of a frequency response, over frequencies in [Hz]; phases in [rad]."""

    frequency: list[float]
    magnitude: list[float]
    phase: list[float]


class ResponseJson(TypedDict):
    """Frequency response from a unit load to a quantity."""

    mechanism: str
    masses: list[LinkMass]
    load: str
    quantity: str
    unit: str
    response: ResponseColumns


ForwardJson = ForwardRunJson | StaticsJson | ModesJson | ResponseJson
