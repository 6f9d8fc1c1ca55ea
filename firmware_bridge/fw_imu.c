/* SPDX-License-Identifier: MIT */
#include "fw_imu.h"

enum { SETTINGS = 0x20, COUNT_ON = 0x80, SWITCHED_ON = 0x08, SWITCHED_OFF = 0x07 };

static uint8_t number_of(const struct fw_imu *fw, uint8_t pointer)
{
    return (uint8_t)(fw->chip->is_lsm330 ? pointer & ~COUNT_ON : pointer);
}

static void count_on(struct fw_imu *fw)
{
    if (!fw->chip->is_lsm330 || (fw->pointer & COUNT_ON) != 0)
        fw->pointer++;
}

static enum fw_i2c_result imu_write(void *context, const uint8_t *buf, size_t len,
                                    uint64_t first_us)
{
    struct fw_imu *fw = context;
    size_t i;

    (void)first_us;
    fw->pointer = buf[0];
    for (i = 1; i < len; i++) {
        unsigned int at = (unsigned int)number_of(fw, fw->pointer) - SETTINGS;

        if (fw->chip->is_lsm330 && at < sizeof fw->settings)
            fw->settings[at] = buf[i];
        count_on(fw);
    }
    return FW_I2C_ACK;
}

static uint8_t read_register(const struct fw_imu *fw, uint8_t number)
{
    const struct epuck_imu *chip = fw->chip;
    unsigned int at = (unsigned int)number - number_of(fw, chip->rates);
    uint16_t rate;

    if (chip->id != 0 && number == chip->id_register)
        return chip->id;
    if (at >= EPUCK_IMU_LEN || (chip->is_lsm330 && (fw->settings[0] & SWITCHED_ON) == 0))
        return 0;
    rate = (uint16_t)fw->rates[at / 2];
    return (uint8_t)(at % 2 == chip->is_lsm330 ? rate >> 8 : rate & 0xFFu);
}

static enum fw_i2c_result imu_read(void *context, uint8_t *buf, size_t len, uint64_t first_us)
{
    struct fw_imu *fw = context;
    size_t i;

    (void)first_us;
    for (i = 0; i < len; i++, count_on(fw))
        buf[i] = read_register(fw, number_of(fw, fw->pointer));
    return FW_I2C_ACK;
}

static void no_error(void *context)
{
    (void)context;
}

void fw_imu_init(struct fw_imu *fw, int chip)
{
    *fw = (struct fw_imu){.chip = &epuck_imus[chip], .settings = {SWITCHED_OFF, 0, 0, 0}};
    fw->device = (struct fw_i2c_device){fw, epuck_imus[chip].address, imu_write, imu_read,
                                        no_error};
}
