/* SPDX-License-Identifier: MIT */
/*
 * fw_line.h - one direction of an emulated serial line: a bounded queue whose
 * bytes come out one by one, as fast as a real UART would carry them. A pseudo
 * terminal has no baud rate, so the pace has to come from here. So do faults.
 *
 * Freestanding. Time is an argument and only has to grow.
 */
#ifndef FW_LINE_H
#define FW_LINE_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { FW_LINE_CAPACITY = 256 }; /* [bytes] on the line at once */

/* What goes wrong on the line, each once: with the n-th byte from now, 0 = not. */
struct fw_line_faults {
    uint32_t lose;  /* it does not arrive */
    uint32_t flip;  /* one of its bits arrives wrong */
    uint32_t twice; /* it arrives, and once more */
};

struct fw_line {
    struct fw_line_faults faults; /* the owner writes */
    uint8_t bytes[FW_LINE_CAPACITY];
    uint64_t arrival_ns[FW_LINE_CAPACITY]; /* when each byte is through */
    uint64_t free_ns;                      /* when the newest byte is through */
    uint32_t byte_ns;                      /* [ns] per byte */
    uint32_t head;
    uint32_t count;
};

/* Makes an empty line that carries one byte in byte_ns. */
void fw_line_init(struct fw_line *line, uint32_t byte_ns);

/* Starts sending buf at now_ns, behind what is already under way.
 * Returns how many bytes fit, the first ones; the rest is the caller's. */
size_t fw_line_put(struct fw_line *line, const uint8_t *buf, size_t len,
                   uint64_t now_ns);

/* Takes the oldest byte if it is through at now_ns. Returns 1, or 0. */
int fw_line_get(struct fw_line *line, uint64_t now_ns, uint8_t *byte);

/* When the oldest byte is through, UINT64_MAX if the line is empty. */
uint64_t fw_line_next_ns(const struct fw_line *line);

#ifdef __cplusplus
}
#endif

#endif
