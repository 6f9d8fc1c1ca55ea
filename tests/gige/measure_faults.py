"""How fast faults of a GigE camera are told, and how fast it is back: run by hand.

    python -m tests.gige.measure_faults --rounds 5

Four cameras with 10 pictures a second, one of which has each fault in turn. Times run from the
fault's beginning (its end) to the word of it that the tracking session gives; and from its end
to the camera's next picture in a timestep.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path
from statistics import median

from tests.gige.conftest import ROBOTS
from tests.gige.faults import FAULTS, VICTIM, Fault
from tests.gige.network import CAMERAS, MIDDLE_PX, RATE_HZ, GigeCameras
from tests.gige.watch import Watch

NAME = CAMERAS[VICTIM].id
OTHER = CAMERAS[0].id
REST = 15
"""Pictures between two faults."""


def main() -> None:
    """Prints a table: each fault's median and longest times."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--only", default="", help="part of the name of a fault")
    words = parser.parse_args()
    size = " x ".join(map(str, MIDDLE_PX))
    print(f"{len(CAMERAS)} cameras of {size} px at {RATE_HZ} Hz; median (most)")
    print(f"{'fault':34} {'told':>14} {'end told':>14} {'first picture':>14}  ms")
    for fault in FAULTS:
        if words.only in fault.name:
            times = measured(fault, words.rounds)
            columns = (f"{median(ms):.0f} ({max(ms):.0f})" if ms else "-" for ms in times)
            print(f"{fault.name:34} {' '.join(f'{c:>14}' for c in columns)}", flush=True)


def measured(fault: Fault, rounds: int) -> tuple[list[float], list[float], list[float]]:
    """Has a fault come and go; gives the times till it is told, told over, and pictures [ms]."""
    told, over, pictures = [], [], []
    with tempfile.TemporaryDirectory() as folder:
        rig = GigeCameras(Path(folder), ROBOTS)
        try:
            rig.start()
            watch = Watch(rig, Path(folder))
            for _ in range(rounds):
                watch.all_deliver(REST)
                told.append(_until_told(watch, fault, rig))
                watch.delivered(OTHER, count=max(fault.lasts, 1))
                end_told, picture = _until_over(watch, fault, rig)
                over += [end_told] if end_told is not None else []
                pictures.append(picture)
            watch.close()
        finally:
            rig.close()
    return told, over, pictures


def _until_told(watch: Watch, fault: Fault, rig: GigeCameras) -> float:
    before = len(watch.events)
    fault.begin(rig)
    began_s = time.monotonic()
    watch.until(lambda: watch.told(NAME, fault.kind, before), fault.kind)
    return _ms_since(began_s)


def _until_over(watch: Watch, fault: Fault, rig: GigeCameras) -> tuple[float | None, float]:
    before = len(watch.events)
    fault.mend(rig)
    ended_s = time.monotonic()
    had = watch.frames[NAME]
    times_ms: dict[str, float] = {}

    def over() -> bool:
        if watch.frames[NAME] > had:
            times_ms.setdefault("picture", _ms_since(ended_s))
        if fault.after is not None and watch.told(NAME, fault.after, before):
            times_ms.setdefault("told", _ms_since(ended_s))
        return "picture" in times_ms and (fault.after is None or "told" in times_ms)

    watch.until(over, fault.after or "a picture")
    return times_ms.get("told"), times_ms["picture"]


def _ms_since(begin_s: float) -> float:
    return 1e3 * (time.monotonic() - begin_s)


if __name__ == "__main__":
    main()
