"""Who plays in a series: spares of the roster are put in for robots that cannot go on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from vsense.base.terminal import Console
from vsense.config.casting import Casting
from vsense.config.roster import Roster
from vsense.studies.series.parts import PlanLoader, PlannedExperiment


class SeriesCast:
    """The robots of all conditions.

    Attributes:
        known: what each condition runs, with who plays now.
    """

    def __init__(
        self,
        loader: PlanLoader,
        known: Mapping[str, PlannedExperiment],
        roster: Roster | None,
        console: Console,
    ) -> None:
        """`known` are loaded with the casting of `loader`; without a roster there are no spares."""
        self.known = dict(known)
        self._loader, self._roster, self._console = loader, roster, console
        self._casting = loader.casting
        self._out: set[int] = set()
        first = {plays: tag for tag, plays in loader.casting.replaced}
        self._parts = {
            name: {first.get(r.tag, r.tag) for r in planned.experiment.robots}
            for name, planned in known.items()
        }

    @property
    def tags(self) -> set[int]:
        """Everybody who plays in some run."""
        return {r.tag for planned in self.known.values() for r in planned.experiment.robots}

    def spares(self) -> list[int]:
        """Spares that work, and do not play yet."""
        robots = () if self._roster is None else self._roster.robots
        free = (r.tag for r in robots if r.spare and not r.out_of_order)
        return [tag for tag in free if tag not in self._out | self.tags]

    def follow(self, condition: str, casting: Casting) -> None:
        """Goes on with whom people have put in while a run of a condition waited.

        Raises:
            VsenseError: an experiment cannot be played by them.
        """
        before = self.known[condition].experiment.casting.replaced
        if casting.replaced != before:
            # Those of other conditions' parts stay.
            others = tuple(pair for pair in self._casting.replaced if pair not in before)
            self._recast(replace(self._casting, replaced=others + casting.replaced))

    def put_in_for(self, gone: Mapping[int, str]) -> list[int]:
        """Puts a spare in for each of these robots, as far as there are spares, and says so.

        Args:
            gone: by tag, why each cannot go on.

        Returns:
            Those for whom there is no spare.

        Raises:
            VsenseError: an experiment cannot be played by the spares.
        """
        casting, spares, still = self._casting, self.spares(), []
        for tag, why in gone.items():
            if not spares:
                self._console.say(f"robot {tag} {why}; there is no spare for it", "warning")
                still.append(tag)
                continue
            spare = spares.pop(0)
            casting = casting.with_replaced((tag, spare))
            self._out.add(tag)
            text = f"robot {tag} {why}: robot {spare} plays its part from now on"
            self._console.say(text, "warning")
        if len(still) < len(gone):
            self._recast(casting)
        return still

    def _recast(self, casting: Casting) -> None:
        """Loads all conditions anew, as somebody else plays in them."""
        self._casting = casting
        for name, planned in self.known.items():
            # Another condition's experiment may not have that part.
            pairs = tuple(pair for pair in casting.replaced if pair[0] in self._parts[name])
            own = replace(casting, replaced=pairs)
            self.known[name] = self._loader.load(planned.condition, own)
