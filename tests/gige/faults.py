"""What befalls cameras: how it begins, what is told, how it ends."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from tests.gige.gvcp import Reader
from tests.gige.network import GigeCameras

VICTIM = 1
"""The camera that has the fault."""
OTHER_SIZE = ("--size", "300x200", "--sensor")


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault of the camera `VICTIM`.

    Attributes:
        name: What it is.
        begin, mend: Have it begin and end.
        kind, after: What is told of both; None: its end is not told.
        text: What the first must say.
        lasts: So many pictures of another camera long.
    """

    name: str
    begin: Callable[[GigeCameras], object]
    kind: str
    text: str
    mend: Callable[[GigeCameras], object]
    after: str | None
    lasts: int = 0


def telling(name: str, begin: str, kind: str, text: str, mend: str, after: str | None) -> Fault:
    """A fault that the camera itself has when it is told so."""
    return Fault(
        name,
        lambda rig: rig.tell(VICTIM, begin),
        kind,
        text,
        lambda rig: rig.tell(VICTIM, mend),
        after,
    )


def begin_again(rig: GigeCameras) -> None:
    """Starts the camera once more."""
    rig.start(VICTIM)


def cut(rig: GigeCameras) -> None:
    """Pulls its cable."""
    rig.net.cut(VICTIM)


def restore(rig: GigeCameras) -> None:
    """Plugs it in."""
    rig.net.restore(VICTIM)


FAULTS = [
    Fault("switched off and on", lambda rig: rig.kill(VICTIM), "gone", "gone", begin_again, "back"),
    Fault("cable out, and in at once", cut, "gone", "gives no pictures", restore, "back"),
    Fault("cable out for long", cut, "gone", "gives no pictures", restore, "back", lasts=35),
    Fault(
        "started again with another size",
        lambda rig: rig.start(VICTIM, words=OTHER_SIZE),
        "size",
        "300 x 200",
        begin_again,
        "fits",
    ),
    telling("frozen", "freeze", "frozen", "froze", "thaw", "running"),
    telling("black", "black", "dark", "dark", "normal", "light"),
    telling("white", "white", "saturated", "", "normal", "exposed"),
    telling("packets are lost", "lose 20", "damaged", "packets", "lose 0", "whole"),
    telling("too slow", "slow 4", "slow", "", "slow 10", "prompt"),
    telling("its clock jumps", "jump 5000", "clock", "", "jump -5000", None),
]


def hold(rig: GigeCameras) -> Reader:
    """Has another program control the camera, until it is released."""
    reader = Reader(rig.address(VICTIM))
    reader.take()
    return reader
