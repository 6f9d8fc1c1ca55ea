/* SPDX-License-Identifier: MIT */
/*
 * mps2.c - board.h for ARM's MPS2 with the AN386 image, and what happens before main.
 * Source: ARM DAI 0386, "Cortex-M4 SMM on V2M-MPS2" (memory map, interrupts, the counter); ARM DDI 0479D,
 * "Cortex-M System Design Kit", 4.3 (UART); ARMv7-M Architecture Reference Manual, B3.2 and B3.3.
 */
#include "board.h"

#include <string.h>

#define CLOCK_HZ 25000000u
#define RING 2048u /* [byte] of what came and was not read; a power of two */

struct uart {
    volatile uint32_t data, state, control, interrupts, divider;
};
enum { FULL = 1, SENT = 1, RECEIVED = 2, BOTH_WAYS_WITH_INTERRUPTS = 15 };

static struct uart *const uarts[] = {(struct uart *)0x40004000, (struct uart *)0x40005000};
#define SYSTICK ((volatile uint32_t *)0xE000E010) /* control, reload, value */
#define COUNTER ((volatile uint32_t *)0x40028018) /* value, cycles of the board's clock less 1 */
#define NVIC_ENABLE (*(volatile uint32_t *)0xE000E100)

static struct ring {
    uint8_t bytes[RING];
    volatile uint32_t head, tail;
} received[2], to_send[2];

extern uint32_t stack_end[], data_from[], data_begin[], data_end[], bss_begin[], bss_end[];
int main(void);

void on_start(void)
{
    memcpy(data_begin, data_from, (size_t)((char *)data_end - (char *)data_begin));
    memset(bss_begin, 0, (size_t)((char *)bss_end - (char *)bss_begin));
    (void)main();
    for (;;)
        ;
}

static void on_fault(void)
{
    for (;;) /* a watchdog would begin here; the motors' packets have ended */
        ;
}

static void on_tick(void) /* it only ends the wait */
{
}

static void put(struct ring *ring, uint8_t byte)
{
    ring->bytes[ring->head % RING] = byte;
    ring->head = ring->head + 1;
}

static void receive(enum board_uart uart)
{
    uarts[uart]->interrupts = RECEIVED;
    put(&received[uart], (uint8_t)uarts[uart]->data);
}

/* With its interrupts off, or from one of them. */
static void send(enum board_uart uart)
{
    struct ring *ring = &to_send[uart];

    uarts[uart]->interrupts = SENT;
    while (ring->tail != ring->head && (uarts[uart]->state & FULL) == 0) {
        uarts[uart]->data = ring->bytes[ring->tail % RING];
        ring->tail = ring->tail + 1;
    }
}

static void on_host_received(void)
{
    receive(UART_HOST);
}

static void on_host_sent(void)
{
    send(UART_HOST);
}

static void on_motors_received(void)
{
    receive(UART_MOTORS);
}

static void on_motors_sent(void)
{
    send(UART_MOTORS);
}

/* The first sixteen are the core's, then the board's: UART 0 has received, has sent, then UART 1. */
__attribute__((section(".vectors"), used)) static void (*const vectors[])(void) = {
    (void (*)(void))stack_end, on_start, on_fault, on_fault, on_fault, on_fault, on_fault, 0, 0,
    0, 0, on_fault, on_fault, 0, on_fault, on_tick, on_host_received, on_host_sent,
    on_motors_received, on_motors_sent};

void board_init(void)
{
    int i;

    for (i = 0; i < 2; i++) {
        uarts[i]->divider = CLOCK_HZ / 115200u;
        uarts[i]->control = BOTH_WAYS_WITH_INTERRUPTS;
    }
    NVIC_ENABLE = 15;
    COUNTER[1] = CLOCK_HZ / 1000000u - 1u;
    SYSTICK[1] = CLOCK_HZ / 1000u - 1u;
    SYSTICK[2] = 0;
    SYSTICK[0] = 7; /* the core's clock, with interrupts */
}

uint64_t board_now_ns(void)
{
    static uint32_t last_us, turns;
    uint32_t now_us = COUNTER[0];

    turns += now_us < last_us; /* after 71 minutes */
    last_us = now_us;
    return ((uint64_t)turns << 32 | now_us) * 1000u + 1000u;
}

void board_wait(void)
{
    __asm volatile("wfi");
}

int board_read(enum board_uart uart)
{
    struct ring *ring = &received[uart];
    int byte;

    if (ring->tail == ring->head)
        return -1;
    if (ring->head - ring->tail > RING)
        ring->tail = ring->head - RING; /* overwritten */
    byte = ring->bytes[ring->tail % RING];
    ring->tail = ring->tail + 1;
    return byte;
}

int board_write(enum board_uart uart, const uint8_t *bytes, size_t len)
{
    struct ring *ring = &to_send[uart];

    if (len > RING - (ring->head - ring->tail))
        return -1;
    while (len-- > 0)
        put(ring, *bytes++);
    __asm volatile("cpsid i" ::: "memory");
    send(uart);
    __asm volatile("cpsie i" ::: "memory");
    return 0;
}
