"""The commands that pages show: in blocks of shell, and in prose between backticks."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from typing import NamedTuple

BLOCK = re.compile(r"^( *)(```+)([^\n`]*)\n(.*?)^\1\2[ \t]*$", re.MULTILINE | re.DOTALL)
"""A fenced block: indent, fence, language, text."""

SHELL = ("sh", "bash")
_PROMPT = "$ "
_CODE = re.compile(r"(?<!`)`([^`]+)`(?!`)")
_FILE = re.compile(r"`([\w./-]+\.\w+)`[^`\n]*:\s*\Z")
"""A file's name as the last words before a block: what stands in the block is that file."""

_ENDS = ("|", "||", "&", "&&", ";", ">", ">>", "<", "2>", "2>&1")


class Block(NamedTuple):
    """A block of a page.

    Attributes:
        line: of its text, from 1.
        file: the name of the file that it shows, "" where it shows none.
    """

    language: str
    text: str
    line: int
    file: str

    def commands(self) -> list[str]:
        """The shell's lines: all of a block of shell, else those after a prompt."""
        lines = self.text.replace("\\\n", " ").splitlines()
        if self.language not in SHELL:
            lines = [line[len(_PROMPT) :] for line in lines if line.startswith(_PROMPT)]
        return [line.strip() for line in lines if line.strip() and not line.startswith("#")]


def blocks(text: str) -> list[Block]:
    """All fenced blocks of a page."""
    found = []
    for match in BLOCK.finditer(text):
        before = text[: match.start()]
        named = _FILE.search(before.rstrip())
        words = match[3].split()
        language = words[0] if words else ""
        line = before.count("\n") + 2
        found.append(Block(language, match[4], line, named[1] if named else ""))
    return found


def shown(text: str) -> Iterator[tuple[int, str]]:
    """Line and words of every command that a page shows, in blocks and in prose."""
    for block in blocks(text):
        for command in block.commands():
            yield block.line, command
    prose = BLOCK.sub(lambda match: "\n" * match[0].count("\n"), text)
    for match in _CODE.finditer(prose):
        yield prose.count("\n", 0, match.start()) + 1, " ".join(match[1].split())


def calls(command: str) -> Iterator[list[str]]:
    """The programs that a line of shell calls, each with its arguments."""
    try:
        lexer = shlex.shlex(command, posix=True, punctuation_chars="|&;<>")
        lexer.whitespace_split, lexer.commenters = True, "#"
        words = list(lexer)
    except ValueError:  # a quote that is not closed: prose
        return
    call: list[str] = []
    skip = False
    for word in [*words, ";"]:
        if set(word) <= set("|&;<>"):
            if call:
                yield call
            call, skip = [], set(word) <= set("<>")
        elif skip:
            skip = False
        else:
            call.append(word)
