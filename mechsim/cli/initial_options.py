"""Options of a run from an initial state, which `dynamics`, `plot`, `render` and `view` share."""

from dataclasses import dataclass, replace

from mechsim.analytic.dynamics import DynamicModel
from mechsim.cli.load_options import LoadOptions
from mechsim.cli.options import ModelOptions, pair_of
from mechsim.errors import InputError
from mechsim.studies.release import DURATION, Release
from mechsim.units import option


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
    def requested(self) -> bool:
        """Whether a run is asked for."""
        return bool(self.initial or self.until)

    def release(self, model: DynamicModel, duration: float | None) -> Release:
        """Return the release of a model; the run lasts a second where no duration is given."""
        return Release(
            model=model,
            initial=dict(self.initial),
            duration=DURATION if duration is None else duration,
            until=self.until,
            restitution=self.restitution,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class ReleaseOptions(InitialOptions):
    """A run from an initial state, or a mode of vibration, to be drawn."""

    mode: int | None = option(None, "Draw this mode of vibration about the equilibrium, from 1.", metavar="N")

    @property
    def requested(self) -> bool:
        """Whether a run or a mode is asked for."""
        return bool(self.initial or self.until or self.mode is not None)


def released_model(source: ModelOptions, loads: LoadOptions) -> DynamicModel:
    """Return the dynamic model of a mechanism whose drivers are free; --duration is that of its run."""
    return loads.dynamic_model(replace(source, duration=None).load(still=True))


def require_release(loads: LoadOptions, options: InitialOptions, usage: str) -> None:
    """Raise InputError for loads or a restitution without a run that they act in.

    Args:
        loads: as given.
        options: of the run.
        usage: what would make them count.
    """
    if loads != LoadOptions() or options.restitution:
        raise InputError(f"loads, masses and --restitution act in a run from an initial state; {usage}")


def states_initial(source: ModelOptions) -> bool:
    """Whether --duration is that of a run from the state that a file's [initial] gives."""
    if source.duration is None or source.drive:
        return False
    return bool(getattr(replace(source, duration=None).load(still=True), "initial", None))
