/* SPDX-License-Identifier: MIT */
#include "vs_packet.h"

/* [byte] where the header's fields stand. */
enum {
    TYPE_AT = 3,
    FLAGS_AT = 4,
    LENGTH_AT = 6,
    SESSION_AT = 8,
    SEQUENCE_AT = 12,
    RUN_AT = 16,
    TIMESTEP_AT = 20,
    CAPTURE_AT = 24,
    SEND_AT = 32,
    ECHO_AT = 40,
    HOLD_AT = 48,
    TABLE_AT = 52
};

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
    if (len > 3 && vs_packet_limit(buf[TYPE_AT]) == 0)
        return VS_ERR_TYPE;
    if (len < VS_PREFIX_SIZE)
        return VS_ERR_SHORT;
    whole = vs_load_u16(buf + LENGTH_AT);
    if (whole < VS_PACKET_MIN || whole > vs_packet_limit(buf[TYPE_AT]))
        return VS_ERR_LENGTH;
    *length = whole;
    return VS_OK;
}

static void read_header(struct vs_header *h, const uint8_t *buf)
{
    h->type = buf[TYPE_AT];
    h->flags = vs_load_u16(buf + FLAGS_AT);
    h->length = vs_load_u16(buf + LENGTH_AT);
    h->session = vs_load_u32(buf + SESSION_AT);
    h->sequence = vs_load_u32(buf + SEQUENCE_AT);
    h->run = vs_load_u32(buf + RUN_AT);
    h->timestep = vs_load_u32(buf + TIMESTEP_AT);
    h->capture_ns = vs_load_u64(buf + CAPTURE_AT);
    h->send_ns = vs_load_u64(buf + SEND_AT);
    h->echo_ns = vs_load_u64(buf + ECHO_AT);
    h->hold_us = vs_load_u32(buf + HOLD_AT);
    h->table_hash = vs_load_u32(buf + TABLE_AT);
}

/* Whether exactly one packet is there. */
static int check_frame(const uint8_t *buf, size_t len)
{
    size_t length = 0;
    int err = vs_packet_length(buf, len, &length);

    if (err != VS_OK || len == length)
        return err;
    return len < length ? VS_ERR_SHORT : VS_ERR_LENGTH;
}

static const uint8_t *key_or_published(const uint8_t *key)
{
    return key != NULL ? key : vs_key_published;
}

int vs_packet_session(const uint8_t *buf, size_t len, uint32_t *session)
{
    int err = check_frame(buf, len);

    if (err == VS_OK)
        *session = vs_load_u32(buf + SESSION_AT);
    return err;
}

/* 1 if two tags are the same, 0 if not; takes the same time wherever they differ. */
static int is_tag(const uint8_t a[VS_TAG_SIZE], const uint8_t b[VS_TAG_SIZE])
{
    uint32_t differ = 0;
    int i;

    for (i = 0; i < VS_TAG_SIZE; i += 4)
        differ |= vs_load_u32(a + i) ^ vs_load_u32(b + i);
    return differ == 0;
}

int vs_packet_open(const uint8_t *buf, size_t len, const uint8_t *key,
                   struct vs_header *header, const uint8_t **body, size_t *body_len)
{
    int err = check_frame(buf, len);

    return err == VS_OK ? vs_packet_open_framed(buf, len, key, header, body, body_len) : err;
}

int vs_packet_open_framed(const uint8_t *buf, size_t len, const uint8_t *key,
                          struct vs_header *header, const uint8_t **body, size_t *body_len)
{
    uint8_t tag[VS_TAG_SIZE];

    vs_tag_make(key_or_published(key), buf, len - VS_TAG_SIZE, tag);
    if (!is_tag(tag, buf + len - VS_TAG_SIZE))
        return VS_ERR_TAG;
    read_header(header, buf);
    header->key = key;
    *body = buf + VS_HEADER_SIZE;
    *body_len = len - VS_PACKET_MIN;
    return VS_OK;
}

void vs_packet_begin(struct vs_writer *w, uint8_t type, const struct vs_header *header,
                     uint8_t *buf, size_t cap)
{
    vs_writer_init(w, buf, cap);
    w->key = key_or_published(header->key);
    if (vs_put_room(w, VS_HEADER_SIZE) == NULL)
        return;
    vs_store_u16(buf, VS_MAGIC);
    buf[2] = VS_VERSION;
    buf[TYPE_AT] = type;
    vs_store_u16(buf + FLAGS_AT, header->flags);
    vs_store_u32(buf + SESSION_AT, header->session);
    vs_store_u32(buf + SEQUENCE_AT, header->sequence);
    vs_store_u32(buf + RUN_AT, header->run);
    vs_store_u32(buf + TIMESTEP_AT, header->timestep);
    vs_store_u64(buf + CAPTURE_AT, header->capture_ns);
    vs_store_u64(buf + SEND_AT, header->send_ns);
    vs_store_u64(buf + ECHO_AT, header->echo_ns);
    vs_store_u32(buf + HOLD_AT, header->hold_us);
    vs_store_u32(buf + TABLE_AT, header->table_hash);
}

int vs_packet_end(struct vs_writer *w, size_t *len)
{
    uint8_t *tag;
    size_t limit;

    *len = 0;
    if (w->error != VS_OK)
        return w->error;
    limit = vs_packet_limit(w->buf[TYPE_AT]);
    if (limit == 0)
        return VS_ERR_TYPE;
    tag = vs_put_room(w, VS_TAG_SIZE);
    if (tag == NULL || w->len > limit)
        return VS_ERR_SPACE;
    vs_store_u16(w->buf + LENGTH_AT, (uint16_t)w->len);
    vs_tag_make(w->key, w->buf, w->len - VS_TAG_SIZE, tag);
    *len = w->len;
    return VS_OK;
}
