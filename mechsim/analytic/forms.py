"""What moves: a closed form of the catalogue, or a mechanism of one's own by its loop equations."""

from mechsim.analytic.catalog.base import ClosedForm
from mechsim.analytic.loops.loop_form import LoopForm
from mechsim.errors import InputError

Form = ClosedForm | LoopForm


def closed_form(form: Form, what: str) -> ClosedForm:
    """Return a mechanism of the catalogue.

    Args:
        form: what may be one.
        what: it is wanted for.

    Raises:
        InputError: for any other.
    """
    if isinstance(form, ClosedForm):
        return form
    raise InputError(
        f"{what} is known for mechanisms of the catalogue only, and {form.name!r} is none; "
        "`mechsim list` names them"
    )
