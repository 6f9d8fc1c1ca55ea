"""The links of a page, and the anchors that its headings make, as GitHub and the site have them."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

FENCE = re.compile(r"^( *)(```+|~~~+).*?^\1\2[ \t]*$", re.MULTILINE | re.DOTALL)
"""A block of code, in which nothing is a link or a heading."""

LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^)#\s:]*)(#[^)\s]*)?\)")
"""A link or picture whose target is no address: `!` for a picture, text, path, anchor."""

_HEADING = re.compile(r"^#{1,6} +(.*?)(?: +#+)? *$", re.MULTILINE)


def targets(text: str) -> list[tuple[str, str]]:
    """Path and anchor of every link to this repository; "" for an absent one."""
    found = []
    for _, words, path, anchor in LINK.findall(FENCE.sub("", text)):
        found += [(path, anchor.removeprefix("#")), *targets(words)]
    return found


def anchors(text: str) -> set[str]:
    """The anchors of a page's headings; one that is there again gets a number."""
    seen: Counter[str] = Counter()
    found = set()
    for heading in _HEADING.findall(FENCE.sub("", text)):
        slug = _slug(heading)
        found.add(f"{slug}-{seen[slug]}" if seen[slug] else slug)
        seen[slug] += 1
    return found


def _slug(heading: str) -> str:
    words = LINK.sub(r"\2", heading).replace("`", "").replace("*", "")
    return re.sub(r"[^\w\- ]", "", words.lower()).replace(" ", "-")


def broken(root: Path, page: str, text: str) -> list[str]:
    """The links of a page, at its path below `root`, that lead nowhere, with their reason."""
    found = []
    for path, anchor in targets(text):
        target = (root / page).parent / path if path else root / page
        if not target.exists():
            found.append(f"{page}: {path}: there is no such file")
        elif anchor and target.suffix == ".md":
            goal = text if target == root / page else target.read_text()
            if anchor not in anchors(goal):
                found.append(f"{page}: {path}#{anchor}: no heading makes this anchor")
    return found
