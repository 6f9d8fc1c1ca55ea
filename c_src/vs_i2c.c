/* SPDX-License-Identifier: MIT */
#include "vs_i2c.h"

enum { TRIES = 3 }; /* about one transaction in 1000 fails: epuck.md, pitfall 2 */

int vs_i2c_has_time(const struct vs_i2c *bus, uint64_t deadline_ns)
{
    return bus->now_ns(bus->context) + VS_I2C_TIMEOUT_NS <= deadline_ns;
}

int vs_i2c_insist(struct vs_i2c *bus, uint8_t address, const uint8_t *out, size_t out_len,
                  uint8_t *in, size_t in_len, uint64_t deadline_ns)
{
    int err = VS_ERR_BUSY;
    int i;

    for (i = 0; i < TRIES && vs_i2c_has_time(bus, deadline_ns); i++) {
        err = bus->transfer(bus->context, address, out, out_len, in, in_len);
        if (err != VS_ERR_SILENT)
            break;
        bus->failures++;
    }
    return err;
}
