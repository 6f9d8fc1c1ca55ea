"""The experiment's file with what people changed on the page, to be saved.

The text stays as it is, comments and all, but for the attributes that were changed, and for files
beside the original, which are named by their whole paths.
"""

from __future__ import annotations

import html
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape, quoteattr

from vsense.base.message_bus import Message
from vsense.base.xml.parsing import NAMESPACE
from vsense.config.experiment import ARGOS_SUFFIX, SHIPPED_FOLDER
from vsense.monitor.recording.form import ORDERS_TOPIC, Data
from vsense.run.changing import ChangeKind

_MARKUP = re.compile(
    r"""<(?:!--.*?(?:-->|\Z)|!\[CDATA\[.*?(?:\]\]>|\Z)|\?.*?(?:\?>|\Z))"""
    r"""|<(?P<end>/?)(?P<name>[\w:.-]+)(?![\w:.-])"""
    r"""(?P<attributes>(?:"[^"<]*"|'[^'<]*'|[^<>"'])*?)(?P<empty>/?)>""",
    re.DOTALL,
)
"""What does not end is looked at once: a recording may have any text for its file."""
_QUOTED = re.compile(r"""(["'])(.*?)\1""", re.DOTALL)
_VALUE = r"""(?<![\w:])%s\s*=\s*("[^"]*"|'[^']*')"""
_ATTRIBUTES = {
    "intensity": "intensity",
    "radius_m": "radius",
    "value": "value",
    "evaporation_per_s": "evaporation",
    "diffusion_m2_s": "diffusion",
}
"""Of things and fields, by the names of settings."""
_PLAIN = ("noise_level", "noise_std_dev")
"""Of sensors' settings those that ARGoS has, too."""
_AFFIXES = re.compile(r"^(vs:)?(epuck_)?(virtual_)?|(_virtual)?(_sensor)?$")

_Tag = re.Match[str]
"""The start of an element."""


class ArenaFile:
    """Follows an experiment and the changes of its world; the bus's thread and the server's.

    Attributes:
        name: of the experiment; "" before the first.
    """

    def __init__(self) -> None:
        self.name, self._text = "", ""
        self._path = ""
        self._seed: object = None
        self._orders: list[Any] = []

    def receive(self, message: Message) -> None:
        """Takes `/experiment` and `/orders`. The next run begins again as the file says."""
        data = message.data
        if message.topic != ORDERS_TOPIC:
            if (data.get("name"), data.get("seed")) != (self.name, self._seed):
                self._orders = []
            self._seed = data.get("seed")
            self.name, self._text = data.get("name", ""), data.get("file_text", "")
            self._path = (data.get("made") or {}).get("path", "")
        # A newcomer has a simulation say its newest change again.
        elif data not in self._orders[-1:]:
            self._orders.append(data)

    def edited(self) -> str:
        """The file's text with all changes; what it has no place for stands in comments."""
        text, left, added = self._text, list[str](), dict[str, Data]()
        for order in list(self._orders):
            change = order["change"]
            kind, name = change["kind"], change.get("name", "")
            if kind == ChangeKind.ADD:
                added[order["text"].partition(" stands at ")[0]] = change
            elif kind == ChangeKind.MOVE and name in added:
                added[name] = change
            elif kind == ChangeKind.REMOVE and name in added:
                del added[name]
            elif place := next(_places(text, change), None):
                text = _with(text, *place)
            else:
                left.append(order["text"])
        lines = [f"<!-- not in this file: {escape(line).replace('--', '- -')} -->" for line in left]
        lines += [_robot(name, change) for name, change in added.items()]
        head, end, tail = text.rpartition("</arena>")
        text = head + "".join(f"  {line}\n  " for line in lines) + end + tail
        if added and NAMESPACE not in text:
            root = next(tag for tag, _ in _tags(text))
            text = _with(text, root, "xmlns:vs", NAMESPACE)
        shipped, path = SHIPPED_FOLDER / f"{self.name}{ARGOS_SUFFIX}", self._path
        if os.path.isfile(shipped) and shipped.read_text() == self._text:
            path = str(shipped)
        return _from_anywhere(text, Path(path).parent) if path else text


def _from_anywhere(text: str, folder: Path) -> str:
    """The text in which files that lie in a folder are named by their whole paths."""

    def whole(match: re.Match[str]) -> str:
        path = folder / html.unescape(match[2])
        return quoteattr(str(path)) if match[2] and os.path.isfile(path) else match[0]

    parts, done = list[str](), 0
    for tag, _ in _tags(text):
        begin, end = tag.span("attributes")
        parts += text[done:begin], _QUOTED.sub(whole, text[begin:end])
        done = end
    return "".join([*parts, text[done:]])


def _robot(name: str, change: Data) -> str:
    pose = f'<body position="{_place(change)},0" orientation="0,0,0" />'
    return f'<e-puck id={quoteattr(name)} vs:virtual="true">{pose}</e-puck>'


def _place(change: Data) -> str:
    return f"{change['x_m']:.4g},{change['y_m']:.4g}"


def _tags(text: str) -> Iterator[tuple[_Tag, list[_Tag]]]:
    """Gives the starts of all elements, each with those that it is in."""
    above: list[_Tag] = []
    for tag in _MARKUP.finditer(text):
        if tag["end"]:
            del above[-1:]
        elif tag["name"]:
            yield tag, above
            if not tag["empty"]:
                above.append(tag)


def _of(tag: _Tag, attribute: str) -> str:
    found = re.search(_VALUE % attribute, tag["attributes"])
    return "" if found is None else found[1][1:-1]


def _places(text: str, change: Data) -> Iterator[tuple[_Tag, str, str]]:
    """Gives tags, attributes and values that say what a change of a thing or number says."""
    name, controller, setting = (change.get(key, "") for key in ("name", "controller", "setting"))
    value = change.get("value", "")
    value = value if isinstance(value, str) else f"{value:.10g}"
    for tag, above in _tags(text):
        owner = above[-1] if tag["name"] == "body" and above else tag
        z = _of(tag, "position").rpartition(",")[2]
        if change["kind"] == ChangeKind.MOVE:
            if z and _of(owner, "id") == name:
                yield tag, "position", f"{_place(change)},{z}"
        elif change["kind"] != ChangeKind.SET:
            return
        elif controller:
            is_own = controller in (_of(outer, "id") for outer in above)
            names = _of(tag, "name"), _AFFIXES.sub("", tag["name"])
            if is_own and above[-1]["name"] == "sensors" and name in names:
                yield tag, setting if setting in _PLAIN else f"vs:{setting}", value
        elif tag["name"] == "loop_functions" and not name:
            yield tag, setting, value
        elif name and _of(tag, "id") == name and setting in _ATTRIBUTES:
            yield tag, _ATTRIBUTES[setting], value


def _with(text: str, tag: _Tag, name: str, value: str) -> str:
    """The text with one attribute of a tag set."""
    begin, end = tag.span("attributes")
    before, pair = text[begin:end], f"{name}={quoteattr(value)}"
    after, count = re.subn(_VALUE % re.escape(name), lambda match: pair, before, count=1)
    if not count:
        after = f"{before.rstrip()} {pair}{' ' if tag['empty'] else ''}"
    return text[:begin] + after + text[end:]
