"""The built site: every link leads somewhere, and no page asks another machine for anything."""

from __future__ import annotations

import importlib.util
import re
import subprocess
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import quote, unquote, urlsplit

import pytest

from scripts.site.contents import ROOT, pages
from tests.conftest import lack, require_tool
from tests.monitor.ui.browser import Browser

pytestmark = pytest.mark.campaign

LOADS = {("script", "src"), ("img", "src"), ("link", "href"), ("source", "src"), ("iframe", "src")}
"""Tags and attributes whose address a browser opens by itself."""


class Page(HTMLParser):
    """What a page loads, links to, and can be linked at."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.loads: list[str] = []
        self.links: list[str] = []
        self.ids: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        known = {key: value or "" for key, value in attrs}
        self.ids |= {known[key] for key in ("id", "name") if key in known}
        self.loads += [value for key, value in known.items() if (tag, key) in LOADS]
        if tag == "a" and "href" in known:
            self.links.append(known["href"])


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    if importlib.util.find_spec("sphinx") is None or importlib.util.find_spec("furo") is None:
        lack("needs Sphinx and Furo: scripts/docs installs them")
    folder = tmp_path_factory.mktemp("docs")
    command = [sys.executable, "-m", "scripts.site.build", str(folder)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    return folder / "html"


@pytest.fixture(scope="module")
def built(site: Path) -> dict[Path, Page]:
    return {path: Page(path.read_text()) for path in site.rglob("*.html")}


def test_every_page_is_there_and_found_by_the_search(site: Path) -> None:
    index = (site / "searchindex.js").read_text()
    for page in pages():
        name = "index" if page == "README.md" else page.removesuffix(".md")
        assert (site / f"{name}.html").exists(), page
        assert f'"{name}"' in index, page


def test_nothing_is_loaded_from_elsewhere(site: Path, built: dict[Path, Page]) -> None:
    assert len(built) > 40
    for path, page in built.items():
        assert [url for url in page.loads if urlsplit(url).netloc] == [], path
    styles = [*site.rglob("*.css"), *site.rglob("*.js")]
    assert styles
    for path in styles:
        text = path.read_text()
        found = re.findall(r"(?:@import\s*|url\(\s*)[\"']?(?:https?:)?//[^)\"']*", text)
        assert found == [], path


def test_every_link_leads_to_a_page_and_an_anchor(built: dict[Path, Page]) -> None:
    broken = set()
    for path, page in built.items():
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            goal = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            known = built[goal].ids if goal in built else {parts.fragment}
            if not goal.exists() or parts.fragment not in {"", *known}:
                broken.add(f"{path.name}: {link}")
    assert broken == set()


def test_pictures_are_there(built: dict[Path, Page]) -> None:
    loads = {(path, urlsplit(url).path) for path, page in built.items() for url in page.loads}
    assert len(loads) > 100
    missing = {(p.name, url) for p, url in loads if not (p.parent / unquote(url)).exists()}
    assert missing == set()


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    opened = Browser(require_tool("chromium", "chromium"))
    yield opened
    opened.close()


def test_no_page_is_wider_than_a_phone(site: Path, browser: Browser) -> None:
    page = browser.open("about:blank", 390, 844)
    wide = {}
    for path in (path for path in site.rglob("*.html") if "source" not in path.parts):
        page.go(path.as_uri())
        page.until(f"document.readyState === 'complete' && location.href === {path.as_uri()!r}")
        width = page.value("document.documentElement.scrollWidth")
        if width > 390:
            wide[path.name] = width
    assert wide == {}


def test_the_search_finds_a_word_in_pages_that_are_files(site: Path, browser: Browser) -> None:
    page = browser.open((site / "search.html").as_uri() + "?q=drop_out")
    found = "[...document.querySelectorAll('#search-results a')].map(a => a.innerText)"
    page.until(f"{found}.some(title => title.includes('Experiment files'))")


RANKED = {
    "emergency stop": ("The control room", "guide"),
    "noise_level": ("Virtual sensors", "guide"),
    "markers": ("From printed markers to an arena state", "guide"),
    "latency": ("", "guide"),
    "commands": ("Commands", "reference"),
    "changelog": ("Changelog", "changes"),
}
"""By what somebody looks for: the title that leads, "" where several may, and its kind."""


@pytest.mark.parametrize("words", RANKED)
def test_the_search_ranks_guides_before_reference_before_changes(
    words: str, site: Path, browser: Browser
) -> None:
    """Pages are opened as files, and yet show the words that were looked for."""
    page = browser.open(f"{(site / 'search.html').as_uri()}?q={quote(words)}")
    page.until("/finished/.test(document.querySelector('.search-summary')?.innerText)")
    results = "[...document.querySelectorAll('#search-results li')]"
    shown = page.value(
        f"{results}.map(li => [li.querySelector('a').innerText, li.querySelector('a').getAttribute"
        "('href'), li.querySelector('p.context')?.innerText || ''])"
    )
    title, kind = RANKED[words]
    leader, address, _ = shown[0]
    assert title in (leader, "") and kind_of(address) == kind, shown[:5]
    assert words in " ".join(text for *_, text in shown[:3]).lower()
    assert all(text for *_, text in shown)
    changes = [n for n, (_, address, _) in enumerate(shown) if kind_of(address) == "changes"]
    assert kind == "changes" or all(n > 2 for n in changes)


def kind_of(address: str) -> str:
    """Which kind of page an address of the site is."""
    if address.startswith("CHANGELOG"):
        return "changes"
    return "reference" if address.startswith("reference/") else "guide"
