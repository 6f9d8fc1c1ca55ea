"""The measures since a run began, on the host and in a real browser that comes late."""

from __future__ import annotations

import csv
import shutil
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import require_tool
from tests.monitor.ui.browser import Page
from tests.monitor.ui.conftest import Open, Serve
from tests.monitor.ui.portrait import state
from tests.monitor.ui.puppet import running
from tests.rigs.processes import Program
from vsense.monitor.recording.form import is_recorded
from vsense.monitor.recording.measures import (
    BUCKETS_MAX,
    LEDS_ON,
    MeasureHistory,
    count_swarm,
)
from vsense.world.pollution import PollutantSource

LINES = (
    "[...vsense.store.measures].map(([name, line]) => [name, line.times, line.values, line.spans])"
)


@pytest.mark.parametrize("timesteps", [1, 400, 401, 5000])
def test_a_thinned_history_keeps_smallest_and_largest_values(timesteps: int) -> None:
    walk = np.random.default_rng(timesteps).normal(size=timesteps).cumsum()
    history = MeasureHistory()
    for number, value in enumerate(walk.tolist()):
        history.add(number, {"walk": value, **({"late": value} if number >= 300 else {})})
    data = history.data(3, 0.1)
    starts = np.round(np.array(data["time_s"]) / 0.1).astype(int)
    assert data["run"] == 3 and len(starts) <= BUCKETS_MAX and starts[0] == 0
    edges = [*starts.tolist(), timesteps]
    parts = [walk[begin:end] for begin, end in pairwise(edges)]
    columns = data["measures"]["walk"]
    assert columns["low"] == tuple(part.min() for part in parts)
    assert columns["high"] == tuple(part.max() for part in parts)
    assert columns["last"] == tuple(part[-1] for part in parts)
    if timesteps > 300:
        late = data["measures"]["late"]["last"]
        assert late.count(None) == sum(end <= 300 for end in edges[1:])


def test_what_was_missed_is_a_gap_and_nothing_is_recorded() -> None:
    history = MeasureHistory()
    for number in (0, 1, 50, 51):
        history.add(number, {"items": number})
    assert history.data(1, 0.1)["time_s"] == [0.0, 0.1, 5.0, 5.1]
    assert not is_recorded("/history")


def test_leds_are_a_measure_from_the_beginning_where_one_was_ever_on() -> None:
    history = MeasureHistory()
    history.add(0, {LEDS_ON: 0, "items": 1})
    assert list(history.data(1, 0.1)["measures"]) == ["items"]
    history.add(1, {LEDS_ON: 2, "items": 1})
    assert history.data(1, 0.1)["measures"][LEDS_ON]["last"] == (0, 2)


def test_robots_in_a_cone_are_those_that_the_world_calls_polluted() -> None:
    cone = PollutantSource(9, 0.7, 1.1, 1.5).cone_at(0.2, -0.1, 0)
    places = np.random.default_rng(1).uniform(-2, 2, (300, 2))
    inside = np.flatnonzero(cone.contains(places))
    assert 5 < len(inside) < 150
    leds = {int(inside[0]): 1, int(inside[1]): 1 << 8, 299: 0}
    by_tag = dict(enumerate(map(tuple, places.tolist())))
    for corners in (cone.vertices(), cone.vertices()[::-1]):
        counts = count_swarm(by_tag, leds, [corners])
        # A body LED is on, and is none of the red ones.
        assert counts == {LEDS_ON: 2, "robots_in_cone": len(inside), "lit_in_cone": 1}
    assert count_swarm(by_tag, leds, None) == {LEDS_ON: 2}
    assert count_swarm({}, {}, []) == {LEDS_ON: 0, "robots_in_cone": 0, "lit_in_cone": 0}


def chart(page: Page, name: str) -> tuple[list[float], list[float], list[list[float] | None]]:
    """A measure's line on the page: times, values, and what was thinned out."""
    lines = {row[0]: row[1:] for row in page.value(LINES)}
    times, values, spans = lines[name]
    return times, [value for (value,) in values], spans


def test_a_page_that_is_reloaded_late_in_a_fast_run_has_its_chart_from_the_beginning(
    tmp_path: Path, opened: Open
) -> None:
    require_tool("cc", "build-essential")
    folder = tmp_path / "run"
    words = ["sim", "phototaxis", "--web", "0", "--hold", "--duration", "120", "-o", str(folder)]
    run = Program([sys.executable, "-m", "vsense", *words])
    try:
        page = opened(
            run.wait_for(r"control room: http://\S+").split()[-1], "window.vsense?.store.run"
        )
        state(page, "paused")
        page.value("vsense.controls.order('speed', 100), vsense.controls.order('start')")
        page.until("vsense.store.now.time_s > 95")
        page.value("window.old = true")
        page.call("Page.reload")
        page.until("!window.old && vsense.store.measures.get('light_distance_m')?.times[0] === 0")
        state(page, "ended")
        page.until("vsense.store.measures.get('light_distance_m').times.at(-1) > 119")
        times, values, spans = chart(page, "light_distance_m")
    finally:
        run.process.terminate()
        run.end()
    with next(folder.rglob("measures.csv")).open() as file:
        rows = [float(row["light_distance_m"]) for row in csv.DictReader(file)]
    assert len(times) > 200 and times == sorted(times)
    assert max(later - time for time, later in pairwise(times)) < 0.7, (
        "no part of the run is missing"
    )
    known = [*values, *(edge for span in spans for edge in span or ())]
    assert (min(known), max(known)) == pytest.approx((min(rows), max(rows)))
    shutil.rmtree(folder)


def test_another_run_begins_without_the_numbers_of_the_one_before(
    served: Serve, opened: Open
) -> None:
    _, _, url = served(running())
    page = opened(url)
    page.until("vsense.store.measures.get('LEDs on')?.times.length > 5")
    page.value("vsense.measures.toggle({ key: 'k', label: 'k', now: () => [1] })")
    page.until("vsense.measures.series.get('k').times.length > 2")
    page.key("S")
    state(page, "ended")
    page.key("R")
    page.until("vsense.store.run.run === 2 && !vsense.measures.series.get('k')?.times.length")
    assert page.value("vsense.store.measures.get('LEDs on')?.times ?? [0]") == [0]
