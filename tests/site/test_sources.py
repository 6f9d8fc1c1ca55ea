"""The pages' sources: every link and anchor leads somewhere, and every page is on the site."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from scripts.site.contents import (
    GENERATED,
    NO_PAGES,
    ROOT,
    SECTIONS,
    STAND_IN,
    STANDS_IN,
    pages,
    sources,
)
from scripts.site.generated import WRITERS
from scripts.site.links import anchors, broken, targets

FOLDERS = (".github", "c_src", "firmware_bridge", "robot", "scripts", "tests", "vsense")


def markdown() -> list[str]:
    """All Markdown files of the repository, by their paths."""
    files = [*ROOT.glob("*.md"), *(p for f in FOLDERS for p in (ROOT / f).rglob("*.md"))]
    return sorted(str(path.relative_to(ROOT)) for path in files)


def test_every_page_is_on_the_site_once() -> None:
    listed = pages()
    assert len(listed) == len(set(listed))
    assert set(sources()) == {page for page in markdown() if not page.startswith(NO_PAGES)}


@pytest.mark.parametrize("page", markdown())
def test_links_lead_to_a_file_and_a_heading(page: str) -> None:
    assert broken(ROOT, page, (ROOT / page).read_text()) == []


@pytest.mark.parametrize("page", WRITERS)
def test_links_of_generated_pages_lead_to_a_file_and_a_heading(page: str, tmp_path: Path) -> None:
    for path in ROOT.iterdir():
        (tmp_path / path.name).symlink_to(path)
    (tmp_path / GENERATED).mkdir()
    for name in WRITERS:
        (tmp_path / name).write_text(WRITERS[name]())
    assert broken(tmp_path, page, (tmp_path / page).read_text()) == []


def test_pages_have_links() -> None:
    found = [link for page in markdown() for link in targets((ROOT / page).read_text())]
    assert len(found) > 100
    assert len([anchor for _, anchor in found if anchor]) > 20


def test_a_link_that_leads_nowhere_is_found(tmp_path: Path) -> None:
    text = "# One `two`: three\n[a](b.md) [c](#one-two-three) [d](#four)\n```\n[e](f.md)\n```\n"
    (tmp_path / "x.md").write_text(text)
    assert broken(tmp_path, "x.md", text) == [
        "x.md: b.md: there is no such file",
        "x.md: #four: no heading makes this anchor",
    ]


def test_anchors_are_those_of_github() -> None:
    # As GitHub's own pages of this text have them.
    text = "# `vsense` & co.\n## The tracker's client: `vsense serve`\n## Same\n## Same\n"
    assert anchors(text) == {"vsense--co", "the-trackers-client-vsense-serve", "same", "same-1"}


def test_every_generated_page_has_a_section_that_stands_in_for_it() -> None:
    assert set(STANDS_IN) <= anchors((ROOT / STAND_IN).read_text())
    assert set(STANDS_IN.values()) == set(WRITERS)


def test_no_section_is_empty_and_generated_pages_have_their_folder() -> None:
    assert all(SECTIONS.values())
    generated = [page for page in pages() if not (ROOT / page).exists()]
    assert all(page.startswith(GENERATED) for page in generated)


AVOIDED = {
    r"[Aa]new": "again",
    r"[Ww]hoever": "the robot that, any machine that, a user who",
    r"(?:is|are|was|were) told": "is reported, gets",
    r"sighted": "with virtual sensors",
    r"lit": "with LEDs on",
    r"(?:is|are|be|as|of|it) void|[Vv]oid (?:runs?|ones?)|voids": "invalid",
    r"be blind": "have no virtual sensors",
    r"[Ww]ho comes|count who": "the robot that",
    r"plays? (?:the|its|their) part": "has the role",
}
"""Words that had to be read twice, and what is said instead; keys of files stand in backticks."""
CODE = re.compile(r"```.*?```|~~~.*?~~~|`[^`]*`", re.S)


def messages(path: Path) -> Iterator[str]:
    """The strings of a module that people may read: those with a space that are no docstrings."""
    nodes = [*ast.walk(ast.parse(path.read_text()))]
    bare = {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
    for node in nodes:
        text = node.value if isinstance(node, ast.Constant) else None
        if isinstance(text, str) and " " in text and id(node) not in bare:
            yield text


def test_pages_and_messages_are_in_plain_words() -> None:
    pages = [page for page in sources() if page != "CHANGELOG.md"]
    read = {page: [(ROOT / page).read_text()] for page in pages}
    modules = sorted((ROOT / "vsense").rglob("*.py"))
    read |= {str(path.relative_to(ROOT)): [*messages(path)] for path in modules}
    given = [*(ROOT / "vsense/config/experiments/start").glob("*.*")]
    given += (ROOT / "vsense/config/examples").glob("*.toml")  # what users get as their own
    read |= {str(path.relative_to(ROOT)): [path.read_text()] for path in given}
    avoided = re.compile(rf"\b(?:{'|'.join(AVOIDED)})\b")
    assert len(read) > 400
    assert [
        f"{name}: {word}"
        for name, texts in read.items()
        for text in texts
        for word in avoided.findall(CODE.sub("", text))
    ] == []
