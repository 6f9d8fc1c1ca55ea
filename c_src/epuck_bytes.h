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

/* Reads numbers. Returns 0, or -1 if one is not within least..most. */
int epuck_get_raw(const uint8_t *at, int count, int least, int most, int16_t *raw);

/* Reads calibrated proximity: what was measured, -4095..4095, minus what was measured where
 * nothing was near, so 0..8190 with flickering light. What is above 4095 becomes that.
 * Returns 0, or -1. Source: e-puck-library 4cb85cb library/a_d/advance_ad_scan/e_prox.c:124-138;
 * e-puck2_main-processor 517ef07 src/sensors/proximity.c:346-358. */
int epuck_get_calibrated(const uint8_t *at, int count, int16_t *prox);

void epuck_zero(uint8_t *at, size_t len);

/* XOR of all bytes. */
uint8_t epuck_xor(const uint8_t *at, size_t len);

/* OR of all bytes: 0 if there are only zeros. */
uint8_t epuck_or(const uint8_t *at, size_t len);

#ifdef __cplusplus
}
#endif

#endif
