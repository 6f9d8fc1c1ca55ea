"""Builds `vsensed` with a user's controller for robots' boards; where their compilers come from.

Two cross compilers are known. `ziglang` from PyPI (the extra `robot`) makes every target, static
against musl, so that the board's own C library and float ABI do not matter. Where it is not
installed Debian's cross compilers do, with the larger glibc.

Sources: embedded.md section 1 (which versions link ARMv5, which flags, sizes); epuck.md section 7
(the boards). Debian's armhf compiler is left out on purpose: its libc is ARMv7, and the Pi Zero
is not.

Boards are reached with `ssh`. They are older than the machines that deploy to them: a dropbear or
OpenSSH of 2010 knows keys and ciphers only that OpenSSH does not use any more unless told so.
"""

from __future__ import annotations

import importlib.util
import os
import platform
import re
import shutil
import subprocess
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

from vsense.base.errors import UsageError, pip_line
from vsense.base.processes import python_module
from vsense.robots._cache import with_parts
from vsense.robots.build import DRIVER_PARTS, cache_directory, on_robots, source_tree
from vsense.robots.compiling import DRIVERS, BuildError, Toolchain, native
from vsense.robots.sources import ProgramSources

SMALL = ("-Os", "-static", "-fno-unwind-tables", "-fno-asynchronous-unwind-tables")
"""Boards have little room: -O2 is 12 % larger, and a step has hardly fewer instructions. Nothing
unwinds the stack of a C program."""


@dataclass(frozen=True, slots=True)
class Target:
    """A kind of board.

    Attributes:
        name: as the command line calls it.
        help: which boards these are.
        zig: what the zig compiler is told to compile for; empty: this machine.
        small: what it is told for small code (Thumb: on ARMv5 three quarters of the bytes); empty:
            nothing makes any.
        debian: Debian's compiler and what it is told; empty: there is none.
        package: Debian's package of that compiler.
        drivers: its daemons can have a driver as their base. Those for the oldest boards have no
            room for it, which 100,000 bytes are.
    """

    name: str
    help: str
    zig: tuple[str, ...]
    small: tuple[str, ...]
    debian: tuple[str, ...]
    package: str
    drivers: bool = True

    @property
    def flags(self) -> tuple[str, ...]:
        """What of our own its daemons have."""
        return (DRIVERS,) if self.drivers else ()


TARGETS = {
    target.name: target
    for target in (
        Target(
            "epuck",
            "any 32-bit ARM board of an e-puck: ARMv5TE, soft float (Gumstix Overo, AT91, Pi Zero)",
            ("-target", "arm-linux-musleabi", "-mcpu=arm926ej_s"),
            ("-target", "thumb-linux-musleabi", "-mcpu=arm926ej_s"),
            ("arm-linux-gnueabi-gcc", "-march=armv5te", "-mtune=arm926ej-s", "-marm"),
            "gcc-arm-linux-gnueabi",
            drivers=False,
        ),
        Target(
            "pi-puck",
            "a Pi-puck's Raspberry Pi Zero: ARMv6 with its floating point unit",
            ("-target", "arm-linux-musleabihf", "-mcpu=arm1176jzf_s"),
            (),
            ("arm-linux-gnueabi-gcc", "-march=armv6", "-mtune=arm1176jzf-s", "-marm"),
            "gcc-arm-linux-gnueabi",
        ),
        Target(
            "aarch64",
            "64-bit ARM boards (Raspberry Pi Zero 2 and newer)",
            ("-target", "aarch64-linux-musl"),
            (),
            ("aarch64-linux-gnu-gcc",),
            "gcc-aarch64-linux-gnu",
        ),
        Target("host", "this machine", (), (), (), "build-essential"),
    )
}


def toolchain(target: Target, cache: Path) -> Toolchain:
    """Finds the compiler for a target.

    Args:
        target: what to compile for.
        cache: folder in which zig keeps what it has compiled, its C library above all.

    Raises:
        UsageError: there is none here; the message says how to get one.
    """
    zig = _zig(target, cache)
    if zig is not None:
        return zig
    if target.name == "host":
        toolchain = native()
        return replace(toolchain, flags=(*SMALL, *target.flags), debug=())
    command, *flags = target.debian
    if shutil.which(command) is None:
        raise UsageError(
            f"no compiler for {target.name} boards: install one with: {pip_line('ziglang')}"
            f" (or, for Debian's: sudo apt install {target.package})"
        )
    return Toolchain(
        (command,),
        (*SMALL, *target.flags, *flags),
        cxx=(f"{command.removesuffix('gcc')}g++",),
        cxx_line=f"sudo apt install {target.package.replace('gcc-', 'g++-')}",
    )


def _zig(target: Target, cache: Path) -> Toolchain | None:
    """The zig compiler, where it is installed and knows the target."""
    flags = target.zig or ("-target", f"{platform.machine()}-linux-musl")
    supported = target.zig or platform.machine() in ("x86_64", "aarch64", "riscv64")
    if not supported or importlib.util.find_spec("ziglang") is None:
        return None
    folders = {
        "ZIG_GLOBAL_CACHE_DIR": str(cache / "zig"),
        "ZIG_LOCAL_CACHE_DIR": str(cache / "zig"),
    }
    zig = python_module("ziglang")
    small = (*SMALL, *target.flags, *target.small) if target.small else ()
    flags = (*SMALL, *target.flags, *flags)
    return Toolchain((*zig, "cc"), flags, folders, small, cxx=(*zig, "c++"))


@dataclass(frozen=True, slots=True)
class Built:
    """A daemon that was built.

    Attributes:
        path: the executable.
        target: name of what it runs on.
        size: bytes, stripped.
        controller: the controller's source, its first one where there are several.
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


def build(controller: str | ProgramSources, target: str, output: Path) -> Built:
    """Builds one.

    Args:
        controller: a program, a shipped controller's name or the path of a `.c` or `.cpp` file.
        target: a name in `TARGETS`.
        output: where it goes; what was there is replaced whole, or stays as it is.

    Raises:
        UsageError: no such controller, or no compiler.
        BuildError: a source that does not compile, or it cannot be written.
    """
    tree = source_tree()
    program = on_robots(tree.program(controller))
    board = TARGETS[target]
    compiler = toolchain(board, cache_directory())
    sources = tree.daemon(program, plain=True)
    if not board.drivers:
        own = [path for path in sources.own if path.stem not in (*DRIVER_PARTS, "epuck_wifi")]
        sources = replace(sources, own=own)
    try:
        if "ziglang" not in compiler.command:  # which keeps by itself what it has compiled
            sources = with_parts(sources, compiler)
        digest = sources.link_daemon(compiler, output)
    except BuildError as error:
        raise BuildError(_explain(board, compiler, str(error))) from None
    return Built(
        path=output,
        target=target,
        size=output.stat().st_size,
        controller=program.sources[0],
        hash=digest,
        compiler=" ".join(Path(word).name for word in compiler.command),
    )


def _explain(board: Target, compiler: Toolchain, said: str) -> str:
    """Adds what a linker does not say: which compilers cannot link ARMv5."""
    if board.name == "epuck" and re.search(r"undefined symbol: __sync_", said):
        version = compiler.version().splitlines()[:1]
        return (
            f"{' '.join(version)} cannot link for ARMv5: versions after ziglang 0.15.2 use"
            f" instructions that these boards do not have; {pip_line('ziglang')}\n{said}"
        )
    return said


def load(binary: Path) -> bytes:
    """Reads a daemon.

    Raises:
        UsageError: it is not there, or no program.
    """
    try:
        content = binary.read_bytes()
    except OSError as error:
        raise UsageError(
            f"cannot read {binary}: {error.strerror}; make it with: vsense robot build"
        ) from None
    if not content.startswith(b"\x7fELF"):
        raise UsageError(f"{binary} is no program for Linux; make it with: vsense robot build")
    return content


SSH = ("ssh", "-o", "BatchMode=yes", "-o", "ConnectTimeout=10")
"""Never asks for a password: with many robots at once nobody could tell who asks."""

_OFFERS = {
    "host key type": ("HostKeyAlgorithms", "PubkeyAcceptedAlgorithms"),
    "key exchange method": ("KexAlgorithms",),
    "cipher": ("Ciphers",),
    "MAC": ("MACs",),
}
"""What both ends have to agree on, as ssh calls it, and the options that say more is allowed."""

_NO_MATCH = re.compile(r"no matching (.+?) found\. Their offer: (\S+)")
_WEAK_KEY = re.compile(r"Bad server host key: Invalid key length|Invalid key length")


def ssh_command(destination: str, options: Iterable[str], words: str) -> list[str]:
    """What is run on this machine.

    Args:
        destination: whom to reach, as ssh is told.
        options: NAME=VALUE, as after `ssh -o`.
        words: for the board's shell.
    """
    return [*SSH, *(word for option in options for word in ("-o", option)), destination, words]


ASK_S = 8.0
_MOST_ASKED = 64


def call(command: Sequence[str]) -> tuple[int, str]:
    """Runs a command that reaches a board; gives its exit code and what it said."""
    try:
        done = subprocess.run(
            command, stdin=subprocess.DEVNULL, capture_output=True, timeout=ASK_S, check=False
        )
    except subprocess.TimeoutExpired:
        return 1, ""
    except OSError as error:
        return 1, f"ssh: {error.strerror}"
    return done.returncode, (done.stdout or done.stderr).decode(errors="replace")


def call_all(
    commands: Sequence[Sequence[str]], call: Callable[[Sequence[str]], tuple[int, str]] = call
) -> list[tuple[int, str]]:
    """Runs commands at once; gives what `call` gives of each."""
    with ThreadPoolExecutor(min(max(len(commands), 1), _MOST_ASKED)) as pool:
        return list(pool.map(call, commands))


def in_words(said: str) -> str:
    """What a daemon said, with the system's text in place of an error's number."""
    return re.sub(r"\berrno (\d+)", lambda match: os.strerror(int(match[1])), said)


def ssh_advice(destination: str, said: Sequence[str]) -> str | None:
    """The way out of what ssh said; None where it needs no words of ours.

    Args:
        destination: whom it did not reach.
        said: its lines.
    """
    text = "\n".join(said)
    host = destination.rpartition("@")[2]
    if match := _NO_MATCH.search(text):
        return _older_server(match[1], match[2])
    if "REMOTE HOST IDENTIFICATION HAS CHANGED" in text:
        return (
            "this board has another host key than the last time; if its card was written again:"
            f" ssh-keygen -R {host}"
        )
    if "Host key verification failed" in text:
        return (
            f"ssh does not know this board yet: log in once by hand (ssh {destination}), or give"
            " --ssh-option StrictHostKeyChecking=accept-new to take all new ones as they are"
        )
    if _WEAK_KEY.search(text):
        return "its host key is too short for this ssh: give --ssh-option RequiredRSASize=1024"
    if "Permission denied" in text:
        return (
            f"it does not take your ssh key: ssh-copy-id {destination}; where the key is there,"
            " and the board old: --ssh-option PubkeyAcceptedAlgorithms=+ssh-rsa with an RSA key"
        )
    return None


def _older_server(what: str, offer: str) -> str:
    names = _OFFERS.get(what)
    if names is None:
        return f"this ssh and the board's have no {what} in common; it offers {offer}"
    options = " ".join(f"--ssh-option {name}=+{offer}" for name in names)
    return f"this board's ssh is old; in a network that you trust, give {options}"
