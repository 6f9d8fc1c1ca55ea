"""Builds the site: `python -m scripts.site.build FOLDER`, pages in `FOLDER/html`.

Every warning of Sphinx is an error: a link or anchor that leads nowhere ends the build.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

from scripts.site.generated import generated
from scripts.site.searching import extend_search
from scripts.site.staging import Stage


def build(folder: Path) -> int:
    """Fills the stage and has Sphinx make pages of it; gives Sphinx's exit code."""
    from sphinx.cmd.build import main as sphinx

    stage(folder / "pages")
    shutil.rmtree(folder / "html", ignore_errors=True)
    here = Path(__file__).parent
    options = ["-q", "-W", "--keep-going", "-b", "html", "-c", str(here), "-d", str(folder / "tmp")]
    code = int(sphinx([*options, str(folder / "pages"), str(folder / "html")]))
    if not code:
        extend_search(folder / "html")
    return code


def stage(folder: Path) -> None:
    """Fills a folder with all pages, those that are written from the code among them."""
    Stage(folder, generated()).fill()


if __name__ == "__main__":
    sys.exit(build(Path(sys.argv[1])))
