"""Where a run takes its arena states from: cameras of our own, a recording, or another tracker."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple, Protocol

from vsense.base.arena import ArenaState, Frame
from vsense.base.clock import host_ns
from vsense.base.errors import GrabberError, NoMorePictures
from vsense.base.terminal import counted
from vsense.config import tracking_session
from vsense.config.specs import Experiment, JsonLinesTracker, MocapTracker, TrackerAddress
from vsense.modes.live.opening import require_source
from vsense.monitor.ui.access import is_loopback
from vsense.monitor.ui.messages import ExperimentFacts
from vsense.robots.link.status import LinkError
from vsense.robots.link.trackers.client import ArenaClient, TrackerEnded
from vsense.robots.link.trackers.lines import ArenaListener
from vsense.robots.link.trackers.mocap import MocapListener
from vsense.run.runtime import Pace
from vsense.run.watch import ArenaSource
from vsense.vision.calibration.checked import of_tracking
from vsense.vision.tracking.camera_tracking import CameraTracking
from vsense.vision.tracking.opening import masks_px, open_tracking
from vsense.vision.tracking.specs import TrackingSession

Expect = Callable[[Experiment], None]
"""Tells a source of an experiment's tags, from any thread; VsenseError: it can look for others
only."""


class ClosableSource(ArenaSource, Protocol):
    """A source that holds sockets, cameras or files."""

    def close(self) -> None:
        """Ends a waiting `next` and releases everything; can be called again."""


class OwnCameras(NamedTuple):
    """Cameras of our own, or recordings in their place; `tracking` is opened from `session`."""

    session: TrackingSession
    tracking: CameraTracking


def seen_by(own: OwnCameras, scene: ExperimentFacts) -> ExperimentFacts:
    """What the page is told, with the cameras that see the robots."""
    session = own.session
    return replace(
        scene,
        cameras=[view.camera for view in session.views],
        trackers={view.camera.id: view.tracker.id for view in session.views},
        troubles=own.tracking.troubles,
        recorded=not session.is_live,
        masks=masks_px(session),
        calibration=of_tracking(session),
    )


class SteadySource:
    """A source that goes on: silence is no failure, and timesteps are as long as they should be.

    Attributes:
        kind: "cameras", "recording", "original", "lines" or "mocap".
        name: where the states come from, for people.
        own: None where another tracker is used.
        doubt: how other machines could move robots through it, "": they cannot.
        expect: has it look for the tags of a changed experiment; VsenseError: it cannot.
    """

    def __init__(
        self,
        kind: str,
        name: str,
        source: ClosableSource,
        timestep_ns: int,
        figures: Callable[[], Mapping[str, int]],
        own: OwnCameras | None = None,
        doubt: str = "",
        expect: Expect = lambda experiment: None,
    ) -> None:
        """Takes over a source with a rate of its own.

        `figures` gives its counters; `expect` tells it of other tags.
        """
        self.expect = expect
        self.kind = kind
        self.name = name
        self.own = own
        self.doubt = doubt
        self._source = source
        self._pace = Pace(timestep_ns)
        self._figures = figures
        self._closed = False

    def next(self, timeout_s: float) -> tuple[ArenaState, Sequence[Frame]]:
        """Waits for the arena state that begins the next timestep, however long that takes.

        The state has the timestep's number. After `timeout_s` without one the source looks after
        its connections.

        Raises:
            NoMorePictures: a recording has come to its end.
            TrackerEnded: the tracker has ended the run.
            VsenseError: the tracker has failed, or `close` was called.
        """
        while True:
            try:
                state, frames = self._source.next(timeout_s)
            except (NoMorePictures, TrackerEnded):
                raise
            except (GrabberError, LinkError):
                if self._closed:
                    raise
                continue
            timestep = self._pace.timestep(state.capture_ns)
            if timestep is not None:
                return replace(state, timestep=timestep), frames

    def start(self) -> None:
        """See `ArenaSource.start`."""
        self._source.start()

    def stop(self) -> None:
        """See `ArenaSource.stop`."""
        self._source.stop()

    def check_cameras(self) -> None:
        """See `ArenaSource.check_cameras`."""
        self._source.check_cameras()

    def figures(self) -> dict[str, object]:
        """Kind, name and counters, for the run's report."""
        return {"kind": self.kind, "name": self.name, **self._figures()}

    def close(self) -> None:
        """See `ClosableSource.close`."""
        self._closed = True
        self._source.close()


def open_source(
    experiment: Experiment, tracking: tuple[str, str] | None, say: Callable[[str], None]
) -> SteadySource:
    """Opens what the command line or the experiment names.

    Args:
        experiment: whose tags are looked for.
        tracking: resources file and experiment file of a tracking session; None: what the
            experiment names.
        say: takes what happens to cameras and trackers.

    Raises:
        UsageError: nothing is named.
        VsenseError: it cannot be used.
    """
    require_source(experiment, tracking)
    tracker = experiment.tracker
    if tracking is not None:
        return _own_cameras(experiment, tracking, say)
    if isinstance(tracker, TrackerAddress):
        return _original(experiment, tracker, say)
    assert tracker is not None
    if isinstance(tracker, MocapTracker):
        return _mocap(experiment, tracker, say)
    return _lines(experiment, tracker, say)


def _own_cameras(
    experiment: Experiment, files: tuple[str, str], say: Callable[[str], None]
) -> SteadySource:
    session = tracking_session.load(*files).within(experiment.arena.corners_m)
    session = replace(session, offsets=experiment.markers)
    _check_roster(experiment, session)
    tracking = open_tracking(session, host_ns, say, experiment.timestep_ns / 1e9)
    cameras = f"{counted(len(session.views), 'camera')} of {Path(session.file).name}"
    kind = "cameras" if session.is_live else "recording"
    name = cameras if session.is_live else f"recordings of {cameras}"
    own = OwnCameras(session, tracking)
    expect = partial(_check_roster, session=session)
    figures = tracking.figures
    timestep_ns, doubt = experiment.timestep_ns, doubt_of_nodes(session)
    return SteadySource(kind, name, tracking, timestep_ns, figures, own, doubt, expect)


def doubt_of_nodes(session: TrackingSession) -> str:
    """How other machines could move robots as nodes of cameras; "": they cannot, or none is."""
    network = session.resources.network
    if network is None or not any(view.grabber.node for view in session.views):
        return ""
    open_to_all = [
        where
        for where in (*network.listen, *network.connect)
        if where.startswith(("tcp/", "udp/")) and not is_loopback(where[4:].rpartition(":")[0])
    ]
    return f"{open_to_all[0]}: any program there can be a camera's node" if open_to_all else ""


def _check_roster(experiment: Experiment, session: TrackingSession) -> None:
    """Raises ConfigError for a tag that no tracker looks for, and none can learn of."""
    if any(view.tracker.open_roster for view in session.views):
        return
    heights_m = session.heights_m
    bodies = [(body.line, body.id, body.tag) for body in experiment.robots]
    bodies += [(body.line, body.id, body.tag) for body in experiment.objects]
    for line, name, tag in bodies:
        if tag not in heights_m:
            tags = ", ".join(map(str, sorted(heights_m)))
            message = f"{name!r}: no tracker of {session.file} looks for its tag {tag}"
            raise experiment.error(line, f"{message}; they look for: {tags}")


def _original(
    experiment: Experiment, tracker: TrackerAddress, say: Callable[[str], None]
) -> SteadySource:
    whom, latency_ns = (tracker.host, tracker.port), round(tracker.latency_s * 1e9)
    client = ArenaClient(*whom, _tags(experiment), say, latency_ns, tracker.origin_m)

    def figures() -> dict[str, int]:
        reconnects = max(client.connections - 1, 0)
        return asdict(client.counters) | asdict(client.repairs) | {"reconnects": reconnects}

    name, doubt = f"the tracker {client.name}", ""
    if not is_loopback(tracker.host):
        doubt = f"{name}: any program that answers in its place moves every robot"
    return SteadySource(
        *("original", name, client, experiment.timestep_ns, figures),
        doubt=doubt,
        expect=lambda changed: client.expect(_tags(changed)),
    )


def _lines(
    experiment: Experiment, tracker: JsonLinesTracker, say: Callable[[str], None]
) -> SteadySource:
    listener = ArenaListener(tracker.host, tracker.port, _tags(experiment), say)
    name, doubt = f"a tracker that writes lines to {tracker.host}, port {listener.port}", ""
    if not is_loopback(tracker.host):
        doubt = f"port {listener.port} on {tracker.host}: any program there moves every robot"
    return _listening("lines", name, listener, experiment, doubt)


def _listening(
    kind: str, name: str, listener: ArenaListener, experiment: Experiment, doubt: str
) -> SteadySource:
    def figures() -> dict[str, int]:
        return asdict(listener.counters) | asdict(listener.repair.counters)

    return SteadySource(
        *(kind, name, listener, experiment.timestep_ns, figures),
        doubt=doubt,
        expect=lambda changed: listener.repair.expect(_tags(changed)),
    )


def _mocap(
    experiment: Experiment, tracker: MocapTracker, say: Callable[[str], None]
) -> SteadySource:
    tags, system = experiment.tags, tracker.system
    for body, tag in system.bodies.items():
        if tag not in tags.values():
            words = f"<vs:tracker> bodies: {body!r} has tag {tag}, which nobody here wears"
            raise experiment.error(tracker.line, words)
    named = {str(tag): tag for tag in tags.values()} | dict(tags)
    system = replace(system, bodies=system.bodies or named)
    listener = MocapListener(system, _tags(experiment), say)
    name, doubt = f"motion capture, {listener.name}", ""
    if not is_loopback(system.settings["hostname"]):
        doubt = f"{name}: any program that answers in its place moves every robot"
    return _listening("mocap", name, listener, experiment, doubt)


def _tags(experiment: Experiment) -> list[int]:
    """Tags of all that wears a marker."""
    return list(experiment.tags.values())
