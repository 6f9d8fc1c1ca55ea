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

void vs_robot_fail(struct vs_robot *robot, const char *words)
{
    size_t len = strlen(words);

    if (robot->failure[0] != '\0')
        return;
    len = len < sizeof robot->failure ? len : sizeof robot->failure - 1;
    memcpy(robot->failure, len > 0 ? words : "?", len > 0 ? len : 1);
    robot->failure[len > 0 ? len : 1] = '\0';
    vs_robot_log(robot, robot->failure);
}
