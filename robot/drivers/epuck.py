# SPDX-License-Identifier: MIT
"""An e-puck with GCtronic's firmware behind a serial line: epuck.py /dev/ttyS1

Selector at 10, extension connector, 230400 baud. What goes over the line stands in
c_src/epuck_asercom.h, with its sources. A native base does the same (`asercom:`); this one shows
how a driver looks, and lets `vsense lab --base exec` emulate robots that have one.
"""

import os
import select
import struct
import sys
import termios
import time
import tty

import vsense_driver

STEP_M = 128.805e-6
ASK = bytes([0xB2, 0xB1, 0xAF, 0x9E, 0xBB, 0])  # proximity, light, steps, battery, speeds
ANSWER = struct.Struct("<10h10h2HH2h")
RESYNC = bytes(36) + b"\rV\r"
LIGHT_MAX = 4095
ANSWER_S, QUIET_S = 0.02, 0.01


class EPuck:
    max_m_s = 1000 * STEP_M

    def __init__(self, device):
        self.line = os.open(device, os.O_RDWR | os.O_NOCTTY)
        vsense_driver.hold(self.line)
        tty.setraw(self.line)
        settings = termios.tcgetattr(self.line)
        settings[4] = settings[5] = termios.B230400
        termios.tcsetattr(self.line, termios.TCSANOW, settings)
        self.counted, self.steps, self.leds = None, [0, 0], 0x100
        self.resync()

    def resync(self):
        """From whatever its firmware waits for back to idle."""
        os.write(self.line, RESYNC)
        while select.select([self.line], [], [], QUIET_S)[0]:
            self.read()

    def read(self):
        """What has come; of a line that was unplugged there is nothing, for ever."""
        return os.read(self.line, 4096) or sys.exit("epuck.py: the serial line is gone")

    def ask(self, packet):
        """Its answer, which has to end with the speeds that it was told."""
        os.write(self.line, packet)
        got, end_s = b"", time.monotonic() + ANSWER_S
        while len(got) < ANSWER.size:
            if not select.select([self.line], [], [], max(end_s - time.monotonic(), 0))[0]:
                break
            got += self.read()
        if len(got) != ANSWER.size or got[-4:] != packet[1:5]:
            self.resync()
            raise TimeoutError
        return ANSWER.unpack(got)

    def drive(self, left_m_s, right_m_s):
        speeds = [round(speed / STEP_M) for speed in (left_m_s, right_m_s)]
        lamps = b"".join(bytes([0xB4, i, self.leds >> i & 1]) for i in range(8))
        self.answer = self.ask(b"\xbc" + struct.pack("<2h", *speeds) + lamps + ASK)

    def lights(self, leds, rgb):
        if leds != self.leds:  # with the next order, if it is not the first one
            self.leds = leds
            self.drive(*(speed * STEP_M for speed in self.answer[-2:]))

    def sense(self, report):
        proximity, light = self.answer[:8], self.answer[10:18]
        counters, battery = self.answer[20:22], self.answer[22]
        for i, count in enumerate(counters):
            grown = (count - self.counted[i] + 0x8000) % 0x10000 - 0x8000 if self.counted else 0
            self.steps[i] += grown
        self.counted = counters
        report.proximity = proximity
        report.light = [LIGHT_MAX - value for value in light]
        report.way_m = [steps * STEP_M for steps in self.steps]
        report.battery_low = battery == 0 if battery <= 1 else battery < 2070
        report.battery_v = 3.4 + (battery - 2070) * 0.8 / 490 if battery > 1 else None


if __name__ == "__main__":
    vsense_driver.run(EPuck(sys.argv[1]))
