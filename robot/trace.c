/* SPDX-License-Identifier: MIT */
#include "trace.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <string.h>
#include <unistd.h>

#include "../c_src/vs_format.h"
#include "../c_src/vs_posix.h"

#define LINE_BYTES 6144 /* 32 names and times, 1116 bytes in hexadecimal, the rest */

static const char columns[] = "# columns: step timestep run now_ns rx_ns capture_ns age_ns "
                              "bound_ns stale left right leds values\n";

struct line {
    char text[LINE_BYTES];
    size_t len;
};

static void put_char(struct line *line, char c)
{
    if (line->len < LINE_BYTES)
        line->text[line->len++] = c;
}

static void put_text(struct line *line, const char *text)
{
    while (*text != '\0')
        put_char(line, *text++);
}

/* The bytes in hexadecimal, when they were measured, and their age and whether they were
 * stale as the controller was told. */
static void put_value(struct line *line, const struct vs_value *value,
                      const struct vs_reading *reading)
{
    static const char digits[] = "0123456789abcdef";
    char times[64];
    size_t i;

    if (!value->known) {
        put_char(line, '-');
        return;
    }
    for (i = 0; i < value->size; i++) {
        put_char(line, digits[value->data[i] >> 4]);
        put_char(line, digits[value->data[i] & 15]);
    }
    vs_format(times, sizeof times, "@%" PRIu64 ":%" PRId64 ":%d", value->capture_ns,
             (int64_t)reading->age_ns, reading->stale != 0);
    put_text(line, times);
}

static void put_values(struct line *line, const struct vs_robot *robot)
{
    const struct vs_table *table = &robot->session->table;
    struct vs_reading reading;
    struct vs_value value;
    uint32_t i;
    int some = 0;

    for (i = 0; i < table->count; i++) {
        if (vs_session_value(robot->session, (int)i, &value) != VS_OK)
            continue;
        reading = vs_robot_read(robot, (int)i);
        if (some)
            put_char(line, ',');
        put_text(line, table->entries[i].name);
        put_char(line, '=');
        put_value(line, &value, &reading);
        some = 1;
    }
    if (!some)
        put_char(line, '-');
}

static int write_all(int fd, const char *text, size_t len)
{
    ssize_t done = write(fd, text, len);

    if (done == (ssize_t)len)
        return 0;
    if (done < 0)
        return errno == EAGAIN ? 1 : -1;
    errno = ENOBUFS;
    return -1;
}

int vs_trace_open(const char *path)
{
    int fd = open(path, O_WRONLY | O_CREAT | O_APPEND | O_NONBLOCK, 0666);

    if (fd >= 0)
        vs_posix_keep_from_children(fd);
    if (fd >= 0 && write_all(fd, columns, sizeof columns - 1) != 0) {
        close(fd);
        return -1;
    }
    return fd;
}

int vs_trace_step(int fd, const struct vs_loop *loop)
{
    const struct vs_session *s = loop->session;
    const struct vs_step *step = &loop->step;
    struct line line;
    int64_t offset_ns;
    uint64_t bound_ns;

    if (vs_clock_estimate(&s->clock, step->session_ns, &offset_ns, &bound_ns) != VS_OK)
        bound_ns = UINT64_MAX;
    line.len = vs_format(
        line.text, LINE_BYTES,
        "step %" PRIu32 " timestep %" PRIu32 " run %" PRIu32 " now_ns %" PRId64 " rx_ns %" PRId64
        " capture_ns %" PRIu64 " age_ns %" PRId64 " bound_ns %" PRId64
        " stale %d left %d right %d leds %u values ",
        step->number, s->timestep, s->run, (int64_t)step->session_ns, (int64_t)s->fresh_ns,
        s->capture_ns, (int64_t)step->age_ns, (int64_t)bound_ns, (int)step->stale,
        (int)step->command.left_steps_s, (int)step->command.right_steps_s,
        (unsigned int)step->command.leds);
    put_values(&line, &loop->robot);
    put_char(&line, '\n');
    return write_all(fd, line.text, line.len);
}
