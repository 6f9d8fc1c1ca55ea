"""One element of an experiment file, with its line and what has been read of it.

A reader asks an element for attributes and children by name; what was not asked for is an error at
the end that lists the names that are known: so a misspelt key is an error, not a silent
default.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from vsense.base.errors import ConfigError, instead, likely

MAX_SHOWN = 60
"""Characters of a value that an error repeats."""

COUNTS = ("no", "one", "two", "three", "four")


@dataclass(slots=True)
class Document:
    """An experiment file while it is read.

    Attributes:
        passed_over: line and words for each thing that is not done as the file asks.
        lenient: what nobody asked for is a warning, no error: so in a file of ARGoS that has
            no name of our own namespace, as ARGoS passes over what it does not know.
    """

    file: str
    passed_over: list[tuple[int, str]] = field(default_factory=list)
    lenient: bool = False

    def warnings(self) -> tuple[str, ...]:
        """What is passed over, in the file's order: `file:line: what happens instead`.

        An element that stands for many robots tells it for each of them: it is said once.
        """
        entries = sorted(set(self.passed_over))
        return tuple(f"{self.file}:{line}: {words}" for line, words in entries)


def shown(text: str) -> str:
    """A value in quotes, a long one cut."""
    return repr(text if len(text) <= MAX_SHOWN else text[:MAX_SHOWN] + "...")


_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")
_INTEGER = re.compile(r"[+-]?[0-9]{1,15}")
_OURS = "vs:"


class Element:
    """One element of an experiment file.

    What reads an attribute raises ConfigError where the attribute is absent and has no default, is
    malformed, or is out of range.

    Attributes:
        name: its name; one of our own namespace starts with `vs:`.
        line: line of its start tag, from 1.
        document: the file that it stands in.
    """

    __slots__ = (
        "_asked_attributes",
        "_asked_children",
        "_attributes",
        "_children",
        "_left_out",
        "_settings",
        "_text",
        "document",
        "line",
        "name",
    )

    def __init__(
        self, document: Document, name: str, line: int, attributes: dict[str, str]
    ) -> None:
        self.document = document
        self.name = name
        self.line = line
        self._attributes = attributes
        self._children: list[Element] = []
        self._asked_attributes: set[str] = set()
        self._asked_children: set[str] = set()
        self._left_out = False
        self._settings: dict[str, str] = {}
        self._text: tuple[str, tuple[int, str]] | None = None

    def append(self, child: Element) -> None:
        """Adds a child element: the parser's part."""
        self._children.append(child)

    def begin_with(self, text: str, warning: tuple[int, str]) -> None:
        """Notes the text at its begin, and the warning that it has no effect: the parser's part."""
        self._text = text, warning
        self.document.passed_over.append(warning)

    def take_text(self) -> str:
        """The text at its begin, with single blanks: it has an effect; "" where there is none."""
        if self._text is None:
            return ""
        text, warning = self._text
        if warning in self.document.passed_over:
            self.document.passed_over.remove(warning)
        return " ".join(text.split())

    def set(self, key: str, value: str) -> None:
        """Overrides an attribute, or adds it; the prefix of our own namespace may be left out."""
        self._settings[key.removeprefix(_OURS)] = value

    @property
    def added(self) -> frozenset[str]:
        """Attributes that are set from outside and do not stand in the file."""
        there = {key.removeprefix(_OURS) for key in self._attributes}
        return frozenset(self._settings.keys() - there)

    def is_set(self, key: str) -> bool:
        """Whether an attribute's value comes from outside the file."""
        return key.removeprefix(_OURS) in self._settings

    def peek(self, key: str) -> str | None:
        """An attribute as it stands, None where it is absent, without counting it as read."""
        return self._settings.get(key.removeprefix(_OURS), self._attributes.get(key))

    def walk(self) -> Iterator[Element]:
        """This element and all below it that are not left out, in the file's order."""
        if not self._left_out:
            yield self
            for child in self._children:
                yield from child.walk()

    def error(self, message: str, attribute: str | None = None) -> ConfigError:
        """Makes the error that this element, or one attribute of it, is wrong."""
        subject = f"<{self.name}>" if attribute is None else f"<{self.name}> {attribute}"
        if attribute is not None and self.is_set(attribute):
            subject += " (set from outside the file)"
        return ConfigError(self.document.file, self.line, f"{subject}: {message}")

    def warn(self, message: str) -> None:
        """Notes for the user what happens instead of what this element asks for."""
        self.document.passed_over.append((self.line, f"<{self.name}> {message}"))

    def leave_out(self, instead: str) -> None:
        """Passes over this element with all that is in it, and says so in a warning."""
        self._left_out = True
        self.warn(f"is not supported: {instead}")

    @property
    def has_own_attribute(self) -> bool:
        """Whether an attribute is of our own namespace."""
        return any(key.startswith(_OURS) for key in self._attributes)

    def was_asked(self, key: str) -> bool:
        """Whether somebody has asked for an attribute."""
        return key in self._asked_attributes

    def has(self, key: str) -> bool:
        """Whether an optional attribute is there."""
        self._asked_attributes.add(key)
        return self.peek(key) is not None

    def text(self, key: str, default: str | float | None = None, expected: str = "a text") -> str:
        """Reads an attribute without blanks around it; `expected` is the value's name in errors."""
        given = self.peek(key) if self.has(key) else default
        if given is None:
            raise self.error(f"is missing, expected {expected}{likely(key, self._attributes)}", key)
        value = str(given).strip()
        if not value:
            raise self.error(f"is empty, expected {expected}", key)
        return value

    def number(
        self, key: str, low: float, high: float, unit: str = "", default: float | None = None
    ) -> float:
        """Reads a finite number within [low, high]."""
        text = self.text(key, default, f"a number from {low:g} to {high:g} {unit}".rstrip())
        return self._number(key, text, low, high, unit)

    def integer(
        self, key: str, low: int, high: int, default: int | None = None, why: str = ""
    ) -> int:
        """Reads a whole number within [low, high]; `why` explains the range in the error."""
        text = self.text(key, default, f"a whole number from {low} to {high}")
        text = self._beginning(key, text, _INTEGER)
        if not _INTEGER.fullmatch(text):
            raise self.error(f"{shown(text)} is not a whole number from {low} to {high}", key)
        if not low <= int(text) <= high:
            allowed = f"{low} to {high}{why and f': {why}'}"
            raise self.error(f"{text[:MAX_SHOWN]} is out of range, expected {allowed}", key)
        return int(text)

    def share(self, key: str) -> float:
        """Reads a percentage such as "50%" as a share in [0, 1]."""
        text = self.text(key, None, "a percentage such as '50%'")
        if not text.endswith("%"):
            raise self.error(f"{shown(text)} is not a percentage such as '50%'", key)
        return self._number(key, text[:-1].strip(), 0.0, 100.0, "%") / 100.0

    def angle(
        self, key: str, low_deg: float, high_deg: float, default_deg: float | None = None
    ) -> float:
        """Reads an angle in degrees as one in rad, not wrapped."""
        return math.radians(self.number(key, low_deg, high_deg, "deg", default_deg))

    def vector(
        self, key: str, low: float, high: float, unit: str = "", default: str | None = None
    ) -> tuple[float, float, float]:
        """Reads three numbers with commas between them; see `numbers`."""
        x, y, z = self.numbers(key, 3, low, high, unit, default)
        return x, y, z

    def numbers(
        self,
        key: str,
        count: int,
        low: float,
        high: float,
        unit: str = "",
        default: str | None = None,
    ) -> tuple[float, ...]:
        """Reads two or three numbers with commas between them, each within [low, high]."""
        letters = ",".join("xyz"[:count])
        text = self.text(key, default, f"{COUNTS[count]} numbers '{letters}' {unit}".rstrip())
        parts = [part.strip() for part in text.split(",")]
        if len(parts) != count or not all(parts):
            expected = f"{COUNTS[count]} numbers with commas between them"
            raise self.error(f"{shown(text)} is not {expected}", key)
        return tuple(self._number(key, part, low, high, unit) for part in parts)

    def points(
        self, key: str, least: int, most: int, far: float, unit: str = ""
    ) -> list[tuple[float, float]]:
        """Reads `least` to `most` points 'x,y x,y', each number within [-far, far]."""
        expected = f"{least} to {most} points 'x,y x,y' {unit}".rstrip()
        text = self.text(key, None, expected)
        pairs = [point.split(",") for point in text.split()]
        if any(len(pair) != 2 for pair in pairs):
            raise self.error(f"{shown(text)} are no points, expected {expected}", key)
        if not least <= len(pairs) <= most:
            raise self.error(f"{shown(text)} has {len(pairs)} points, expected {expected}", key)
        numbers = [[self._number(key, n, -far, far, unit) for n in pair] for pair in pairs]
        return [(x, y) for x, y in numbers]

    def boolean(self, key: str, default: bool | None = None) -> bool:
        """Reads "true" or "false"."""
        fallback = None if default is None else str(default).lower()
        return self.choice(key, ("true", "false"), fallback) == "true"

    def choice(self, key: str, choices: Sequence[str], default: str | None = None) -> str:
        """Reads one of several words."""
        expected = ", ".join(choices)
        text = self.text(key, default, f"one of: {expected}")
        if text not in choices:
            raise self.error(f"{shown(text)} is not one of: {expected}", key)
        return text

    def integers(self, key: str, low: int, high: int) -> list[int]:
        """Reads whole numbers within [low, high] with blanks or commas between them."""
        text = self.text(key, None, f"whole numbers from {low} to {high}")
        parts = text.replace(",", " ").split()
        for part in parts:
            if not _INTEGER.fullmatch(part) or not low <= int(part) <= high:
                raise self.error(f"{shown(part)} is not a whole number from {low} to {high}", key)
        return [int(part) for part in parts]

    def free_attributes(self) -> dict[str, str]:
        """All attributes of an element whose keys are the user's own."""
        self._asked_attributes.update(self._attributes, self._settings)
        return {**self._attributes, **self._settings}

    def children(self, *names: str) -> list[Element]:
        """The children of these names, in the file's order; without names all of them."""
        self._asked_children.update(names or self.child_names())
        return self.below(*names)

    def below(self, *names: str) -> list[Element]:
        """The same children as `children`, without counting them as read."""
        return [child for child in self._children if not names or child.name in names]

    def optional_child(self, name: str) -> Element | None:
        """The only child of this name, or None; ConfigError where there are two."""
        nodes = self.children(name)
        if len(nodes) > 1:
            raise nodes[1].error(f"appears twice in <{self.name}>, first in line {nodes[0].line}")
        return nodes[0] if nodes else None

    def child(self, name: str) -> Element:
        """The only child of this name; ConfigError where there is none, or there are two."""
        element = self.optional_child(name)
        if element is None:
            raise self.error(f"<{name}> is missing in it{likely(name, self.child_names())}")
        return element

    def check_all_read(self) -> None:
        """Raises ConfigError for an attribute or child that was not asked for, here and below.

        In a lenient document it is a warning.
        """
        if self._left_out:
            return
        asked = self._asked_attributes
        unset = self._settings.keys() - {key.removeprefix(_OURS) for key in asked}
        if unset or not self.document.lenient:
            for key in (*unset, *(k for k in self._attributes if k not in asked)):
                raise self.error(
                    f"is not an attribute of it; {instead(key, asked, 'known are')}", key
                )
        self._pass_over_rest()
        for child in self._children:
            if child.name not in self._asked_children and not child._left_out:
                child._misplaced(self)
            child.check_all_read()

    def _pass_over_rest(self) -> None:
        """Warns of every attribute that was not asked for."""
        asked = self._asked_attributes
        for key in self._attributes:
            if key not in asked:
                self.warn(f"{key} is not known here: it has no effect{likely(key, asked)}")

    def _misplaced(self, parent: Element) -> None:
        """Refuses an element that its parent does not know, or passes over it."""
        asked, place = parent._asked_children, f"<{parent.name}>"
        if not self.document.lenient:
            hint = instead(self.name, asked, "known there are")
            raise self.error(f"does not belong in {place}; {hint}")
        self.leave_out(f"it is not known in {place}{likely(self.name, asked)}")

    def child_names(self) -> list[str]:
        """The children's names in the file's order, without counting them as read."""
        return [child.name for child in self._children]

    def _beginning(self, key: str, text: str, form: re.Pattern[str]) -> str:
        """Of a text that goes on after a number, the number: ARGoS reads no further."""
        begins = form.match(text) if self.document.lenient else None
        if begins is None or begins.end() == len(text):
            return text
        self.warn(f"{key}: {shown(text)} is read as {begins[0]}")
        return begins[0]

    def _number(self, key: str, text: str, low: float, high: float, unit: str) -> float:
        text = self._beginning(key, text, _NUMBER)
        if not _NUMBER.fullmatch(text):
            raise self.error(f"{shown(text)} is not a number", key)
        if not low <= float(text) <= high:
            allowed = f"{low:g} to {high:g} {unit}".rstrip()
            raise self.error(f"{text[:MAX_SHOWN]} is out of range, expected {allowed}", key)
        return float(text)
