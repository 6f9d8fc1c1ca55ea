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

/* Writes into the caller's buf; after an error nothing more is written. */
struct vs_writer {
    uint8_t *buf;
    size_t cap; /* bytes in buf */
    size_t len; /* bytes written */
    int error;  /* VS_OK or the first error */
};

void vs_writer_init(struct vs_writer *w, uint8_t *buf, size_t cap);
void vs_put_u8(struct vs_writer *w, uint8_t value);
void vs_put_u16(struct vs_writer *w, uint16_t value);
void vs_put_u32(struct vs_writer *w, uint32_t value);
void vs_put_u64(struct vs_writer *w, uint64_t value);
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

/* VS_OK if the bytes are UTF-8 (RFC 3629) without control characters, else
 * VS_ERR_TEXT. With lines set, '\n' is allowed. */
int vs_text_check(const uint8_t *text, size_t len, int lines);

/* CRC-32 of IEEE 802.3 (reflected, initial and final inversion), as zlib's. */
uint32_t vs_crc32(const uint8_t *buf, size_t len);

/* IEEE 754 single from and to 4 little-endian bytes: the layout type "f4". */
float vs_load_f4(const uint8_t bytes[4]);
void vs_store_f4(uint8_t bytes[4], float value);

#endif
