"""Brings pages, pictures and the source files that pages link to into one folder for Sphinx.

Pages keep their paths, so that links between them stay as they are. A link to a source file leads
to a page that shows it, one to a folder to its README or else to a list of its files.
"""

from __future__ import annotations

import os
import re
import shutil
from pathlib import Path, PurePosixPath

from scripts.site.contents import HOME, ROOT, SECTIONS, STAND_IN, STANDS_IN, pages
from scripts.site.links import FENCE, LINK

PICTURES = (".png", ".jpg", ".svg", ".webp")
LEXERS = {
    ".argos": "xml", ".c": "c", ".cpp": "cpp", ".css": "css", ".h": "c", ".hpp": "cpp", ".js": "js",
    ".json": "json", ".py": "python", ".toml": "toml", ".txt": "text", ".xml": "xml", ".xsd": "xml",
}  # fmt: skip
"""The language of a source file, by its ending."""

SOURCES = "source"
"""Folder of the pages that show source files."""


class Stage:
    """A folder that Sphinx reads, while it is filled."""

    def __init__(self, folder: Path, generated: dict[str, str]) -> None:
        """Empties the folder; `generated` are the texts of the pages that no file holds."""
        shutil.rmtree(folder, ignore_errors=True)
        self._folder = folder
        self._generated = generated
        self._shown: set[PurePosixPath] = set()

    def fill(self) -> None:
        """Writes every page with what it links to."""
        for page in pages():
            text = self._generated.get(page) or (ROOT / page).read_text()
            self._write(self._place(PurePosixPath(page)), self.rewritten(text, page))
        self._write(PurePosixPath("index.md"), self._first_page())
        while missing := {path for path in self._shown if not self._has(path)}:
            for path in sorted(missing):
                self._show(path)

    def rewritten(self, text: str, page: str) -> str:
        """The text of a page with its links leading to places in this folder."""
        parts, end = [], 0
        for fence in FENCE.finditer(text):
            parts += [self._relinked(text[end : fence.start()], page), fence[0]]
            end = fence.end()
        return "".join([*parts, self._relinked(text[end:], page)])

    def _relinked(self, prose: str, page: str) -> str:
        here = PurePosixPath(page).parent

        def replace(link: re.Match[str]) -> str:
            picture, words, path, anchor = link.groups()
            words = self._relinked(words, page)
            if not path:
                return f"{picture}[{words}]({anchor or ''})"
            target = PurePosixPath(os.path.normpath(here / path))
            generated = STANDS_IN.get((anchor or "").lstrip("#"))
            if str(target) == STAND_IN and generated:
                target, anchor = PurePosixPath(generated), None
            place = self._target(target)
            back = os.path.relpath(place, self._place(PurePosixPath(page)).parent)
            return f"{picture}[{words}]({back}{anchor or ''})"

        return LINK.sub(replace, prose)

    def _target(self, path: PurePosixPath) -> PurePosixPath:
        """Where what a page links to lies in this folder; brings or notes it."""
        if str(path) in pages():
            return self._place(path)
        if str(path / HOME) in pages():
            return path / HOME
        if path.suffix in PICTURES:
            self._bring(path)
            return path
        self._shown.add(path)
        return self._page_of(path)

    def _place(self, page: PurePosixPath) -> PurePosixPath:
        if str(page) == HOME:
            return PurePosixPath("index.md")
        return page if str(page) in pages() else self._page_of(page)

    def _page_of(self, path: PurePosixPath) -> PurePosixPath:
        return PurePosixPath(SOURCES) / f"{path}.md"

    def _has(self, path: PurePosixPath) -> bool:
        return (self._folder / self._page_of(path)).exists()

    def _bring(self, path: PurePosixPath) -> None:
        (self._folder / path).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(ROOT / path, self._folder / path)

    def _show(self, path: PurePosixPath) -> None:
        """Writes the page of a source file or folder."""
        hidden = "---\norphan: true\nnosearch: true\n---\n\n"
        head, place = f"{hidden}# {path}\n\n", self._page_of(path)
        if (ROOT / path).is_dir():
            inside = sorted(p.name for p in (ROOT / path).iterdir() if _is_source(p))
            rows = [self._row(path / name) for name in inside]
            return self._write(place, head + "\n".join(rows) + "\n")
        text = (ROOT / path).read_text()
        if path.suffix == ".md":  # which others link to by its headings
            return self._write(place, hidden + self.rewritten(text, str(path)))
        ticks = "`" * (2 + max((len(t) for t in re.findall("`+", text)), default=1))
        language = LEXERS.get(path.suffix, "text")
        return self._write(place, f"{head}{ticks}{language}\n{text.rstrip()}\n{ticks}\n")

    def _row(self, path: PurePosixPath) -> str:
        """A file's line in its folder's list: a link where the site has it."""
        if str(path) not in pages() and path not in self._shown:
            return f"- {path.name}"
        back = os.path.relpath(self._target(path), self._page_of(path.parent).parent)
        return f"- [{path.name}]({back})"

    def _first_page(self) -> str:
        """The README with the site's navigation."""
        text = self.rewritten((ROOT / HOME).read_text(), HOME)
        trees = [
            "\n".join(
                [f"```{{toctree}}\n:hidden:\n:caption: {caption}\n", *map(_without_end, listed)]
            )
            + "\n```\n"
            for caption, listed in SECTIONS.items()
        ]
        return "\n".join([text, *trees])

    def _write(self, path: PurePosixPath, text: str) -> None:
        (self._folder / path).parent.mkdir(parents=True, exist_ok=True)
        (self._folder / path).write_text(text)


def _without_end(page: str) -> str:
    return page.removesuffix(".md")


def _is_source(path: Path) -> bool:
    """Whether a file or folder belongs into a folder's list."""
    return not path.name.startswith((".", "__")) and path.suffix not in (".so", ".o", *PICTURES)
