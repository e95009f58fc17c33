"""A mechanism released from an initial state: what pictures draw of its run and of its vibrations."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from mechsim.analytic.dynamics import DynamicModel, DynamicRun, nearest_equilibrium, run
from mechsim.analytic.dynamics.joint_forces import joint_forces
from mechsim.analytic.dynamics.mode_motion import ModeMotion, mode_motion, mode_motions
from mechsim.errors import InputError
from mechsim.model.quantities import Quantity, numeric_quantity, record_columns, unwrapped
from mechsim.numerics.arrays import Array
from mechsim.studies.frequency_response import FrequencyResponse, frequency_response

# [s] of a run of which no duration is given
DURATION = 1.0
# outcomes of runs that are drawn
SHOWN = ("done", "stopped", "time over")


@dataclass(frozen=True, slots=True, kw_only=True)
class Release:
    """A dynamic model, its initial state, and how a run of it ends.

    Attributes:
        model: mechanism, masses and forces; its drivers are free.
        initial: `J.q` and `J.v` at the start, as `mechsim.dynamics.run` takes them.
        duration: longest time in [s].
        until: event that ends the run; None for none.
        restitution: at the limits of joints.
    """

    model: DynamicModel
    initial: Mapping[str, float | str] = field(default_factory=dict[str, "float | str"])
    duration: float = DURATION
    until: str | None = None
    restitution: float = 0.0

    def run(self, samples: int) -> DynamicRun:
        """Return the run at instants after the first."""
        return run(
            self.model,
            initial=self.initial,
            duration=self.duration,
            until=self.until,
            samples=samples,
            restitution=self.restitution,
        )

    def columns(self, result: DynamicRun, quantities: Sequence[Quantity]) -> dict[str, Array]:
        """Return the columns of a run, with those of forces in joints where quantities need them.

        Raises:
            InputError: for forces where the drivers do not determine the motion.
        """
        columns = record_columns(result.motion, quantities) | dict(result.columns())
        if any(column.name not in columns for quantity in quantities for column in quantity.columns):
            columns |= dict(joint_forces(self.model, result).columns())
        return columns

    def values(self, result: DynamicRun, names: Sequence[str]) -> dict[Quantity, Array]:
        """Return quantities over a run, (n,) each; of vectors the length."""
        quantities = [numeric_quantity(name, self.model.mechanism) for name in names]
        columns = self.columns(result, quantities)
        if missing := [q.name for q in quantities if any(c.name not in columns for c in q.columns)]:
            raise InputError(f"{missing[0]} is not known of a run from an initial state; leave it out")
        numbers = {quantity: quantity.number(columns) for quantity in quantities}
        return {quantity: unwrapped(n) if quantity.angle else n for quantity, n in numbers.items()}

    def shown_run(self, samples: int) -> DynamicRun:
        """Return the run to be drawn.

        Raises:
            InputError: where it broke down.
        """
        result = self.run(samples)
        if result.outcome not in SHOWN:
            raise InputError(
                f"{self.model.mechanism.name}: {result.outcome}, nothing is drawn: {result.reason}"
            )
        return result

    def cycle(self, number: int, samples: int = 72) -> ModeMotion:
        """Return a cycle along a mode shape about the equilibrium next to the initial configuration."""
        return mode_motion(nearest_equilibrium(self.model, initial=self.initial), number, samples)

    def cycles(self) -> list[ModeMotion]:
        """Return a cycle along each mode shape."""
        return mode_motions(nearest_equilibrium(self.model, initial=self.initial))

    def response(self, text: str) -> FrequencyResponse:
        """Return the frequency response that LOAD:QUANTITY names."""
        return frequency_response(self.model, text, self.initial)
