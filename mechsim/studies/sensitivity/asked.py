"""What is asked in one call: a subject by name, file or object, its quantities and dimensions."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from mechsim import units
from mechsim.analytic.derivatives import DesignFamily
from mechsim.analytic.forms import Form
from mechsim.analytic.path_instants import path_instants
from mechsim.errors import InputError
from mechsim.model.forces import Forces
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array
from mechsim.numerics.inputs import numbers
from mechsim.studies.sensitivity.moved_family import Loading, MovedFamily, instants_of
from mechsim.studies.sensitivity.table import ALL, Sensitivity, derivative_table
from mechsim.subjects.parametric_models import parametric_model

Subject = str | Form | Mechanism | MovedFamily


def moved(
    model: Subject,
    *,
    angles: ArrayLike | None = None,
    t: ArrayLike | None = None,
    speed: float | str = 1.0,
    forces: Forces | None = None,
) -> MovedFamily:
    """Return a subject as one of a family, and how it is moved.

    Args:
        model: as `load` takes it, or what moves itself.
        angles: of the crank, (n,) in [rad] or text, as "0:360:5deg"; where neither these nor times are given,
            instants are spread over the crank's range, or over the duration of motion laws.
        t: times, (n,) in [s], of motion laws, or of a crank that turns at `speed`.
        speed: of the crank in [rad/s] or text, as "600rpm"; motion laws have their own.
        forces: what acts on it; None takes what its file says.

    Raises:
        InputError: as `load`, for angles or times that are no finite numbers, and for angles where motion
            laws drive.
    """
    if isinstance(model, MovedFamily):
        return model
    pace = units.si(speed, "rad/s", "the speed")
    of = parametric_model(model)
    form = of.make({})
    if angles is None and t is None:
        return moved_along(of, instants_of(form), pace, forces)
    given = None if form.motion_laws is not None else pace
    at = np.atleast_1d(
        numbers(path_instants(form.mechanism, form.motion_laws, angles, given, 0.0, t).parameter)
    )
    if at.ndim != 1 or not at.size or not np.isfinite(at).all():
        raise InputError(f"{of.name}: angles must be a list of finite numbers; give them in [rad]")
    return moved_along(of, at, pace, forces)


def moved_along(of: DesignFamily, parameter: Array, speed: float, forces: Forces | None) -> MovedFamily:
    """Return a family moved along its path, at values (n,) of the path parameter in [rad]."""
    loading = Loading() if forces is None else Loading(lambda _: forces)
    return MovedFamily(of, parameter, speed, loading)


def sensitivity(
    model: Subject,
    of: str | Sequence[str],
    to: str | Sequence[str] = ALL,
    *,
    angles: ArrayLike | None = None,
    t: ArrayLike | None = None,
    speed: float | str = 1.0,
    forces: Forces | None = None,
) -> Sensitivity:
    """Return quantities of a subject and their exact derivatives by dimensions, the drivers held as they are.

    Args:
        model: as `moved` takes it.
        of: quantities: points (P3, P3.v), joints (rocker), columns (P3.x, rocker.v, torque, P3.fx), force:P3.
        to: dimensions: parameters, parts of places as pivot.x; of a mechanism without parameters JOINT.at.x;
            "all" is every one.
        angles: as of `moved`.
        t: as of `moved`.
        speed: as of `moved`.
        forces: as of `moved`.

    Raises:
        InputError: for an unknown quantity or dimension, with the nearest one.
        AssemblyError: where the loops do not close, or two assemblies meet.

    Accuracy: about 1e-15 times the condition of the loops; docs/sensitivity.md has what was measured.
    """
    subject = moved(model, angles=angles, t=t, speed=speed, forces=forces)
    return derivative_table(subject, [of] if isinstance(of, str) else of, to)
