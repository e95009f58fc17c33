"""Options of commands that solve configurations of a MuJoCo model."""

from typing import Annotated, Any

from mechsim.cli.command import Without
from mechsim.cli.exit_codes import notes
from mechsim.cli.options import ModelOptions
from mechsim.errors import InputError
from mechsim.io.mujoco_inputs import with_loops
from mechsim.studies.robots.mujoco_models import StartedModel, started_model

ClosedModelOptions = Annotated[ModelOptions, Without("drive", "track", "duration")]


def closed_model(source: ModelOptions) -> tuple[StartedModel, Any, dict[str, Any]]:
    """Return a model as its paths start, the same with its loop closures, and options of both.

    What of it is not read is noted.
    """
    if [*source.lock] not in ([], [("others", None)]):
        raise InputError("--lock takes only `others` here, for every actuator moves; leave other joints out")
    model, arguments = with_loops(source.model, source.loops), source.load_arguments()
    options = {name: arguments[name] for name in ("set", "key", "start")}
    started = started_model(model, **options)
    notes.extend(started.notes)
    return started, model, options | {"fix_base": source.fix_base}
