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

/* Room for len more bytes, or NULL. */
static uint8_t *reserve(struct vs_writer *w, size_t len)
{
    uint8_t *at = NULL;

    if (w->error == VS_OK && len > w->cap - w->len)
        w->error = VS_ERR_SPACE;
    if (w->error == VS_OK) {
        at = w->buf + w->len;
        w->len += len;
    }
    return at;
}

/* The low `size` bytes of value, lowest first. */
static void put_little(struct vs_writer *w, uint64_t value, size_t size)
{
    uint8_t *at = reserve(w, size);
    size_t i;

    for (i = 0; at && i < size; i++)
        at[i] = (uint8_t)(value >> (8 * i));
}

void vs_put_u8(struct vs_writer *w, uint8_t value)
{
    put_little(w, value, 1);
}

void vs_put_u16(struct vs_writer *w, uint16_t value)
{
    put_little(w, value, 2);
}

void vs_put_u32(struct vs_writer *w, uint32_t value)
{
    put_little(w, value, 4);
}

void vs_put_u64(struct vs_writer *w, uint64_t value)
{
    put_little(w, value, 8);
}

void vs_put_bytes(struct vs_writer *w, const uint8_t *data, size_t len)
{
    uint8_t *at = reserve(w, len);

    if (at && len > 0)
        memcpy(at, data, len);
}

void vs_put_text(struct vs_writer *w, const char *text, size_t max)
{
    size_t len = strlen(text);

    if (w->error == VS_OK && (len > max || vs_text_check((const uint8_t *)text, len, 0) < 0))
        w->error = VS_ERR_TEXT;
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

const uint8_t *vs_get_bytes(struct vs_reader *r, size_t len)
{
    const uint8_t *at = NULL;

    if (r->error == VS_OK && len > r->len - r->pos)
        r->error = VS_ERR_BODY;
    if (r->error == VS_OK) {
        at = r->buf + r->pos;
        r->pos += len;
    }
    return at;
}

static uint64_t get_little(struct vs_reader *r, size_t size)
{
    const uint8_t *at = vs_get_bytes(r, size);
    uint64_t value = 0;
    size_t i;

    for (i = 0; at && i < size; i++)
        value |= (uint64_t)at[i] << (8 * i);
    return value;
}

uint8_t vs_get_u8(struct vs_reader *r)
{
    return (uint8_t)get_little(r, 1);
}

uint16_t vs_get_u16(struct vs_reader *r)
{
    return (uint16_t)get_little(r, 2);
}

uint32_t vs_get_u32(struct vs_reader *r)
{
    return (uint32_t)get_little(r, 4);
}

uint64_t vs_get_u64(struct vs_reader *r)
{
    return get_little(r, 8);
}

void vs_get_text(struct vs_reader *r, char *text, size_t max)
{
    size_t len = vs_get_u8(r);
    const uint8_t *at = vs_get_bytes(r, len);

    text[0] = '\0';
    if (!at)
        return;
    if (len > max || vs_text_check(at, len, 0) < 0) {
        r->error = VS_ERR_TEXT;
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

int vs_text_check(const uint8_t *text, size_t len, int lines)
{
    size_t i = 0;

    while (i < len) {
        size_t size = character_length(text + i, len - i);

        if (size == 0)
            return VS_ERR_TEXT;
        if ((text[i] < 0x20 && !(lines && text[i] == '\n')) || text[i] == 0x7F)
            return VS_ERR_TEXT;
        i += size;
    }
    return VS_OK;
}

uint32_t vs_crc32(const uint8_t *buf, size_t len)
{
    /* Four bits at a time: 64 bytes of table instead of 1024. */
    static const uint32_t table[16] = {
        0x00000000, 0x1DB71064, 0x3B6E20C8, 0x26D930AC, 0x76DC4190, 0x6B6B51F4,
        0x4DB26158, 0x5005713C, 0xEDB88320, 0xF00F9344, 0xD6D6A3E8, 0xCB61B38C,
        0x9B64C2B0, 0x86D3D2D4, 0xA00AE278, 0xBDBDF21C,
    };
    uint32_t crc = 0xFFFFFFFF;
    size_t i;

    for (i = 0; i < len; i++) {
        crc ^= buf[i];
        crc = table[crc & 15] ^ (crc >> 4);
        crc = table[crc & 15] ^ (crc >> 4);
    }
    return ~crc;
}

float vs_load_f4(const uint8_t bytes[4])
{
    uint32_t bits = (uint32_t)bytes[0] | (uint32_t)bytes[1] << 8 |
                    (uint32_t)bytes[2] << 16 | (uint32_t)bytes[3] << 24;
    float value;

    memcpy(&value, &bits, sizeof value);
    return value;
}

void vs_store_f4(uint8_t bytes[4], float value)
{
    uint32_t bits;
    size_t i;

    memcpy(&bits, &value, sizeof bits);
    for (i = 0; i < 4; i++)
        bytes[i] = (uint8_t)(bits >> (8 * i));
}
