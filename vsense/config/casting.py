"""Which real robots play the parts of an experiment: tags out of a roster, and spares put in.

A part is what an experiment's file has: a controller, a start, a name. A robot that has no tag in
the file is played by the next robot of the roster that works and is no spare; a robot that has one
by that robot. `--replace 23=37` has 37 play the part of 23.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from itertools import islice
from typing import Any

from vsense.base.errors import UsageError
from vsense.config.roster import SPARE, Roster
from vsense.vision.markers.families import load_family, ranked_tags

Pair = tuple[int, int]
"""A tag, and that of the robot that plays in its place."""


@dataclass(frozen=True, slots=True)
class Casting:
    """Who plays.

    Attributes:
        roster: what errors call the roster; "": there is none, and robots without a tag are given
            any that is free.
        free: the roster's robots that may be taken, in their order.
        others: tags of its other robots, each with why it is not taken.
        limit: so many robots play: the first of the file, or more than it has, which are added to
            its `<distribute>`. None: the file's.
        replaced: who plays in whose place.
        types: the kind of base of each robot that has one in the roster, such as "argos", or its
            driver, such as "thymio".
        here: tags of those that have no board, which the machine of a run drives.
        models: the model of each robot of which the roster says one.
    """

    roster: str = ""
    free: tuple[int, ...] = ()
    others: tuple[tuple[int, str], ...] = ()
    limit: int | None = None
    replaced: tuple[Pair, ...] = ()
    types: tuple[tuple[int, str], ...] = ()
    here: tuple[int, ...] = ()
    models: tuple[tuple[int, str], ...] = ()

    @classmethod
    def of(
        cls, roster: Roster | None, replaced: Iterable[Pair] = (), limit: int | None = None
    ) -> Casting:
        """Casts from a roster, None: there is none."""
        if roster is None:
            return cls(limit=limit, replaced=tuple(replaced))
        free = tuple(robot.tag for robot in roster.robots if robot.is_ready)
        others = tuple((r.tag, r.why_not) for r in roster.robots if not r.is_ready)
        types = tuple((r.tag, _type_of(r.base)) for r in roster.robots if r.base)
        here = tuple(robot.tag for robot in roster.robots if robot.is_driven_here)
        models = tuple((robot.tag, robot.model) for robot in roster.robots if robot.model)
        return cls(str(roster.path), free, others, limit, tuple(replaced), types, here, models)

    @classmethod
    def read(cls, data: Mapping[str, Any]) -> Casting:
        """Reads what `dataclasses.asdict` made of one, also from JSON."""
        names = ("others", "replaced", "types", "models")
        pairs = {name: tuple(map(tuple, data.get(name, ()))) for name in names}
        free, limit = tuple(data.get("free", ())), data.get("limit")
        here = tuple(data.get("here", ()))
        return cls(str(data.get("roster", "")), free, limit=limit, here=here, **pairs)

    def check(
        self, what: str, pair: Pair, playing: Mapping[int, str], worn: Collection[int]
    ) -> None:
        """Refuses a robot that cannot play another's part.

        Args:
            what: how errors call it.
            pair: of whom, and who.
            playing: the robots' models by their tags.
            worn: all tags in the experiment.

        Raises:
            UsageError: there is no such part, or the robot has one, is out of order, or is of
                another model.
        """
        out, new = pair
        if out not in playing:
            expected = ", ".join(map(str, playing))
            raise UsageError(f"{what}: no robot has tag {out}; expected one of {expected}")
        if new in worn:
            raise UsageError(f"{what}: {new} is in the experiment already")
        broken = [why for tag, why in self.others if tag == new and why != SPARE]
        if broken:
            raise UsageError(f"{what}: {new} is {broken[0]}")
        if unfit := self.unfit(new, playing[out]):
            raise UsageError(f"{what}: {new} {unfit}, as the part of {out} is")

    def unfit(self, tag: int, model: str) -> str:
        """Why a robot plays no part of a model's, for errors; "": it may, as far as the roster
        says."""
        own = next((name for other, name in self.models if other == tag), model)
        return "" if own == model else f"is of the model {own!r}, and not of {model!r}"

    def type_of(self, tag: int) -> str:
        """Of `types`; "": the roster has none."""
        return next((kind for other, kind in self.types if other == tag), "")

    def spares(self, playing: Collection[int]) -> list[int]:
        """The roster's spares that work and do not play."""
        return [tag for tag, why in self.others if why == SPARE and tag not in playing]


def _type_of(base: str) -> str:
    kind, _, device = base.partition(":")
    return device.split()[0].removesuffix(".py") if kind == "exec" and device.split() else kind


def pair(text: str) -> Pair:
    """Reads "23=37".

    Raises:
        ValueError: it is no such pair; the message says what was expected.
    """
    out, _, new = text.partition("=")
    words = out.strip(), new.strip()
    tags = [
        int(t) for t in words if t.isascii() and t.isdigit() and len(t) < 6 and int(t) < 1 << 16
    ]
    if len(tags) != 2 or tags[0] == tags[1]:
        raise ValueError(f"expected two tags, such as 23=37, got {text[:40]!r}")
    return tags[0], tags[1]


_MOST_CHOSEN = 128
"""Choosing takes about 10 ms a tag; the robots of larger swarms wear whatever is free."""


def free_tags(family: str, count: int, worn: Collection[int]) -> list[int]:
    """Chooses free tags, those of `vsense camera markers --ids auto:N` first.

    Another robot at the end of a file leaves the others theirs.
    """
    chosen = _well_apart(family, min(count + len(worn), _MOST_CHOSEN))
    taken = {*worn, *chosen}
    rest = (tag for tag in range(load_family(family).tags) if tag not in taken)
    free = [tag for tag in chosen if tag not in worn][:count]
    return [*free, *islice(rest, count - len(free))]


@cache
def _well_apart(family: str, count: int) -> tuple[int, ...]:
    """See `ranked_tags`; all that there are of a family that has not so many."""
    markers = load_family(family)
    return tuple(ranked_tags(markers, min(count, markers.tags)))
