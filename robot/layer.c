/* SPDX-License-Identifier: MIT */
#include "layer.h"

#include <string.h>

#include "robot.h"

const char *vs_robot_params(struct vs_robot *robot)
{
    memset(robot->asked, 0xFF, sizeof robot->asked);
    return robot->session->params;
}

int vs_robot_is_own(int sensor)
{
    return sensor >= VS_OWN;
}

int vs_robot_has_actuator(const struct vs_robot *robot, const char *name)
{
    const struct vs_table *table = &robot->session->table;
    int index = vs_table_find(table, name);

    return index >= 0 && table->entries[index].direction == VS_ACTUATOR;
}

/* Logs text in lines that are cut nowhere: a new one at its ends of line and where one is full. */
static void log_lines(struct vs_robot *robot, const char *text)
{
    char line[VS_LOG_MAX + 1];

    while (*text != '\0') {
        size_t len = strcspn(text, "\n");

        if (len > VS_LOG_MAX)
            for (len = VS_LOG_MAX; len > VS_LOG_MAX - 3 && ((uint8_t)text[len] & 0xC0) == 0x80;)
                len--; /* not within a character of several bytes */
        memcpy(line, text, len);
        line[len] = '\0';
        vs_robot_log(robot, line);
        text += len + (text[len] == '\n');
    }
}

void vs_robot_fail(struct vs_robot *robot, const char *words)
{
    size_t len = strlen(words);

    if (robot->failure[0] != '\0')
        return;
    len = len < sizeof robot->failure ? len : sizeof robot->failure - 1;
    memcpy(robot->failure, len > 0 ? words : "?", len > 0 ? len : 1);
    robot->failure[len > 0 ? len : 1] = '\0';
    vs_robot_log(robot, "the controller cannot go on:");
    log_lines(robot, robot->failure);
}
