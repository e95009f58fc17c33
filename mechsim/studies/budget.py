"""Time budgets of studies by the wall clock."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from time import perf_counter


@dataclass(frozen=True, slots=True)
class Budget:
    """Time that may be spent, by a clock.

    Attributes:
        seconds: all of it.
        start: reading of the clock at which it begins; None for now.
        now: reads the wall clock in [s]; tests pass their own.
    """

    seconds: float
    start: float | None = None
    now: Callable[[], float] = field(default_factory=lambda: perf_counter)

    def __post_init__(self) -> None:
        """Read the clock if no start is given."""
        if self.start is None:
            object.__setattr__(self, "start", self.now())

    @property
    def spent(self) -> float:
        """Seconds since the start."""
        assert self.start is not None
        return self.now() - self.start

    @property
    def remaining(self) -> float:
        """Seconds left; negative after the end."""
        return self.seconds - self.spent

    @property
    def fraction(self) -> float:
        """The spent fraction, 0 to 1."""
        return min(1.0, self.spent / self.seconds)

    def share(self, fraction: float) -> "Budget":
        """Return a budget that starts now, with a fraction of the seconds."""
        return replace(self, seconds=fraction * self.seconds, start=None)

    def restarted(self) -> "Budget":
        """Return the same budget, starting now."""
        return replace(self, start=None)
