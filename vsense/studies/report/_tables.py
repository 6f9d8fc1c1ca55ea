"""The tables: a recording's measures, robots, incidents, events; runs compared."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from vsense.base.terminal import spoken
from vsense.studies.report._compare import CampaignRuns, Group, quantities, table
from vsense.studies.report._findings import Findings, RobotRow
from vsense.studies.report._markup import DASH, Counter, figure_of, share_of

MOST_ROWS = 200
"""Rows of a list that are shown."""


def measures(findings: Findings, counter: Counter) -> str:
    """Each measure's last, mean, least and greatest value."""
    rows = [
        [spoken(name), *(figure_of(values[key]) for key in ("end", "mean", "min", "max"))]
        for name, values in findings.measures.items()
    ]
    heads = ("measure", "at the end", "mean over the run", "least", "greatest")
    return counter.table("Measures", "The mean is over timesteps.", heads, rows)


_ROBOTS: Sequence[tuple[str, Callable[[RobotRow], str]]] = (
    ("tag", lambda row: str(row.tag)),
    ("robot", lambda row: row.name),
    ("controller", lambda row: row.controller or DASH),
    ("distance [m]", lambda row: f"{row.distance_m:.2f}"),
    ("mean speed [m/s]", lambda row: DASH if row.speed_m_s is None else f"{row.speed_m_s:.3f}"),
    ("seen [%]", lambda row: share_of(row.seen)),
    ("between sightings, most [s]", lambda row: f"{row.longest_unseen_s:.1f}"),
    ("connected [%]", lambda row: share_of(row.connected)),
    ("links lost", lambda row: DASH if row.losses is None else str(row.losses)),
    ("stops", lambda row: DASH if row.losses is None else str(sum(row.stops.values()))),
    ("silent, most [ms]", lambda row: figure_of(row.silent_ms and round(row.silent_ms))),
    ("signal, least [dBm]", lambda row: figure_of(row.signal_dbm)),
    ("base errors", lambda row: figure_of(row.base_errors)),
    ("battery, least [V]", lambda row: figure_of(row.battery_mv and row.battery_mv / 1e3)),
)
"""Columns of the robots' table; empty ones are left out."""


def robots(findings: Findings, counter: Counter) -> str:
    """A row for each robot, and why they stopped."""
    columns = [(head, [cell(row) for row in findings.robots]) for head, cell in _ROBOTS]
    columns = [(head, cells) for head, cells in columns if set(cells) != {DASH}]
    heads = [head for head, _ in columns]
    caption = (
        "Distance and speed while a robot was seen: times of more than 1 s without it are left out,"
        " and moves of less than 5 mm count once they add up. Stops: how often its wheels were held"
        f" without an order. {DASH}: not reported."
    )
    rows = list(zip(*(cells for _, cells in columns)))
    texts = [place for place, head in enumerate(heads) if head in ("robot", "controller")]
    caption += _worst_link(findings)
    table = counter.table("The robots", caption, heads, rows, texts=texts)
    return table + _stops(findings, counter)


def parts(findings: Findings, counter: Counter) -> str:
    """Which robot played which part, and from when on; nothing where nobody has told it."""
    rows = [
        [row.name, str(row.part), str(row.tag), row.uid, f"{_time_s(row.time_ns, findings):.1f}"]
        for row in findings.gathered.parts[:MOST_ROWS]
    ]
    if not rows:
        return ""
    caption = "A role is called by the tag in the file. Before the run times are below 0."
    heads = ("role", "its tag", "robot", "uid", "from [s]")
    return counter.table("Roles", caption, heads, rows, texts=(0, 3))


def _time_s(time_ns: int, findings: Findings) -> float:
    return (time_ns - findings.zero_ns) / 1e9


QUIET_MS = 200.0
"""Telemetry comes each 75 ms: where nothing was heard for longer than this, some were lost."""


def _worst_link(findings: Findings) -> str:
    """Names the robot whose link was the worst; "" where all were good."""
    reported = [row for row in findings.robots if row.silent_ms is not None or row.losses]
    worst = max(reported, key=lambda row: (row.losses or 0, row.silent_ms or 0.0), default=None)
    if worst is None or not (worst.losses or (worst.silent_ms or 0.0) > QUIET_MS):
        return ""
    times = "once" if worst.losses == 1 else f"{worst.losses} times"
    lost = f"lost {times}, " if worst.losses else ""
    signal = "" if worst.signal_dbm is None else f", signal {worst.signal_dbm:.0f} dBm at least"
    return (
        f" The worst link: {worst.name} (tag {worst.tag}), {lost}silent for"
        f" {(worst.silent_ms or 0.0) / 1e3:.1f} s at most{signal}."
    )


def _stops(findings: Findings, counter: Counter) -> str:
    causes = dict.fromkeys(why for row in findings.robots for why in row.stops)
    rows = []
    for why in list(causes)[:MOST_ROWS]:
        stopped = [row for row in findings.robots if why in row.stops]
        names = ", ".join(f"{row.name} ({row.stops[why]})" for row in stopped)
        rows.append([why, str(sum(row.stops[why] for row in stopped)), names])
    if not rows:
        return ""
    heads = ("cause", "times", "robots (times)")
    return counter.table("Stops by cause", "", heads, rows, texts=(0, 2))


def incidents(findings: Findings, counter: Counter) -> str:
    """What was lost, silent or in trouble."""
    flow, late = findings.gathered.flow, findings.gathered.late
    words = ""
    if findings.gathered.ran:
        words = f"<p>{flow.missed} of {flow.lived + flow.missed} timesteps of the run were missed"
        words += "" if late is None else f"; the run counted {late} as late or missed"
        words += ".</p>\n"
    if not findings.incidents:
        words += "<p>No gaps in the recording, no silences, no lost links,"
        return words + " no camera trouble.</p>\n"
    rows = []
    for incident in findings.incidents[:MOST_ROWS]:
        length = "to the end" if incident.to_s is None else f"{incident.to_s - incident.from_s:.1f}"
        rows.append([incident.kind, f"{incident.from_s:.1f}", length, incident.text])
    caption = _shown(len(rows), len(findings.incidents))
    heads = ("what", "from [s]", "for [s]", "")
    return words + counter.table("Loss and gaps", caption, heads, rows, texts=(0, 3))


def events(findings: Findings, counter: Counter) -> str:
    """The messages for people."""
    events = findings.gathered.events
    if not events:
        return "<p>None.</p>\n"
    rows = []
    for event in events[:MOST_ROWS]:
        time_s = _time_s(event.time_ns, findings)
        text = event.text + (f" ({event.by})" if event.by else "")
        rows.append([f"{time_s:.1f}", event.level, text])
    caption = _shown(len(rows), len(events) + findings.gathered.more_events)
    heads = ("time [s]", "level", "text")
    return counter.table("Events", caption, heads, rows, texts=(1, 2))


def _shown(shown: int, count: int) -> str:
    return "" if shown == count else f"The first {shown} of {count}."


def statistics(groups: Sequence[Group], counter: Counter) -> str:
    """Mean, standard deviation and median of each quantity, by condition."""
    rows = []
    for name, columns in table(groups).items():
        row = [name]
        for group in groups:
            column = columns.get(group.condition)
            if column is None:
                row += ["0", DASH, DASH, DASH]
            else:
                numbers = (column.mean, column.spread, column.median)
                row += [str(len(column.values)), *(figure_of(value) for value in numbers)]
        rows.append(row)
    heads = ["quantity", *(["n", "mean", "SD", "median"] * len(groups))]
    caption = "One value of each run; SD: sample standard deviation over the runs."
    over = [("", 1), *((group.condition, 4) for group in groups)]
    return counter.table(f"Runs of {groups[0].experiment}", caption, heads, rows, over=over)


def _state(run: Findings) -> str:
    if not run.complete or run.damaged:
        return "cut off or damaged"
    return "world changed by hand" if run.gathered.changes else "whole"


def runs(groups: Sequence[Group], counter: Counter) -> str:
    """A row for each of the compared runs."""
    rows = []
    for group in groups:
        for run in group.runs:
            facts, values = run.gathered.facts, quantities(run)
            seen = [row.seen for row in run.robots]
            rows.append(
                [
                    str(run.path),
                    group.condition,
                    DASH if facts.seed is None else str(facts.seed),
                    f"{run.run_s:.1f}",
                    str(len(run.robots)),
                    share_of(sum(seen) / len(seen) if seen else None),
                    figure_of(values.get("latency, median [ms]")),
                    str(run.gathered.flow.missed),
                    _state(run),
                ]
            )
        rows += [_campaign_row(table, group.condition) for table in group.tables]
    heads = (
        "recording", "condition", "seed", "length [s]", "robots", "seen [%]",
        "median latency [ms]", "timesteps missed", "file",
    )  # fmt: skip
    caption = "Seen: mean share of the timesteps in which a robot was seen."
    return counter.table("The recordings", caption, heads, rows, texts=(0, 1, 8))


def _campaign_row(table: CampaignRuns, condition: str) -> list[str]:
    """The row of a table, whose runs are not recorded."""
    seeds = table.seeds
    words = seeds[0] if len(seeds) == 1 else f"{len(seeds)}: {seeds[0]} … {seeds[-1]}"
    return [str(table.path), condition, words, *[DASH] * 5, "a table of runs"]
