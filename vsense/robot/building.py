"""Builds `vsensed` with a user's controller for a robot's board."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from vsense.build import cache_directory, source_tree
from vsense.compiling import BuildError, Toolchain
from vsense.robot.targets import TARGETS, Target, toolchain


@dataclass(frozen=True, slots=True)
class Built:
    """A daemon that was built.

    Attributes:
        path: the executable.
        target: name of what it runs on.
        size: bytes, stripped.
        controller: the controller's source.
        hash: of the controller and the headers of its own, hexadecimal. The daemon tells it, too:
            `vsensed --version`.
        compiler: the words that start it.
    """

    path: Path
    target: str
    size: int
    controller: Path
    hash: str
    compiler: str


def build(controller: str, target: str, output: Path) -> Built:
    """Builds one.

    Args:
        controller: a shipped controller's name or the path of a `.c` file.
        target: a name in `TARGETS`.
        output: where it goes; what was there is replaced whole, or stays as it is.

    Raises:
        UsageError: no such controller.
        BuildError: no compiler, a source that does not compile, or it cannot be written.
    """
    tree = source_tree()
    source = tree.controller(controller)
    board = TARGETS[target]
    compiler = toolchain(board, cache_directory())
    sources = tree.daemon(source)
    try:
        digest = sources.link_daemon(compiler, output)
    except BuildError as error:
        raise BuildError(_explain(board, compiler, str(error))) from None
    return Built(
        path=output,
        target=target,
        size=output.stat().st_size,
        controller=source,
        hash=digest,
        compiler=" ".join(Path(word).name for word in compiler.command),
    )


def _explain(board: Target, compiler: Toolchain, said: str) -> str:
    """Adds what a linker does not say: which compilers cannot link ARMv5."""
    if board.name == "epuck" and re.search(r"undefined symbol: __sync_", said):
        version = compiler.version().splitlines()[:1]
        return (
            f"{' '.join(version)} cannot link for ARMv5: versions after ziglang 0.15.2 use"
            f" instructions that these boards do not have; pip install ziglang==0.15.2\n{said}"
        )
    return said
