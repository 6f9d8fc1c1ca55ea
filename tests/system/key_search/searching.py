"""Loop functions that look for keys in the process in which they run."""

from __future__ import annotations

from memory_search import search

from vsense import World


class LoopFunctions:
    """One run."""

    done = False

    def pre_step(self, world: World) -> None:
        """Searches once, when all robots have their sessions."""
        if not self.done and world.run_timestep >= 8:
            self.done = True
            search("loop")
