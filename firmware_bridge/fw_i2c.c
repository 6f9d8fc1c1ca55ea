/* SPDX-License-Identifier: MIT */
#include "fw_i2c.h"

enum { FLIPPED = 0x10, OUT_MAX = 64 };

void fw_i2c_init(struct fw_i2c *bus)
{
    *bus = (struct fw_i2c){.stuck = 0};
}

int fw_i2c_add(struct fw_i2c *bus, const struct fw_i2c_device *device)
{
    if (bus->count == FW_I2C_DEVICES)
        return -1;
    bus->devices[bus->count] = device;
    bus->count++;
    return 0;
}

static const struct fw_i2c_device *find(const struct fw_i2c *bus, uint8_t address)
{
    uint32_t i;

    for (i = 0; i < bus->count; i++)
        if (bus->devices[i]->address == address)
            return bus->devices[i];
    return NULL;
}

/* Counts down to the transaction that a fault is for. Returns 1 if this is it. */
static int is_due(uint32_t *countdown)
{
    if (*countdown == 0)
        return 0;
    (*countdown)--;
    return *countdown == 0;
}

static enum fw_i2c_result write_part(struct fw_i2c *bus, const struct fw_i2c_device *device,
                                     const uint8_t *out, size_t len)
{
    uint64_t first_us = bus->free_us + FW_I2C_EDGE_US + 2u * FW_I2C_BYTE_US;
    uint8_t damaged[OUT_MAX];
    size_t i;

    bus->free_us += FW_I2C_EDGE_US + (1u + len) * FW_I2C_BYTE_US;
    if (!is_due(&bus->faults.flip_write) || len > OUT_MAX)
        return device->write(device->context, out, len, first_us);
    for (i = 0; i < len; i++)
        damaged[i] = out[i];
    damaged[len / 2] ^= FLIPPED;
    return device->write(device->context, damaged, len, first_us);
}

static enum fw_i2c_result read_part(struct fw_i2c *bus, const struct fw_i2c_device *device,
                                    uint8_t *in, size_t len)
{
    uint64_t first_us = bus->free_us + FW_I2C_EDGE_US + FW_I2C_BYTE_US;
    enum fw_i2c_result result = device->read(device->context, in, len, first_us);

    bus->free_us += FW_I2C_EDGE_US + (1u + len) * FW_I2C_BYTE_US;
    if (is_due(&bus->faults.flip_read))
        in[len / 2] ^= FLIPPED;
    return result;
}

static enum fw_i2c_result run(struct fw_i2c *bus, const struct fw_i2c_device *device,
                              const uint8_t *out, size_t out_len, uint8_t *in, size_t in_len)
{
    enum fw_i2c_result result = FW_I2C_ACK;

    if (out_len > 0)
        result = write_part(bus, device, out, out_len);
    if (result == FW_I2C_ACK && in_len > 0)
        result = read_part(bus, device, in, in_len);
    bus->free_us += FW_I2C_EDGE_US;
    return result;
}

enum fw_i2c_result fw_i2c_transfer(struct fw_i2c *bus, uint8_t address, const uint8_t *out,
                                   size_t out_len, uint8_t *in, size_t in_len, uint64_t now_us)
{
    const struct fw_i2c_device *device = find(bus, address);
    int is_refused = is_due(&bus->faults.refuse);
    enum fw_i2c_result result = FW_I2C_NACK;

    if (bus->free_us < now_us)
        bus->free_us = now_us;
    bus->transactions++;
    if (bus->stuck) {
        result = FW_I2C_STUCK;
    } else if (device != NULL && !is_refused) {
        result = run(bus, device, out, out_len, in, in_len);
        bus->stuck = result == FW_I2C_STUCK;
    } else {
        bus->free_us += FW_I2C_EDGE_US + FW_I2C_BYTE_US + FW_I2C_EDGE_US;
        if (device != NULL)
            device->error(device->context);
    }
    bus->failed += result != FW_I2C_ACK;
    return result;
}
