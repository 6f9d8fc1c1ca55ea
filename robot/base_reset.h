/* SPDX-License-Identifier: MIT */
/*
 * base_reset.h - the GPIO that holds a robot's microcontroller in reset while it is low: the
 * last way to stop wheels when a bus is stuck and no stop can be delivered. On a Pi-puck it is
 * 24. Source: yorkrobotlab/pi-puck 9cb1a25 device-tree/pi-puck-config.txt:37-38 and
 * python-library/pipuck/epuck.py:10, 30-31, 49-52 (pin 18 of the board), 0.1 s long.
 */
#ifndef VS_BASE_RESET_H
#define VS_BASE_RESET_H

#include <stdint.h>

#define VS_RESET_HOLD_NS 100000000u   /* [ns] low */
#define VS_RESET_REST_NS 5000000000u  /* [ns] from one reset to the next: it has to boot */

struct vs_reset {
    uint8_t kind;      /* 0: there is none */
    uint8_t held;      /* 1: it is low */
    int fd;
    uint64_t begun_ns; /* of the newest reset, 0: none, or one that helped */
};

/* Opens the GPIO, high. Its name is a number, through /sys/class/gpio or, where that is gone or
 * counts from elsewhere, line of that number of /dev/gpiochip0; or the folder of one that was
 * exported before, such as /sys/class/gpio/gpio536. VS_OK, or VS_ERR_IO with errno set. */
int vs_reset_open(struct vs_reset *reset, const char *name);

/* Begins a reset unless the last one was a moment ago. Returns 1 if it did. */
int vs_reset_begin(struct vs_reset *reset, uint64_t now_ns);

/* While a reset lasts this waits, at the longest 20 ms, and returns 1; then it lets go. */
int vs_reset_lasts(struct vs_reset *reset, uint64_t now_ns);

#endif
