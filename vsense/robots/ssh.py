"""How `vsense robot deploy` calls `ssh`, and the way out of what `ssh` refuses.

Robots' boards are older than the machines that deploy to them: a dropbear or OpenSSH of 2010 knows
keys and ciphers only that OpenSSH does not use any more unless told so.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

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


def command(destination: str, options: Iterable[str], words: str) -> list[str]:
    """What is run on this machine.

    Args:
        destination: whom to reach, as ssh is told.
        options: NAME=VALUE, as after `ssh -o`.
        words: for the board's shell.
    """
    return [*SSH, *(word for option in options for word in ("-o", option)), destination, words]


def advice(destination: str, said: Sequence[str]) -> str | None:
    """The way out of what ssh said; None where it needs no words of ours.

    Args:
        destination: whom it did not reach.
        said: its lines.
    """
    text = "\n".join(said)
    host = destination.rpartition("@")[2]
    if found := _NO_MATCH.search(text):
        return _older_server(found[1], found[2])
    if "REMOTE HOST IDENTIFICATION HAS CHANGED" in text:
        return (
            "this board has another host key than the last time; if its card was written anew:"
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
    """Which options let ssh talk to it."""
    names = _OFFERS.get(what)
    if names is None:
        return f"this ssh and the board's have no {what} in common; it offers {offer}"
    options = " ".join(f"--ssh-option {name}=+{offer}" for name in names)
    return f"this board's ssh is old; in a network that you trust, give {options}"
