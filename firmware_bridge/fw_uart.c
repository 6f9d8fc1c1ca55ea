/* SPDX-License-Identifier: MIT */
#include "fw_uart.h"

#define NS_PER_US 1000u

enum { FLIPPED = 0x10 }; /* the bit that a fault turns */

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

/* When the oldest byte is through, UINT64_MAX if the line is empty. */
static uint64_t next_ns(const struct fw_line *line)
{
    return line->count == 0 ? UINT64_MAX : line->arrival_ns[line->head];
}

/* Takes the oldest byte if it is through at now_ns. Returns 1, or 0. */
static int get(struct fw_line *line, uint64_t now_ns, uint8_t *byte)
{
    if (next_ns(line) > now_ns)
        return 0;
    *byte = line->bytes[line->head];
    line->head = (line->head + 1) % FW_LINE_CAPACITY;
    line->count--;
    return 1;
}

void fw_uart_init(struct fw_uart *uart, uint32_t byte_ns)
{
    *uart = (struct fw_uart){0};
    uart->rx.byte_ns = uart->tx.byte_ns = byte_ns;
}

void fw_uart_reset(struct fw_uart *uart)
{
    uart->ring_read = uart->ring_write;
    uart->busy_until_ns = 0;
    uart->sending = 0;
}

void fw_uart_send(struct fw_uart *uart, const uint8_t *buf, size_t len)
{
    uart->unsent += (uint32_t)(len - fw_line_put(&uart->tx, buf, len, uart->lived_ns));
    uart->busy_until_ns = uart->tx.free_ns;
    uart->sending = 1;
}

void fw_uart_keep_busy(struct fw_uart *uart, uint32_t duration_us)
{
    uart->busy_until_ns = uart->lived_ns + (uint64_t)duration_us * NS_PER_US;
    uart->sending = 0;
}

static void interrupt(struct fw_uart *uart, uint8_t byte)
{
    if (uart->busy_until_ns != 0 && uart->sending)
        uart->overlapped++;
    uart->ring[uart->ring_write] = byte;
    uart->ring_write = (uart->ring_write + 1) % FW_UART_RING;
    if (uart->ring_write == uart->ring_read)
        uart->overflowed += FW_UART_RING;
}

enum fw_uart_event fw_uart_step(struct fw_uart *uart, uint64_t until_us, uint8_t *byte)
{
    while (uart->busy_until_ns != 0 || uart->ring_read == uart->ring_write) {
        uint64_t at_ns = next_ns(&uart->rx);
        int free_first = uart->busy_until_ns != 0 && uart->busy_until_ns <= at_ns;

        if (free_first)
            at_ns = uart->busy_until_ns;
        if (at_ns / NS_PER_US + (at_ns % NS_PER_US != 0) > until_us)
            return FW_UART_NONE;
        uart->lived_ns = at_ns;
        if (free_first) {
            uart->busy_until_ns = 0;
            return FW_UART_IDLE;
        }
        if (get(&uart->rx, at_ns, byte))
            interrupt(uart, *byte);
    }
    *byte = uart->ring[uart->ring_read];
    uart->ring_read = (uart->ring_read + 1) % FW_UART_RING;
    return FW_UART_BYTE;
}

size_t fw_uart_transmitted(struct fw_uart *uart, uint8_t *buf, size_t cap, uint64_t now_us)
{
    size_t len = 0;

    while (len < cap && get(&uart->tx, now_us * NS_PER_US, &buf[len]))
        len++;
    return len;
}

static uint64_t all_through_ns(const struct fw_line *line)
{
    return line->count == 0 ? UINT64_MAX : line->free_ns;
}

uint64_t fw_uart_due_us(const struct fw_uart *uart)
{
    uint64_t rx_ns = all_through_ns(&uart->rx);
    uint64_t tx_ns = all_through_ns(&uart->tx);
    uint64_t due_ns = rx_ns < tx_ns ? rx_ns : tx_ns;

    if (uart->busy_until_ns != 0 && uart->busy_until_ns < due_ns)
        due_ns = uart->busy_until_ns;
    return due_ns == UINT64_MAX ? UINT64_MAX : due_ns / NS_PER_US + 1;
}
