"""Mutations that know what they change: texts and their words, JSON values, XML trees, tables.

All of them take the source of chance as an argument, and nothing else decides.
"""

from __future__ import annotations

import contextlib
import copy
import json
import re
from collections.abc import Callable, Sequence
from random import Random
from typing import Any
from xml.etree import ElementTree

NUMBERS = (
    "0", "-0", "-1", "1", "2", "0.5", "1e-9", "1e9", "1e308", "1e309", "1e400", "-1e400", "nan",
    "inf", "-inf", "NaN", "Infinity", "4294967295", "4294967296", "9223372036854775807",
    "18446744073709551616", "1_000", "0x10", "1e", ".5", "5.", "+3", " 7 ", "\u0661", "\uff11",
    "65536", "-32769", "2147483648", "1,5", "1e5", "100000", "1e-400", "00012", "7" * 40,
    "1" + "0" * 5000,
)  # fmt: skip
"""As people, programs and attackers write them."""
TEXTS = (
    "", " ", "\t", "a", "x" * 300, "x" * 140_000, "é", "\u202e", "\u2028", "\x7f", "%s%n", "../..",
    "/etc/passwd", "/dev/zero", "/dev/stdin", "a/b", ".", "..", "#", "=", "true", "false", "None",
    "0,0,0", "0,0", "1,2,3,4", ",", ";", "<", "&amp;", "&#0;", "]]>", "--", "\ud800", "\ufeff",
    "epuck", "all", "e1", "white", "aux", "__class__", "{}", "[]", "*", "\\", "'", '"',
)  # fmt: skip
VALUES: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 1.5, -0.0, 1e308, -1e308, 1e-320, float("nan"), float("inf"),
    float("-inf"), 2**31, 2**53, 2**63, 2**64, 10**30, 10**400, "", "a", "1", "nan", [], {}, [[]],
    [1], [None], {"a": 1}, "x" * 1000, "\ud800", "\x00",
)  # fmt: skip
"""For JSON."""
_NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
_WORD = re.compile(r"[A-Za-z_][A-Za-z_0-9.]*")


def few(random: Random, most: int = 4) -> int:
    """From 1 on, mostly few."""
    return 1 + min(int(random.expovariate(0.9)), most - 1)


def text(random: Random, source: str) -> str:
    """A text with numbers, words and characters that have changed."""
    for _ in range(few(random)):
        source = random.choice(_TEXT_CHANGES)(random, source)
    return source


def _change_match(random: Random, source: str, pattern: re.Pattern[str], new: str) -> str:
    found = list(pattern.finditer(source))
    if not found:
        return source + new
    match = random.choice(found)
    return source[: match.start()] + new + source[match.end() :]


def _number(random: Random, source: str) -> str:
    return _change_match(random, source, _NUMBER, random.choice(NUMBERS))


def _word(random: Random, source: str) -> str:
    others = _WORD.findall(source)
    new = random.choice(others) if others and random.random() < 0.6 else random.choice(TEXTS)
    return _change_match(random, source, _WORD, new)


def _insert(random: Random, source: str) -> str:
    place = random.randrange(len(source) + 1)
    new = random.choice((*TEXTS, *NUMBERS, "\n", "\r\n", "\x00", chr(random.randrange(1, 0xD800))))
    return source[:place] + new + source[place:]


def _cut(random: Random, source: str) -> str:
    begin = random.randrange(len(source) + 1)
    end = begin + random.choice((1, 1, 2, 5, 20, 200, len(source)))
    return source[:begin] + source[end:]


def _double(random: Random, source: str) -> str:
    lines = source.splitlines(keepends=True)
    if not lines:
        return source
    place = random.randrange(len(lines))
    lines.insert(random.randrange(len(lines) + 1), lines[place])
    return "".join(lines)


_TEXT_CHANGES: tuple[Callable[[Random, str], str], ...] = (
    _number, _number, _number, _word, _word, _insert, _cut, _double,
)  # fmt: skip


def raw(random: Random, data: bytes) -> bytes:
    """Bytes of which some have fallen over, are gone, are there twice, or are another's."""
    found = bytearray(data)
    for _ in range(few(random, 8)):
        kind = random.randrange(6)
        place = random.randrange(len(found) + 1)
        length = random.choice((1, 1, 2, 4, 8, 30, 300))
        if kind == 0 and place < len(found):
            found[place] ^= 1 << random.randrange(8)
        elif kind == 1:
            found[place : place + length] = random.randbytes(min(length, 8))
        elif kind == 2:
            del found[place : place + length]
        elif kind == 3:
            found[place:place] = found[place : place + length]
        elif kind == 4:
            ends = (b"\x00", b"\xff", b"\x7f", b"\x80", b"\xff\xff\xff\xff", bytes(8), b"\n")
            new = random.choice(ends)
            found[place : place + len(new)] = new
        elif random.random() < 0.3:
            del found[place:]
    return bytes(found)


def chunks(random: Random, data: bytes) -> list[bytes]:
    """The same bytes in pieces, as a network may bring them."""
    pieces = []
    while data:
        length = random.choice((1, 2, 3, 7, 60, 1000, len(data)))
        pieces.append(data[:length])
        data = data[length:]
    return pieces


def value(random: Random, source: Any) -> Any:
    """A JSON value, a few of whose members are others, gone, there twice or elsewhere."""
    found = {"": copy.deepcopy(source)}
    for _ in range(few(random)):
        _change_value(random, found)
    return found[""]


def _places(node: Any, found: list[tuple[Any, Any]]) -> None:
    if isinstance(node, dict):
        keys: Sequence[Any] = list(node)
    elif isinstance(node, list):
        keys = range(len(node))
    else:
        return
    for key in keys:
        found.append((node, key))
        _places(node[key], found)


def _change_value(random: Random, root: dict[str, Any]) -> None:
    places: list[tuple[Any, Any]] = []
    _places(root, places)
    node, key = random.choice(places)
    other_node, other_key = random.choice(places)
    kind = random.randrange(8)
    if kind == 0 and node is not root:
        del node[key]
    elif kind == 1 and isinstance(node, dict) and node is not root:
        node[random.choice(TEXTS)] = node.pop(key)
    elif kind == 2:
        node[key] = copy.deepcopy(other_node[other_key])
    elif kind == 3 and isinstance(node[key], list) and len(node[key]) < 1000:
        node[key] = node[key] * random.choice((2, 3, 50))
    elif kind == 4 and isinstance(node[key], (int, float)):
        factor = random.choice((-1, 0, 2, 1e-9, 1e9, 1e300))
        node[key] = node[key] * factor if abs(node[key]) < 1e15 else factor
    elif kind == 5:
        node[key] = [node[key]]
    else:
        node[key] = copy.deepcopy(random.choice(VALUES))


def as_json(random: Random, source: Any) -> str:
    """A JSON text of a changed value; now and then the text has changed, too."""
    said = json.dumps(value(random, source), indent=random.choice((None, None, 1)))
    chance = random.random()
    if chance < 0.15:
        return text(random, said)
    if chance < 0.17:
        depth = random.choice((5, 500, 3000))
        return random.choice(("[", '{"a":')) * depth + said
    return said


def xml(random: Random, source: bytes) -> bytes:
    """An XML file whose tree has changed; now and then its text, encoding or bytes, too."""
    # What only ARGoS's parser takes has no tree here.
    with contextlib.suppress(ElementTree.ParseError):
        root = ElementTree.fromstring(source)
        for _ in range(few(random, 6) if random.random() < 0.8 else 0):
            _change_tree(random, root)
        source = ElementTree.tostring(root, encoding="utf-8")
    chance = random.random()
    if chance < 0.15:
        return text(random, source.decode("utf-8", "replace")).encode("utf-8", "replace")
    if chance < 0.2:
        said = source.decode("utf-8", "replace")
        coding = random.choice(("utf-16", "latin-1", "utf-8-sig", "utf-32"))
        return said.encode(coding, "replace")
    return raw(random, source) if chance < 0.3 else source


def _change_tree(random: Random, root: ElementTree.Element) -> None:
    every = list(root.iter())
    element, other = random.choice(every), random.choice(every)
    names = list(element.attrib)
    kind = random.randrange(10)
    if kind < 4 and names:
        name = random.choice(names)
        element.set(name, _attribute(random, element.get(name, "")))
    elif kind == 4 and names:
        del element.attrib[random.choice(names)]
    elif kind == 5 and other.attrib:
        name = random.choice(list(other.attrib))
        element.set(name, other.get(name, ""))
    elif kind == 6 and len(element):
        element.remove(random.choice(list(element)))
    elif kind == 7 and other is not root:
        element.insert(random.randrange(len(element) + 1), copy.deepcopy(other))
    elif kind == 8:
        element.tag = random.choice(every).tag
    else:
        element.text = random.choice((*NUMBERS, "a", " "))


_XML_TEXTS = tuple(t for t in TEXTS if t.isprintable() and "\ud800" not in t)


def _attribute(random: Random, before: str) -> str:
    kind = random.randrange(5)
    if kind == 0:
        return random.choice(_XML_TEXTS)
    if kind < 4 and _NUMBER.search(before):
        return _number(random, before)
    return before + random.choice(_XML_TEXTS)
