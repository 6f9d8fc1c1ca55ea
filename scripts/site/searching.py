"""Has the site's search rank pages by what people look for, and show where the words stand.

Sphinx's index knows which pages hold a word and not how often, so it orders most results by name;
what it shows around a word it asks a server for. `search.js` has each page's text and weight.
"""

from __future__ import annotations

import json
from html.parser import HTMLParser
from pathlib import Path

from scripts.site.contents import GENERATED, HOME, SECTIONS, pages

WEIGHTS = {"Write experiments": 24, "Protocols": 6, "Change vsense": 2}
"""What a section of the contents adds to a page's score; `OF_GUIDES` where there is nothing."""
OF_GUIDES, OF_REFERENCE, OF_CHANGES = 20, 10, -20
SCRIPT = "search.js"
_SEARCH = '<script src="_static/searchtools.js'


class PageText(HTMLParser):
    """The text of a page's article.

    Attributes:
        text: all of it, white space as single spaces.
        sections: where each section, by its anchor, begins in it.
    """

    def __init__(self, page: str) -> None:
        super().__init__()
        self.text = ""
        self.sections: dict[str, int] = {}
        self._inside = False
        self._hidden = ""
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Begins the article, a section, or what is no text."""
        known = dict(attrs)
        if tag == "article" and known.get("role") == "main":
            self._inside = True
        elif tag == "section" and known.get("id"):
            self.sections[known["id"] or ""] = len(self.text)
        elif tag in ("script", "style") or known.get("class") == "headerlink":
            self._hidden = tag

    def handle_endtag(self, tag: str) -> None:
        """Ends it."""
        if tag == "article":
            self._inside = False
        if tag == self._hidden:
            self._hidden = ""

    def handle_data(self, data: str) -> None:
        """Takes words."""
        if self._inside and not self._hidden:
            space = " " if data[:1].isspace() and not self.text.endswith(" ") else ""
            self.text += space + " ".join(data.split()) + (" " if data[-1:].isspace() else "")


def weight(page: str) -> int:
    """What a page's place in the contents adds to its score: guides first, changes last."""
    if page == "CHANGELOG.md":
        return OF_CHANGES
    if page.startswith(GENERATED):
        return OF_REFERENCE
    sections = (name for name, listed in SECTIONS.items() if page in listed)
    return WEIGHTS.get(next(sections, ""), OF_GUIDES)


def extend_search(html: Path) -> None:
    """Writes the texts, and has the page of the search use them."""
    known = {}
    for page in pages():
        name = "index" if page == HOME else page.removesuffix(".md")
        read = PageText((html / f"{name}.html").read_text())
        known[name] = {"weight": weight(page), "text": read.text, "sections": read.sections}
    script = (Path(__file__).parent / SCRIPT).read_text()
    (html / "_static" / SCRIPT).write_text(f"const PAGES = {json.dumps(known)};\n{script}")
    search = html / "search.html"
    before, tag, after = search.read_text().partition(_SEARCH)
    end = after.index("</script>") + len("</script>")
    ours = f'\n<script src="_static/{SCRIPT}"></script>'
    search.write_text(f"{before}{tag}{after[:end]}{ours}{after[end:]}")
