/* SPDX-License-Identifier: MIT */
#include "hosted.h"

#include "robot.h"

enum { WANDER = 1, TOWARDS, REST };

/* All have the same table, so the handles are the same, too. */
int vs_hosted_sensor(struct vs_inprocess *all, const char *name)
{
    int handle = -1;
    uint32_t i;

    for (i = 0; i < vs_inprocess_robots(all); i++)
        handle = vs_robot_sensor(vs_inprocess_robot(all, i), name);
    return handle;
}

int vs_hosted_actuator(struct vs_inprocess *all, const char *name)
{
    int handle = -1;
    uint32_t i;

    for (i = 0; i < vs_inprocess_robots(all); i++)
        handle = vs_robot_actuator(vs_inprocess_robot(all, i), name);
    return handle;
}

void vs_hosted_read(const struct vs_inprocess *all, int sensor, int count, double *values,
                    uint64_t *ages_ns, uint8_t *stale)
{
    uint32_t i;

    for (i = 0; i < vs_inprocess_robots(all); i++) {
        const struct vs_robot *robot = vs_inprocess_robot(all, i);
        struct vs_reading reading = vs_robot_read(robot, sensor);
        double *row = values + (size_t)i * (size_t)count;
        int there = vs_robot_values(robot, sensor, row, count);

        for (; there < count; there++)
            row[there] = 0.0;
        ages_ns[i] = reading.age_ns;
        stale[i] = (uint8_t)reading.stale;
    }
}

void vs_hosted_wheels(struct vs_inprocess *all, const uint8_t *wanted, const int32_t *steps_s)
{
    uint32_t i;

    for (i = 0; i < vs_inprocess_robots(all); i++)
        if (wanted[i])
            vs_robot_set_wheels(vs_inprocess_robot(all, i), steps_s[2 * i], steps_s[2 * i + 1]);
}

void vs_hosted_leds(struct vs_inprocess *all, const uint8_t *wanted, const uint32_t *leds)
{
    uint32_t i;

    for (i = 0; i < vs_inprocess_robots(all); i++)
        if (wanted[i])
            vs_robot_set_leds(vs_inprocess_robot(all, i), leds[i]);
}

void vs_hosted_actuate(struct vs_inprocess *all, const uint8_t *wanted, int actuator, int count,
                       const double *values)
{
    uint32_t i;
    int index;

    for (i = 0; i < vs_inprocess_robots(all); i++)
        for (index = 0; wanted[i] && index < count; index++)
            vs_robot_actuate(vs_inprocess_robot(all, i), actuator, index,
                             values[i * (uint32_t)count + (uint32_t)index]);
}

void vs_hosted_random(struct vs_inprocess *all, const uint8_t *wanted, double *values)
{
    uint32_t i;

    for (i = 0; i < vs_inprocess_robots(all); i++)
        if (wanted[i])
            values[i] = vs_robot_random(vs_inprocess_robot(all, i));
}

void vs_hosted_show(struct vs_inprocess *all, uint32_t robot, const char *name, double value)
{
    if (robot < vs_inprocess_robots(all))
        vs_robot_show(vs_inprocess_robot(all, robot), name, value);
}

void vs_hosted_show_text(struct vs_inprocess *all, uint32_t robot, const char *name,
                         const char *text)
{
    if (robot < vs_inprocess_robots(all))
        vs_robot_show_text(vs_inprocess_robot(all, robot), name, text);
}

void vs_hosted_log(struct vs_inprocess *all, uint32_t robot, const char *line)
{
    if (robot < vs_inprocess_robots(all))
        vs_robot_log(vs_inprocess_robot(all, robot), line);
}

double vs_hosted_param(struct vs_inprocess *all, uint32_t robot, const char *name, double fallback)
{
    return vs_robot_param(vs_inprocess_robot(all, robot), name, fallback);
}

double vs_hosted_param_in(struct vs_inprocess *all, uint32_t robot, const char *name,
                          double fallback, int least, int most)
{
    return vs_robot_param_in(vs_inprocess_robot(all, robot), name, fallback, least, most);
}

int vs_hosted_param_text(struct vs_inprocess *all, uint32_t robot, const char *name, char *text,
                         size_t size)
{
    return vs_robot_param_text(vs_inprocess_robot(all, robot), name, text, size);
}

size_t vs_hosted_walk_bytes(const struct vs_inprocess *all)
{
    return vs_inprocess_robots(all) * sizeof(struct vs_walk);
}

void vs_hosted_walk_begin(struct vs_inprocess *all, void *walks)
{
    struct vs_walk *walk = walks;
    uint32_t i;

    for (i = 0; i < vs_inprocess_robots(all); i++)
        vs_walk_init(&walk[i], vs_inprocess_robot(all, i));
}

void vs_hosted_walk(struct vs_inprocess *all, void *walks, const uint8_t *does,
                    const double *bearings_rad)
{
    struct vs_walk *walk = walks;
    uint32_t i;

    for (i = 0; i < vs_inprocess_robots(all); i++) {
        struct vs_robot *robot = vs_inprocess_robot(all, i);

        if (does[i] == WANDER)
            vs_walk_wander(&walk[i], robot);
        else if (does[i] == TOWARDS)
            vs_walk_towards(&walk[i], robot, bearings_rad[i]);
        else if (does[i] == REST)
            vs_walk_rest(&walk[i], robot);
    }
}
