"""From the bytes of an experiment file to its element tree, with the line of every element.

As a file may come from anywhere, no entity is expanded, no other file is opened, and size and depth
are bounded.
"""

from __future__ import annotations

import codecs
import re
from collections.abc import Callable
from xml.parsers import expat

from vsense.base.errors import ConfigError
from vsense.base.xml.element import Document, Element

NAMESPACE = "urn:vsense:1"
"""Our own additions to ARGoS's format; their names start with `vs:` in the element tree."""

_PASSED_OVER = ("http://www.w3.org/2001/XMLSchema-instance", "http://www.w3.org/XML/1998/namespace")
"""Editors' hints, such as the place of a schema."""

_MAX_BYTES = 1 << 20
_MAX_DEPTH = 32
_SEPARATOR = " "
_OURS = "vs:"

_TAKEN = re.compile(
    rb"""<!\[CDATA\[(?:.*?\]\]>|.*)|<!--(?:(.*?)-->|.*)|("[^"<]*"|'[^'<]*')([A-Za-z_:]?)"""
    rb"""|>[^<]*|(?<=[\w.:-])\s*=\s*([^\s"'<>/]+)(["']?)""",
    re.DOTALL,
)
"""What TinyXML takes beside XML: any comment up to the first `-->`, attributes without a blank
between them, and values without quotes unless a quote ends them. What does not end reaches to the
end of the file, which is searched once."""


def parse(data: bytes, file: str, of_argos: bool = False) -> Element:
    """Reads the bytes of an XML file; returns its root element.

    Args:
        of_argos: take what ARGoS's parser takes: dashes in comments, attributes without blanks
            between them, and with a warning values without quotes and text between the elements.
            The document is lenient if it has no name of our namespace.

    Raises:
        ConfigError: the file is too large or too deep, is not well-formed, holds a DOCTYPE,
            an unknown namespace, or text between its elements.
    """
    if len(data) > _MAX_BYTES:
        raise ConfigError(file, 1, f"the file has {len(data)} bytes, expected at most {_MAX_BYTES}")
    if not of_argos:
        return _TreeBuilder(file).build(data)
    readable, line = _as_utf8(data)
    bare: list[re.Match[bytes]] = []
    root = _TreeBuilder(file, stray_text=True).build(_TAKEN.sub(_repairing(bare), readable))
    root.document.lenient = not _uses_namespace(root)
    if bare:
        first, more = bare[0], f" (nor have {len(bare) - 1} more)" if bare[1:] else ""
        words = f"the value {first[4].decode()[:40]!r} has no quotes{more}; XML asks for them"
        root.document.passed_over.append((1 + readable.count(b"\n", 0, first.start(4)), words))
    if line:
        warning = line, "what is no UTF-8 is read as Latin-1; with encoding= in line 1 it is sure"
        root.document.passed_over.append(warning)
    return root


def _as_utf8(data: bytes) -> tuple[bytes, int]:
    """Gives a file that is said to be UTF-8, or of which nothing is said, as what it is, and the
    line that shows that it is Latin-1, else 0: ARGoS's parser takes all bytes."""
    said = _ENCODING.match(data)
    declared = said is not None and said[1].lower() not in (b"utf-8", b"utf8")
    if declared or data.startswith((codecs.BOM_UTF16_BE, codecs.BOM_UTF16_LE)):
        return data, 0
    try:
        data.decode()
    except UnicodeDecodeError as error:
        plain = data if said is None else data.replace(said[0], b"<?xml version='1.0'", 1)
        return plain.decode("latin-1").encode(), data.count(b"\n", 0, error.start) + 1
    return data, 0


_ENCODING = re.compile(rb"""\s*<\?xml[^>]*?\sencoding\s*=\s*["']([^"'>]*)["']""")


def _repairing(bare: list[re.Match[bytes]]) -> Callable[[re.Match[bytes]], bytes]:
    """What makes XML of what `_TAKEN` finds: blank dashes in a comment, a blank after a value,
    quotes around one; those that had none are appended to `bare`."""

    def repaired(match: re.Match[bytes]) -> bytes:
        comment, value, after, unquoted, quote = match.groups()
        if comment is not None:
            return b"<!--" + comment.replace(b"-", b" ") + b"-->"
        if unquoted is not None and not quote:
            bare.append(match)
            return b'="' + unquoted + b'"' + b"\n" * match[0].count(b"\n")
        return value + b" " + after if after else match[0]

    return repaired


def _uses_namespace(root: Element) -> bool:
    """Whether an element or attribute is of our own namespace."""
    return any(e.name.startswith(_OURS) or e.has_own_attribute for e in root.walk())


_OPEN = [
    expat.errors.codes[words]
    for words in (expat.errors.XML_ERROR_TAG_MISMATCH, expat.errors.XML_ERROR_NO_ELEMENTS)
]
"""An end tag that closes another element, and a file that ends before all are closed."""


class _TreeBuilder:
    def __init__(self, file: str, stray_text: bool = False) -> None:
        self._document = Document(file)
        self._stray_text = stray_text
        self._open: list[Element] = []
        self._begun: list[bool] = []
        self._root: Element | None = None
        self._parser = expat.ParserCreate(namespace_separator=_SEPARATOR)
        self._parser.buffer_text = True
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = self._end
        self._parser.CharacterDataHandler = self._text
        # With it a comment ends a text, and both keep their lines.
        self._parser.CommentHandler = self._comment
        self._parser.StartDoctypeDeclHandler = self._doctype

    def build(self, data: bytes) -> Element:
        try:
            self._parser.Parse(data, True)
        except expat.ExpatError as error:
            reason = expat.ErrorString(error.code) or "unknown error"
            message = f"not well-formed XML: {reason} (column {error.offset + 1})"
            if not data.strip():
                message = "the file is empty"
            elif self._open and error.code in _OPEN:
                message += (
                    f"; <{self._open[-1].name}>, opened in line {self._open[-1].line}, is open"
                )
            if error.code == expat.errors.codes[expat.errors.XML_ERROR_UNBOUND_PREFIX]:
                message += f'; names with vs: need xmlns:vs="{NAMESPACE}" in the first element'
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
            self._begun[-1] = True
        else:
            self._root = element
        self._open.append(element)
        self._begun.append(False)

    def _end(self, _name: str) -> None:
        self._open.pop()
        self._begun.pop()

    def _comment(self, _text: str) -> None:
        if self._begun:
            self._begun[-1] = True

    def _text(self, text: str) -> None:
        if words := text.strip():
            if not self._stray_text:
                raise self._error(f"text {words[:40]!r} between the elements; expected none")
            # The parser gives it when it has come to what follows.
            after = text[len(text) - len(text.lstrip()) :].count("\n")
            line = self._parser.CurrentLineNumber - after
            warning = line, f"text {words[:40]!r} between the elements has no effect"
            # As ARGoS's parser has it: an element's text is the one with which it begins.
            if not self._begun[-1]:
                self._open[-1].begin_with(text, warning)
            else:
                self._document.passed_over.append(warning)
            self._begun[-1] = True

    def _doctype(self, *_declaration: object) -> None:
        raise self._error("a DOCTYPE is not accepted in an experiment file")

    def _local(self, name: str) -> str:
        """Shortens a name with its namespace; "" for one that is passed over."""
        uri, _, local = name.rpartition(_SEPARATOR)
        if uri in _PASSED_OVER:
            return ""
        if uri not in ("", NAMESPACE):
            raise self._error(f"unknown namespace {uri!r}, expected {NAMESPACE!r}")
        return f"{_OURS}{local}" if uri else local

    def _error(self, message: str) -> ConfigError:
        return ConfigError(self._document.file, self._parser.CurrentLineNumber, message)
