/* SPDX-License-Identifier: MIT */
#include "epuck_imu.h"

enum { DIGITS = 147, OF_RAW = 128 }; /* 8.75e-3 degrees a second are 1.147 digits */

const struct epuck_imu epuck_imus[EPUCK_IMUS] = {
    {0x68, 0x75, 0x71, 0x43, 0},
    {0x69, 0x75, 0x71, 0x43, 0},
    {0x68, 0x00, 0xEA, 0x33, 0},
    {0x69, 0x00, 0xEA, 0x33, 0},
    {0x6A, 0x00, 0x00, 0x28 | 0x80, 1}, /* 0x80: the register counts on */
};

/* 760 Hz and all axes on; no filter; +-250 degrees a second. */
const uint8_t epuck_imu_settings[EPUCK_IMU_SETTINGS][2] = {
    {0x20, 0xCF}, {0x21, 0x20}, {0x23, 0x00}};

static int16_t scale(int16_t raw)
{
    int32_t digits = (int32_t)raw * DIGITS / OF_RAW;

    if (digits > INT16_MAX)
        return INT16_MAX;
    return (int16_t)(digits < INT16_MIN ? INT16_MIN : digits);
}

void epuck_imu_get(const struct epuck_imu *imu, const uint8_t registers[EPUCK_IMU_LEN],
                   int16_t rates[3])
{
    int i;

    for (i = 0; i < 3; i++) {
        uint8_t high = registers[2 * i + imu->is_lsm330];
        uint8_t low = registers[2 * i + 1 - imu->is_lsm330];
        int16_t raw = (int16_t)(uint16_t)(high << 8 | low);

        rates[i] = imu->is_lsm330 ? scale(raw) : raw;
    }
}
