"""Evaluation of a scene with some settings: one run, its errors and its cost."""

from dataclasses import dataclass

from mechsim.studies.scene.errors import SceneErrors, errors_of
from mechsim.studies.scene.run import RECORDS, SceneRun, run_scene
from mechsim.studies.scene.scene import UserScene
from mechsim.studies.scene.settings import UNCHANGED, PlainSettings


@dataclass(frozen=True, slots=True)
class SceneTrial:
    """Evaluated settings.

    Attributes:
        settings: changes of the scene's own settings.
        errors: of the run.
        seconds: processor time of a simulated second, in [s].
    """

    settings: PlainSettings
    errors: SceneErrors
    seconds: float


@dataclass(frozen=True)
class SceneEvaluator:
    """Runs scenes and measures errors and cost; used by tune, reduce and the scene costs of tradeoff.

    Attributes:
        reference: run that gives the true points, forces and energies; None compares none.
        closure: whether points are compared with the exact closure of the scene's loops.
        forces: whether forces are compared with the reference.
        energy: whether energies are.
    """

    reference: SceneRun | None = None
    closure: bool = True
    forces: bool = False
    energy: bool = False

    def errors(self, run: SceneRun) -> SceneErrors:
        """Return the errors of a run."""
        return errors_of(run, self.reference, closure=self.closure, forces=self.forces, energy=self.energy)

    def evaluate(
        self,
        scene: UserScene,
        settings: PlainSettings = UNCHANGED,
        *,
        records: int | None = RECORDS,
        duration: float | None = None,
    ) -> SceneTrial:
        """Run a scene once with settings and return its errors and cost.

        Args:
            scene: the scene.
            settings: changes of its own settings.
            records: approximate number of compared instants; None for every step.
            duration: in [s]; None for the scene's.
        """
        run = run_scene(scene, settings.applied(scene.model), records=records, duration=duration)
        return SceneTrial(settings, self.errors(run), run.seconds_per_second)
