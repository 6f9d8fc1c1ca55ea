"""All Python targets by name: what each reads, and how a user is told that it is wrong."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

from tests.fuzz import file_rooms, link_rooms, recording_rooms, server_rooms, study_rooms
from vsense.base.errors import VsenseError

Scene = Any
"""What a room makes once and uses in every case."""


@dataclass(frozen=True, slots=True)
class Room:
    """One target.

    Attributes:
        prepare: makes what all cases use; its folder is empty and goes with the run.
        case: tries one case, made from the source of chance alone; asserts what must hold.
        refusals: what a case may raise: the documented way to say no.
    """

    prepare: Callable[[Path], Scene]
    case: Callable[[Random, Scene], None]
    refusals: tuple[type[BaseException], ...] = (VsenseError,)


ROOMS: dict[str, Room] = {
    "py-argos": Room(file_rooms.prepare_argos, file_rooms.argos),
    "py-session": Room(file_rooms.prepare_session, file_rooms.session),
    "py-camera": Room(file_rooms.prepare_camera, file_rooms.camera),
    "py-family": Room(file_rooms.prepare_family, file_rooms.family),
    "py-lists": Room(file_rooms.prepare_lists, file_rooms.lists),
    "py-tables": Room(file_rooms.prepare_tables, file_rooms.tables),
    "py-policy": Room(file_rooms.prepare_policy, file_rooms.policy),
    "py-lines": Room(link_rooms.prepare_nothing, link_rooms.lines),
    "py-original": Room(link_rooms.prepare_nothing, link_rooms.original),
    "py-legacy": Room(link_rooms.prepare_nothing, link_rooms.legacy),
    "py-sentences": Room(link_rooms.prepare_nothing, link_rooms.sentences, (ValueError,)),
    "py-socket": Room(link_rooms.prepare_socket, link_rooms.control_socket),
    "py-access": Room(link_rooms.prepare_nothing, link_rooms.access, link_rooms.ACCESS_REFUSALS),
    "py-wire": Room(link_rooms.prepare_nothing, link_rooms.wire, link_rooms.WIRE_REFUSALS),
    "py-roster": Room(link_rooms.prepare_nothing, link_rooms.roster, link_rooms.WIRE_REFUSALS),
    "py-server": Room(server_rooms.prepare, server_rooms.server, ()),
    "py-mcap": Room(recording_rooms.prepare, recording_rooms.damaged),
    "py-mcap-json": Room(recording_rooms.prepare, recording_rooms.untrue),
    "py-package": Room(study_rooms.prepare_package, study_rooms.package),
    "py-study": Room(study_rooms.prepare_study, study_rooms.study),
}
