"""Controllers: efforts on joint coordinates that are expressions of the state and of time."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from mechsim.errors import InputError
from mechsim.model.expressions import Expression, compiled
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array

# a coordinate's value or rate, as crank.q or P.x.v, and not a number such as 2.5
_STATE = re.compile(r"(?<![\w.])([^\W\d][\w.]*)\.(q|v)(?![\w.])")


@dataclass(frozen=True)
class Controller:
    """An effort on a coordinate that depends on the state and on time.

    Attributes:
        coordinate: on which it acts.
        text: the effort in [N m] or [N]: an expression of coordinates `J.q` in [rad] or [m], rates `J.v` per
            second and the time `t` in [s].

    Raises:
        InputError: for text that is no such expression.

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
        """The coordinates that it reads and acts on."""
        return {self.coordinate, *(name for name, _ in self.inputs)}

    def effort(self, values: Mapping[str, Array], rates: Mapping[str, Array], time: Array) -> Array:
        """Return the effort at coordinates and rates in SI and times, (n,) each, in [N m] or [N]."""
        variables = {
            f"state_{k}_": (values if letter == "q" else rates)[name]
            for k, (name, letter) in enumerate(self.inputs)
        }
        return np.broadcast_to(self._expression({**variables, "t": time}), time.shape)

    def check(self, mechanism: Mechanism) -> None:
        """Raise InputError for a coordinate that a mechanism does not have."""
        names = [name for joint in mechanism.joints for name in joint.coordinates]
        for name in sorted(self.coordinates):
            if name not in names:
                raise InputError(
                    f"the controller of {self.coordinate} names {name!r}, no coordinate of {mechanism.name}; "
                    f"it has {', '.join(names)}"
                )
