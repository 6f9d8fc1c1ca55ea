"""What an arena tracker counts, and how a person is told of it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(slots=True)
class TrackerCounters:
    """What the tracker has noticed since it began.

    Attributes:
        old_frames: Frames not newer than the newest timestep already done, or beaten by a
            newer one in the same call; dropped.
        repeated_frames: Second and further frames of one camera in one timestep; dropped.
        out_of_reach: Sightings at places where their robot cannot have come.
        duplicates: Tags seen at two places at once, counted each timestep.
        overflows: Pictures with more in them than a detector's tables hold.
    """

    old_frames: int = 0
    repeated_frames: int = 0
    out_of_reach: int = 0
    duplicates: int = 0
    overflows: int = 0

    def notes(self) -> list[str]:
        """Returns a line for everything that is not zero."""
        facts = (
            (self.old_frames, "pictures older than the newest were dropped"),
            (self.repeated_frames, "pictures of a camera that had delivered already were dropped"),
            (self.overflows, "pictures held more than the detector's tables"),
            (self.out_of_reach, "sightings were out of their robot's reach"),
            (self.duplicates, "times a tag was at two places at once"),
        )
        return [f"{count} {what}" for count, what in facts if count]
