"""A mechanism released from an initial state: what pictures draw of its run and of its vibrations."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from mechsim.analytic.dynamics import DynamicModel, DynamicRun, nearest_equilibrium, run
from mechsim.analytic.dynamics.mode_motion import ModeMotion, mode_motion, mode_motions
from mechsim.errors import InputError
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
