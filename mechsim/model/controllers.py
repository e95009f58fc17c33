"""Controllers: drive forces on joint coordinates as expressions of the state and the time."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from mechsim.errors import InputError
from mechsim.model.expressions import Expression, compiled
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array

# value or rate of a coordinate, such as crank.q or P.x.v; not a number such as 2.5
_STATE = re.compile(r"(?<![\w.])([^\W\d][\w.]*)\.(q|v)(?![\w.])")


@dataclass(frozen=True)
class Controller:
    """A force or torque on a coordinate that depends on the state and the time.

    Attributes:
        coordinate: name of the coordinate it acts on.
        text: torque in [N m] or force in [N], an expression of the coordinates `J.q` in [rad] or [m], their
            rates `J.v` per second and the time `t` in [s].
        inputs: pairs (coordinate, "q" or "v") that the expression reads.

    Raises:
        InputError: if the text is not such an expression.

    Example:
        >>> import mechsim as ms
        >>> ms.Controller("crank", "-20*(crank.q - 0.5) - 2*crank.v")
        Controller(coordinate='crank', text='-20*(crank.q - 0.5) - 2*crank.v')
    """

    coordinate: str
    text: str
    inputs: tuple[tuple[str, str], ...] = field(init=False, repr=False, compare=False)
    _expression: Expression = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        inputs = tuple(dict.fromkeys((match[1], match[2]) for match in _STATE.finditer(self.text)))
        names = {pair: f"state_{k}_" for k, pair in enumerate(inputs)}
        text = _STATE.sub(lambda match: names[match[1], match[2]], self.text)
        try:
            expression = compiled(text, ("t", *names.values()))
        except InputError as error:
            raise InputError(
                f"the controller of {self.coordinate}, {self.text!r}, {error}; "
                "write an expression of J.q, J.v and t"
            ) from None
        object.__setattr__(self, "inputs", inputs)
        object.__setattr__(self, "_expression", expression)

    @property
    def coordinates(self) -> set[str]:
        """Names of the coordinates that it reads or acts on."""
        return {self.coordinate, *(name for name, _ in self.inputs)}

    def effort(self, values: Mapping[str, Array], rates: Mapping[str, Array], time: Array) -> Array:
        """Return the torque [N m] or force [N] at coordinates and rates in SI and times in [s], (n,) each."""
        variables = {
            f"state_{k}_": (values if letter == "q" else rates)[name]
            for k, (name, letter) in enumerate(self.inputs)
        }
        return np.broadcast_to(self._expression({**variables, "t": time}), time.shape)

    def check(self, mechanism: Mechanism) -> None:
        """Raise InputError if the mechanism lacks one of the coordinates."""
        names = [name for joint in mechanism.joints for name in joint.coordinates]
        for name in sorted(self.coordinates):
            if name not in names:
                raise InputError(
                    f"the controller of {self.coordinate} names {name!r}, which is no coordinate of "
                    f"{mechanism.name}; it has {', '.join(names)}"
                )
