"""Frequency responses about an equilibrium, over frequencies around its natural ones."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.dynamics import DynamicModel, nearest_equilibrium, response
from mechsim.errors import InputError
from mechsim.model.quantities import numeric_quantity
from mechsim.numerics.arrays import Array

# frequencies, from a tenth of the lowest to ten times the highest natural one
FREQUENCIES, BELOW, ABOVE = 200, 0.1, 10.0


@dataclass(frozen=True, slots=True)
class FrequencyResponse:
    """A frequency response.

    Attributes:
        load: where a unit load acts.
        quantity: what responds.
        unit: of the quantity per unit load.
        frequency: (n,) in [Hz].
        values: complex, (n,).
    """

    load: str
    quantity: str
    unit: str
    frequency: Array
    values: NDArray[np.complex128]

    def columns(self) -> dict[str, Array]:
        """Return frequency in [Hz], magnitude and phase in [rad], without jumps of revolutions."""
        phase = np.unwrap(np.angle(self.values))
        return {"frequency": self.frequency, "magnitude": np.abs(self.values), "phase": phase}


def frequency_response(
    model: DynamicModel, text: str, initial: Mapping[str, float | str] | None = None
) -> FrequencyResponse:
    """Return the response that a text as "crank:P.x" or "P.y:distance:P,Q" names.

    Args:
        model: of the mechanism.
        text: load, colon, quantity, as `mechsim.dynamics.response` takes them.
        initial: coordinates near the equilibrium.

    Raises:
        InputError: for text of another form.
        AssemblyError: where no equilibrium is found.
    """
    load, colon, output = text.partition(":")
    if load in ("distance", "angle"):
        # the pair of names ends at the next colon
        pair, colon, output = output.partition(":")
        load = f"{load}:{pair}"
    if not (load and colon and output):
        raise InputError(f"response is {text!r}; give LOAD:QUANTITY, as in crank:P.x")
    modes = nearest_equilibrium(model, initial=initial).modes
    natural = [mode.frequency for mode in modes if mode.frequency > 0.0] or [1.0]
    frequency = np.geomspace(BELOW * min(natural), ABOVE * max(natural), FREQUENCIES)
    values = response(model, load, output, frequency, initial=initial)
    load_unit, unit = (numeric_quantity(name, model.mechanism).unit for name in (load, output))
    effort = "N" if load_unit == "m" else "(N m)"
    return FrequencyResponse(load, output, f"{unit}/{effort}", frequency, values)
