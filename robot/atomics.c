/* SPDX-License-Identifier: MIT */
/*
 * atomics.c - what a C++ library calls to change shared words, for ARM before version 6: those
 * processors have no instruction for it, and the compiler's own library leaves it out. The
 * kernel does it for them. Of the daemon's C nothing needs this, and the linker drops it.
 * Source: Linux, Documentation/arch/arm/kernel_user_helpers.rst, kuser_cmpxchg, since 2.6.12.
 */
#include <stdint.h>

#if defined __arm__ && defined __ARM_ARCH && __ARM_ARCH < 6

/* Where the kernel puts it in every process: 0 if *at was old and is fresh now. */
#define KERNEL_SWAP 0xFFFF0FC0u

static int swaps(uint32_t old, uint32_t fresh, volatile uint32_t *at)
{
    int (*swap)(uint32_t, uint32_t, volatile uint32_t *) =
        (int (*)(uint32_t, uint32_t, volatile uint32_t *))KERNEL_SWAP;

    return swap(old, fresh, at) == 0;
}

/* Puts bits of mask of the word that holds *at to fresh if they are old, or anyway. Returns
 * what they were. */
static uint32_t change(volatile void *at, uint32_t mask, uint32_t old, uint32_t fresh, int anyway)
{
    uintptr_t address = (uintptr_t)at;
    volatile uint32_t *word = (volatile uint32_t *)(address & ~(uintptr_t)3);
    unsigned int shift = (unsigned int)(address & 3) * 8;
    uint32_t before;
    uint32_t was;

    do {
        before = *word;
        was = before >> shift & mask;
        if (was != old && !anyway)
            return was;
    } while (!swaps(before, (before & ~(mask << shift)) | fresh << shift, word));
    return was;
}

/* The compiler knows these names and lets nobody define them but so. */
uint8_t vs_swap_if_1(volatile void *at, uint8_t old, uint8_t fresh)
    __asm__("__sync_val_compare_and_swap_1");
uint32_t vs_swap_if_4(volatile void *at, uint32_t old, uint32_t fresh)
    __asm__("__sync_val_compare_and_swap_4");
uint8_t vs_swap_1(volatile void *at, uint8_t fresh) __asm__("__sync_lock_test_and_set_1");
uint32_t vs_swap_4(volatile void *at, uint32_t fresh) __asm__("__sync_lock_test_and_set_4");
uint32_t vs_add_4(volatile void *at, uint32_t more) __asm__("__sync_fetch_and_add_4");

uint8_t vs_swap_if_1(volatile void *at, uint8_t old, uint8_t fresh)
{
    return (uint8_t)change(at, 0xFFu, old, fresh, 0);
}

uint32_t vs_swap_if_4(volatile void *at, uint32_t old, uint32_t fresh)
{
    return change(at, 0xFFFFFFFFu, old, fresh, 0);
}

uint8_t vs_swap_1(volatile void *at, uint8_t fresh)
{
    return (uint8_t)change(at, 0xFFu, 0, fresh, 1);
}

uint32_t vs_swap_4(volatile void *at, uint32_t fresh)
{
    return change(at, 0xFFFFFFFFu, 0, fresh, 1);
}

uint32_t vs_add_4(volatile void *at, uint32_t more)
{
    volatile uint32_t *word = at;
    uint32_t was;

    do
        was = *word;
    while (!swaps(was, was + more, word));
    return was;
}

#else

enum { VS_ATOMICS_ARE_THE_PROCESSORS_OWN = 1 };

#endif
