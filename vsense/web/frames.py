"""Messages as WebSocket frames, and what a page says; `MESSAGES.md` has both."""

from __future__ import annotations

import json
import math
from collections import OrderedDict
from collections.abc import Mapping
from typing import Any

from vsense.hub import Message
from vsense.orders import Kind

KEPT = 64
"""Frames that are kept for other viewers who want the same message."""
PICTURES_MAX = 256
NAME_MAX = 200
FAR = 2**53
"""No whole number beyond it is exact in JavaScript."""


class Frames:
    """Makes frames, each once for all viewers. The web server's thread only."""

    def __init__(self) -> None:
        """Begins with none."""
        self._made: OrderedDict[int, tuple[Message, str | bytes]] = OrderedDict()

    def frame(self, message: Message) -> str | bytes:
        """Text, or bytes where the message has a blob."""
        # Messages cannot be hashed; while one is kept here, no other has its id.
        kept = self._made.get(id(message))
        if kept is not None:
            return kept[1]
        made = _frame(message)
        self._made[id(message)] = (message, made)
        if len(self._made) > KEPT:
            self._made.popitem(last=False)
        return made


def _frame(message: Message) -> str | bytes:
    head = [message.topic, message.time_ns, message.data]
    try:
        text = json.dumps(head, separators=(",", ":"), allow_nan=False)
    except ValueError:
        text = json.dumps(_finite(head), separators=(",", ":"))
    if not message.blob:
        return text
    encoded = text.encode()
    return len(encoded).to_bytes(4, "big") + encoded + message.blob


def _finite(value: Any) -> Any:
    """The same with null for every number that JSON does not have."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(item) for item in value]
    return value


def read(text: str) -> tuple[str, Any]:
    """Understands one sentence of a page.

    Returns:
        "order" with (Kind, value), "look" with a tag or None, "refresh" with a bool, "pictures"
        with a tuple of camera ids, "got" with a number of frames.

    Raises:
        ValueError: it is none of these; the text says so to the page.
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


def _order(said: dict[str, Any]) -> tuple[Kind, float]:
    value = said.get("value", 0)
    plain = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not plain or not abs(value) < FAR:
        raise ValueError(f"an order's value is not {value!r:.40}")
    try:
        return Kind(said["order"]), float(value)
    except ValueError:
        raise ValueError(f"there is no order {said['order']!r:.40}") from None


def _look(said: dict[str, Any]) -> int | None:
    tag = said["look"]
    if tag is None:
        return None
    return _whole(tag, "tag")


def _got(said: dict[str, Any]) -> int:
    return _whole(said["got"], "number of frames")


def _whole(value: Any, what: str) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value < FAR:
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
    if not all(isinstance(camera, str) and len(camera) <= NAME_MAX for camera in cameras):
        raise ValueError("pictures is a list of camera ids")
    return tuple(cameras)


_READERS = {
    "order": _order,
    "look": _look,
    "refresh": _refresh,
    "pictures": _pictures,
    "got": _got,
}
