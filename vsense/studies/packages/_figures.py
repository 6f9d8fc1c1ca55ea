"""The report of a package: the same figures, bytes and all, from the same tables and recordings."""

from __future__ import annotations

import html
import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any

from vsense.base.errors import UsageError, VsenseError, failing_as
from vsense.monitor.recording import require
from vsense.studies.packages._archive import PackageError
from vsense.studies.report import Questions, lacking, lacking_tests

REPORT_PREFIX = "report"
"""The folder of the report."""
FIGURES = "report.json"
"""In it: the figures as numbers."""


def make(
    root: Path,
    files: Sequence[str],
    asked: Questions,
    into: Path,
    show: Callable[[str], None] = lambda text: None,
) -> list[Path]:
    """Makes the report of files in a package.

    Args:
        root: the folder of the package.
        files: tables and recordings, from there.
        asked: what is asked of the tables.
        into: a new folder.
        show: takes what is going on.

    Returns:
        The files that were written.

    Raises:
        VsenseError: it cannot be made of them.
    """
    from vsense.studies.report.report import make_report  # needs the extra `record`

    with _own_style():
        written = make_report(
            [root / name for name in files],
            into,
            lambda path, share: show(f"{path.name} {100 * share:.0f} %"),
            "svg",
            None,
            asked,
            show,
        )
    path = into / FIGURES
    with failing_as(PackageError, f"{into}: cannot be written"):
        path.write_text(f"{json.dumps(written.as_json(), indent=1)}\n", encoding="utf-8")
        for file in (path, *(f for f in written.files if f.suffix in (".html", ".svg"))):
            file.write_text(_without(file.read_text(encoding="utf-8"), root, into), "utf-8")
    return [*written.files, path]


def cannot() -> str:
    """Why there are no figures, or no tests, on this machine; "": there are."""
    try:
        require()
    except UsageError as error:
        return str(error)
    return lacking() or lacking_tests()


def to_data(asked: Questions) -> dict[str, Any]:
    """What was asked, for JSON."""
    data: dict[str, Any] = json.loads(json.dumps(asdict(asked)))
    return data


def from_data(data: Mapping[str, Any]) -> Questions:
    """Reads what `to_data` gave; VsenseError if it is something else."""
    try:
        questions = Questions(**data)
        texts = [*questions.by, *questions.only, questions.against, *questions.margins]
        numbers = [questions.seed, *questions.margins.values()]
        if all(isinstance(t, str) for t in texts) and all(type(n) in (int, float) for n in numbers):
            return questions
        raise TypeError("a text or a number was expected")
    except (TypeError, AttributeError) as error:
        raise VsenseError(f"what was asked of its tables is damaged: {error}") from None


def _without(text: str, root: Path, into: Path) -> str:
    for folder, name in ((into, f"{REPORT_PREFIX}/"), (root, "")):
        for way in (json.dumps(f"{folder}/")[1:-1], html.escape(f"{folder}/"), f"{folder}/"):
            text = text.replace(way, name)
    return text


@contextmanager
def _own_style() -> Iterator[None]:
    """Leaves out the user's own matplotlibrc: others have another one."""
    before = os.environ.get("MATPLOTLIBRC")
    with NamedTemporaryFile("w", suffix="-matplotlibrc") as empty:
        os.environ["MATPLOTLIBRC"] = empty.name
        try:
            yield
        finally:
            if before is None:
                del os.environ["MATPLOTLIBRC"]
            else:
                os.environ["MATPLOTLIBRC"] = before
