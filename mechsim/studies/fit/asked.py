"""A fit in one call."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from mechsim import files, units
from mechsim.model.forces import Forces
from mechsim.numerics.arrays import Array
from mechsim.studies.fit.calibration import Fit, fit_dimensions
from mechsim.studies.fit.measured import measured_of
from mechsim.studies.sensitivity.asked import Subject, moved_along
from mechsim.studies.sensitivity.moved_family import MovedFamily
from mechsim.subjects.parametric_models import parametric_model


def fit(
    model: Subject,
    table: str | Path | Mapping[str, ArrayLike],
    vary: str | Sequence[str],
    *,
    offset: bool = False,
    speed: float | str = 1.0,
    forces: Forces | None = None,
) -> Fit:
    """Return the dimensions with which a subject moves most nearly as it was measured.

    Args:
        model: as `moved` takes it; the fit begins from its dimensions.
        table: measured motion: columns angle in [rad] (t in [s] under programs) and quantities named like
            ours or in `reference/` (torque:crank), in SI; a column P3.x± is the standard deviation of P3.x.
            A .csv or .npz file, or a mapping.
        vary: dimensions to find.
        offset: whether the zero of the crank's encoder is unknown, too: CRANK.offset is how far the crank
            stood ahead of the angles in the table.
        speed: of the crank in [rad/s] or text, as "600rpm", which only rates and efforts depend on.
        forces: what acts on it, where efforts were measured; None takes what its file says.

    Raises:
        InputError: for a table that does not serve, an unknown dimension, or fewer numbers than dimensions.
        AssemblyError: where it cannot stand at what was measured as it begins.
    """
    subject = model
    if not isinstance(subject, MovedFamily):
        # the table has the instants
        pace = units.si(speed, "rad/s", "the speed")
        subject = moved_along(parametric_model(subject), np.zeros(1), pace, forces)
    if isinstance(table, Mapping):
        columns: Mapping[str, Array] = {
            name: np.asarray(one, dtype=np.float64) for name, one in table.items()
        }
        where = "the table"
    else:
        columns, where = files.read(table), str(table)
    names = [vary] if isinstance(vary, str) else vary
    return fit_dimensions(subject, measured_of(columns, subject.form, where), names, offset=offset)
