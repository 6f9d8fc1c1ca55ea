/* SPDX-License-Identifier: MIT */
#include "vs_table.h"

#include <string.h>

#include "vs_bytes.h"

/* Bytes that a sensor's value takes in STATE, a reading's in TELEMETRY, beside its payload. */
#define STAMP_SIZE 4

/* What a value takes before its payload in the block of what goes up. */
static uint32_t stamp_size(const struct vs_entry *e)
{
    return e->direction == VS_READING ? STAMP_SIZE : 0;
}

static void rehash(struct vs_table *t)
{
    uint8_t bytes[VS_TABLE_BYTES];
    size_t len = 0;

    (void)vs_table_encode(t, bytes, sizeof bytes, &len);
    t->hash = vs_crc32(bytes, len);
}

/* Empty but for the hash, which only the finished table needs. */
static void clear(struct vs_table *t)
{
    memset(t, 0, sizeof *t);
}

void vs_table_init(struct vs_table *t)
{
    clear(t);
    rehash(t);
}

/* Bytes of one item, 0 if the two letters are no type. */
static uint32_t item_size(const char *type)
{
    static const char types[6][3] = {"u1", "i2", "u2", "i4", "u4", "f4"};
    size_t i;

    for (i = 0; i < sizeof types / sizeof types[0]; i++) {
        if (strcmp(type, types[i]) == 0)
            return (uint32_t)(types[i][1] - '0');
    }
    return 0;
}

/* Fills layout, count, type and size of an entry from "[count*]type". */
static int parse_layout(struct vs_entry *e, const char *layout)
{
    const char *p = layout;
    uint32_t count = 0;
    uint32_t size;

    if (strlen(layout) > VS_NAME_MAX)
        return VS_ERR_LAYOUT;
    while (*p >= (p == layout ? '1' : '0') && *p <= '9') {
        if (count <= VS_SENSOR_BYTES)
            count = 10 * count + (uint32_t)(*p - '0');
        p++;
    }
    if (p == layout)
        count = 1;
    else if (*p++ != '*')
        return VS_ERR_LAYOUT;
    size = item_size(p);
    if (size == 0)
        return VS_ERR_LAYOUT;
    if (count > VS_SENSOR_BYTES / size)
        return VS_ERR_TABLE_SIZE;
    e->count = (uint16_t)count;
    e->size = (uint16_t)(count * size);
    e->type[0] = (uint8_t)p[0];
    e->type[1] = (uint8_t)p[1];
    memcpy(e->layout, layout, strlen(layout) + 1);
    return VS_OK;
}

/* Rank and offset of the new entry, if the table has room for it. */
static int place(const struct vs_table *t, struct vs_entry *e)
{
    if (t->count == VS_TABLE_MAX)
        return VS_ERR_TABLE_SIZE;
    if (e->direction == VS_SENSOR) {
        if (t->sensor_bytes + e->size + STAMP_SIZE * (t->sensors + 1) > VS_SENSOR_BYTES)
            return VS_ERR_TABLE_SIZE;
        e->rank = (uint16_t)t->sensors;
        e->offset = (uint16_t)t->sensor_bytes;
    } else {
        if (t->actuator_bytes + stamp_size(e) + e->size > VS_ACTUATOR_BYTES)
            return VS_ERR_TABLE_SIZE;
        e->rank = (uint16_t)t->actuators;
        e->offset = (uint16_t)(t->actuator_bytes + stamp_size(e));
    }
    return VS_OK;
}

static int is_taken(const struct vs_table *t, uint8_t id, const char *name)
{
    uint32_t i;

    for (i = 0; i < t->count; i++) {
        if (t->entries[i].id == id)
            return 1;
    }
    return vs_table_find(t, name) >= 0;
}

static int append(struct vs_table *t, uint8_t id, uint8_t direction,
                  const char *name, const char *layout)
{
    struct vs_entry e;
    size_t name_len = strlen(name);
    int err;

    memset(&e, 0, sizeof e);
    e.id = id;
    e.direction = direction;
    if (direction > VS_READING)
        return VS_ERR_ARGUMENT;
    if (name_len == 0 || name_len > VS_NAME_MAX ||
        vs_text_check((const uint8_t *)name, name_len, 0) < 0)
        return VS_ERR_TEXT;
    memcpy(e.name, name, name_len);
    err = parse_layout(&e, layout);
    if (err != VS_OK)
        return err;
    if (is_taken(t, id, name))
        return VS_ERR_DUPLICATE;
    err = place(t, &e);
    if (err != VS_OK)
        return err;
    t->entries[t->count++] = e;
    if (direction == VS_SENSOR) {
        t->sensors++;
        t->sensor_bytes += e.size;
    } else {
        t->actuators++;
        t->readings += direction == VS_READING;
        t->actuator_bytes += stamp_size(&e) + e.size;
    }
    return VS_OK;
}

int vs_table_add(struct vs_table *t, uint8_t id, uint8_t direction,
                 const char *name, const char *layout)
{
    int err = append(t, id, direction, name, layout);

    if (err == VS_OK)
        rehash(t);
    return err;
}

int vs_table_encode(const struct vs_table *t, uint8_t *buf, size_t cap, size_t *len)
{
    struct vs_writer w;
    uint32_t i;

    vs_writer_init(&w, buf, cap);
    vs_put_u8(&w, (uint8_t)t->count);
    for (i = 0; i < t->count; i++) {
        const struct vs_entry *e = &t->entries[i];

        vs_put_u8(&w, e->id);
        vs_put_u8(&w, e->direction);
        vs_put_u16(&w, e->size);
        vs_put_text(&w, e->name, VS_NAME_MAX);
        vs_put_text(&w, e->layout, VS_NAME_MAX);
    }
    *len = w.error == VS_OK ? w.len : 0;
    return w.error;
}

static int decode_entry(struct vs_table *t, struct vs_reader *r)
{
    char name[VS_NAME_MAX + 1];
    char layout[VS_NAME_MAX + 1];
    uint8_t id = vs_get_u8(r);
    uint8_t direction = vs_get_u8(r);
    uint16_t size = vs_get_u16(r);
    int err;

    vs_get_text(r, name, VS_NAME_MAX);
    vs_get_text(r, layout, VS_NAME_MAX);
    if (r->error != VS_OK)
        return r->error;
    err = append(t, id, direction, name, layout);
    if (err == VS_ERR_ARGUMENT)
        return VS_ERR_BODY;
    if (err == VS_OK && t->entries[t->count - 1].size != size)
        return VS_ERR_LAYOUT;
    return err;
}

int vs_table_decode(struct vs_table *t, const uint8_t *buf, size_t len)
{
    struct vs_reader r;
    uint32_t count;
    int err;

    clear(t);
    vs_reader_init(&r, buf, len);
    count = vs_get_u8(&r);
    err = count > VS_TABLE_MAX ? VS_ERR_TABLE_SIZE : r.error;
    while (err == VS_OK && t->count < count)
        err = decode_entry(t, &r);
    if (err == VS_OK)
        err = vs_reader_end(&r);
    if (err != VS_OK) {
        vs_table_init(t);
        return err;
    }
    t->hash = vs_crc32(buf, len); /* a table is written in one way only */
    return VS_OK;
}

int vs_table_find(const struct vs_table *t, const char *name)
{
    uint32_t i;

    for (i = 0; i < t->count; i++) {
        if (strcmp(t->entries[i].name, name) == 0)
            return (int)i;
    }
    return VS_ERR_NOT_FOUND;
}
