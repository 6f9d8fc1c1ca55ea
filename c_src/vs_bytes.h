/* SPDX-License-Identifier: MIT */
/*
 * vs_bytes.h - little-endian bytes, bounded: a writer and a reader with a
 * sticky error, so that call sites stay flat and only the end is checked.
 * Internal to libvsense and its tests.
 */
#ifndef VS_BYTES_H
#define VS_BYTES_H

#include <stddef.h>
#include <stdint.h>

#include "vs_err.h"

/* One number at a place whose room the caller has checked. Storing gives the place behind it. */
static inline uint8_t *vs_store_u8(uint8_t *at, uint8_t value)
{
    at[0] = value;
    return at + 1;
}

static inline uint8_t *vs_store_u16(uint8_t *at, uint16_t value)
{
    at[0] = (uint8_t)value;
    at[1] = (uint8_t)(value >> 8);
    return at + 2;
}

static inline uint8_t *vs_store_u32(uint8_t *at, uint32_t value)
{
    at[0] = (uint8_t)value;
    at[1] = (uint8_t)(value >> 8);
    at[2] = (uint8_t)(value >> 16);
    at[3] = (uint8_t)(value >> 24);
    return at + 4;
}

static inline uint8_t *vs_store_u64(uint8_t *at, uint64_t value)
{
    return vs_store_u32(vs_store_u32(at, (uint32_t)value), (uint32_t)(value >> 32));
}

static inline uint16_t vs_load_u16(const uint8_t *at)
{
    return (uint16_t)(at[0] | at[1] << 8);
}

static inline uint32_t vs_load_u32(const uint8_t *at)
{
    return (uint32_t)at[0] | (uint32_t)at[1] << 8 | (uint32_t)at[2] << 16 |
           (uint32_t)at[3] << 24;
}

static inline uint64_t vs_load_u64(const uint8_t *at)
{
    return (uint64_t)vs_load_u32(at + 4) << 32 | vs_load_u32(at);
}

/* Bytes where words may lie: an ARM reads them word by word. */
union vs_words {
    uint32_t words[14];
    uint8_t bytes[56];
};

static inline int vs_is_aligned(const uint8_t *at)
{
    return ((uintptr_t)at & (sizeof(uint32_t) - 1)) == 0;
}

/* The same address, which the compiler may then believe to be a word's. */
static inline const uint8_t *vs_aligned(const uint8_t *at)
{
#if defined __GNUC__
    return __builtin_assume_aligned(at, sizeof(uint32_t));
#else
    return at;
#endif
}

/* Writes into the caller's buf; after an error nothing more is written. */
struct vs_writer {
    uint8_t *buf;
    size_t cap; /* bytes in buf */
    size_t len; /* bytes written */
    int error;  /* VS_OK or the first error */
    const uint8_t *key; /* of a packet's tag */
};

void vs_writer_init(struct vs_writer *w, uint8_t *buf, size_t cap);
void vs_put_u8(struct vs_writer *w, uint8_t value);
void vs_put_u16(struct vs_writer *w, uint16_t value);
void vs_put_u32(struct vs_writer *w, uint32_t value);
void vs_put_u64(struct vs_writer *w, uint64_t value);

/* Room for len bytes that the caller writes, or NULL with VS_ERR_SPACE. */
uint8_t *vs_put_room(struct vs_writer *w, size_t len);
void vs_put_bytes(struct vs_writer *w, const uint8_t *data, size_t len);

/* u8 length + text, at most max bytes; VS_ERR_TEXT if longer or no clean text. */
void vs_put_text(struct vs_writer *w, const char *text, size_t max);

/* Reads from the caller's buf; after an error every value is 0, every pointer NULL. */
struct vs_reader {
    const uint8_t *buf;
    size_t len; /* bytes in buf */
    size_t pos; /* bytes read */
    int error;  /* VS_OK or the first error: VS_ERR_BODY where buf ended too early */
};

void vs_reader_init(struct vs_reader *r, const uint8_t *buf, size_t len);
uint8_t vs_get_u8(struct vs_reader *r);
uint16_t vs_get_u16(struct vs_reader *r);
uint32_t vs_get_u32(struct vs_reader *r);
uint64_t vs_get_u64(struct vs_reader *r);

/* len bytes inside buf, or NULL. */
const uint8_t *vs_get_bytes(struct vs_reader *r, size_t len);

/* u8 length + text into text[max + 1], zero-terminated; VS_ERR_TEXT as above. */
void vs_get_text(struct vs_reader *r, char *text, size_t max);

/* VS_OK if all of buf was read without error, else the first error (VS_ERR_BODY
 * where bytes are left over). */
int vs_reader_end(const struct vs_reader *r);

/* VS_OK if the bytes are UTF-8 (RFC 3629) without characters that steer a terminal (C0, C1, line
 * separators, directions of writing), else VS_ERR_TEXT. With lines set, '\n' is allowed. */
int vs_text_check(const uint8_t *text, size_t len, int lines);

/* CRC-32 of IEEE 802.3 (reflected, initial and final inversion), as zlib's. */
uint32_t vs_crc32(const uint8_t *buf, size_t len);

/* IEEE 754 single from and to 4 little-endian bytes: the layout type "f4". */
float vs_load_f4(const uint8_t bytes[4]);
void vs_store_f4(uint8_t bytes[4], float value);

#endif
