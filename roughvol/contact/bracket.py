"""The value of a quantity that a search looks for, and the solved states around it."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from roughvol.contact.state import Contact


@dataclass(frozen=True)
class Target:
    """The value of a quantity that never falls under more contact, such as A* or p* of a part of the surface.

    `elements`: it jumps with single elements, as A* does. `power`: it goes about with a power of the indentation.
    """

    measure: Callable[[Contact], float]
    value: float
    elements: bool = False
    power: bool = True

    def reached(self, contact: Contact) -> bool:
        """Return whether a contact has the value."""
        return self.measure(contact) >= self.value

    def guess(self, states: Sequence[Contact]) -> float:
        """Return Δ on the power law through the last two states, about Δ² from one state; infinite without any."""
        power, last = 2.0, states[-1]
        if not self.power or not (reached := self.measure(last)) > 0.0:
            return math.inf
        if len(states) > 1 and states[-2].approach > 0.0 and 0.0 < (before := self.measure(states[-2])) != reached:
            power = math.log(reached / before) / math.log(last.approach / states[-2].approach)
        return last.approach * float((self.value / reached) ** (1.0 / max(power, 0.5)))


class Bracket:
    """Solved states before a value (`short`) and from it on (`beyond`): at most two of each, the nearest first.

    `falls` if the indentation falls on the way to the value.
    """

    def __init__(self, short: Sequence[Contact], *, falls: bool = False) -> None:
        self.short, self.beyond = list(short), list[Contact]()
        self._sign = -1.0 if falls else 1.0

    def add(self, contact: Contact, reached: bool) -> None:
        """Put a state on its side, in place of a state at the same indentation."""
        for side in (self.short, self.beyond):
            side[:] = [state for state in side if state.approach != contact.approach]
        side, sign = (self.beyond, self._sign) if reached else (self.short, -self._sign)
        side.append(contact)
        side.sort(key=lambda state: sign * state.approach)
        del side[2:]

    @property
    def width(self) -> float:
        """Indentation from the nearest state before the value to the nearest beyond."""
        return self.beyond[0].approach - self.short[0].approach
