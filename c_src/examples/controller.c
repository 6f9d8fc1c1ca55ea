/* SPDX-License-Identifier: MIT */
/* controller.c - drives a wide curve in clean air, and a narrow one where the virtual sensor
 * "pollutant" (one byte) says that there is some. */
#include "robot.h"

void controller_step(struct robot *r)
{
    struct vs_value pollutant;
    int index = vs_table_find(&r->session.table, "pollutant");
    int is_polluted = vs_session_value(&r->session, index, &pollutant) == VS_OK &&
                      pollutant.known && pollutant.data[0] > 0;

    r->left_steps_s = is_polluted ? -200 : 400;
    r->right_steps_s = is_polluted ? 200 : 300;
    r->telemetry.leds = is_polluted ? 0xFF : 0;
}
