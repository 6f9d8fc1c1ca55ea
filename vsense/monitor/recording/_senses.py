"""What robots sensed and did in a timestep as messages, made live and made again from a recording.

`vsense.monitor.recording.resense` compares what both gave.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from vsense.monitor.recording.form import Data
from vsense.robots.link.table import Entry
from vsense.robots.link.wire import ReadingValues
from vsense.run.runtime import GivenDeeds
from vsense.world.sensors.base import layout_dtype


def readings(
    sensors: Mapping[int, Sequence[Entry]],
    sent: Mapping[int, ReadingValues],
    timestep: int,
    capture_ns: int,
) -> Data:
    """Gives /readings: what the robots were sent, as numbers.

    `sensors` are those of each robot by its tag; `sent` has payload and capture time per sensor,
    by tag; `capture_ns` is the arena state's.
    """
    return {
        "timestep": timestep,
        "capture_ns": capture_ns,
        "tag": list(sent),
        "values": [
            [
                np.frombuffer(data, layout_dtype(sensor.layout)[1]).tolist()
                for (data, _), sensor in zip(values, sensors[tag])
            ]
            for tag, values in sent.items()
        ],
        "captured_ns": [[when for _, when in values] for values in sent.values()],
    }


def reported(given: GivenDeeds, timestep: int, run_timestep: int) -> Data:
    """Gives /deeds: bytes as they came, in hexadecimal digits; "" where nobody is known to send."""
    tags = list(given.reports)
    return {
        "timestep": timestep,
        "run_timestep": run_timestep,
        "count": given.count,
        "orders": given.orders,
        "tag": tags,
        "report": [given.reports[tag].hex() for tag in tags],
        "sender": [given.senders.get(tag, b"").hex() for tag in tags],
    }


def given_reports(data: Mapping[str, object]) -> GivenDeeds:
    """Reads what `reported` gives; KeyError, TypeError or ValueError where it is damaged."""
    rows = list(zip(*(_column(data, name) for name in ("tag", "report", "sender")), strict=True))
    count, orders = data["count"], data["orders"]
    if not isinstance(count, int) or not isinstance(orders, int):
        raise TypeError("count and orders are whole numbers")
    return GivenDeeds(
        count,
        {int(tag): bytes.fromhex(report) for tag, report, _ in rows},
        {int(tag): bytes.fromhex(sender) for tag, _, sender in rows},
        orders,
    )


def _column(data: Mapping[str, object], name: str) -> list[Any]:
    column = data[name]
    if not isinstance(column, list):
        raise TypeError(f"{name} is no list")
    return column
