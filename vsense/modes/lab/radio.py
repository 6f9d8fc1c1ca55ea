"""A simulated Wi-Fi link of an emulated robot: what its kernel would tell of the radio.

The real `vsensed` reads it from a file that looks like `/proc/net/wireless` (the kernel's
net/wireless/wext-proc.c); below the table stands what a board says by ioctls. No packet is lost or
late for it: that is the network's.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

HEAD = (
    "Inter-| sta-|   Quality        |   Discarded packets               | Missed | WE\n"
    " face | tus | link level noise |  nwid  crypt   frag  retry   misc | beacon | 22\n"
)
NAME = "wlan0"

WEAKEST_DBM, STRONGEST_DBM = -110, -40
"""Between these the kernel makes a link quality of 0 to 70 of a signal (wext-compat.c)."""

SAVES_POWER = "saves"

WRITTEN = re.compile(rf"(\d+)=(-\d+)(?:,(\d+(?:\.\d+)?))?(,{SAVES_POWER})?")


@dataclass(frozen=True, slots=True)
class EmulatedRadio:
    """A radio as its robot tells it.

    Attributes:
        signal_dbm: of the access point, -127 to -1.
        rate_mbit_s: its bit rate.
        saves_power: whether its power saving is on.
        retries: frames that it gave up after all tries.
    """

    signal_dbm: int
    rate_mbit_s: float = 54.0
    saves_power: bool = False
    retries: int = 0

    def file_text(self) -> str:
        """The file that `vsensed --radio` reads."""
        quality = min(max(self.signal_dbm, WEAKEST_DBM), STRONGEST_DBM) - WEAKEST_DBM
        row = (
            f"{NAME:>6}: 0000  {quality:3}.  {self.signal_dbm:3}.  -256  "
            f"{0:6} {0:6} {0:6} {self.retries:6} {0:6}   {0:6}\n"
        )
        rate = f"rate {round(1e6 * self.rate_mbit_s)}\n"
        return f"{HEAD}{row}{rate}power {int(self.saves_power)}\n"


def read_radio(text: str) -> tuple[int, EmulatedRadio]:
    """Reads TAG=DBM[,MBIT][,saves]; ValueError says what was expected."""
    found = WRITTEN.fullmatch(text)
    if found is None:
        expected = f"TAG=DBM[,MBIT_S][,{SAVES_POWER}], such as 23=-84 or 23=-61,5.5,saves"
        raise ValueError(f"'{text}': expected {expected}")
    tag, signal_dbm, rate = int(found[1]), int(found[2]), float(found[3] or 54.0)
    if not -127 <= signal_dbm <= -1 or not 0.1 <= rate <= 2000.0:
        raise ValueError(f"'{text}': expected -127 to -1 dBm, and 0.1 to 2000 Mbit/s")
    return tag, EmulatedRadio(signal_dbm, rate, found[4] is not None)
