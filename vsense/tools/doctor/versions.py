"""What is installed: vsense and the commit it is of, Python, and the libraries that results need.

Nothing is imported for it: a library that is damaged has a version, too.
"""

from __future__ import annotations

import platform
import subprocess
from importlib import metadata
from pathlib import Path

from vsense import __version__
from vsense.robots.sources import source_roots

COMMIT = "commit"
"""The file in an installed package's sources that names the commit it was built from."""

UNKNOWN = "?"
GIT_TIMEOUT_S = 5.0
_OPENCV = ("opencv-python-headless", "opencv-python", "opencv-contrib-python-headless")
"""Packages that bring OpenCV; with several of them in one environment the last one installed is
there."""


def versions() -> dict[str, str]:
    """Gives versions by the name of what has them, vsense first."""
    revision = commit()
    return {
        "vsense": f"{__version__} ({revision})" if revision else __version__,
        "Python": platform.python_version(),
        "NumPy": _package("numpy"),
        "OpenCV": _package(*_OPENCV),
    }


def commit() -> str:
    """Gives the commit of the checkout or of the installed package, "" if it is not known.

    A checkout with changes has a "+" behind it.
    """
    installed, checkout = source_roots()
    if (installed / COMMIT).is_file():
        return (installed / COMMIT).read_text().strip()
    return of_checkout(checkout) if (checkout / ".git").exists() else ""


def of_checkout(root: Path) -> str:
    """Asks Git for the commit of a checkout; "" where it does not answer."""
    try:
        result = subprocess.run(
            ["git", "-C", str(root), "describe", "--always", "--exclude=*", "--dirty=+"],
            capture_output=True,
            text=True,
            check=True,
            timeout=GIT_TIMEOUT_S,
        )
    except (OSError, subprocess.SubprocessError):
        return ""
    return result.stdout.strip()


def _package(*names: str) -> str:
    """The version of the first of some packages that is there."""
    for name in names:
        try:
            return metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return UNKNOWN
