/* SPDX-License-Identifier: MIT */
#include "fw_line.h"

enum { FLIPPED = 0x10 }; /* the bit that a fault turns */

void fw_line_init(struct fw_line *line, uint32_t byte_ns)
{
    line->faults = (struct fw_line_faults){0, 0, 0};
    line->free_ns = 0;
    line->byte_ns = byte_ns;
    line->head = 0;
    line->count = 0;
}

/* Counts down to the byte that a fault is for. Returns 1 if this is it. */
static int is_due(uint32_t *countdown)
{
    if (*countdown == 0)
        return 0;
    (*countdown)--;
    return *countdown == 0;
}

static void add(struct fw_line *line, uint8_t byte)
{
    uint32_t at = (line->head + line->count) % FW_LINE_CAPACITY;

    line->bytes[at] = byte;
    line->arrival_ns[at] = line->free_ns;
    line->count++;
}

size_t fw_line_put(struct fw_line *line, const uint8_t *buf, size_t len,
                   uint64_t now_ns)
{
    size_t taken = 0;

    if (line->free_ns < now_ns)
        line->free_ns = now_ns;
    while (taken < len && line->count < FW_LINE_CAPACITY) {
        uint8_t byte = buf[taken];

        line->free_ns += line->byte_ns;
        taken++;
        if (is_due(&line->faults.flip))
            byte ^= FLIPPED;
        if (is_due(&line->faults.lose))
            continue;
        add(line, byte);
        if (is_due(&line->faults.twice) && line->count < FW_LINE_CAPACITY)
            add(line, byte);
    }
    return taken;
}

int fw_line_get(struct fw_line *line, uint64_t now_ns, uint8_t *byte)
{
    if (fw_line_next_ns(line) > now_ns)
        return 0;
    *byte = line->bytes[line->head];
    line->head = (line->head + 1) % FW_LINE_CAPACITY;
    line->count--;
    return 1;
}

uint64_t fw_line_next_ns(const struct fw_line *line)
{
    return line->count == 0 ? UINT64_MAX : line->arrival_ns[line->head];
}
