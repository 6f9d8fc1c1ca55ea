"""Where an experiment takes its arena state from, if not from cameras of its own.

The thesis puts `ats_host` and `ats_port` on `<framework>`, the original's code `its_host`,
`its_port`, `translate_x` and `translate_y` on the physics engine `<iridia_tracking_system>`; both
are understood. Source: iridia.md section 1c; argos3-tycho subtracts the translation from the
tracker's places.
"""

from __future__ import annotations

from dataclasses import dataclass

from vsense.config.element import Element

DEFAULT_PORT = 4040
"""Of the original tracking server. Source: iridia.md section 1a."""

ENGINE = "iridia_tracking_system"

_PREFIXES = ("ats", "its")
_FAR_M = 1000.0


@dataclass(frozen=True, slots=True)
class TrackerAddress:
    """A tracker that speaks the original protocol.

    Attributes:
        host: its name or address.
        port: its TCP port.
        origin_m: where the arena's origin lies in the tracker's frame.
        line: line of the element that names the host.
    """

    host: str
    port: int
    origin_m: tuple[float, float]
    line: int


def read_tracker(root: Element) -> TrackerAddress | None:
    """Reads a tracker's address from an experiment, None where it names no host.

    Args:
        root: <argos-configuration>.

    Raises:
        ConfigError: a value is wrong, a port has no host, or two elements name a host.
    """
    engines = root.optional_child("physics_engines")
    engine = engines.optional_child(ENGINE) if engines is not None else None
    origin_m = (0.0, 0.0)
    if engine is not None:
        shift = [engine.number(f"translate_{axis}", -_FAR_M, _FAR_M, "m", 0.0) for axis in "xy"]
        origin_m = (shift[0], shift[1])
    found: TrackerAddress | None = None
    for element in (root.child("framework"), engine):
        address = _read(element, origin_m) if element is not None else None
        if address is not None and found is not None:
            assert element is not None
            raise element.error(f"a tracker's host stands in line {found.line} already")
        found = found or address
    return found


def _read(element: Element, origin_m: tuple[float, float]) -> TrackerAddress | None:
    """Reads the address that stands on one element."""
    named = [prefix for prefix in _PREFIXES if element.has(f"{prefix}_host")]
    if len(named) > 1:
        raise element.error("stands beside ats_host, expected one of them", "its_host")
    for prefix in _PREFIXES:
        if element.has(f"{prefix}_port") and prefix not in named:
            raise element.error(f"is without {prefix}_host", f"{prefix}_port")
    if not named:
        return None
    host = element.text(f"{named[0]}_host", None, "a host's name or address")
    port = element.integer(f"{named[0]}_port", 1, 65_535, DEFAULT_PORT)
    return TrackerAddress(host, port, origin_m, element.line)
