"""Robots that are a microcontroller: libvsense's two examples under a real `vsense run`.

One runs on an emulated Cortex-M4 and moves an emulated e-puck over a byte stream. The other one is
for ESP-IDF and sockets: it is compiled with a stand-in for what ESP-IDF has beside them, and runs
as a program of this machine.
"""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

import vsense
from tests.conftest import require_tool
from tests.rigs.compiling import PROTOCOL
from tests.rigs.places import ROOT
from tests.system.floor import MS, Floor, LinesTracker, Program, experiment

TAG = 23
LIMIT_NS = 450 * MS
CANARY_NS = 10 * MS
SECRET_AT = 0x203FFFF0
"""Where `mps2.ld` has a start's random bytes."""


EXAMPLES = ROOT / "c_src" / "examples"
COMMON = [*PROTOCOL, *EXAMPLES.glob("*.c")]
FLAGS = ["-Os", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-DVS_SMALL", f"-I{ROOT / 'c_src'}"]
FLAGS += [f"-DROBOT_TAG={TAG}"]

ESP_IDF = """
#include <fcntl.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/random.h>
#include <time.h>

typedef int esp_err_t;
typedef const char *esp_event_base_t;
typedef struct { int unused; } wifi_init_config_t;
typedef struct { struct { uint8_t ssid[32], password[64]; } sta; } wifi_config_t;
typedef void (*handler)(void *, esp_event_base_t, int32_t, void *);
#define WIFI_EVENT "WIFI_EVENT"
#define WIFI_INIT_CONFIG_DEFAULT() {0}
#define ESP_ERROR_CHECK(x) do { if ((x) != 0) abort(); } while (0)
enum { WIFI_EVENT_STA_START, WIFI_EVENT_STA_DISCONNECTED, WIFI_MODE_STA, WIFI_IF_STA, WIFI_PS_NONE,
       ESP_MAC_WIFI_STA };

static inline int64_t esp_timer_get_time(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC_RAW, &t);
    return t.tv_sec * 1000000 + t.tv_nsec / 1000;
}
static inline void esp_fill_random(void *to, size_t len)
{
    if (getrandom(to, len, 0) != (ssize_t)len) abort();
}
static inline esp_err_t esp_read_mac(uint8_t *mac, int of)
{
    mac[5] = 1;
    return of != ESP_MAC_WIFI_STA;
}
static inline esp_err_t nvs_flash_init(void) { return 0; }
static inline esp_err_t esp_netif_init(void) { return 0; }
static inline esp_err_t esp_event_loop_create_default(void) { return 0; }
static inline void *esp_netif_create_default_wifi_sta(void) { return NULL; }
static inline esp_err_t esp_wifi_init(const wifi_init_config_t *c) { return c->unused; }
static inline esp_err_t esp_event_handler_register(esp_event_base_t base, int32_t id, handler to,
                                                   void *with)
{
    return base == NULL || id > WIFI_EVENT_STA_DISCONNECTED || to == NULL || with != NULL;
}
static inline esp_err_t esp_wifi_set_mode(int mode) { return mode != WIFI_MODE_STA; }
static inline esp_err_t esp_wifi_set_config(int which, wifi_config_t *c)
{
    return which != WIFI_IF_STA || c->sta.ssid[0] == 0;
}
static inline esp_err_t esp_wifi_start(void) { return 0; }
static inline esp_err_t esp_wifi_connect(void) { return 0; }
static inline esp_err_t esp_wifi_set_ps(int type) { return type != WIFI_PS_NONE; }
"""
"""What the example asks of ESP-IDF beside sockets, by ESP-IDF's names and types."""

ESP_HEADERS = ("err", "event", "mac", "netif", "random", "timer", "wifi")

MOTORS = """
#include <stdio.h>
#include "motors.h"
#include "esp_timer.h"
void motors_begin(void) {}
void motors_set(int16_t left, int16_t right)
{
    static int16_t before[2] = {-1, -1};
    if (left != before[0] || right != before[1])
        printf("%d %d %lld\\n", left, right, (long long)esp_timer_get_time());
    fflush(stdout);
    before[0] = left, before[1] = right;
}
int main(void) { void app_main(void); app_main(); return 0; }
"""


def compiled(command: list[str], sources: list[Path], target: Path) -> Path:
    words = [*command, *FLAGS, *map(str, sources), "-o", str(target)]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return target


def built(folder: Path) -> Path:
    """The example for a bare board, as its page says."""
    compiler = require_tool("arm-none-eabi-gcc", "gcc-arm-none-eabi libnewlib-arm-none-eabi")
    sources = [*COMMON, *EXAMPLES.glob("bare/*.c")]
    sources += [ROOT / "c_src" / f"epuck_{part}.c" for part in ("asercom", "bytes")]
    command = [compiler, "-std=c99", "-mcpu=cortex-m4", "-mthumb", "-ffunction-sections"]
    command += ["-fdata-sections", "-Wl,--gc-sections", "-nostartfiles"]
    command += ["-T", str(EXAMPLES / "bare" / "mps2.ld")]
    return compiled(command, sources, folder / "bare.elf")


def built_for_esp32(folder: Path, port: int) -> Path:
    """The example for ESP-IDF, for this machine."""
    stubs = folder / "esp"
    stubs.mkdir()
    for name in (*(f"esp_{part}.h" for part in ESP_HEADERS), "nvs_flash.h"):
        (stubs / name).write_text('#include "esp_idf.h"\n')
    (stubs / "esp_idf.h").write_text("#pragma once\n" + ESP_IDF)
    (folder / "motors.c").write_text(MOTORS)
    command = [require_tool("cc", "build-essential"), "-std=gnu17", f"-I{stubs}"]
    command += [f"-I{EXAMPLES / 'esp32'}", '-DHOST_ADDRESS="127.0.0.1"', f"-DHOST_PORT={port}"]
    sources = [*COMMON, EXAMPLES / "esp32" / "main.c", folder / "motors.c"]
    return compiled(command, sources, folder / "esp32")


class Board(Program):
    """The board: one of its lines is a connection that is made again, one leads to a base."""

    def __init__(self, program: Path, port: int, device: str) -> None:
        words = [
            "-M",
            "mps2-an386",
            "-kernel",
            str(program),
            "-display",
            "none",
            "-monitor",
            "none",
        ]
        words += ["-chardev", f"socket,id=host,host=127.0.0.1,port={port},reconnect=1"]
        words += ["-chardev", f"serial,id=motors,path={device}"]
        words += ["-serial", "chardev:host", "-serial", "chardev:motors"]
        for place in (SECRET_AT, SECRET_AT + 8):
            data = int.from_bytes(os.urandom(8), "little")
            words += ["-device", f"loader,addr={place:#x},data={data:#x},data-len=8"]
        super().__init__(require_tool("qemu-system-arm", "qemu-system-arm"), *words)


@pytest.fixture
def floor() -> Iterator[Floor]:
    made = Floor([TAG], base="asercom")
    yield made
    made.close()


def start_host(floor: Floor, file: Path, port: int, number: int) -> tuple[Program, int]:
    words = ["run", str(file), "--port", str(port), "--other-programs"]
    host = floor.program(*words, "--output", str(file.parent / f"notes{number}"))
    waiting = r"waiting for robots on .*, port (\d+)"
    floor.wait_for(host.heard(waiting), "the host")
    found = re.search(waiting, host.said)
    assert found is not None
    return host, int(found[1])


def test_a_bare_one_drives_stops_with_its_host_and_goes_on_with_the_next(
    floor: Floor, tmp_path: Path
) -> None:
    program = built(tmp_path)
    tracker = LinesTracker([TAG])
    floor.add(tracker)
    file = experiment(tmp_path, tracker.framework(), [TAG], 3000)
    host, port = start_host(floor, file, 0, 1)
    floor.add(Board(program, port, floor.device(TAG)))
    floor.wait_for(floor.moving, "motion")
    assert floor.speeds(TAG) == (400, 300)
    for number in (signal.SIGSTOP, signal.SIGKILL):
        floor.held_up_ns = 0
        begun_ns = floor.clock()
        host.tell(number)
        floor.wait_for(floor.resting, f"rest after {number.name}")
        late_ns = floor.stopped_ns(TAG) - begun_ns
        print(number.name, late_ns / MS, floor.held_up_ns / MS)
        assert late_ns <= LIMIT_NS or floor.held_up_ns > CANARY_NS
        floor.live_for(3000 * MS)
        assert floor.resting()
        if number == signal.SIGSTOP:
            host.tell(signal.SIGCONT)
            floor.wait_for(floor.moving, "motion again")
    floor.remove(host)
    begun_ns = floor.clock()
    start_host(floor, file, port, 2)
    floor.wait_for(floor.moving, "motion under the next host")
    print("again after", (floor.clock() - begun_ns) / MS)


def test_one_with_sockets_drives_stops_with_its_host_and_goes_on_with_the_next(
    floor: Floor, tmp_path: Path
) -> None:
    tracker = LinesTracker([TAG])
    floor.add(tracker)
    file = experiment(tmp_path, tracker.framework(), [TAG], 3000)
    host, port = start_host(floor, file, 0, 1)
    robot = Program(str(built_for_esp32(tmp_path, port)))
    floor.add(robot)

    def wheels() -> list[int]:
        return list(map(int, robot.printed.splitlines()[-1].split())) if robot.printed else [0, 0]

    def moves() -> bool:
        return wheels()[:2] == [400, 300]

    floor.wait_for(moves, "motion")
    for number in (signal.SIGSTOP, signal.SIGKILL):
        floor.held_up_ns = 0
        begun_us = floor.clock() // 1000
        host.tell(number)
        floor.wait_for(lambda: wheels()[:2] == [0, 0], f"rest after {number.name}")
        late_ns = (wheels()[2] - begun_us) * 1000
        print(number.name, late_ns / MS, floor.held_up_ns / MS)
        assert late_ns <= LIMIT_NS or floor.held_up_ns > CANARY_NS
        floor.live_for(1000 * MS)
        assert wheels()[:2] == [0, 0]
        if number == signal.SIGSTOP:
            host.tell(signal.SIGCONT)
            floor.wait_for(moves, "motion again")
    floor.remove(host)
    start_host(floor, file, port, 2)
    floor.wait_for(moves, "motion under the next host")
    assert not robot.ended


def test_every_build_system_compiles_the_same_files() -> None:
    names = {path.name for path in PROTOCOL}
    facts = json.loads((ROOT / "c_src" / "library.json").read_text())
    listed = set(re.findall(r"\+<(\w+\.c)>", " ".join(facts["build"]["srcFilter"])))
    cmake = set(re.findall(r"\bvs_\w+\.c\b", (ROOT / "c_src" / "CMakeLists.txt").read_text()))
    assert listed == cmake == names
    assert facts["version"] == vsense.__version__ and "-DVS_SMALL" in facts["build"]["flags"]
