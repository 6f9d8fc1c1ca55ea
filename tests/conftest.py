"""What all tests share: a missing tool skips a test with the package's name; in CI it fails."""

from __future__ import annotations

import os
import shutil

import pytest
from hypothesis import settings

# A busy machine is no defect: no property has to hold within a wall-clock time.
settings.register_profile("vsense", deadline=None)
settings.load_profile("vsense")


def require_tool(name: str, package: str) -> str:
    """Gives the tool's path, or skips the test (in CI: fails it), naming the Debian package."""
    path = shutil.which(name)
    if path is None:
        text = f"needs {name}: apt install {package}"
        if os.environ.get("CI"):
            pytest.fail(text)
        pytest.skip(text)
    return path
