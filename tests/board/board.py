"""A robot's board, emulated whole: QEMU, Debian's kernel for ARM, the static daemon, real devices.

The guest's serial port is an emulated robot's pseudo-terminal, its /dev/i2c-N an adapter on USB
whose bus is an emulated robot's (`usb_bus`), and its network QEMU's user network: 10.0.2.2 is this
machine. Only the processor, its board and the wires are emulated; the kernel, its drivers and the
daemon are those of a robot.
"""

from __future__ import annotations

import os
import re
import socket
import subprocess
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.board.initramfs import archive
from tests.board.usb_bus import UsbBus
from tests.conftest import require_tool
from vsense.robots.build import cache_directory

HERE = Path(__file__).parent
HOST = "10.0.2.2"
"""This machine, as the guest sees it."""

MODULES = ("virtio_pci", "virtio_net", "xhci-pci", "i2c-dev", "i2c-tiny-usb")
MAC = "00:04:25:01:02:03"
UART = "/dev/ttyS0"
I2C = "/dev/i2c-0"


@dataclass(frozen=True)
class Kernel:
    """A kernel and its modules, by name."""

    image: Path
    modules: dict[str, Path]

    def order(self, names: tuple[str, ...]) -> list[str]:
        """Modules with all that they need, each after what it needs."""
        found: list[str] = []
        for name in names:
            content = self.modules[name].read_bytes()
            match = re.search(rb"\0depends=([^\0]*)\0", content)
            needed = match[1].decode().split(",") if match and match[1] else []
            for other in (*self.order(tuple(n for n in map(self._named, needed) if n)), name):
                if other not in found:
                    found.append(other)
        return found

    def _named(self, name: str) -> str | None:
        """A module's file; None: it is built in. Dashes and underscores are the same."""
        plain = name.replace("-", "_")
        return next((n for n in self.modules if n.replace("-", "_") == plain), None)


def kernel() -> Kernel:
    """The kernel that `get-kernel` fetched; without it the test is skipped, or fails where the
    board test was asked for (VSENSE_BOARD)."""
    folder = cache_directory() / "board"
    if not (folder / "vmlinuz").is_file():
        text = f"needs a kernel: {HERE.name}/get-kernel fetches it"
        if os.environ.get("VSENSE_BOARD"):
            pytest.fail(text)
        pytest.skip(text)
    modules = {path.stem: path for path in (folder / "modules").glob("*.ko")}
    return Kernel(folder / "vmlinuz", modules)


class Board:
    """A board that is switched on; it stands in for a `tests.robots.rig.Daemon`.

    Attributes:
        process: QEMU.
        said: what came from its console.
        usb: the USB plug, if a bus is in it.
    """

    def __init__(
        self,
        folder: Path,
        files: dict[str, Path],
        words: list[str],
        uart: str | None,
        bus: str | None,
        old: bool = False,
    ) -> None:
        """Switches it on.

        Args:
            folder: for its files.
            files: "init" and "vsensed".
            words: the daemon's arguments.
            uart: path of the terminal that is its serial port.
            bus: path of the Unix socket that is its I2C bus.
            old: its system is one of 2010: vsensed can make system calls only that Linux 2.6.24
                has, and nothing has written a machine-id.
        """
        wired = kernel()
        modules = wired.order(MODULES if bus else MODULES[:2])
        waits = [UART] * bool(uart) + [I2C] * bool(bus)
        plan = [f"module /boot/{name}.ko" for name in modules] + ["up eth0"]
        plan += ["old"] * old
        plan += [f"wait {device}" for device in waits] + [f"run /bin/vsensed {' '.join(words)}"]
        content = {
            "init": files["init"].read_bytes(),
            "bin/vsensed": files["vsensed"].read_bytes(),
            **({} if old else {"etc/machine-id": b"0123456789abcdef0123456789abcdef\n"}),
            "boot/plan": ("\n".join(plan) + "\n").encode(),
            **{f"boot/{name}.ko": wired.modules[name].read_bytes() for name in modules},
        }
        (folder / "initramfs").write_bytes(archive(content))
        self.usb: UsbBus | None = None
        command = self._command(wired, folder, uart, bus)
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
        )
        assert self.process.stdout is not None
        self.stderr = self.process.stdout.fileno()
        os.set_blocking(self.stderr, False)
        self.open = True
        self.said = ""

    def _command(self, wired: Kernel, folder: Path, uart: str | None, bus: str | None) -> list[str]:
        qemu = require_tool("qemu-system-arm", "qemu-system-arm")
        command = [qemu, "-M", "virt,highmem=off", "-cpu", "cortex-a7", "-m", "128"]
        command += ["-display", "none", "-monitor", "none", "-nodefaults", "-no-reboot"]
        command += ["-kernel", str(wired.image), "-initrd", str(folder / "initramfs")]
        command += ["-append", "console=ttyAMA0 panic=-1 quiet", "-serial", "stdio"]
        command += [
            "-netdev",
            "user,id=net",
            "-device",
            f"virtio-net-pci,netdev=net,romfile=,mac={MAC}",
        ]
        if uart:
            command += [
                "-chardev",
                f"serial,id=uart,path={uart}",
                "-device",
                "pci-serial,chardev=uart",
            ]
        if bus:
            listener = socket.socket(socket.AF_UNIX)
            listener.bind(str(folder / "usb"))
            listener.listen(1)
            self.usb = UsbBus(listener, bus)
            self.usb.start()
            command += ["-chardev", f"socket,id=usb,path={folder / 'usb'}"]
            command += ["-device", "qemu-xhci", "-device", "usb-redir,chardev=usb"]
        return command

    def tell(self, word: str) -> None:
        """Types a line on its console."""
        assert self.process.stdin is not None
        self.process.stdin.write(word.encode() + b"\n")
        self.process.stdin.flush()

    def read(self) -> None:
        """Takes what it said."""
        try:
            got = os.read(self.stderr, 65536)
        except BlockingIOError:
            return
        self.open = bool(got)
        self.said += got.decode(errors="replace").replace("\r", "")

    def close(self) -> None:
        """Pulls its plug."""
        self.process.kill()
        self.process.wait()
        for pipe in (self.process.stdin, self.process.stdout):
            assert pipe is not None
            pipe.close()
