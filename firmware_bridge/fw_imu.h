/* SPDX-License-Identifier: MIT */
/*
 * fw_imu.h - the gyroscopes of epuck_imu.h on an I2C bus, as freestanding C:
 * - registers count on by themselves; an LSM330's only with 0x80 in the register's number;
 * - an LSM330 measures nothing until it is switched on.
 */
#ifndef FW_IMU_H
#define FW_IMU_H

#include <stddef.h>
#include <stdint.h>

#include "epuck_imu.h"
#include "fw_i2c.h"

#ifdef __cplusplus
extern "C" {
#endif

struct fw_imu {
    struct fw_i2c_device device; /* to be put on a bus; the struct must not move then */
    int16_t rates[3];            /* x, y, z in the chip's own digits: the owner writes */
    const struct epuck_imu *chip;
    uint8_t settings[4];         /* of an LSM330: registers 0x20..0x23 */
    uint8_t pointer;
};

/* Power on: a chip of epuck_imus, at rest. */
void fw_imu_init(struct fw_imu *fw, int chip);

#ifdef __cplusplus
}
#endif

#endif
