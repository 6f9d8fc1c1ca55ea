/* SPDX-License-Identifier: MIT */
#include "driver_record.h"

#include <string.h>

#include "../c_src/vs_body.h"
#include "../c_src/vs_bytes.h"

#define RAYS_AT 96 /* of a report; up to there are zeros, for what is to come */

#define WAY_MAX_UM INT64_C(1000000000000000) /* 1e9 m: nanometres of a difference are a number */

static const uint8_t magic[4] = {'v', 's', 'd', VS_DRIVER_VERSION};

void vs_driver_put_order(const struct vs_driver_order *order, uint8_t buf[VS_DRIVER_ORDER_LEN])
{
    uint8_t *at = buf + sizeof magic;

    memcpy(buf, magic, sizeof magic);
    at = vs_store_u32(at, order->flags);
    at = vs_store_u64(at, order->sent_ns);
    at = vs_store_u64(at, order->until_ns);
    at = vs_store_u32(at, (uint32_t)order->left_um_s);
    at = vs_store_u32(at, (uint32_t)order->right_um_s);
    at = vs_store_u16(at, order->leds);
    memcpy(at, order->rgb, sizeof order->rgb);
    (void)vs_store_u16(at + sizeof order->rgb, 0);
}

/* Numbers of 16 bits. Returns the place behind them. */
static const uint8_t *load(const uint8_t *at, int16_t *values, size_t count)
{
    for (; count > 0; count--, at += 2)
        *values++ = (int16_t)vs_load_u16(at);
    return at;
}

static int is_possible(const struct vs_driver_report *r)
{
    int i;

    for (i = 0; i < 2; i++)
        if (r->way_um[i] > WAY_MAX_UM || r->way_um[i] < -WAY_MAX_UM)
            return 0;
    return r->rays[0] <= VS_DRIVER_RAYS && r->rays[1] <= VS_DRIVER_RAYS &&
           r->rgb_leds <= VS_BASE_RGB_LEDS && (r->battery_low <= 1 || r->battery_low == VS_UNKNOWN);
}

int vs_driver_get_report(const uint8_t buf[VS_DRIVER_REPORT_LEN], struct vs_driver_report *report)
{
    const uint8_t *at = buf + 40;

    if (memcmp(buf, magic, sizeof magic - 1) != 0)
        return VS_ERR_MAGIC;
    if (buf[sizeof magic - 1] != VS_DRIVER_VERSION)
        return VS_ERR_VERSION;
    report->flags = vs_load_u32(buf + 4);
    report->order_ns = vs_load_u64(buf + 8);
    report->measured_ns = vs_load_u64(buf + 16);
    report->way_um[0] = (int64_t)vs_load_u64(buf + 24);
    report->way_um[1] = (int64_t)vs_load_u64(buf + 32);
    report->max_mm_s = vs_load_u16(at);
    report->battery_mv = vs_load_u16(at + 2);
    report->battery_low = at[4];
    report->rgb_leds = at[5];
    report->rays[0] = at[6];
    report->rays[1] = at[7];
    report->distance_mm = vs_load_u16(at + 8);
    at = load(at + 10, report->ground, 3);
    at = load(at, report->acceleration, 3);
    (void)load(at, report->rates_mrad_s, 3);
    at = load(buf + RAYS_AT, report->prox, VS_DRIVER_RAYS);
    (void)load(at, report->light, VS_DRIVER_RAYS);
    return is_possible(report) ? VS_OK : VS_ERR_BODY;
}
