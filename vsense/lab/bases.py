"""What the lab's robots can be based on: names, and who gets which."""

from __future__ import annotations

from vsense.errors import UsageError

KINDS = ("argos", "asercom", "gctronic", "york")
"""As `vsensed --base` knows them."""

MIXED = "mixed"
"""One kind after the other."""

BASES = (*KINDS, MIXED)


def bases_of(name: str, count: int) -> list[str]:
    """The kind of base of each of `count` robots, where `name` is one of `BASES`.

    Raises:
        UsageError: it is none of them.
    """
    if name not in BASES:
        raise UsageError(f"no base {name!r} in the lab: expected one of {', '.join(BASES)}")
    kinds = KINDS if name == MIXED else (name,)
    return [kinds[robot % len(kinds)] for robot in range(count)]
