/* SPDX-License-Identifier: MIT */
/*
 * epuck_imu.h - the gyroscopes that GCtronic built into e-pucks, as a Pi-puck reaches them on the
 * robot's I2C bus. Both ends use it.
 *
 * Which chip it is its identity tells. An e-puck2's chips were set up for +-250 degrees a second by
 * its firmware, which leaves them so when the selector stands at 10; an LSM330 has to be set up.
 * Source: gctronic/Pi-puck 73b8913 e-puck2/e-puck2_imu.c:17-27, 136-145, 151,
 * e-puck1/e-puck1_imu.c:78-89, 164-173; e-puck2_main-processor d2e0dbb src/sensors/imu.c:317-412,
 * mpu9250.c:11-16, 274-279, mpu9250_registers.h:91, 134, icm20948/ICM_20948_C.h:36-38,
 * ICM_20948_REGISTERS.h:24, 51-57; e-puck-library 4cb85cb library/acc_gyro/e_lsm330.c:279-283.
 * Read, not tried on hardware.
 */
#ifndef EPUCK_IMU_H
#define EPUCK_IMU_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define EPUCK_IMU_DIGITS (7509.872412) /* of a rad/s: 250 degrees a second are 32768 */

enum {
    EPUCK_IMU_LEN = 6,      /* [byte] x, y, z */
    EPUCK_IMU_MPU9250 = 0,  /* e-puck2; the next one is the same at its other address */
    EPUCK_IMU_ICM20948 = 2, /* newer e-puck2; likewise */
    EPUCK_IMU_LSM330 = 4,   /* e-puck of hardware 1.3 */
    EPUCK_IMUS = 5
};

struct epuck_imu {
    uint8_t address;
    uint8_t id_register;
    uint8_t id;          /* 0: it is not asked for */
    uint8_t rates;       /* register from which the rates are read */
    uint8_t is_lsm330;   /* 1: has to be set up, low byte first, 8.75e-3 degrees a second each */
};

extern const struct epuck_imu epuck_imus[EPUCK_IMUS];

/* What sets up an LSM330: register and value of each. */
#define EPUCK_IMU_SETTINGS 3
extern const uint8_t epuck_imu_settings[EPUCK_IMU_SETTINGS][2];

/* Reads rates: x, y, z as the chip counts its axes, in digits of 250/32768 degrees a second. */
void epuck_imu_get(const struct epuck_imu *imu, const uint8_t registers[EPUCK_IMU_LEN],
                   int16_t rates[3]);

#ifdef __cplusplus
}
#endif

#endif
