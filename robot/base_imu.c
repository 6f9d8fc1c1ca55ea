/* SPDX-License-Identifier: MIT */
#include "base_imu.h"

/* Sets up an LSM330, which is told to anew whenever it was lost: it may have been switched off. */
static int set_up(struct vs_i2c *bus, uint8_t address, uint64_t deadline_ns)
{
    int err = VS_OK;
    int i;

    for (i = 0; i < EPUCK_IMU_SETTINGS && err == VS_OK; i++)
        err = vs_i2c_insist(bus, address, epuck_imu_settings[i], 2, NULL, 0, deadline_ns);
    return err;
}

/* VS_OK: this chip is there; VS_ERR_SILENT: it is not. */
static int look_for(const struct epuck_imu *chip, struct vs_i2c *bus, uint64_t deadline_ns)
{
    uint8_t id;
    int err;

    if (chip->is_lsm330)
        return set_up(bus, chip->address, deadline_ns);
    err = vs_i2c_insist(bus, chip->address, &chip->id_register, 1, &id, 1, deadline_ns);
    return err == VS_OK && id != chip->id ? VS_ERR_SILENT : err;
}

int vs_imu_read(struct vs_imu *imu, struct vs_i2c *bus, int16_t rates[3], uint64_t deadline_ns)
{
    const struct epuck_imu *chip = &epuck_imus[imu->chip];
    uint8_t in[EPUCK_IMU_LEN];
    int err = imu->found ? VS_OK : look_for(chip, bus, deadline_ns);

    if (err == VS_OK) {
        imu->found = 1;
        err = vs_i2c_insist(bus, chip->address, &chip->rates, 1, in, sizeof in, deadline_ns);
    } else if (err == VS_ERR_SILENT && imu->chip + 1 < EPUCK_IMUS) {
        imu->chip++;
        return VS_ERR_BUSY;
    }
    if (err == VS_OK) {
        epuck_imu_get(chip, in, rates);
    } else if (err != VS_ERR_BUSY) {
        imu->found = 0;
        imu->chip = 0;
    }
    return err;
}
