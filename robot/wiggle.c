/* SPDX-License-Identifier: MIT */
#include "wiggle.h"

#include <string.h>

#include "driver.h"
#include "../c_src/vs_posix.h"

#define EACH_NS 500000000u  /* [ns] a way */
#define BREATH_NS 20000000u /* [ns] between two exchanges */
#define LASTS_NS 250000000u /* [ns] an order, where the next one does not come */

/* VS_OK, or how the base failed; a late one goes on. */
static int drive(struct vs_base *base, int16_t steps_s, struct vs_base_reading *reading)
{
    struct vs_base_command command;
    uint64_t end_ns = vs_posix_now_ns() + EACH_NS;
    int err = VS_OK;

    memset(&command, 0, sizeof command);
    command.left_steps_s = (int16_t)-steps_s;
    command.right_steps_s = steps_s;
    while (vs_posix_now_ns() < end_ns && (err == VS_OK || err == VS_ERR_BUSY || err == VS_ERR_LATE)) {
        vs_driver_until(base, vs_posix_now_ns() + LASTS_NS);
        err = vs_base_exchange(base, &command, reading);
        (void)vs_posix_wait(-1, 0, vs_posix_now_ns() + BREATH_NS);
    }
    return err == VS_ERR_BUSY || err == VS_ERR_LATE ? VS_OK : err;
}

int vs_wiggle(struct vs_base *base, struct vs_base_reading *reading, int32_t way[2])
{
    int32_t before[2] = {reading->steps[0], reading->steps[1]};
    int err = drive(base, VS_WIGGLE_STEPS_S, reading);
    int i;

    for (i = 0; i < 2; i++)
        way[i] = reading->steps[i] - before[i];
    if (err == VS_OK)
        err = drive(base, -VS_WIGGLE_STEPS_S, reading);
    return err == VS_OK ? drive(base, 0, reading) : err;
}
