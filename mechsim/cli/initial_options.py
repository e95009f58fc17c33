"""Options of a run from an initial state, which `dynamics`, `plot`, `render` and `view` share."""

from dataclasses import dataclass

from mechsim.analytic.dynamics import DynamicModel, DynamicRun, run
from mechsim.cli.options import pair_of
from mechsim.errors import InputError
from mechsim.units import option

# [s] of a run without --duration
DURATION = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class InitialOptions:
    """A run from an initial state."""

    initial: tuple[tuple[str, str], ...] = option(
        (),
        "Initial coordinate J.q or rate J.v of a joint; the drivers are free, and the run lasts --duration.",
        read=pair_of("--initial crank.q=10deg"),
        many=True,
        metavar="J.q=VALUE",
    )
    until: str | None = option(
        None,
        "Event that ends the run, as P.y=0, J.q=90deg or distance:P,Q=10mm.",
        metavar="QUANTITY=VALUE",
    )
    restitution: float = option(0.0, "Coefficient of restitution at the limits of joints, 0 to 1.")

    @property
    def released(self) -> bool:
        """Whether a run is asked for."""
        return bool(self.initial or self.until)

    def run(self, model: DynamicModel, duration: float | None, samples: int) -> DynamicRun:
        """Return the run of a model; it lasts a second where no duration is given."""
        return run(
            model,
            initial=dict(self.initial),
            duration=DURATION if duration is None else duration,
            until=self.until,
            samples=samples,
            restitution=self.restitution,
        )


def complete(result: DynamicRun) -> DynamicRun:
    """Return a run; raise InputError for one that broke down, of which nothing can be drawn."""
    if result.outcome not in ("done", "stopped", "time over"):
        raise InputError(f"the run ends in {result.outcome}: {result.reason}")
    return result
