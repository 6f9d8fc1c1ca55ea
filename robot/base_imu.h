/* SPDX-License-Identifier: MIT */
/* base_imu.h - the gyroscope on a Pi-puck's I2C bus (epuck_imu.h): finds out which chip it is, and
 * reads it. Pure. */
#ifndef VS_BASE_IMU_H
#define VS_BASE_IMU_H

#include "../c_src/epuck_imu.h"
#include "../c_src/vs_i2c.h"

struct vs_imu {
    uint8_t chip;  /* of epuck_imus: the one that is there, or is looked for next */
    uint8_t found; /* 1: it is there */
};

/* Reads its rates, in digits of epuck_imu.h. As vs_i2c_insist; VS_ERR_BUSY too while it is looked
 * for, one chip in a call, VS_ERR_SILENT when there is none. */
int vs_imu_read(struct vs_imu *imu, struct vs_i2c *bus, int16_t rates[3], uint64_t deadline_ns);

#endif
