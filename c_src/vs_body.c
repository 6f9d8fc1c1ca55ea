/* SPDX-License-Identifier: MIT */
#include "vs_body.h"

#include "vs_packet.h"

#include <string.h>

#define STATE_FIXED 8      /* [byte] of STATE before the readings */
#define TELEMETRY_FIXED 48 /* [byte] of TELEMETRY before the actuators */

/* Begins a packet of the given type with an otherwise given header. */
static void begin(struct vs_writer *w, uint8_t type, const struct vs_header *header,
                  uint8_t *buf, size_t cap)
{
    struct vs_header h = *header;

    h.type = type;
    vs_packet_begin(w, &h, buf, cap);
}

int vs_encode_hello(const struct vs_header *header, const struct vs_hello *hello,
                    uint8_t *buf, size_t cap, size_t *len)
{
    struct vs_writer w;

    begin(&w, VS_HELLO, header, buf, cap);
    vs_put_bytes(&w, hello->uid, VS_UID_SIZE);
    vs_put_u64(&w, hello->nonce);
    vs_put_u16(&w, hello->tag);
    vs_put_u16(&w, hello->capabilities);
    vs_put_text(&w, hello->name, VS_NAME_MAX);
    vs_put_text(&w, hello->controller, VS_NAME_MAX);
    vs_put_text(&w, hello->version, VS_NAME_MAX);
    vs_put_text(&w, hello->hash, VS_NAME_MAX);
    return vs_packet_end(&w, len);
}

int vs_decode_hello(const uint8_t *body, size_t len, struct vs_hello *hello)
{
    struct vs_hello b;
    struct vs_reader r;
    const uint8_t *uid;
    int err;

    vs_reader_init(&r, body, len);
    uid = vs_get_bytes(&r, VS_UID_SIZE);
    b.nonce = vs_get_u64(&r);
    b.tag = vs_get_u16(&r);
    b.capabilities = vs_get_u16(&r);
    vs_get_text(&r, b.name, VS_NAME_MAX);
    vs_get_text(&r, b.controller, VS_NAME_MAX);
    vs_get_text(&r, b.version, VS_NAME_MAX);
    vs_get_text(&r, b.hash, VS_NAME_MAX);
    err = vs_reader_end(&r);
    if (err != VS_OK)
        return err;
    memcpy(b.uid, uid, VS_UID_SIZE);
    *hello = b;
    return VS_OK;
}

int vs_encode_welcome(const struct vs_header *header, const struct vs_welcome *welcome,
                      uint8_t *buf, size_t cap, size_t *len)
{
    uint8_t table[VS_TABLE_BYTES];
    size_t params_len = strlen(welcome->params);
    size_t table_len = 0;
    struct vs_writer w;
    int err = vs_table_encode(&welcome->table, table, sizeof table, &table_len);

    *len = 0;
    if (err != VS_OK)
        return err;
    if (vs_text_check((const uint8_t *)welcome->params, params_len, 1) < 0)
        return VS_ERR_TEXT;
    if (params_len > VS_PARAMS_MAX || welcome->timestep_us == 0)
        return VS_ERR_BODY;
    begin(&w, VS_WELCOME, header, buf, cap);
    vs_put_u64(&w, welcome->nonce);
    vs_put_u32(&w, welcome->timestep_us);
    vs_put_u32(&w, welcome->seed);
    vs_put_u16(&w, (uint16_t)params_len);
    vs_put_bytes(&w, (const uint8_t *)welcome->params, params_len);
    vs_put_u16(&w, (uint16_t)table_len);
    vs_put_bytes(&w, table, table_len);
    return vs_packet_end(&w, len);
}

int vs_decode_welcome(const uint8_t *body, size_t len, struct vs_welcome *welcome)
{
    struct vs_welcome b;
    struct vs_reader r;
    const uint8_t *params;
    const uint8_t *table;
    size_t params_len;
    size_t table_len;
    int err;

    vs_reader_init(&r, body, len);
    b.nonce = vs_get_u64(&r);
    b.timestep_us = vs_get_u32(&r);
    b.seed = vs_get_u32(&r);
    params_len = vs_get_u16(&r);
    params = vs_get_bytes(&r, params_len);
    table_len = vs_get_u16(&r);
    table = vs_get_bytes(&r, table_len);
    err = vs_reader_end(&r);
    if (err != VS_OK)
        return err;
    if (params_len > VS_PARAMS_MAX || b.timestep_us == 0)
        return VS_ERR_BODY;
    err = vs_text_check(params, params_len, 1);
    if (err == VS_OK)
        err = vs_table_decode(&b.table, table, table_len);
    if (err != VS_OK)
        return err;
    memcpy(b.params, params, params_len);
    b.params[params_len] = '\0';
    *welcome = b;
    return VS_OK;
}

int vs_encode_notice(const struct vs_header *header, const struct vs_notice *notice,
                     uint8_t *buf, size_t cap, size_t *len)
{
    struct vs_writer w;

    *len = 0;
    if (header->type != VS_REFUSE && header->type != VS_GOODBYE)
        return VS_ERR_TYPE;
    vs_packet_begin(&w, header, buf, cap);
    if (header->type == VS_REFUSE)
        vs_put_u16(&w, notice->code);
    else if (notice->code > 0xFF)
        return VS_ERR_BODY;
    else
        vs_put_u8(&w, (uint8_t)notice->code);
    vs_put_text(&w, notice->text, VS_TEXT_MAX);
    return vs_packet_end(&w, len);
}

int vs_decode_notice(uint8_t type, const uint8_t *body, size_t len, struct vs_notice *notice)
{
    struct vs_notice b;
    struct vs_reader r;
    int err;

    vs_reader_init(&r, body, len);
    b.code = type == VS_REFUSE ? vs_get_u16(&r) : vs_get_u8(&r);
    vs_get_text(&r, b.text, VS_TEXT_MAX);
    err = vs_reader_end(&r);
    if (err == VS_OK)
        *notice = b;
    return err;
}

int vs_encode_state(const struct vs_header *header, const struct vs_table *table,
                    const struct vs_state *state, uint8_t *buf, size_t cap, size_t *len)
{
    struct vs_writer w;
    uint32_t i;

    *len = 0;
    if (state->wanted > VS_STOP)
        return VS_ERR_BODY;
    begin(&w, VS_STATE, header, buf, cap);
    vs_put_u8(&w, state->wanted);
    vs_put_u8(&w, 0);
    vs_put_u16(&w, 0);
    vs_put_u32(&w, state->from_timestep);
    for (i = 0; i < table->count; i++) {
        const struct vs_entry *e = &table->entries[i];

        if (e->direction != VS_SENSOR)
            continue;
        vs_put_u32(&w, state->older_us[e->rank]);
        vs_put_bytes(&w, state->payload + e->offset, e->size);
    }
    return vs_packet_end(&w, len);
}

int vs_decode_state(const struct vs_table *table, const uint8_t *body, size_t len,
                    struct vs_state *state)
{
    struct vs_reader r;
    uint8_t wanted;
    uint32_t zero;
    uint32_t from_timestep;
    uint32_t i;

    if (len != STATE_FIXED + 4 * (size_t)table->sensors + table->sensor_bytes)
        return VS_ERR_BODY;
    vs_reader_init(&r, body, len);
    wanted = vs_get_u8(&r);
    zero = vs_get_u8(&r);
    zero |= vs_get_u16(&r);
    from_timestep = vs_get_u32(&r);
    if (wanted > VS_STOP || zero != 0)
        return VS_ERR_BODY;
    state->wanted = wanted;
    state->from_timestep = from_timestep;
    for (i = 0; i < table->count; i++) {
        const struct vs_entry *e = &table->entries[i];

        if (e->direction != VS_SENSOR)
            continue;
        state->older_us[e->rank] = vs_get_u32(&r);
        memcpy(state->payload + e->offset, vs_get_bytes(&r, e->size), e->size);
    }
    return VS_OK;
}

static int telemetry_is_valid(const struct vs_telemetry *t)
{
    return t->state <= VS_STOP && t->wanted <= VS_STOP &&
           (t->battery_low <= 1 || t->battery_low == VS_BATTERY_UNKNOWN);
}

int vs_encode_telemetry(const struct vs_header *header, const struct vs_table *table,
                        const struct vs_telemetry *telemetry,
                        uint8_t *buf, size_t cap, size_t *len)
{
    const struct vs_telemetry *t = telemetry;
    struct vs_writer w;

    *len = 0;
    if (!telemetry_is_valid(t))
        return VS_ERR_BODY;
    begin(&w, VS_TELEMETRY, header, buf, cap);
    vs_put_u8(&w, t->state);
    vs_put_u8(&w, t->wanted);
    vs_put_u8(&w, t->stop_cause);
    vs_put_u8(&w, t->battery_low);
    vs_put_u32(&w, t->wanted_run);
    vs_put_u32(&w, t->control_step);
    vs_put_u16(&w, (uint16_t)t->left_steps_s);
    vs_put_u16(&w, (uint16_t)t->right_steps_s);
    vs_put_u16(&w, t->leds);
    vs_put_u16(&w, t->battery_mv);
    vs_put_u32(&w, t->received);
    vs_put_u32(&w, t->old);
    vs_put_u32(&w, t->foreign);
    vs_put_u32(&w, t->corrupt);
    vs_put_u32(&w, t->base_errors);
    vs_put_u32(&w, t->guard_restarts);
    vs_put_u32(&w, t->clock_bound_us);
    vs_put_bytes(&w, t->payload, table->actuator_bytes);
    return vs_packet_end(&w, len);
}

/* Two's complement without a conversion that C leaves to the compiler. */
static int16_t to_i16(uint16_t value)
{
    return (int16_t)(value < 0x8000 ? (int)value : (int)value - 0x10000);
}

static void read_telemetry(struct vs_reader *r, struct vs_telemetry *t)
{
    t->wanted_run = vs_get_u32(r);
    t->control_step = vs_get_u32(r);
    t->left_steps_s = to_i16(vs_get_u16(r));
    t->right_steps_s = to_i16(vs_get_u16(r));
    t->leds = vs_get_u16(r);
    t->battery_mv = vs_get_u16(r);
    t->received = vs_get_u32(r);
    t->old = vs_get_u32(r);
    t->foreign = vs_get_u32(r);
    t->corrupt = vs_get_u32(r);
    t->base_errors = vs_get_u32(r);
    t->guard_restarts = vs_get_u32(r);
    t->clock_bound_us = vs_get_u32(r);
}

int vs_decode_telemetry(const struct vs_table *table, const uint8_t *body, size_t len,
                        struct vs_telemetry *telemetry)
{
    struct vs_telemetry b;
    struct vs_reader r;
    size_t payload = table->actuator_bytes;

    if (len != TELEMETRY_FIXED + payload)
        return VS_ERR_BODY;
    vs_reader_init(&r, body, len);
    b.state = vs_get_u8(&r);
    b.wanted = vs_get_u8(&r);
    b.stop_cause = vs_get_u8(&r);
    b.battery_low = vs_get_u8(&r);
    if (!telemetry_is_valid(&b))
        return VS_ERR_BODY;
    read_telemetry(&r, &b);
    memcpy(b.payload, vs_get_bytes(&r, payload), payload);
    *telemetry = b;
    return VS_OK;
}
