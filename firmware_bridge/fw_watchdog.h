/* SPDX-License-Identifier: MIT */
/*
 * fw_watchdog.h - stops the motors when the host falls silent, which no e-puck's firmware
 * does by itself. Freestanding: no clock, no timer, no motor of its own, 4 bytes of memory.
 * README.md says where its calls go in each firmware.
 *
 * fw_watchdog_feed is called where a command arrives, before its speeds are applied;
 * fw_watchdog_tick by something that runs even while the program waits for bytes, such as a
 * timer's interrupt. A tick may interrupt feeding, which is one write of 16 bits; feeding must
 * not interrupt a tick.
 */
#ifndef FW_WATCHDOG_H
#define FW_WATCHDOG_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum {
    FW_WATCHDOG_TICK_MS = 10, /* [ms] between two ticks */
    FW_WATCHDOG_TICKS = 40    /* after the last command: the motors stop 390 to 400 ms later */
};

struct fw_watchdog {
    volatile uint16_t left; /* [tick] until the motors stop; 0: asleep, as at power on */
};

/* A command has come: the motors may turn for so many ticks more. */
void fw_watchdog_feed(struct fw_watchdog *watchdog, uint16_t ticks);

/* One tick has passed. Returns 1 if the motors have to be stopped now, which is said once. */
int fw_watchdog_tick(struct fw_watchdog *watchdog);

#ifdef __cplusplus
}
#endif

#endif
