"""What a search for settings came to: one record, which the screen, the file's comment and JSON read."""

from dataclasses import dataclass

import numpy as np

from mechsim.studies.scenes import SceneErrors
from mechsim.studies.tuning.search import SceneTrial, Tuned

# a trajectory that is farther from the limit by less than this factor is as good as before
WORSE = 1.1
UNITS = {"closure": "m", "trajectory": "m", "torque": "N m"}


@dataclass(frozen=True)
class TuningReport:
    """What a search came to, measured at every step of the written file.

    Attributes:
        found: the search.
        errors: of the written file.
    """

    found: Tuned
    errors: SceneErrors

    @property
    def best(self) -> SceneTrial:
        """The settings that are written."""
        return self.found.chosen or self.found.closest

    @property
    def unit(self) -> str:
        """The unit of the tolerance."""
        return UNITS[self.found.by]

    @property
    def bar(self) -> float:
        """The error of the limit by which the measure judges."""
        return self.found.bar

    @property
    def error(self) -> float:
        """The error of the written file, that of the limit included."""
        return self.errors.by(self.found.by) + self.bar

    @property
    def published_error(self) -> float:
        """The error of the file as published, that of the limit included."""
        return self.found.published.errors.by(self.found.by) + self.bar

    @property
    def reached(self) -> bool:
        """Whether the written file satisfies the tolerance."""
        return self.error <= self.found.tolerance

    @property
    def unchanged(self) -> bool:
        """Whether the written file has the settings of the published one."""
        return not self.best.settings.without_idle(self.found.scene.model).as_dict()

    @property
    def sentences(self) -> list[str]:
        """The result in sentences: the file as published first, then what is written."""
        found, published = self.found, self.found.published
        tolerance = f"{found.tolerance:g} {self.unit} by {found.by} over {found.scene.duration:g} s"
        if np.isfinite(self.published_error):
            satisfies = "satisfies" if found.satisfied else "does not satisfy"
            figures = self._figures(self.published_error, published)
            first = f"as published the file {satisfies} {tolerance}: {figures}"
        else:
            first = f"as published the file does not satisfy {tolerance}: it diverges"
        satisfies = "satisfies" if self.reached else "does not satisfy"
        figures = self._figures(self.error, self.best)
        if self.unchanged:
            cheaper = "; no cheaper settings satisfy it" if self.reached else ""
            return [first, f"the settings stay as published{cheaper}"]
        return [first, f"the tuned file {satisfies} it: {figures}{self._cost}", *self._trajectory]

    @staticmethod
    def _figures(error: float, trial: SceneTrial) -> str:
        return f"error {error:.2g}, {1e3 * trial.seconds:.3g} ms a simulated second"

    @property
    def _cost(self) -> str:
        ratio = self.best.seconds / self.found.published.seconds
        if not np.isfinite(ratio) or ratio <= 0.0:
            return ""
        return f", {ratio:.2g} times slower" if ratio > 1.0 else f", {1.0 / ratio:.2g} times faster"

    @property
    def _trajectory(self) -> list[str]:
        """State a trajectory that is worse than that of the published file."""
        after, before = self.errors.trajectory, self.found.published.errors.trajectory
        if (
            self.found.by == "trajectory"
            or not after > WORSE * before
            or not after > self.found.limit.bars[0]
        ):
            return []
        times = f", {after / before:.2g} times as far" if before > 0.0 else ""
        return [
            f"its trajectory is worse: up to {after:.2g} m from the scene's limit, as published "
            f"{before:.2g} m{times}; tuning by trajectory bounds it"
        ]
