"""Robots that loop functions in Python add before a run, where the file does not name them.

A hook `populate(space)` of the experiment's loop functions is called while the file is read. It
takes the place of ARGoS's C++ loop functions that add e-pucks to the space in Init:

    def populate(space):
        for i in range(20):
            space.add_robot(f"ep{i}", "automode", space.random.uniform(-1, 1), 0.1 * i - 1)

Robots that overlap are placed anew, as those of the file (`vsense.config.placement`).
"""

from __future__ import annotations

import math
import random
from collections.abc import Mapping

from vsense.base.errors import ConfigError
from vsense.base.files import read_bytes
from vsense.base.xml.element import Document, Element
from vsense.config.robots import ArenaContents, add_epuck
from vsense.config.specs import LoopSpec
from vsense.world.entities import Arena, WorldError
from vsense.world.loop_functions import LoopFunctions

HOOK = "populate"


class Space:
    """What `populate` may do.

    Attributes:
        arena: where the robots stand.
        params: the settings of the loop functions.
        random: to draw from; the file's seed decides.
    """

    def __init__(
        self, document: Document, spec: LoopSpec, bodies: ArenaContents, seed: int
    ) -> None:
        self.arena: Arena = bodies.arena
        self.params: Mapping[str, str] = dict(spec.params)
        self.random = random.Random(seed)
        self._document, self._line, self._bodies = document, spec.line, bodies

    def add_robot(
        self, name: str, controller: str, x_m: float, y_m: float, yaw_rad: float = 0.0
    ) -> None:
        """Adds an e-puck with the id `name`, driven by the controller of that id.

        Raises:
            WorldError: there is another thing with this id, or no such place.
        """
        robot = self._element("e-puck", id=str(name))
        place = f"{float(x_m)!r},{float(y_m)!r},0"
        turn = math.degrees(math.remainder(float(yaw_rad), 2.0 * math.pi))
        robot.append(self._element("body", position=place, orientation=f"{turn!r},0,0"))
        robot.append(self._element("controller", config=str(controller)))
        try:
            add_epuck(robot, self._bodies)
        except ConfigError as error:
            raise WorldError(error.message) from None

    def _element(self, name: str, **attributes: str) -> Element:
        return Element(self._document, name, self._line, attributes)


def populate(document: Document, spec: LoopSpec | None, bodies: ArenaContents, seed: int) -> None:
    """Calls the hook of loop functions that have one, if there are any.

    Raises:
        LoopFunctionsError: their file cannot be run, or the hook failed.
    """
    if spec is None or spec.program is not None:
        return
    if HOOK in read_bytes(spec.path).decode(errors="replace"):
        hooks = LoopFunctions(spec.path, spec.label, spec.params)
        hooks.populate(Space(document, spec, bodies, seed))
