"""From the bytes of an experiment file to its element tree, with the line of every element.

As a file may come from anywhere, no entity is expanded, no other file is opened, and size and depth
are bounded.
"""

from __future__ import annotations

from xml.parsers import expat

from vsense.errors import ConfigError
from vsense.xml.element import Document, Element

NAMESPACE = "urn:vsense:1"
"""Our own additions to ARGoS's format; their names start with `vs:` in the element tree."""

_PASSED_OVER = ("http://www.w3.org/2001/XMLSchema-instance", "http://www.w3.org/XML/1998/namespace")
"""Editors' hints, such as the place of a schema."""

_MAX_BYTES = 1 << 20
_MAX_DEPTH = 32
_SEPARATOR = " "


def parse(data: bytes, file: str) -> Element:
    """Reads the bytes of an XML file; returns its root element.

    Raises:
        ConfigError: the file is too large or too deep, is not well-formed, holds a DOCTYPE,
            an unknown namespace, or text between its elements.
    """
    if len(data) > _MAX_BYTES:
        raise ConfigError(file, 1, f"the file has {len(data)} bytes, expected at most {_MAX_BYTES}")
    return _TreeBuilder(file).build(data)


class _TreeBuilder:
    def __init__(self, file: str) -> None:
        self._document = Document(file)
        self._open: list[Element] = []
        self._root: Element | None = None
        self._parser = expat.ParserCreate(namespace_separator=_SEPARATOR)
        self._parser.buffer_text = True
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = self._end
        self._parser.CharacterDataHandler = self._text
        self._parser.StartDoctypeDeclHandler = self._doctype

    def build(self, data: bytes) -> Element:
        try:
            self._parser.Parse(data, True)
        except expat.ExpatError as error:
            reason = expat.ErrorString(error.code) or "unknown error"
            message = f"not well-formed XML: {reason} (column {error.offset + 1})"
            raise ConfigError(self._document.file, error.lineno, message) from None
        except (LookupError, ValueError) as error:
            # An encoding that Python does not know, or one that expat cannot use.
            raise ConfigError(self._document.file, 1, f"cannot be decoded: {error}") from None
        if self._root is None:
            raise self._error("holds no element")
        return self._root

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        if len(self._open) >= _MAX_DEPTH:
            raise self._error(f"more than {_MAX_DEPTH} elements inside each other")
        readable = {self._local(key): value for key, value in attributes.items()}
        readable.pop("", None)
        name = self._local(name) or name.rpartition(_SEPARATOR)[2]
        element = Element(self._document, name, self._parser.CurrentLineNumber, readable)
        if self._open:
            self._open[-1].append(element)
        else:
            self._root = element
        self._open.append(element)

    def _end(self, _name: str) -> None:
        self._open.pop()

    def _text(self, text: str) -> None:
        if text.strip():
            raise self._error(f"text {text.strip()[:40]!r} between the elements; expected none")

    def _doctype(self, *_declaration: object) -> None:
        raise self._error("a DOCTYPE is not accepted in an experiment file")

    def _local(self, name: str) -> str:
        """Shortens a name with its namespace; "" for one that is passed over."""
        uri, _, local = name.rpartition(_SEPARATOR)
        if uri in _PASSED_OVER:
            return ""
        if uri not in ("", NAMESPACE):
            raise self._error(f"unknown namespace {uri!r}, expected {NAMESPACE!r}")
        return f"vs:{local}" if uri else local

    def _error(self, message: str) -> ConfigError:
        return ConfigError(self._document.file, self._parser.CurrentLineNumber, message)
