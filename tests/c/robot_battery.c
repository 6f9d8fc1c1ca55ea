/* SPDX-License-Identifier: MIT */
/* battery.h: low for a while is empty, and only a good deal more is charged. */
#include <string.h>

#include "battery.h"
#include "check.h"

#define S UINT64_C(1000000000)
#define UNKNOWN 255

static void test_it_has_to_be_low_for_a_while(void)
{
    struct vs_battery battery = {.stop_mv = 3400};

    CHECK(!vs_battery_look(&battery, 3399, 0, 10 * S));
    CHECK(!vs_battery_look(&battery, 3399, 0, 13 * S - 1));
    CHECK(!vs_battery_look(&battery, 3400, 0, 13 * S)); /* a motor had started */
    CHECK(!vs_battery_look(&battery, 3300, 0, 14 * S));
    CHECK(vs_battery_look(&battery, 3300, 0, 17 * S) && battery.empty);
    CHECK(vs_battery_look(&battery, 3599, 0, 18 * S)); /* it rises at rest */
    CHECK(!vs_battery_look(&battery, 3600, 0, 19 * S));
    CHECK(!vs_battery_look(&battery, 3300, 0, 20 * S));
    CHECK(vs_battery_look(&battery, 3300, 0, 23 * S));
}

/* IRIDIA's firmware says low or not, and that at 3.4 V. */
static void test_a_base_that_says_low_only(void)
{
    struct vs_battery battery = {.stop_mv = 3400};

    CHECK(!vs_battery_look(&battery, 0, UNKNOWN, S) && !vs_battery_look(&battery, 0, UNKNOWN, 9 * S));
    CHECK(!vs_battery_look(&battery, 0, 0, 10 * S));
    CHECK(!vs_battery_look(&battery, 0, 1, 11 * S));
    CHECK(vs_battery_look(&battery, 0, 1, 14 * S));
    CHECK(vs_battery_look(&battery, 0, 0, 15 * S));
}

/* A converter on a bad line answers now and then; what it does not say changes nothing. */
static void test_a_measurement_that_fails_is_none(void)
{
    struct vs_battery battery = {.stop_mv = 3400};

    CHECK(!vs_battery_look(&battery, 3300, 0, 10 * S));
    CHECK(!vs_battery_look(&battery, 0, UNKNOWN, 11 * S));
    CHECK(!vs_battery_look(&battery, 3300, 0, 12 * S));
    CHECK(!vs_battery_look(&battery, 0, UNKNOWN, 14 * S));
    CHECK(vs_battery_look(&battery, 3300, 0, 15 * S));
    CHECK(vs_battery_look(&battery, 0, UNKNOWN, 16 * S));
}

static void test_without_a_limit_nothing_stops(void)
{
    struct vs_battery battery = {.stop_mv = 0};
    uint64_t now_ns;

    for (now_ns = S; now_ns < 20 * S; now_ns += S)
        CHECK(!vs_battery_look(&battery, 1, 1, now_ns));
}

int main(void)
{
    test_it_has_to_be_low_for_a_while();
    test_a_base_that_says_low_only();
    test_a_measurement_that_fails_is_none();
    test_without_a_limit_nothing_stops();
    return 0;
}
