# SPDX-License-Identifier: MIT
"""A Thymio II or 3 by cable, dongle or Aseba's TCP: thymio.py /dev/ttyACM0|HOST:PORT [NODE]

It needs the package thymiodirect (BSD; extra `thymio` of vsense). One driver has the line; several
Thymios of one dongle (at most 6, says its manual) go through `asebaswitch`, each with its NODE.

Nothing in a Thymio stops its motors when nobody speaks to it any more. So the driver loads a short
program into its virtual machine: every 200 ms it multiplies both motors' targets with a variable of
its own that each order sets to 1, and sets that to 0. Whatever breaks, cable, dongle, driver or
host, the wheels stop 200 to 400 ms after the last order.

Sources: names of variables, 16.6 cm/s at a target of 500, and what SET_VARIABLES does: Mobsya/aseba
78225eb aseba/targets/playground/robots/thymio2/Thymio2-descriptions.c, Thymio2.cpp:152,
aseba/common/consts.h. Not tried on a robot. Its LEDs are its own firmware's.
"""

import asyncio
import os
import sys
import threading
import time
import traceback

import serial
import thymiodirect.assembler
import vsense_driver
from thymiodirect.connection import Connection

M_S = 0.166 / 500  # of one unit of a motor's target
PROVEN_S = 0.025
RAW_MAX = 4095
TICK_S = 0.005
DISCOVER_S = 1.0
WATCHDOG_MS = 200
WATCHDOG = """
    dc end
    dc _ev.init, begin
    dc _ev.timer0, look
end:
begin:
    push.s {period}
    store timer.period
    stop
look:
    load motor.left.target
    load _userdata
    mult
    store motor.left.target
    load motor.right.target
    load _userdata
    mult
    store motor.right.target
    push.s 0
    store _userdata
    stop
"""
SPAN = {"prox.horizontal", "prox.ground.delta", "motor.left.target", "motor.right.speed"}


class Thymio:
    max_m_s = 500 * M_S

    def __init__(self, where, node=None):
        loop = asyncio.new_event_loop()
        host, _, port = where.rpartition(":")
        if host:
            self.line = Connection.tcp(host, int(port), discover_rate=DISCOVER_S, loop=loop)
        else:
            port = serial.Serial(where, timeout=1)
            vsense_driver.hold(port.fileno())  # before anything is read
            self.line = Connection(port, discover_rate=DISCOVER_S, loop=loop)
        self.line.on_variables_received = self.received
        self.ticking = loop.create_task(self.tick())
        threading.Thread(target=loop.run_forever, daemon=True).start()
        self.line.wait_for_handshake(1)
        self.node = self.line.one_remote_node_id() if node is None else int(node)
        described = self.line.remote_nodes[self.node]
        self.alive, self.offset = described.var_total_size, described.var_offset
        self.start, self.count = described.data_span_for_variables(SPAN)
        program = WATCHDOG.format(period=WATCHDOG_MS)
        code = thymiodirect.assembler.Assembler(described, program).assemble()
        self.line.set_bytecode(self.node, code)
        self.line.run(self.node)
        self.told, self.measured_ns, self.way_m = (0, 0), None, [0.0, 0.0]
        self.has_answered = threading.Event()

    async def tick(self):
        """Its loop takes what another thread has read only when it wakes up."""
        while True:
            await asyncio.sleep(TICK_S)

    async def received(self, node):
        if node == self.node and self.values("motor.left.target", 2) == list(self.told):
            self.has_answered.set()

    def values(self, name, count):
        data, at = self.line.remote_nodes[self.node].var_data, self.offset[name]
        return [(value + 0x8000) % 0x10000 - 0x8000 for value in data[at : at + count]]

    def drive(self, left_m_s, right_m_s):
        """An order counts when the targets that are read back are its own."""
        self.told = tuple(round(speed / M_S) for speed in (left_m_s, right_m_s))
        targets = [value % 0x10000 for value in self.told]
        self.has_answered.clear()
        self.line.set_variables(self.node, self.alive, [1])
        self.line.set_variables(self.node, self.offset["motor.left.target"], targets)
        self.line.get_variables(self.node, self.start, self.count)
        if not self.has_answered.wait(PROVEN_S):
            raise TimeoutError

    def sense(self, report):
        now_ns, before_ns = time.monotonic_ns(), self.measured_ns
        self.measured_ns = now_ns
        far_left, left, ahead, right, far_right, back_left, back_right = (
            min(value, RAW_MAX) for value in self.values("prox.horizontal", 7)
        )
        # Each where an e-puck has the sensor that looks most as it does: ps0 to ps7, clockwise.
        front = (max(right, ahead), far_right), (far_left, max(left, ahead))
        report.proximity = [*front[0], 0, back_right, back_left, 0, *front[1]]
        ground = [min(value / 1023, 1.0) for value in self.values("prox.ground.delta", 2)]
        report.ground = ground[0], sum(ground) / 2, ground[1]
        speeds = self.values("motor.left.speed", 2)
        for i, speed in enumerate(speeds if before_ns else ()):
            self.way_m[i] += speed * M_S * (now_ns - before_ns) / 1e9  # it counts no steps
        report.way_m = self.way_m

    def close(self):
        self.line.shutdown()


if __name__ == "__main__":
    try:
        vsense_driver.run(Thymio(*sys.argv[1:]))
    except Exception:
        traceback.print_exc()
        os._exit(1)  # a thread of the package would live on, and hold the line
    os._exit(0)
