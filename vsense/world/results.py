"""The measures of a run by name: what loop functions, actuators and others write down."""

from __future__ import annotations

import math
from collections.abc import Iterator, MutableMapping

import numpy as np

from vsense.world.entities import WorldError


class Results(MutableMapping[str, float]):
    """Finite numbers by name; anything else is refused where it is written."""

    def __init__(self) -> None:
        self._numbers: dict[str, float] = {}

    def __getitem__(self, name: str) -> float:
        return self._numbers[name]

    def __setitem__(self, name: str, number: float) -> None:
        """Writes a measure down.

        Raises:
            WorldError: the name is none, or the number is not finite.
        """
        if not isinstance(name, str) or not name.strip() or not name.isprintable():
            raise WorldError(f"a result is called {name!r:.60}, expected a name")
        plain = isinstance(number, (int, float, np.integer, np.floating, np.bool_))
        if not plain or not math.isfinite(number):
            raise WorldError(f"result {name!r} is {number!r:.60}, expected a finite number")
        self._numbers[name] = float(number)

    def __delitem__(self, name: str) -> None:
        del self._numbers[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._numbers)

    def __len__(self) -> int:
        return len(self._numbers)

    def __repr__(self) -> str:
        return repr(self._numbers)
