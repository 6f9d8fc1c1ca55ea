"""What tests of reports share."""

from __future__ import annotations

from collections.abc import Iterator

import pytest


@pytest.fixture(scope="module")
def coarse(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """A user's matplotlibrc with few pixels and no layout, which take most of the time."""
    path = tmp_path_factory.mktemp("style") / "matplotlibrc"
    path.write_text("savefig.dpi: 20\nfigure.constrained_layout.use: False\n")
    patch = pytest.MonkeyPatch()
    patch.setenv("MATPLOTLIBRC", str(path))
    yield
    patch.undo()
