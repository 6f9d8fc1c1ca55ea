"""Where an experiment takes its arena state from, if not from cameras of its own.

The thesis puts `ats_host` and `ats_port` on `<framework>`, the original's code `its_host`,
`its_port`, `translate_x` and `translate_y` on the physics engine `<iridia_tracking_system>`; both
are understood. Source: iridia.md section 1c; argos3-tycho subtracts the translation from the
tracker's places. Ours is `vs:latency` beside the host: the protocol does not say how old a state
is when it comes. Any other tracker is a `<vs:tracker format="lines">` in `<framework>`.
"""

from __future__ import annotations

from dataclasses import dataclass

from vsense.xml.element import Element

DEFAULT_PORT = 4040
"""Of the original tracking server. Source: iridia.md section 1a."""

LINES_PORT = 4041
"""Where trackers that write JSON lines find vsense."""

ENGINE = "iridia_tracking_system"
TRACKER = "vs:tracker"

_PREFIXES = ("ats", "its")
_FAR_M = 1000.0
_MAX_LATENCY_S = 0.3
"""Robots stop 400 ms after the capture of what they heard last: an older one moves nothing."""


@dataclass(frozen=True, slots=True)
class TrackerAddress:
    """A tracker that speaks the original protocol.

    Attributes:
        host: its name or address.
        port: its TCP port.
        origin_m: where the arena's origin lies in the tracker's frame.
        latency_s: from the middle of an exposure to the arrival of its state.
        line: line of the element that names the host.
    """

    host: str
    port: int
    origin_m: tuple[float, float]
    latency_s: float
    line: int


@dataclass(frozen=True, slots=True)
class JsonLinesTracker:
    """Any other tracker: it connects to vsense and writes JSON lines.

    Attributes:
        host: name or address of the interface on which it is waited for.
        port: TCP port; 0: any that is free.
        line: line of its element.
    """

    host: str
    port: int
    line: int


def read_tracker(root: Element) -> TrackerAddress | JsonLinesTracker | None:
    """Reads where the arena state comes from, None where an experiment names no tracker.

    Args:
        root: <argos-configuration>.

    Raises:
        ConfigError: a value is wrong, a port has no host, or two elements name a tracker.
    """
    framework = root.child("framework")
    engines = root.optional_child("physics_engines")
    engine = engines.optional_child(ENGINE) if engines is not None else None
    lines = framework.optional_child(TRACKER)
    origin_m = (0.0, 0.0)
    if engine is not None:
        shift = [engine.number(f"translate_{axis}", -_FAR_M, _FAR_M, "m", 0.0) for axis in "xy"]
        origin_m = (shift[0], shift[1])
    found: TrackerAddress | JsonLinesTracker | None = None
    for element in (framework, engine, lines):
        if element is None:
            continue
        tracker = _read_lines(element) if element is lines else _read(element, origin_m)
        if tracker is not None and found is not None:
            raise element.error(f"a tracker stands in line {found.line} already")
        found = found or tracker
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
        if element.has("vs:latency"):
            raise element.error("is without ats_host", "vs:latency")
        return None
    host = element.text(f"{named[0]}_host", None, "a host's name or address")
    port = element.integer(f"{named[0]}_port", 1, 65_535, DEFAULT_PORT)
    latency_s = element.number("vs:latency", 0.0, _MAX_LATENCY_S, "s", 0.0)
    return TrackerAddress(host, port, origin_m, latency_s, element.line)


def _read_lines(element: Element) -> JsonLinesTracker:
    """Reads a <vs:tracker>."""
    element.choice("format", ("lines",))
    host = element.text("host", "127.0.0.1", "a name or address of this machine")
    port = element.integer("port", 0, 65_535, LINES_PORT)
    return JsonLinesTracker(host, port, element.line)
