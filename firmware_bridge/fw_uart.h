/* SPDX-License-Identifier: MIT */
/*
 * fw_uart.h - how a program of an e-puck's dsPIC lives behind its UART: an interrupt
 * puts bytes into a ring of 64 without an overflow test; the program takes them one by
 * one, but not while it transmits, for which it waits.
 *
 * Each direction of the line is a bounded queue whose bytes come out one by one, as fast as
 * a real UART would carry them. A pseudo terminal has no baud rate, so the pace has to come
 * from here. So do faults. Freestanding. Time is an argument and only has to grow.
 */
#ifndef FW_UART_H
#define FW_UART_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { FW_LINE_CAPACITY = 256 }; /* [bytes] on the line at once */
enum { FW_UART_RING = 64 }; /* [byte] receive buffer of the interrupt */

enum fw_uart_event {
    FW_UART_NONE = 0, /* nothing more until then */
    FW_UART_BYTE = 1, /* the program takes a byte */
    FW_UART_IDLE = 2  /* what kept it busy is over */
};

/* What goes wrong on the line, each once: with the n-th byte from now, 0 = not. */
struct fw_line_faults {
    uint32_t lose;  /* it does not arrive */
    uint32_t flip;  /* one of its bits arrives wrong */
    uint32_t twice; /* it arrives, and once more */
};

/* One direction. */
struct fw_line {
    struct fw_line_faults faults; /* the owner writes */
    uint8_t bytes[FW_LINE_CAPACITY];
    uint64_t arrival_ns[FW_LINE_CAPACITY]; /* when each byte is through */
    uint64_t free_ns;                      /* when the newest byte is through */
    uint32_t byte_ns;                      /* [ns] per byte */
    uint32_t head;
    uint32_t count;
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

/* Starts sending buf at now_ns, behind what is already under way.
 * Returns how many bytes fit, the first ones; the rest is the caller's. */
size_t fw_line_put(struct fw_line *line, const uint8_t *buf, size_t len,
                   uint64_t now_ns);

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
