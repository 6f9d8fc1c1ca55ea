"""What is compared: an experiment or a controller, as it lies here or as Git has it."""

from __future__ import annotations

import os
import subprocess
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

from vsense.base.errors import UsageError
from vsense.config.experiment import ARGOS_SUFFIX, of_folder
from vsense.studies.series._plan import Condition

OLD, NEW = "old", "new"
"""The conditions of a comparison."""


@contextmanager
def conditions(
    old: str, new: str, settings: Mapping[str, str]
) -> Iterator[tuple[Condition, Condition]]:
    """What two sides run; see `compare`.

    Args:
        old, new: a shipped experiment's name, an experiment's file or folder, or a controller's
            file; behind `REVISION:` as Git has it in the repository of the current folder, where
            an old one without a path has that of the new one.
        settings: of both.

    Raises:
        UsageError: there is no such thing, or both are controllers.
    """
    with ExitStack() as stack:
        places = {}
        for name, text in ((NEW, new), (OLD, old)):
            revision, colon, path = text.partition(":")
            if not colon or os.path.exists(text):
                places[name] = text
                continue
            tree = stack.enter_context(_checked_out(revision))
            places[name] = _inside(tree, text, path or _below(new))
        experiments = [places[n] for n in (NEW, OLD) if not _is_controller(places[n])]
        if not experiments:
            raise UsageError(f"{old}, {new}: both are controllers: one has to be an experiment")
        yield (
            _condition(OLD, places[OLD], experiments[-1], settings),
            _condition(NEW, places[NEW], experiments[0], settings),
        )


def _condition(name: str, place: str, experiment: str, settings: Mapping[str, str]) -> Condition:
    """A controller drives the robots of the other side's experiment."""
    if _is_controller(place):
        return Condition(name, of_folder(experiment), place, settings)
    return Condition(name, of_folder(place), settings=settings)


def _is_controller(place: str) -> bool:
    return os.path.isfile(place) and Path(place).suffix not in ("", ARGOS_SUFFIX, ".xml")


def _below(new: str) -> str:
    """The path of the new side as seen from the top of its repository."""
    path = new.partition(":")[2] if ":" in new and not os.path.exists(new) else ""
    if path or not os.path.exists(new):
        return path or new
    top = _git(["rev-parse", "--show-toplevel"]).strip()
    return os.path.relpath(os.path.realpath(new), os.path.realpath(top))


def _inside(tree: Path, text: str, path: str) -> str:
    """A path in a revision: from the top, or, where it begins with `./`, from here."""
    if path.startswith(("./", "../")):
        path = os.path.join(_git(["rev-parse", "--show-prefix"]).strip(), path)
    place = os.path.normpath(tree / path)
    if not os.path.exists(place) or not Path(place).is_relative_to(tree):
        raise UsageError(f"{text}: this revision has no {os.path.normpath(path)}")
    return place


@contextmanager
def _checked_out(revision: str) -> Iterator[Path]:
    """All files of a revision, in a folder of their own that is removed after use.

    The repository notes nothing of it: the index is in that folder, too.
    """
    top = _git(["rev-parse", "--show-toplevel"]).strip()
    try:
        commit = _git(["rev-parse", "--verify", "--end-of-options", f"{revision}^{{commit}}"])
    except UsageError:
        raise UsageError(f"{revision}: is no revision of {top}") from None
    with tempfile.TemporaryDirectory(prefix="vsense-revision-") as name:
        tree = Path(os.path.realpath(name), "files")
        environment = {**os.environ, "GIT_INDEX_FILE": f"{tree.parent}/index"}
        _git(["-C", top, "read-tree", commit.strip()], environment)
        _git(["-C", top, "checkout-index", "--all", f"--prefix={tree}/"], environment)
        yield tree


def _git(words: Sequence[str], environment: Mapping[str, str] | None = None) -> str:
    """What Git answers; UsageError with its words where it does not."""
    try:
        done = subprocess.run(
            ["git", *words], capture_output=True, text=True, check=True, env=environment
        )
    except FileNotFoundError:
        raise UsageError("a revision needs Git: sudo apt install git") from None
    except subprocess.CalledProcessError as error:
        lines = (error.stderr or "").strip().splitlines() or ["it does not answer"]
        raise UsageError(f"git {words[0]}: {lines[-1]}") from None
    return done.stdout
