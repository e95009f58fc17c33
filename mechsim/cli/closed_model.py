"""Options of commands that solve configurations of a MuJoCo model."""

from typing import Annotated, Any

from mechsim.cli.command import Without
from mechsim.cli.exit_codes import notes
from mechsim.cli.options import ModelOptions
from mechsim.errors import InputError
from mechsim.io.mujoco_inputs import with_loops
from mechsim.studies.robots.mujoco_models import notes_on

ClosedModelOptions = Annotated[ModelOptions, Without("drive", "track", "duration")]


def closed_model(source: ModelOptions) -> tuple[Any, dict[str, Any]]:
    """Return a model with its loop closures, and how its paths start; note what of it is not read."""
    if [*source.lock] not in ([], [("others", None)]):
        raise InputError("--lock takes only `others` here, for every actuator moves; leave other joints out")
    model, arguments = with_loops(source.model, source.loops), source.load_arguments()
    options = {name: arguments[name] for name in ("set", "key", "start")}
    notes.extend(notes_on(model, **options))
    return model, options | {"fix_base": source.fix_base}
