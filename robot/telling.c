/* SPDX-License-Identifier: MIT */
/* telling.c - what the worker tells the host, and when: a part of loop.h. */
#include "loop.h"

#include <string.h>

#include "../c_src/vs_bytes.h"

enum vs_stop_cause vs_loop_cause(const struct vs_loop *loop, const struct vs_instant *now)
{
    if (loop->ending)
        return VS_CAUSE_SIGNAL;
    if (!loop->session->open)
        return VS_CAUSE_NO_SESSION;
    if (!loop->running)
        return VS_CAUSE_WANTED;
    if (loop->guard_lost)
        return VS_CAUSE_GUARD;
    if (loop->base_lost)
        return VS_CAUSE_BASE;
    if (loop->battery.empty)
        return VS_CAUSE_BATTERY;
    if (!vs_safety_may_move(&loop->safety, now->base_ns))
        return VS_CAUSE_STALE;
    return (enum vs_stop_cause)loop->guard_cause;
}

static uint8_t actual_state(const struct vs_loop *loop)
{
    const struct vs_session *s = loop->session;

    if (loop->running)
        return loop->running;
    return s->open && s->wanted != VS_RUN && s->wanted != VS_HOME ? s->wanted : VS_IDLE;
}

/* A control step tells, so that what would fall together with one waits for it. */
uint64_t vs_loop_telemetry_ns(const struct vs_loop *loop)
{
    uint64_t due_ns = loop->telemetry_ns + VS_LOOP_TELEMETRY_NS;
    int stepping = loop->waiting && loop->asked != VS_GUARD_PING;

    if (stepping || (loop->running && due_ns > loop->begin_ns + loop->session->timestep_ns / 2))
        return loop->telemetry_ns + VS_LOOP_REPORT_NS;
    return due_ns;
}

/* Whether the host was told otherwise by the newest packet, or has it twice already. By TCP none
 * is lost, and a copy would be for nothing. */
static int is_news(const struct vs_loop *loop, const struct vs_instant *now,
                   const struct vs_told *told)
{
    return loop->telemetry_due == VS_TELL_NEWS || loop->told_again ||
           told->run != loop->told.run || told->wanted != loop->told.wanted ||
           told->cause != loop->told.cause || told->log_number != loop->told.log_number ||
           vs_session_over_tcp(loop->session, now->session_ns);
}

/* Says of each of the robot's own readings how long ago it was measured. */
static void stamp_readings(const struct vs_loop *loop, const struct vs_instant *now,
                           uint8_t *payload)
{
    const struct vs_table *table = &loop->session->table;
    uint32_t i;

    for (i = 0; i < table->count; i++) {
        const struct vs_entry *e = &table->entries[i];
        uint64_t said_ns = loop->robot.said_ns[i];
        uint64_t older_us = vs_clock_us(now->session_ns - said_ns);

        if (e->direction != VS_READING)
            continue;
        if (said_ns == 0 || older_us > VS_NEVER_US)
            older_us = VS_NEVER_US;
        vs_store_u32(payload + e->offset - 4, (uint32_t)older_us);
    }
}

static void fill(const struct vs_loop *loop, const struct vs_instant *now,
                 struct vs_telemetry *t)
{
    const struct vs_robot *robot = &loop->robot;
    const struct vs_table *table = &loop->session->table;
    const char *line = vs_log_due(&robot->log, &t->log_number);

    t->overruns = loop->overruns;
    t->state = actual_state(loop);
    t->stop_cause = (uint8_t)loop->told.cause;
    t->battery_low = vs_base_battery_low(&robot->base);
    t->battery_mv = vs_base_battery_mv(&robot->base);
    t->control_step = loop->completed;
    t->left_steps_s = loop->applied.left_steps_s;
    t->right_steps_s = loop->applied.right_steps_s;
    t->leds = loop->applied.leds;
    if (table->actuator_bytes > 0)
        memcpy(t->payload, robot->actuators, table->actuator_bytes);
    if (table->readings > 0)
        stamp_readings(loop, now, t->payload);
    memcpy(t->log, line, strlen(line) + 1);
    t->shown_len = robot->shown_len;
    if (t->shown_len > 0)
        memcpy(t->shown, robot->shown, t->shown_len);
}

enum vs_telling vs_loop_telemetry(struct vs_loop *loop, const struct vs_instant *now,
                                  struct vs_telemetry *t)
{
    struct vs_told told;

    if (!loop->session->open)
        return VS_TELL_NOTHING;
    if (!loop->telemetry_due && now->base_ns < vs_loop_telemetry_ns(loop))
        return VS_TELL_NOTHING;
    told.run = loop->session->run;
    told.wanted = loop->session->wanted;
    told.cause = (uint32_t)vs_loop_cause(loop, now);
    (void)vs_log_due(&loop->robot.log, &told.log_number);
    loop->told_again = !is_news(loop, now, &told);
    loop->telemetry_due = VS_TELL_NOTHING;
    loop->telemetry_ns = now->base_ns;
    if (loop->told_again)
        return VS_TELL_AGAIN;
    loop->told = told;
    fill(loop, now, t);
    return VS_TELL_NEWS;
}
