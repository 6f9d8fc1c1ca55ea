"""What the daemon promises when something fails, and controllers that do."""

from __future__ import annotations

from collections.abc import Callable

from tests.robots.rig import MS, Rig

CANARY_NS = 8 * MS
"""A loop that was itself held up for longer notes a stop too late, never too early."""
SILENCE_NS = 450 * MS
"""From the last fresh frame to speed 0 on the motors."""
ORDER_NS = 50 * MS
"""From STOP, SIGTERM or the worker's death to speed 0."""
BEAT_NS = 300 * MS
"""From the worker's last breath, stopped but not dead, to speed 0."""
GUARD_NS = 450 * MS
"""From the guard's death to speed 0: 150 until it is missed, 200 to find the base."""
ATTEMPTS = 8
COUNTED_ATTEMPTS = 2
"""So many that the canary does not void are enough."""
FAULTY = """
#include "controller.h"
static void init(void *state, struct vs_robot *robot) { (void)state; (void)robot; }
static void step(void *state, struct vs_robot *robot)
{
    int *steps = state;

    vs_robot_set_wheels(robot, 400, 400);
    for (++*steps; *steps > 10;)
        FAULT;
}
const struct vs_controller vs_controller = {"faulty", sizeof(int), init, step, NULL};
"""


def still_within(rig: Rig, limit_ns: int, fail: Callable[[], int], mend: Callable[[], None]) -> int:
    """Has something fail in mid-motion and compares when the motors got speed 0 with a limit.

    Every attempt has to keep it but those that the canary voids, and one must be left. What
    was kept on a busy machine was kept: only an attempt that seems late can be void.

    Args:
        rig: a running one.
        limit_ns: the promise.
        fail: makes it happen and returns the time that the limit counts from, or 0: then that
            is when the last fresh frame left.
        mend: undoes it.

    Returns:
        How many attempts there were.
    """
    took_ms, attempts = [], 0
    for _ in range(ATTEMPTS):
        attempts += 1
        rig.run()
        rig.live_for(300 * MS)
        rig.held_up_ns = 0
        began_ns = fail()
        rig.wait_for(lambda: not rig.moving, "rest")
        took_ns = rig.applied[-1].time_ns - (began_ns or rig.host.fresh_ns)
        if took_ns <= limit_ns or rig.held_up_ns < CANARY_NS:
            took_ms.append(took_ns // MS)
        mend()
        if len(took_ms) == COUNTED_ATTEMPTS:
            break
    print("speed 0 after", took_ms, "ms")
    assert took_ms, f"the machine was never quiet in {ATTEMPTS} attempts"
    assert max(took_ms) <= limit_ns // MS, f"{limit_ns // MS} ms promised, took {took_ms}"
    return attempts


def wait_said(rig: Rig, count: int, text: str) -> None:
    rig.wait_for(lambda: rig.daemon.said.count(text) >= count, f"'{text}'")
    assert rig.daemon.said.count(text) == count
