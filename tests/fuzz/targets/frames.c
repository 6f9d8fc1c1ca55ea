/* SPDX-License-Identifier: MIT */
/*
 * The frames of every e-puck protocol, their checksums made right: what is read is written to the
 * same values, lies in its documented range, and is left alone where it is refused.
 */
#include <limits.h>

#include "../../../c_src/epuck_argos.h"
#include "../../../c_src/epuck_asercom.h"
#include "../../../c_src/epuck_boards.h"
#include "../../../c_src/epuck_bytes.h"
#include "../../../c_src/epuck_gctronic.h"
#include "../../../c_src/epuck_imu.h"
#include "../../../c_src/epuck_york.h"
#include "fuzz.h"

static void check_within(const int16_t *values, int count, int least, int most)
{
    int i;

    for (i = 0; i < count; i++)
        CHECK(values[i] >= least && values[i] <= most);
}

static void try_argos(struct input *in)
{
    uint8_t frame[EPUCK_ARGOS_SENSOR_LEN];
    struct epuck_argos_actuators a;
    struct epuck_argos_actuators b;
    struct epuck_argos_sensors s;
    struct epuck_argos_sensors t;

    memset(&a, 0, sizeof a);
    memset(&b, 0, sizeof b);
    take_into(in, frame, sizeof frame);
    epuck_argos_get_actuators(frame, &a);
    if (epuck_argos_get_sensors(frame, &s) == 0) {
        check_within(s.prox, 8, -EPUCK_ARGOS_RAW_MAX, EPUCK_ARGOS_RAW_MAX);
        check_within(s.light, 8, 0, EPUCK_ARGOS_RAW_MAX);
        check_within(s.acceleration, 3, -EPUCK_ARGOS_RAW_MAX, EPUCK_ARGOS_RAW_MAX);
        check_within(s.microphones, 3, 0, EPUCK_ARGOS_RAW_MAX);
        CHECK(s.battery_good <= 1);
        epuck_argos_put_sensors(&s, frame);
        CHECK(epuck_argos_get_sensors(frame, &t) == 0 && memcmp(&s, &t, sizeof s) == 0);
    }
    epuck_argos_put_actuators(&a, frame);
    epuck_argos_get_actuators(frame, &b);
    CHECK(a.left_steps_s == b.left_steps_s && a.right_steps_s == b.right_steps_s);
    CHECK(a.leds == b.leds && (a.leds & ~EPUCK_ARGOS_LED_ALL) == 0);
    CHECK(a.ircom_enable == b.ircom_enable && a.reset == b.reset);
}

static void try_asercom(struct input *in)
{
    const struct epuck_asercom_mode *mode =
        &epuck_asercom_modes[take_below(in, EPUCK_ASERCOM_MODES)];
    uint8_t bytes[EPUCK_ASERCOM_REPLY_MAX];
    struct epuck_asercom_poll poll;
    struct epuck_asercom_sensors s;
    struct epuck_asercom_sensors before;
    size_t len = epuck_asercom_reply_len(mode);
    uint16_t raw = take_u16(in);

    CHECK(len <= sizeof bytes);
    take_into(in, bytes, sizeof bytes);
    memset(&s, 0x5A, sizeof s);
    before = s;
    if (epuck_asercom_get_reply(mode, bytes, &s) == 0) {
        check_within(s.prox, 8, INT16_MIN, EPUCK_ASERCOM_RAW_MAX);
        check_within(s.light, 8, 0, EPUCK_ASERCOM_RAW_MAX);
        check_within(s.ground, 3, 0, EPUCK_ASERCOM_RAW_MAX);
    } else {
        CHECK(memcmp(&s, &before, sizeof s) == 0);
    }
    CHECK(epuck_asercom_battery_mv(raw, 0) <= 8000 && epuck_asercom_battery_mv(raw, 1) <= 5000);
    CHECK(epuck_asercom_battery_low(raw, raw & 1) <= 1);
    memset(&poll, 0, sizeof poll);
    poll.left_steps_s = (int16_t)(bytes[0] | bytes[1] << 8);
    poll.leds = raw;
    poll.change = (uint16_t)(bytes[2] | bytes[3] << 8);
    len = epuck_asercom_put_poll(mode, &poll, bytes);
    CHECK(len >= 5 && len <= EPUCK_ASERCOM_REQUEST_MAX && bytes[len - 1] == 0);
}

static void try_gctronic(struct input *in)
{
    uint8_t packet[EPUCK_GCTRONIC_SENSOR_LEN];
    uint8_t again[EPUCK_GCTRONIC_SENSOR_LEN];
    struct epuck_gctronic_actuators a;
    struct epuck_gctronic_actuators b;
    struct epuck_gctronic_sensors s;
    struct epuck_gctronic_sensors t;
    size_t last = EPUCK_GCTRONIC_ACTUATOR_LEN - 1;

    memset(&a, 0, sizeof a);
    memset(&b, 0, sizeof b);
    take_into(in, packet, sizeof packet);
    packet[last] = epuck_xor(packet, last);
    CHECK(epuck_gctronic_get_actuators(packet, &a) == 0);
    epuck_gctronic_put_actuators(&a, again);
    CHECK(epuck_gctronic_get_actuators(again, &b) == 0 && memcmp(&a, &b, sizeof a) == 0);
    again[last] ^= 1;
    CHECK(epuck_gctronic_get_actuators(again, &b) == -1 && memcmp(&a, &b, sizeof a) == 0);
    last = EPUCK_GCTRONIC_SENSOR_LEN - 1;
    packet[last] = epuck_xor(packet, last);
    memset(&t, 0x5A, sizeof t);
    s = t;
    if (epuck_gctronic_get_sensors(packet, &s) != 0) {
        CHECK(memcmp(&s, &t, sizeof s) == 0);
        return;
    }
    check_within(s.light, 8, 0, EPUCK_GCTRONIC_RAW_MAX);
    check_within(s.microphones, 4, 0, INT16_MAX);
    epuck_gctronic_put_sensors(&s, again);
    CHECK(epuck_gctronic_get_sensors(again, &t) == 0 && memcmp(&s, &t, sizeof s) == 0);
}

static void try_rab(struct input *in)
{
    uint8_t size = take_u8(in) & 1 ? 2 : 4;
    uint8_t registers[8];
    uint8_t again[8];
    struct epuck_rab_message m;
    size_t count = 0;

    CHECK(epuck_rab_reads(size, &count) != NULL && count == size + 4u);
    take_into(in, registers, sizeof registers);
    if (epuck_rab_get(registers, size, &m) != 0)
        return;
    CHECK(m.bearing_e4rad >= -31416 && m.bearing_e4rad <= 31416);
    epuck_rab_put(&m, size, again);
    CHECK(memcmp(registers, again, count) == 0);
}

static void try_boards(struct input *in)
{
    uint8_t bytes[EPUCK_RGB_LEN];
    uint8_t again[EPUCK_RGB_LEN];
    uint8_t rgb[EPUCK_RGB_LEDS][3];
    int16_t values[3] = {-1, -1, -1};
    uint16_t mv;

    take_into(in, bytes, sizeof bytes);
    epuck_rgb_get(bytes, rgb);
    epuck_rgb_put((const uint8_t(*)[3])rgb, again);
    CHECK(memcmp(bytes, again, sizeof bytes) == 0);
    if (epuck_ground_get(bytes, values) == 0) {
        check_within(values, 3, 0, EPUCK_GROUND_MAX);
        epuck_ground_put(values, again);
        CHECK(memcmp(bytes, again, EPUCK_GROUND_LEN) == 0);
    } else {
        check_within(values, 3, -1, -1);
    }
    mv = epuck_adc_get_battery(bytes);
    epuck_adc_put_battery(mv, again);
    CHECK(epuck_adc_get_battery(again) == mv && mv <= 8188);
    epuck_imu_get(&epuck_imus[bytes[8] % EPUCK_IMUS], bytes, values);
    epuck_york_put_write(bytes[0], (uint16_t)values[0], again);
    CHECK(again[0] == bytes[0] && again[1] == (values[0] & 0xFF));
    mv = (uint16_t)(bytes[0] | bytes[1] << 8);
    CHECK((epuck_york_get_leds(mv, epuck_york_other_leds(mv)) & 0x3FF) == (mv & 0x3FF));
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static void (*const tries[])(struct input *) = {try_argos, try_asercom, try_gctronic, try_rab,
                                                    try_boards};
    struct input in = {data, size};

    tries[take_below(&in, 5)](&in);
    return 0;
}
