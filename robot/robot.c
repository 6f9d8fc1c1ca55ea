/* SPDX-License-Identifier: MIT */
#include "robot.h"

#include <limits.h>
#include <string.h>

#include "leds.h"
#include "../c_src/vs_bytes.h"

#define F4_MAX 3.4028234663852886e38 /* the largest finite single */

/* Handles: 0.. of the table, OWN.. own, both: FUSED + (own - OWN) * VS_TABLE_MAX + entry. */
enum { NONE = -1, OWN = VS_OWN, OWN_MESSAGE = 1900, FUSED = 2000 };

#define OWN_OF(fused) (OWN + ((fused) - FUSED) / VS_TABLE_MAX)
#define ENTRY_OF(fused) (((fused) - FUSED) % VS_TABLE_MAX)

const double vs_robot_sensor_angle_rad[8] = {-0.3002, -0.8011, -1.5708, -2.6442,
                                             2.6442,  1.5708,  0.7994,  0.3002};

/* splitmix64. Source: Steele, Lea, Flood: Fast splittable generators, 2014. */
static uint64_t next_random(uint64_t *state)
{
    uint64_t z;

    *state += 0x9E3779B97F4A7C15u;
    z = *state;
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
    return z ^ (z >> 31);
}

void vs_robot_begin(struct vs_robot *robot, const struct vs_session *session)
{
    robot->session = session;
    memset(&robot->command, 0, sizeof robot->command);
    vs_robot_forget(robot);
    robot->random = (uint64_t)session->seed << 16 | session->config.tag;
    robot->bound = 0;
    robot->raw = 0;
    robot->failure[0] = '\0';
    robot->heard_until = robot->base.boards.heard_count;
    memset(robot->asked, 0, sizeof robot->asked);
}

void vs_robot_forget(struct vs_robot *robot)
{
    memset(robot->actuators, 0, sizeof robot->actuators);
    memset(robot->said_ns, 0, sizeof robot->said_ns);
    robot->shown_len = 0;
    robot->show_failed = 0;
}

void vs_robot_begin_step(struct vs_robot *robot)
{
    uint32_t count = robot->base.boards.heard_count;

    robot->heard_from = robot->heard_until <= count ? robot->heard_until : 0; /* counts anew */
    robot->heard_until = count;
}

void vs_robot_rest(struct vs_robot *robot)
{
    vs_leds_off(&robot->command);
    robot->command.message.length = 0;
}

int vs_robot_is_stale(const struct vs_session *session, uint64_t age_ns)
{
    return age_ns > UINT64_MAX / 10 || 10 * age_ns > session->timestep_ns * VS_STALE_TENTHS;
}

void vs_robot_complain(struct vs_robot *robot, const char *what, const char *name)
{
    if (robot->complain != NULL)
        robot->complain(robot->context, what, name);
}

/* Index of the table's entry of that name that goes up or down, or NONE. */
static int bind(struct vs_robot *robot, const char *name, int up)
{
    const struct vs_table *table = &robot->session->table;
    int index = vs_table_find(table, name);

    if (index < 0 || (table->entries[index].direction != VS_SENSOR) != up)
        return NONE;
    robot->bound |= (uint32_t)1 << index;
    return index;
}

/* The entry that is to be fused with the sensor of that name: "+" before it. */
static int bind_fused(struct vs_robot *robot, const char *name)
{
    char plus[VS_NAME_MAX + 1] = "+";

    if (strlen(name) >= VS_NAME_MAX)
        return NONE;
    memcpy(plus + 1, name, strlen(name) + 1);
    return bind(robot, plus, 0);
}

int vs_robot_sensor(struct vs_robot *robot, const char *name)
{
    int index = bind(robot, name, 0);
    int own = vs_base_sensor(name);

    if (index != NONE)
        return index;
    index = bind_fused(robot, name);
    if (own >= 0 && (robot->base_ns == 0 || vs_base_has(&robot->base, own)))
        return index == NONE ? OWN + own : FUSED + own * VS_TABLE_MAX + index;
    if (index == NONE)
        vs_robot_complain(robot, "nobody offers the sensor", name);
    return index; /* nothing here to fuse it with */
}

int vs_robot_offers(const struct vs_robot *robot, const char *name)
{
    const struct vs_table *table = &robot->session->table;
    int index = vs_table_find(table, name);
    int own = vs_base_sensor(name);

    if (index >= 0 && table->entries[index].direction == VS_SENSOR)
        return 1;
    return own >= 0 && (robot->base_ns == 0 || vs_base_has(&robot->base, own));
}

int vs_robot_actuator(struct vs_robot *robot, const char *name)
{
    int index = bind(robot, name, 1);

    if (index != NONE)
        return index;
    if (strcmp(name, "message") == 0 && vs_base_has(&robot->base, VS_BASE_RAB))
        return OWN_MESSAGE;
    vs_robot_complain(robot, "nobody offers the virtual actuator", name);
    return NONE;
}

/* Number index of a payload; the table's layout says what lies there. */
static double load(const struct vs_entry *entry, const uint8_t *data, int index)
{
    struct vs_reader r;
    uint32_t raw;

    vs_reader_init(&r, data, entry->size);
    if (entry->type[1] == '1')
        return vs_get_bytes(&r, (size_t)index + 1)[index];
    if (entry->type[1] == '2') {
        (void)vs_get_bytes(&r, (size_t)index * 2);
        raw = vs_get_u16(&r);
        return entry->type[0] == 'i' && raw > INT16_MAX ? (double)raw - 65536.0 : raw;
    }
    if (entry->type[0] == 'f')
        return (double)vs_load_f4(data + (size_t)index * 4);
    (void)vs_get_bytes(&r, (size_t)index * 4);
    raw = vs_get_u32(&r);
    return entry->type[0] == 'i' && raw > INT32_MAX ? (double)raw - 4294967296.0 : raw;
}

static int virtual_values(const struct vs_robot *robot, int sensor, double *values, int max)
{
    const struct vs_entry *entry;
    struct vs_value value;
    int i;

    if (vs_session_value(robot->session, sensor, &value) != VS_OK || !value.known)
        return 0;
    entry = &robot->session->table.entries[sensor];
    for (i = 0; i < entry->count && i < max; i++)
        values[i] = load(entry, value.data, i);
    return entry->count;
}

static int own_values(const struct vs_robot *robot, int sensor, double *values, int max)
{
    if (robot->base_ns == 0)
        return 0;
    return vs_base_values(&robot->base, sensor - OWN, robot->heard_from, values, max);
}

static uint64_t virtual_age_ns(const struct vs_robot *robot, int sensor)
{
    struct vs_value value;

    if (vs_session_value(robot->session, sensor, &value) != VS_OK || !value.known)
        return UINT64_MAX;
    return vs_session_age_ns(robot->session, value.capture_ns, robot->session_ns);
}

/* A virtual part that is stale would hold a robot before a door that has opened. */
static int fused_values(const struct vs_robot *robot, int sensor, double *values, int max)
{
    double more[VS_BASE_NUMBERS_MAX];
    int count = own_values(robot, OWN_OF(sensor), values, max);
    int both;
    int i;

    if (vs_robot_is_stale(robot->session, virtual_age_ns(robot, ENTRY_OF(sensor))))
        return count;
    max = max < count ? max : count;
    both = virtual_values(robot, ENTRY_OF(sensor), more, max);
    for (i = 0; i < both && i < max; i++)
        if (more[i] > values[i])
            values[i] = more[i];
    return count;
}

int vs_robot_values(const struct vs_robot *robot, int sensor, double *values, int max)
{
    if (sensor < 0)
        return 0;
    if (sensor >= FUSED)
        return fused_values(robot, sensor, values, max);
    if (sensor >= OWN)
        return own_values(robot, sensor, values, max);
    return virtual_values(robot, sensor, values, max);
}

struct vs_reading vs_robot_read(const struct vs_robot *robot, int sensor)
{
    struct vs_reading reading = {0.0, 0, 1, UINT64_MAX};
    struct vs_value value;

    if (sensor >= OWN) {
        reading.known = vs_robot_values(robot, sensor, &reading.value, 1) > 0;
        reading.age_ns = reading.known ? robot->now_ns - robot->base_ns : UINT64_MAX;
    } else if (vs_session_value(robot->session, sensor, &value) == VS_OK && value.known) {
        reading.known = 1;
        reading.value = load(&robot->session->table.entries[sensor], value.data, 0);
        reading.age_ns = vs_session_age_ns(robot->session, value.capture_ns, robot->session_ns);
    }
    reading.stale = vs_robot_is_stale(robot->session, reading.age_ns);
    return reading;
}

static double clip(double value, double low, double high)
{
    if (value > high)
        return high;
    return value >= low ? value : low;
}

/* What the robot's own board says to the others. */
static void actuate_message(struct vs_board_message *message, int index, double value)
{
    uint8_t byte = (uint8_t)(value == value ? clip(value, 0.0, 255.0) : 0.0);

    if (index == 0)
        message->length = byte < sizeof message->data ? byte : sizeof message->data;
    else if (index > 0 && (size_t)index <= sizeof message->data)
        message->data[index - 1] = byte;
}

void vs_robot_actuate(struct vs_robot *robot, int actuator, int index, double value)
{
    const struct vs_entry *entry;
    int width;
    int is_signed;
    double top;
    uint8_t *at;
    uint32_t raw;

    if (actuator == OWN_MESSAGE)
        actuate_message(&robot->command.message, index, value);
    if (actuator < 0 || (uint32_t)actuator >= robot->session->table.count)
        return;
    entry = &robot->session->table.entries[actuator];
    if (entry->direction == VS_SENSOR || index < 0 || index >= entry->count)
        return;
    robot->said_ns[actuator] = robot->session_ns;
    value = value == value ? value : 0.0;
    width = entry->type[1] - '0';
    at = robot->actuators + entry->offset + index * width;
    if (entry->type[0] == 'f') {
        vs_store_f4(at, (float)clip(value, -F4_MAX, F4_MAX));
        return;
    }
    is_signed = entry->type[0] == 'i';
    top = width == 1 ? 256.0 : width == 2 ? 65536.0 : 4294967296.0;
    value = clip(value, is_signed ? -top / 2 : 0.0, is_signed ? top / 2 - 1 : top - 1);
    raw = value < 0 ? (uint32_t)(int32_t)value : (uint32_t)value;
    for (; width > 0; width--, raw >>= 8)
        *at++ = (uint8_t)raw;
}

/* A value that has no room or is no clean text is not shown, which is complained of. */
static void show(struct vs_robot *robot, const char *name, float number, const char *text)
{
    int err = vs_shown_set(robot->shown, &robot->shown_len, name, number, text);

    if (err == VS_OK || robot->show_failed)
        return;
    robot->show_failed = 1;
    vs_robot_complain(robot, err == VS_ERR_SPACE ? "no room to show"
                      : "cannot show (1 to 15 bytes, a text at most 48)", name);
}

void vs_robot_show(struct vs_robot *robot, const char *name, double value)
{
    show(robot, name, (float)clip(value, -F4_MAX, F4_MAX), NULL);
}

void vs_robot_show_text(struct vs_robot *robot, const char *name, const char *text)
{
    show(robot, name, 0.0f, text);
}

void vs_robot_log(struct vs_robot *robot, const char *line)
{
    vs_log_add(&robot->log, line);
}

double vs_robot_random(struct vs_robot *robot)
{
    return (double)(next_random(&robot->random) >> 11) / 9007199254740992.0;
}

static int16_t narrow(int steps_s)
{
    if (steps_s > INT16_MAX)
        return INT16_MAX;
    return steps_s < -INT16_MAX ? -INT16_MAX : (int16_t)steps_s;
}

void vs_robot_set_wheels(struct vs_robot *robot, int left_steps_s, int right_steps_s)
{
    robot->command.left_steps_s = narrow(left_steps_s);
    robot->command.right_steps_s = narrow(right_steps_s);
}

double vs_robot_timestep_s(const struct vs_robot *robot)
{
    return robot->session->timestep_s;
}
