/* SPDX-License-Identifier: MIT */
#include "vs_bytes.h"

#include <string.h>

void vs_writer_init(struct vs_writer *w, uint8_t *buf, size_t cap)
{
    w->buf = buf;
    w->cap = cap;
    w->len = 0;
    w->error = VS_OK;
}

/* Keeps the first error. Without room left nothing else has to ask whether there was one. */
static void fail_writing(struct vs_writer *w, int error)
{
    if (w->error == VS_OK)
        w->error = error;
    w->cap = w->len;
}

uint8_t *vs_put_room(struct vs_writer *w, size_t len)
{
    uint8_t *at = w->buf + w->len;

    if (len > w->cap - w->len) {
        fail_writing(w, VS_ERR_SPACE);
        return NULL;
    }
    w->len += len;
    return at;
}

void vs_put_u8(struct vs_writer *w, uint8_t value)
{
    uint8_t *at = vs_put_room(w, 1);

    if (at)
        *at = value;
}

void vs_put_u16(struct vs_writer *w, uint16_t value)
{
    uint8_t *at = vs_put_room(w, 2);

    if (at)
        vs_store_u16(at, value);
}

void vs_put_u32(struct vs_writer *w, uint32_t value)
{
    uint8_t *at = vs_put_room(w, 4);

    if (at)
        vs_store_u32(at, value);
}

void vs_put_u64(struct vs_writer *w, uint64_t value)
{
    uint8_t *at = vs_put_room(w, 8);

    if (at)
        vs_store_u64(at, value);
}

void vs_put_bytes(struct vs_writer *w, const uint8_t *data, size_t len)
{
    uint8_t *at = vs_put_room(w, len);

    if (at && len > 0)
        memcpy(at, data, len);
}

void vs_put_text(struct vs_writer *w, const char *text, size_t max)
{
    size_t len = strlen(text);

    if (len > max || vs_text_check((const uint8_t *)text, len, 0) < 0)
        fail_writing(w, VS_ERR_TEXT);
    vs_put_u8(w, (uint8_t)len);
    vs_put_bytes(w, (const uint8_t *)text, len);
}

void vs_reader_init(struct vs_reader *r, const uint8_t *buf, size_t len)
{
    r->buf = buf;
    r->len = len;
    r->pos = 0;
    r->error = VS_OK;
}

/* As fail_writing. */
static void fail_reading(struct vs_reader *r, int error)
{
    if (r->error == VS_OK)
        r->error = error;
    r->len = r->pos;
}

const uint8_t *vs_get_bytes(struct vs_reader *r, size_t len)
{
    const uint8_t *at = r->buf + r->pos;

    if (len > r->len - r->pos) {
        fail_reading(r, VS_ERR_BODY);
        return NULL;
    }
    r->pos += len;
    return at;
}

uint8_t vs_get_u8(struct vs_reader *r)
{
    const uint8_t *at = vs_get_bytes(r, 1);

    return at ? *at : 0;
}

uint16_t vs_get_u16(struct vs_reader *r)
{
    const uint8_t *at = vs_get_bytes(r, 2);

    return at ? vs_load_u16(at) : 0;
}

uint32_t vs_get_u32(struct vs_reader *r)
{
    const uint8_t *at = vs_get_bytes(r, 4);

    return at ? vs_load_u32(at) : 0;
}

uint64_t vs_get_u64(struct vs_reader *r)
{
    const uint8_t *at = vs_get_bytes(r, 8);

    return at ? vs_load_u64(at) : 0;
}

void vs_get_text(struct vs_reader *r, char *text, size_t max)
{
    size_t len = vs_get_u8(r);
    const uint8_t *at = vs_get_bytes(r, len);

    text[0] = '\0';
    if (!at)
        return;
    if (len > max || vs_text_check(at, len, 0) < 0) {
        fail_reading(r, VS_ERR_TEXT);
        return;
    }
    memcpy(text, at, len);
    text[len] = '\0';
}

int vs_reader_end(const struct vs_reader *r)
{
    if (r->error == VS_OK && r->pos != r->len)
        return VS_ERR_BODY;
    return r->error;
}

/* Length of the UTF-8 character at text[0..len), 0 if it is none.
 * Source: RFC 3629, section 4. */
static size_t character_length(const uint8_t *text, size_t len)
{
    uint8_t first = text[0];
    uint8_t low = 0x80;
    uint8_t high = 0xBF;
    size_t size = first < 0x80 ? 1 : first < 0xE0 ? 2 : first < 0xF0 ? 3 : 4;
    size_t i;

    if ((first >= 0x80 && first < 0xC2) || first > 0xF4 || size > len)
        return 0;
    if (first == 0xE0)
        low = 0xA0;
    else if (first == 0xED)
        high = 0x9F;
    else if (first == 0xF0)
        low = 0x90;
    else if (first == 0xF4)
        high = 0x8F;
    if (size > 1 && (text[1] < low || text[1] > high))
        return 0;
    for (i = 2; i < size; i++) {
        if (text[i] < 0x80 || text[i] > 0xBF)
            return 0;
    }
    return size;
}

/* 1 if one character is no letter of a line: it would steer a terminal or turn a line around.
 * Source: Unicode, categories Cc, Zl and Zp, and its Bidi_Control. */
static int is_control(const uint8_t *c)
{
    if (c[0] < 0x80)
        return c[0] < 0x20 || c[0] == 0x7F;
    if (c[0] == 0xC2)
        return c[1] < 0xA0;
    if (c[0] == 0xD8)
        return c[1] == 0x9C; /* U+061C */
    if (c[0] != 0xE2)
        return 0;
    if (c[1] == 0x80) /* U+200E, U+200F, U+2028 to U+202E */
        return c[2] == 0x8E || c[2] == 0x8F || (c[2] >= 0xA8 && c[2] <= 0xAE);
    return c[1] == 0x81 && c[2] >= 0xA6 && c[2] <= 0xA9; /* U+2066 to U+2069 */
}

int vs_text_check(const uint8_t *text, size_t len, int lines)
{
    size_t i = 0;

    while (i < len) {
        size_t size = character_length(text + i, len - i);

        if (size == 0)
            return VS_ERR_TEXT;
        if (is_control(text + i) && !(lines && text[i] == '\n'))
            return VS_ERR_TEXT;
        i += size;
    }
    return VS_OK;
}

/* Of each half of a byte the remainder: only tables are summed up, and a robot has few. */
static const uint32_t crc_table[16] = {
    0x00000000, 0x1DB71064, 0x3B6E20C8, 0x26D930AC, 0x76DC4190, 0x6B6B51F4, 0x4DB26158, 0x5005713C,
    0xEDB88320, 0xF00F9344, 0xD6D6A3E8, 0xCB61B38C, 0x9B64C2B0, 0x86D3D2D4, 0xA00AE278, 0xBDBDF21C,
};

uint32_t vs_crc32(const uint8_t *buf, size_t len)
{
    uint32_t crc = 0xFFFFFFFF;
    size_t i;

    for (i = 0; i < len; i++) {
        crc ^= buf[i];
        crc = crc_table[crc & 15] ^ (crc >> 4);
        crc = crc_table[crc & 15] ^ (crc >> 4);
    }
    return ~crc;
}

float vs_load_f4(const uint8_t bytes[4])
{
    uint32_t bits = vs_load_u32(bytes);
    float value;

    memcpy(&value, &bits, sizeof value);
    return value;
}

void vs_store_f4(uint8_t bytes[4], float value)
{
    uint32_t bits;

    memcpy(&bits, &value, sizeof bits);
    vs_store_u32(bytes, bits);
}
