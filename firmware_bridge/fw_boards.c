/* SPDX-License-Identifier: MIT */
#include "fw_boards.h"

enum { ADC_POWER_ON = 0x8583, ADC_IDLE = 0x8000, ADC_CHANNEL_SHIFT = 12, ADC_CHANNEL_0 = 4 };
enum { STOCK_BITS = 16, DEFAULT_POWER = 150, HELD_MAX = 8 };

static enum fw_i2c_result ground_write(void *context, const uint8_t *buf, size_t len,
                                       uint64_t first_us)
{
    struct fw_ground *fw = context;

    (void)first_us;
    (void)len;
    fw->pointer = buf[0];
    return FW_I2C_ACK;
}

static enum fw_i2c_result ground_read(void *context, uint8_t *buf, size_t len, uint64_t first_us)
{
    struct fw_ground *fw = context;
    uint8_t registers[FW_GROUND_REGISTERS] = {0};
    size_t i;

    (void)first_us;
    epuck_ground_put(fw->ground, registers);
    for (i = 0; i < len; i++, fw->pointer++)
        buf[i] = fw->pointer < FW_GROUND_REGISTERS ? registers[fw->pointer] : 0;
    return FW_I2C_ACK;
}

static void no_error(void *context)
{
    (void)context;
}

void fw_ground_init(struct fw_ground *fw)
{
    *fw = (struct fw_ground){.pointer = 0};
    fw->device = (struct fw_i2c_device){fw, EPUCK_GROUND_ADDRESS, ground_write, ground_read,
                                        no_error};
}

/* What it does with fewer bytes no source says: here nothing. */
static enum fw_i2c_result rgb_write(void *context, const uint8_t *buf, size_t len,
                                    uint64_t first_us)
{
    struct fw_rgb *fw = context;

    (void)first_us;
    if (len < EPUCK_RGB_LEN)
        return FW_I2C_ACK;
    epuck_rgb_get(buf, fw->rgb);
    fw->writes++;
    return FW_I2C_ACK;
}

static enum fw_i2c_result rgb_read(void *context, uint8_t *buf, size_t len, uint64_t first_us)
{
    (void)context;
    (void)buf;
    (void)len;
    (void)first_us;
    return FW_I2C_NACK;
}

void fw_rgb_init(struct fw_rgb *fw)
{
    *fw = (struct fw_rgb){.writes = 0};
    fw->device = (struct fw_i2c_device){fw, EPUCK_RGB_ADDRESS, rgb_write, rgb_read, no_error};
}

static enum fw_i2c_result adc_write(void *context, const uint8_t *buf, size_t len,
                                    uint64_t first_us)
{
    struct fw_adc *fw = context;
    unsigned int channel;

    (void)first_us;
    fw->pointer = buf[0];
    if (fw->pointer != EPUCK_ADC_SETTINGS || len < 3)
        return FW_I2C_ACK;
    fw->settings = (uint16_t)(buf[1] << 8 | buf[2]);
    channel = (unsigned int)(fw->settings >> ADC_CHANNEL_SHIFT & 7);
    if ((fw->settings & ADC_IDLE) != 0 && (channel == ADC_CHANNEL_0 || channel == ADC_CHANNEL_0 + 1))
        epuck_adc_put_battery(fw->channels_mv[channel - ADC_CHANNEL_0], fw->value);
    return FW_I2C_ACK;
}

static enum fw_i2c_result adc_read(void *context, uint8_t *buf, size_t len, uint64_t first_us)
{
    const struct fw_adc *fw = context;
    uint16_t settings = fw->settings | ADC_IDLE;
    uint8_t registers[2] = {(uint8_t)(settings >> 8), (uint8_t)(settings & 0xFFu)};
    const uint8_t *from = fw->pointer == EPUCK_ADC_SETTINGS ? registers : fw->value;
    size_t i;

    (void)first_us;
    for (i = 0; i < len; i++)
        buf[i] = from[i % 2];
    return FW_I2C_ACK;
}

void fw_adc_init(struct fw_adc *fw)
{
    *fw = (struct fw_adc){.settings = ADC_POWER_ON};
    fw->device = (struct fw_i2c_device){fw, EPUCK_ADC_ADDRESS, adc_write, adc_read, no_error};
}

static void send(struct fw_rab *fw, uint64_t now_us)
{
    fw->sent_number = fw->bits < 32 ? fw->number & ((1u << fw->bits) - 1u) : fw->number;
    fw->sent_us = now_us;
    fw->sent++;
}

static int is_width(uint8_t bits)
{
    return bits == 8 || bits == 16 || bits == 24 || bits == 32;
}

static void write_register(struct fw_rab *fw, uint8_t number, uint8_t value, uint64_t now_us)
{
    if (number == EPUCK_RAB_POWER)
        fw->power = value;
    else if (number == EPUCK_RAB_STORE_LIGHT)
        fw->light_stored++;
    else if (number == EPUCK_RAB_ON_ROBOT)
        fw->on_robot = value;
    else if (number == EPUCK_RAB_FIRST)
        fw->number = value;
    else if (!fw->is_stock && (number == EPUCK_RAB_THEN || number == EPUCK_RAB_THEN_TOO))
        fw->number = fw->number << 8 | value;
    else if (!fw->is_stock && number == EPUCK_RAB_BITS && is_width(value))
        fw->bits = value;
    if (number != EPUCK_RAB_SEND)
        return;
    fw->number = fw->number << 8 | value;
    send(fw, now_us);
}

static enum fw_i2c_result rab_write(void *context, const uint8_t *buf, size_t len,
                                    uint64_t first_us)
{
    struct fw_rab *fw = context;
    size_t i;

    fw->pointer = buf[0];
    for (i = 1; i < len; i++)
        write_register(fw, fw->pointer, buf[i], first_us + i * FW_I2C_BYTE_US);
    return FW_I2C_ACK;
}

static uint8_t take(struct fw_rab *fw)
{
    if (fw->queue_count == 0)
        return 0;
    fw->taken = fw->queue[fw->queue_read];
    fw->queue_read = (fw->queue_read + 1) % EPUCK_RAB_QUEUE;
    fw->queue_count--;
    return 1;
}

static uint8_t read_register(struct fw_rab *fw, uint8_t number)
{
    uint8_t size = fw->is_stock ? 2 : 4;
    uint8_t held[HELD_MAX];
    size_t count;
    const uint8_t *registers = epuck_rab_reads(size, &count);
    size_t i;

    if (number == EPUCK_RAB_TAKE)
        return take(fw);
    epuck_rab_put(&fw->taken, size, held);
    for (i = 0; i < count; i++)
        if (registers[i] == number)
            return held[i];
    return 0;
}

static enum fw_i2c_result rab_read(void *context, uint8_t *buf, size_t len, uint64_t first_us)
{
    struct fw_rab *fw = context;
    size_t i;

    (void)first_us;
    for (i = 0; i < len; i++)
        buf[i] = read_register(fw, (uint8_t)(fw->pointer + (i < 2 ? 0 : i - 1)));
    return FW_I2C_ACK;
}

void fw_rab_init(struct fw_rab *fw)
{
    *fw = (struct fw_rab){.bits = STOCK_BITS, .power = DEFAULT_POWER};
    fw->device = (struct fw_i2c_device){fw, EPUCK_RAB_ADDRESS, rab_write, rab_read, no_error};
}

void fw_rab_hear(struct fw_rab *fw, const struct epuck_rab_message *message)
{
    uint32_t at = (fw->queue_read + fw->queue_count) % EPUCK_RAB_QUEUE;

    if (fw->queue_count == EPUCK_RAB_QUEUE) {
        fw->overflowed++;
        return;
    }
    fw->queue[at] = *message;
    fw->queue_count++;
}
