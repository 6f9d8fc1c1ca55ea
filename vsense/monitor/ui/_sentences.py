"""What pages say over the WebSocket, checked: anybody may speak there (`MESSAGES.md`)."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

from vsense.run.changing import Change
from vsense.run.orders import OrderKind, read_pair

PICTURES_MAX = 256
CAMERA_NAME_MAX = 200
LOOKS_MAX = 16
INTEGER_MAX = 2**53
"""Greater whole numbers are not exact in JavaScript."""


class ChangeReadError(ValueError):
    """A sentence is a change of the world, but none that can be: its answer has no turn."""


def read(text: str) -> tuple[str, Any]:
    """Reads one sentence of a page; the text of a ValueError is for the page.

    ChangeReadError where it was a change.

    Gives "order" with (Kind, value, pair), "change" with a `Change`, "look" with tags, "refresh"
    with a bool, "pictures" with a tuple of camera ids, or "got" with a number of frames.
    """
    try:
        said = json.loads(text)
    except (ValueError, RecursionError):
        raise ValueError("that was not JSON") from None
    if isinstance(said, dict):
        for name, reader in _READERS.items():
            if name in said:
                return name, reader(said)
    raise ValueError(f"not understood: {text:.60}")


def _order(said: dict[str, Any]) -> tuple[OrderKind, float, tuple[int, int]]:
    value = said.get("value", 0)
    plain = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not plain or not abs(value) < INTEGER_MAX:
        raise ValueError(f"an order's value is not {value!r:.40}")
    pair = read_pair(said.get("pair", [0, 0]))
    try:
        return OrderKind(said["order"]), float(value), pair
    except ValueError:
        raise ValueError(f"there is no order {said['order']!r:.40}") from None


def _change(said: dict[str, Any]) -> Change:
    try:
        return Change.read(said["change"])
    except ValueError as error:
        raise ChangeReadError(str(error)) from None


def _integer(value: Any, what: str) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value < INTEGER_MAX:
        raise ValueError(f"not a {what}: {value!r:.40}")
    return value


def _refresh(said: dict[str, Any]) -> bool:
    if not isinstance(said["refresh"], bool):
        raise ValueError("refresh is true or false")
    return bool(said["refresh"])


def _pictures(said: dict[str, Any]) -> tuple[str, ...]:
    cameras = said["pictures"]
    if not isinstance(cameras, list) or len(cameras) > PICTURES_MAX:
        raise ValueError("pictures is a list of camera ids")
    if not all(isinstance(camera, str) and len(camera) <= CAMERA_NAME_MAX for camera in cameras):
        raise ValueError("pictures is a list of camera ids")
    return tuple(cameras)


def _tags(said: dict[str, Any]) -> tuple[int, ...]:
    wanted = said["look"]
    tags = wanted if isinstance(wanted, list) else [] if wanted is None else [wanted]
    if len(tags) > LOOKS_MAX:
        raise ValueError(f"a page looks at {LOOKS_MAX} robots at most")
    return tuple(_integer(tag, "tag") for tag in tags)


_READERS: dict[str, Callable[[dict[str, Any]], Any]] = {
    "order": _order,
    "change": _change,
    "look": _tags,
    "refresh": _refresh,
    "pictures": _pictures,
    "got": lambda said: _integer(said["got"], "number of frames"),
}
