"""A budget of processor time for runs that are repeated until they converge."""

from collections.abc import Callable
from dataclasses import dataclass, field
from time import process_time

from mechsim.errors import BudgetError


@dataclass
class ProcessorBudget:
    """What work may take of the processor, so that a result does not depend on what else the machine does.

    Attributes:
        seconds: of processor time, of all threads.
        clock: gives processor time in [s].
        began: when the budget began to run, by the clock.
    """

    seconds: float
    clock: Callable[[], float] = process_time
    began: float = field(init=False)

    def __post_init__(self) -> None:
        """Begin to run."""
        self.began = self.clock()

    @property
    def spent(self) -> float:
        """What was taken so far, in [s]."""
        return self.clock() - self.began

    def affords(self, seconds: float) -> bool:
        """Return whether work of some seconds would end within the budget."""
        return self.spent + seconds <= self.seconds

    def require_left(self, done: str) -> None:
        """Raise BudgetError where the budget is spent; `done` is how far the work has come, in words."""
        if self.spent > self.seconds:
            raise BudgetError(f"{self.ended}: it reached {done}; give a larger --budget or a shorter motion")

    @property
    def ended(self) -> str:
        """How a sentence begins that reports the end of the budget."""
        return f"not converged within the budget of {self.seconds:g} s of processor time"
