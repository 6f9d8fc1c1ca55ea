/* SPDX-License-Identifier: MIT */
/* epuck_bytes.h - 16-bit numbers, little-endian, and a checksum: what e-puck protocols share. */
#ifndef EPUCK_BYTES_H
#define EPUCK_BYTES_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

void epuck_put_u16(uint8_t at[2], uint16_t value);

uint16_t epuck_get_u16(const uint8_t at[2]);

int16_t epuck_get_s16(const uint8_t at[2]);

void epuck_zero(uint8_t *at, size_t len);

/* XOR of all bytes. */
uint8_t epuck_xor(const uint8_t *at, size_t len);

/* OR of all bytes: 0 if there are only zeros. */
uint8_t epuck_or(const uint8_t *at, size_t len);

#ifdef __cplusplus
}
#endif

#endif
