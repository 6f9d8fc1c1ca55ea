"""The pages and files that come with vsense, in a checkout and in an installed package alike.

A README is called as its folder, every other page and file by its own name: `sensors`, `protocol`,
`controller.h`, `foraging.argos`. In what is printed, links to other pages are the commands that
print those.
"""

from __future__ import annotations

import ast
import posixpath
import re
import textwrap
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from importlib import resources
from pathlib import Path

from vsense.base.errors import UsageError, failing_as, instead
from vsense.base.files import read_text
from vsense.robots.build import source_tree

PACKAGE = "vsense"

_FOLDERS = {"camera_setup": "cameras", "live": "run", "": "readme"}
"""What pages are called whose folder has another name than the command that they are about."""

_GROUPS = (
    ("experiments", "vsense/config/experiments/", (".argos", ".py")),
    ("controllers", "robot/controllers/", (".c",)),
    ("headers for controllers", "robot/", (".h",)),
    ("virtual sensors", "vsense/world/sensors/", (".py",)),
    ("virtual actuators", "vsense/world/actuators/", (".py",)),
    ("files to begin with", "vsense/config/examples/", (".xml", ".toml")),
    ("layouts for Foxglove", "vsense/monitor/foxglove/", (".json",)),
    ("schemas for editors", "vsense/config/schema/", (".xsd",)),
)
"""Title, folder and suffixes of the files that are listed beside the pages."""

_HEADERS = ("controller.h", "walk.h")
"""What controllers include: all other headers of the daemon are its own."""

_SUFFIXES = (
    ".md",
    ".c",
    ".cpp",
    ".h",
    ".hpp",
    ".py",
    ".argos",
    ".xml",
    ".xsd",
    ".json",
    ".toml",
    ".txt",
)
_LAYOUT = "to import into Foxglove: the arena in 3-D, the cameras, measures, the log"
_LINK = re.compile(r"(!?)\[([^\]]*)\]\(([^)\s]+)\)")
_TITLE_MAX = 100
"""Characters of a title that is a sentence."""

_ABSOLUTE = re.compile(r"[a-z]+:")


@dataclass(frozen=True, slots=True)
class ShippedFile:
    """A page or file.

    Attributes:
        name: what people call it.
        place: its place in vsense's sources, with `/` between folders.
        path: where it is on this machine.
        group: title of what it belongs to; "" for what is found, but not listed.
    """

    name: str
    place: str
    path: Path
    group: str = ""

    def text(self) -> str:
        """Its text; UsageError where it cannot be read."""
        with failing_as(UsageError, f"{self.path}: cannot be read"):
            return read_text(self.path)

    def title(self) -> str:
        """What it is about, in a line."""
        text = self.text()
        if self.path.suffix == ".md":
            return text.partition("\n")[0].lstrip("# ")
        if self.path.suffix == ".py":
            text = ast.get_docstring(ast.parse(text)) or ""
            return text.partition("\n")[0]
        if self.path.suffix == ".toml":
            return text.partition("\n")[0].lstrip("# ").rstrip(".:")
        if self.path.suffix == ".json":  # has no place for a comment
            return _LAYOUT
        if self.path.suffix in (".c", ".h"):
            match = re.search(r"^ \* [\w.]+ - (.*?)(?:[.]\s|\*/)", text, re.M | re.S)
        else:
            match = re.search(r"<!--\s*(.*?[.:])\s", text, re.S)
        words = "" if match is None else match[1].replace("\n *", " ")
        return textwrap.shorten(words.rstrip(".:"), _TITLE_MAX, placeholder=" ...")


@cache
def listed() -> tuple[ShippedFile, ...]:
    """All pages, then all files that people write by, group by group."""
    pages = [
        ShippedFile(_page_name(place), place, path, "pages")
        for place, path in _files()
        if path.suffix == ".md"
    ]
    files = sorted(pages, key=lambda page: (page.name != "readme", page.name))
    for title, folder, suffixes in _GROUPS:
        files += [
            ShippedFile(path.name, place, path, title)
            for place, path in _files()
            if posixpath.dirname(place) + "/" == folder
            and path.suffix in suffixes
            and (path.suffix != ".h" or path.name in _HEADERS)
            and (
                folder not in ("vsense/world/sensors/", "vsense/world/actuators/") or _is_kind(path)
            )
        ]
    names = Counter(document.name for document in files)
    return tuple(
        replace(document, name="/".join(document.place.split("/")[-2:]))
        if names[document.name] > 1
        else document
        for document in files
    )


def find(name: str) -> ShippedFile:
    """Finds a page or file by its name, or by the end of its place.

    Raises:
        UsageError: there is none, or there are several.
        BuildError: vsense's own files are incomplete.
    """
    by_name = {document.name: document for document in listed()}
    wanted = name.strip("/")
    if wanted in by_name:
        return by_name[wanted]
    places = [file for file in _files() if f"/{file[0]}".endswith(f"/{wanted}")]
    if len(places) == 1:
        place, path = places[0]
        return ShippedFile(_page_name(place) if path.suffix == ".md" else path.name, place, path)
    if places:
        raise UsageError(f"several files are called {name!r}: {', '.join(p for p, _ in places)}")
    raise UsageError(
        f"there is no page {name!r}; {instead(name.lower(), by_name)} (vsense docs lists all)"
    )


def printed(document: ShippedFile) -> str:
    """A document's text; in a page, links to others are said as the commands that print them."""
    text = document.text()
    if document.path.suffix != ".md":
        return text
    places = {page.place: page.name for page in listed()}
    every = {place for place, _ in _files()}

    def said(link: re.Match[str]) -> str:
        picture, words, target = link.groups()
        if picture:
            return f"[picture: {words}]"
        if _ABSOLUTE.match(target):
            return f"{words} ({target})"
        place = posixpath.join(posixpath.dirname(document.place), target.partition("#")[0])
        place = posixpath.normpath(place)
        readme = posixpath.join(place, "README.md")
        for candidate in (place, readme):
            if candidate in every and candidate != document.place:
                return f"{words} (vsense docs {places.get(candidate, candidate)})"
        return words

    return _LINK.sub(said, text)


def published(page: Path, url: str, version: str) -> str:
    """A page of the sources' top folder as an index of packages shows it.

    Args:
        page: the page.
        url: where the sources are published, with the folders `blob/TAG` and `raw/TAG`; "": not
            yet, and links are said as `printed` says them.
        version: whose sources links lead to; its tag is `vVERSION`.
    """
    document = ShippedFile("readme", page.name, page)
    if not url:
        return printed(document)

    def absolute(link: re.Match[str]) -> str:
        picture, words, target = link.groups()
        if _ABSOLUTE.match(target):
            return link[0]
        where = "raw" if picture else "blob"
        return f"{picture}[{words}]({url}/{where}/v{version}/{target})"

    return _LINK.sub(absolute, document.text())


def _page_name(place: str) -> str:
    folder, file = posixpath.split(place)
    if file == "README.md":
        last = posixpath.basename(folder)
        return _FOLDERS.get(last, last)
    return file.removesuffix(".md").lower()


def _is_kind(path: Path) -> bool:
    """Whether a Python file makes elements of an experiment."""
    return re.search(r"^(?:ARGOS_)?ELEMENTS = ", path.read_text(encoding="utf-8"), re.M) is not None


@cache
def _files() -> tuple[tuple[str, Path], ...]:
    """Place and path of every file that can be read, in a fixed order."""
    return tuple(_walk())


def _walk() -> Iterator[tuple[str, Path]]:
    root = source_tree().root
    package = Path(str(resources.files(PACKAGE)))
    for path in sorted(root.glob("*.md")):
        yield path.name, path
    for folder in ("c_src", "firmware_bridge", "robot", "tests"):
        pattern = "**/README.md" if folder == "tests" else "**/*"
        for path in sorted((root / folder).glob(pattern)):
            if path.suffix in _SUFFIXES and "data" not in path.parts:
                yield path.relative_to(root).as_posix(), path
    for path in sorted(package.rglob("*")):
        if path.suffix in _SUFFIXES and "_sources" not in path.relative_to(package).parts:
            yield posixpath.join(PACKAGE, path.relative_to(package).as_posix()), path
