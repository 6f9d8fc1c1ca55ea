/* SPDX-License-Identifier: MIT */
#include "vs_packet.h"

#include <string.h>

#define LENGTH_AT 6 /* [byte] offset of the header's length field */

size_t vs_packet_limit(uint8_t type)
{
    switch (type) {
    case VS_STATE:
    case VS_TELEMETRY:
        return VS_DATAGRAM_MAX;
    case VS_HELLO:
    case VS_REFUSE:
    case VS_GOODBYE:
        return VS_GREETING_MAX;
    case VS_WELCOME:
        return VS_PACKET_MAX;
    default:
        return 0;
    }
}

int vs_packet_length(const uint8_t *buf, size_t len, size_t *length)
{
    size_t whole;

    if (len > 0 && buf[0] != (VS_MAGIC & 0xFF))
        return VS_ERR_MAGIC;
    if (len > 1 && buf[1] != VS_MAGIC >> 8)
        return VS_ERR_MAGIC;
    if (len > 2 && buf[2] != VS_VERSION)
        return VS_ERR_VERSION;
    if (len > 3 && vs_packet_limit(buf[3]) == 0)
        return VS_ERR_TYPE;
    if (len < VS_PREFIX_SIZE)
        return VS_ERR_SHORT;
    whole = (size_t)buf[LENGTH_AT] | (size_t)buf[LENGTH_AT + 1] << 8;
    if (whole < VS_PACKET_MIN || whole > vs_packet_limit(buf[3]))
        return VS_ERR_LENGTH;
    *length = whole;
    return VS_OK;
}

static void read_header(struct vs_header *h, const uint8_t *buf)
{
    struct vs_reader r;

    vs_reader_init(&r, buf, VS_HEADER_SIZE);
    (void)vs_get_bytes(&r, 3); /* magic and version */
    h->type = vs_get_u8(&r);
    h->flags = vs_get_u16(&r);
    h->length = vs_get_u16(&r);
    h->session = vs_get_u32(&r);
    h->sequence = vs_get_u32(&r);
    h->run = vs_get_u32(&r);
    h->timestep = vs_get_u32(&r);
    h->capture_ns = vs_get_u64(&r);
    h->send_ns = vs_get_u64(&r);
    h->echo_ns = vs_get_u64(&r);
    h->hold_us = vs_get_u32(&r);
    h->table_hash = vs_get_u32(&r);
}

int vs_packet_open(const uint8_t *buf, size_t len, struct vs_header *header,
                   const uint8_t **body, size_t *body_len)
{
    static const uint8_t zeros[VS_TAG_SIZE - 4];
    struct vs_reader r;
    size_t length = 0;
    int err = vs_packet_length(buf, len, &length);

    if (err != VS_OK)
        return err;
    if (len != length)
        return len < length ? VS_ERR_SHORT : VS_ERR_LENGTH;
    vs_reader_init(&r, buf + len - VS_TAG_SIZE, 4);
    if (memcmp(buf + len - sizeof zeros, zeros, sizeof zeros) != 0)
        return VS_ERR_TAG;
    if (vs_get_u32(&r) != vs_crc32(buf, len - VS_TAG_SIZE))
        return VS_ERR_CHECKSUM;
    read_header(header, buf);
    *body = buf + VS_HEADER_SIZE;
    *body_len = len - VS_PACKET_MIN;
    return VS_OK;
}

void vs_packet_begin(struct vs_writer *w, const struct vs_header *header,
                     uint8_t *buf, size_t cap)
{
    vs_writer_init(w, buf, cap);
    vs_put_u16(w, VS_MAGIC);
    vs_put_u8(w, VS_VERSION);
    vs_put_u8(w, header->type);
    vs_put_u16(w, header->flags);
    vs_put_u16(w, 0);
    vs_put_u32(w, header->session);
    vs_put_u32(w, header->sequence);
    vs_put_u32(w, header->run);
    vs_put_u32(w, header->timestep);
    vs_put_u64(w, header->capture_ns);
    vs_put_u64(w, header->send_ns);
    vs_put_u64(w, header->echo_ns);
    vs_put_u32(w, header->hold_us);
    vs_put_u32(w, header->table_hash);
}

int vs_packet_end(struct vs_writer *w, size_t *len)
{
    static const uint8_t zeros[VS_TAG_SIZE - 4];
    size_t limit;
    size_t whole;

    *len = 0;
    if (w->error != VS_OK)
        return w->error;
    limit = vs_packet_limit(w->buf[3]);
    whole = w->len + VS_TAG_SIZE;
    if (limit == 0)
        return VS_ERR_TYPE;
    if (whole > limit)
        return VS_ERR_SPACE;
    w->buf[LENGTH_AT] = (uint8_t)whole;
    w->buf[LENGTH_AT + 1] = (uint8_t)(whole >> 8);
    vs_put_u32(w, vs_crc32(w->buf, w->len));
    vs_put_bytes(w, zeros, sizeof zeros);
    if (w->error != VS_OK)
        return w->error;
    *len = whole;
    return VS_OK;
}
