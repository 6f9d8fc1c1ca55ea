/* SPDX-License-Identifier: MIT */
#include "vs_body.h"

#include "vs_packet.h"

#include <string.h>

int vs_encode_hello(const struct vs_header *header, const struct vs_hello *hello,
                    uint8_t *buf, size_t cap, size_t *len)
{
    struct vs_writer w;

    vs_packet_begin(&w, VS_HELLO, header, buf, cap);
    vs_put_bytes(&w, hello->uid, VS_UID_SIZE);
    vs_put_bytes(&w, hello->nonce, VS_NONCE_SIZE);
    vs_put_u64(&w, hello->started);
    vs_put_u32(&w, hello->uptime_s);
    vs_put_u16(&w, hello->tag);
    vs_put_u16(&w, hello->capabilities);
    vs_put_u16(&w, hello->params_room);
    vs_put_u16(&w, hello->entries_room);
    vs_put_u16(&w, hello->datagram_room);
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
    const uint8_t *nonce;
    int err;

    vs_reader_init(&r, body, len);
    uid = vs_get_bytes(&r, VS_UID_SIZE);
    nonce = vs_get_bytes(&r, VS_NONCE_SIZE);
    b.started = vs_get_u64(&r);
    b.uptime_s = vs_get_u32(&r);
    b.tag = vs_get_u16(&r);
    b.capabilities = vs_get_u16(&r);
    b.params_room = vs_get_u16(&r);
    b.entries_room = vs_get_u16(&r);
    b.datagram_room = vs_get_u16(&r);
    vs_get_text(&r, b.name, VS_NAME_MAX);
    vs_get_text(&r, b.controller, VS_NAME_MAX);
    vs_get_text(&r, b.version, VS_NAME_MAX);
    vs_get_text(&r, b.hash, VS_NAME_MAX);
    err = vs_reader_end(&r);
    if (err != VS_OK)
        return err;
    memcpy(b.uid, uid, VS_UID_SIZE);
    memcpy(b.nonce, nonce, VS_NONCE_SIZE);
    *hello = b;
    return VS_OK;
}

int vs_encode_welcome(const struct vs_header *header, const struct vs_welcome *welcome,
                      uint8_t *buf, size_t cap, size_t *len)
{
    uint8_t table[VS_TABLE_BYTES];
    size_t table_len = 0;
    struct vs_writer w;
    int err = vs_table_encode(&welcome->table, table, sizeof table, &table_len);

    *len = 0;
    if (err != VS_OK)
        return err;
    if (vs_text_check((const uint8_t *)welcome->params, welcome->params_len, 1) < 0)
        return VS_ERR_TEXT;
    if (welcome->params_len > VS_PARAMS_MAX || welcome->timestep_us == 0)
        return VS_ERR_BODY;
    vs_packet_begin(&w, VS_WELCOME, header, buf, cap);
    vs_put_bytes(&w, welcome->nonce, VS_NONCE_SIZE);
    vs_put_u32(&w, welcome->timestep_us);
    vs_put_u32(&w, welcome->seed);
    vs_put_u16(&w, welcome->params_len);
    vs_put_bytes(&w, (const uint8_t *)welcome->params, welcome->params_len);
    vs_put_u16(&w, (uint16_t)table_len);
    vs_put_bytes(&w, table, table_len);
    return vs_packet_end(&w, len);
}

int vs_decode_welcome(const uint8_t *body, size_t len, struct vs_welcome *welcome)
{
    struct vs_reader r;
    const uint8_t *nonce;
    const uint8_t *params;
    const uint8_t *table;
    uint32_t timestep_us;
    uint32_t seed;
    uint16_t params_len;
    size_t table_len;
    int err;

    vs_reader_init(&r, body, len);
    nonce = vs_get_bytes(&r, VS_NONCE_SIZE);
    timestep_us = vs_get_u32(&r);
    seed = vs_get_u32(&r);
    params_len = vs_get_u16(&r);
    params = vs_get_bytes(&r, params_len);
    table_len = vs_get_u16(&r);
    table = vs_get_bytes(&r, table_len);
    err = vs_reader_end(&r);
    if (err != VS_OK)
        return err;
    if (params_len > VS_PARAMS_MAX || timestep_us == 0)
        return VS_ERR_BODY;
    err = vs_text_check(params, params_len, 1);
    if (err == VS_OK) /* in place: a copy would be most of a microcontroller's stack */
        err = vs_table_decode(&welcome->table, table, table_len);
    if (err != VS_OK)
        return err;
    memcpy(welcome->nonce, nonce, VS_NONCE_SIZE);
    welcome->timestep_us = timestep_us;
    welcome->seed = seed;
    welcome->params_len = params_len;
    welcome->params = (const char *)params;
    return VS_OK;
}

int vs_encode_notice(const struct vs_header *header, const struct vs_notice *notice,
                     uint8_t *buf, size_t cap, size_t *len)
{
    struct vs_writer w;

    *len = 0;
    if (header->type != VS_REFUSE && header->type != VS_GOODBYE)
        return VS_ERR_TYPE;
    vs_packet_begin(&w, header->type, header, buf, cap);
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

/* Two's complement without a conversion that C leaves to the compiler. */
static int16_t to_i16(uint16_t value)
{
    return (int16_t)(value < 0x8000 ? (int)value : (int)value - 0x10000);
}

static int8_t to_i8(uint8_t value)
{
    return (int8_t)(value < 0x80 ? (int)value : (int)value - 0x100);
}

/* The first VS_STATE_FIXED bytes of a body: only who is to drive home has a goal. */
static int wish_is_valid(const uint8_t *body)
{
    if (body[0] > VS_HOME || body[1] != 0)
        return 0;
    return body[0] == VS_HOME ||
           (body[2] | body[3] | body[12] | body[13] | body[14] | body[15]) == 0;
}

int vs_encode_state(const struct vs_header *header, const struct vs_table *table,
                    const struct vs_state *state, uint8_t *buf, size_t cap, size_t *len)
{
    struct vs_writer w;
    uint8_t *at;
    uint32_t i;

    *len = 0;
    vs_packet_begin(&w, VS_STATE, header, buf, cap);
    at = vs_put_room(&w, VS_STATE_FIXED);
    if (at != NULL) {
        at = vs_store_u8(at, state->wanted);
        at = vs_store_u8(at, 0);
        at = vs_store_u16(at, (uint16_t)state->goal_heading);
        at = vs_store_u32(at, state->from_timestep);
        at = vs_store_u32(at, state->log_heard);
        at = vs_store_u16(at, (uint16_t)state->goal_x_mm);
        (void)vs_store_u16(at, (uint16_t)state->goal_y_mm);
        if (!wish_is_valid(buf + VS_HEADER_SIZE))
            return VS_ERR_BODY;
    }
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
    const uint8_t *at = body + VS_STATE_FIXED;
    uint32_t i;

    if (len != VS_STATE_FIXED + 4 * (size_t)table->sensors + table->sensor_bytes ||
        !wish_is_valid(body))
        return VS_ERR_BODY;
    state->wanted = body[0];
    state->goal_heading = to_i16(vs_load_u16(body + 2));
    state->from_timestep = vs_load_u32(body + 4);
    state->log_heard = vs_load_u32(body + 8);
    state->goal_x_mm = to_i16(vs_load_u16(body + 12));
    state->goal_y_mm = to_i16(vs_load_u16(body + 14));
    for (i = 0; i < table->count; i++) {
        const struct vs_entry *e = &table->entries[i];

        if (e->direction != VS_SENSOR)
            continue;
        state->older_us[e->rank] = vs_load_u32(at);
        memcpy(state->payload + e->offset, at + 4, e->size);
        at += 4 + e->size;
    }
    return VS_OK;
}

static int telemetry_is_valid(const struct vs_telemetry *t)
{
    return t->state <= VS_HOME && t->wanted <= VS_HOME &&
           (t->battery_low <= 1 || t->battery_low == VS_UNKNOWN) &&
           (t->power_saving <= 1 || t->power_saving == VS_UNKNOWN);
}

/* The first VS_TELEMETRY_FIXED bytes of a body. */
static void store_telemetry(uint8_t *at, const struct vs_telemetry *t)
{
    at = vs_store_u8(at, t->state);
    at = vs_store_u8(at, t->wanted);
    at = vs_store_u8(at, t->stop_cause);
    at = vs_store_u8(at, t->battery_low);
    at = vs_store_u32(at, t->wanted_run);
    at = vs_store_u32(at, t->control_step);
    at = vs_store_u16(at, (uint16_t)t->left_steps_s);
    at = vs_store_u16(at, (uint16_t)t->right_steps_s);
    at = vs_store_u16(at, t->leds);
    at = vs_store_u16(at, t->battery_mv);
    at = vs_store_u32(at, t->received);
    at = vs_store_u32(at, t->old);
    at = vs_store_u32(at, t->foreign);
    at = vs_store_u32(at, t->corrupt);
    at = vs_store_u32(at, t->base_errors);
    at = vs_store_u32(at, t->guard_restarts);
    at = vs_store_u32(at, t->clock_bound_us);
    at = vs_store_u8(at, (uint8_t)t->signal_dbm);
    at = vs_store_u8(at, t->power_saving);
    at = vs_store_u16(at, t->bit_rate);
    at = vs_store_u32(at, t->retries);
    at = vs_store_u32(at, t->overruns);
    at = vs_store_u32(at, t->base_resets);
    (void)vs_store_u32(at, t->log_number);
}

int vs_encode_telemetry(const struct vs_header *header, const struct vs_table *table,
                        const struct vs_telemetry *telemetry,
                        uint8_t *buf, size_t cap, size_t *len)
{
    const struct vs_telemetry *t = telemetry;
    struct vs_writer w;
    uint8_t *at;

    *len = 0;
    if (!telemetry_is_valid(t))
        return VS_ERR_BODY;
    vs_packet_begin(&w, VS_TELEMETRY, header, buf, cap);
    at = vs_put_room(&w, VS_TELEMETRY_FIXED);
    if (at != NULL)
        store_telemetry(at, t);
    vs_put_bytes(&w, t->payload, table->actuator_bytes);
    vs_put_text(&w, t->log, VS_LOG_MAX);
    vs_put_u8(&w, t->shown_len);
    vs_put_bytes(&w, t->shown, t->shown_len);
    return vs_packet_end(&w, len);
}

static int shown_is_valid(const uint8_t *block, size_t len)
{
    char name[VS_SHOWN_NAME_MAX + 1];
    char text[VS_SHOWN_TEXT_MAX + 1];
    uint8_t kind;
    float number;
    size_t at = 0;
    int err;

    do
        err = vs_shown_next(block, len, &at, name, &kind, &number, text);
    while (err == VS_OK);
    return err == VS_ERR_NOT_FOUND;
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
    t->signal_dbm = to_i8(vs_get_u8(r));
    t->power_saving = vs_get_u8(r);
    t->bit_rate = vs_get_u16(r);
    t->retries = vs_get_u32(r);
    t->overruns = vs_get_u32(r);
    t->base_resets = vs_get_u32(r);
    t->log_number = vs_get_u32(r);
}

int vs_decode_telemetry(const struct vs_table *table, const uint8_t *body, size_t len,
                        struct vs_telemetry *telemetry)
{
    struct vs_telemetry b;
    struct vs_reader r;
    const uint8_t *payload;
    const uint8_t *shown;
    int err;

    vs_reader_init(&r, body, len);
    b.state = vs_get_u8(&r);
    b.wanted = vs_get_u8(&r);
    b.stop_cause = vs_get_u8(&r);
    b.battery_low = vs_get_u8(&r);
    read_telemetry(&r, &b);
    payload = vs_get_bytes(&r, table->actuator_bytes);
    vs_get_text(&r, b.log, VS_LOG_MAX);
    b.shown_len = vs_get_u8(&r);
    shown = vs_get_bytes(&r, b.shown_len);
    err = vs_reader_end(&r);
    if (err != VS_OK)
        return err;
    if (!telemetry_is_valid(&b) || !shown_is_valid(shown, b.shown_len))
        return VS_ERR_BODY;
    memcpy(b.payload, payload, table->actuator_bytes);
    memcpy(b.shown, shown, b.shown_len);
    *telemetry = b;
    return VS_OK;
}
