/* SPDX-License-Identifier: MIT */
/*
 * fw_uart.h - how a program of an e-puck's dsPIC lives behind its UART: an interrupt
 * puts bytes into a ring of 64 without an overflow test; the program takes them one by
 * one, but not while it transmits, for which it waits. Freestanding.
 */
#ifndef FW_UART_H
#define FW_UART_H

#include <stddef.h>
#include <stdint.h>

#include "fw_line.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { FW_UART_RING = 64 }; /* [byte] receive buffer of the interrupt */

enum fw_uart_event {
    FW_UART_NONE = 0, /* nothing more until then */
    FW_UART_BYTE = 1, /* the program takes a byte */
    FW_UART_IDLE = 2  /* what kept it busy is over */
};

struct fw_uart {
    struct fw_line rx;
    struct fw_line tx;
    uint32_t overlapped; /* bytes that came while it transmitted: a host that keeps a
                            protocol's rule never makes one */
    uint32_t overflowed; /* bytes lost in the receive ring */
    uint32_t unsent;     /* bytes of answers lost on a full line: nobody took the others */
    uint64_t lived_ns;   /* everything up to here has happened */
    uint64_t busy_until_ns; /* 0: the program takes bytes */
    uint8_t sending;     /* busy with transmitting, else with something else */
    uint8_t ring[FW_UART_RING];
    uint32_t ring_read;
    uint32_t ring_write;
};

/* Power on: nothing on the lines. */
void fw_uart_init(struct fw_uart *uart, uint32_t byte_ns);

/* Reset: what was in the ring is gone, the program is idle. */
void fw_uart_reset(struct fw_uart *uart);

/* The program transmits, now. */
void fw_uart_send(struct fw_uart *uart, const uint8_t *buf, size_t len);

/* The program does something else for a while, from now on. */
void fw_uart_keep_busy(struct fw_uart *uart, uint32_t duration_us);

/* Lives on to the next event, at the longest until until_us. */
enum fw_uart_event fw_uart_step(struct fw_uart *uart, uint64_t until_us, uint8_t *byte);

/* Takes the bytes that reached the host by now_us. Returns how many. */
size_t fw_uart_transmitted(struct fw_uart *uart, uint8_t *buf, size_t cap, uint64_t now_us);

/* When all that is on one of the lines is through, or the program is no longer busy:
 * looking earlier gains nothing. UINT64_MAX if nothing is under way. */
uint64_t fw_uart_due_us(const struct fw_uart *uart);

#ifdef __cplusplus
}
#endif

#endif
