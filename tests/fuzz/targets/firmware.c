/* SPDX-License-Identifier: MIT */
/*
 * The microcontroller's end of every protocol under any bytes at any time. It lives on, its motors
 * stay within what they can do, its queues within their bounds, and it turns a wheel only if a
 * command that came said so, which needs bytes. First byte: which, and whether it has a watchdog.
 */
#include "../../../firmware_bridge/fw_argos.h"
#include "../../../firmware_bridge/fw_asercom.h"
#include "../../../firmware_bridge/fw_boards.h"
#include "../../../firmware_bridge/fw_gctronic.h"
#include "../../../firmware_bridge/fw_imu.h"
#include "../../../firmware_bridge/fw_york.h"
#include "fuzz.h"

#define STEPS 200
#define WATCHDOG_US 400000u

static uint64_t now_us;
static uint32_t guarded;  /* it has a watchdog */
static uint64_t heard_us; /* newest byte of the host */

static void check_body(const struct fw_body *body, int most)
{
    const struct fw_outputs *out = &body->outputs;

    CHECK(out->left_steps_s >= -most && out->left_steps_s <= most);
    CHECK(out->right_steps_s >= -most && out->right_steps_s <= most);
    if (heard_us == 0)
        CHECK(out->left_steps_s == 0 && out->right_steps_s == 0);
    CHECK(body->applied_us <= now_us + WATCHDOG_US);
}

/* The host has been silent for long: what it sent is through, and the watchdog has stopped. */
static void check_silence(struct fw_body *body)
{
    if (guarded)
        CHECK(body->outputs.left_steps_s == 0 && body->outputs.right_steps_s == 0);
}

static uint64_t pass(struct input *in)
{
    uint32_t us = take_u16(in);

    now_us += us & 0x8000 ? (us & 0x7FFF) * 100u : us;
    return now_us;
}

static const uint8_t *hear(struct input *in, size_t *len)
{
    const uint8_t *bytes;

    *len = take_u8(in);
    bytes = take_bytes(in, len);
    if (*len > 0)
        heard_us = now_us;
    return bytes;
}

static void set_faults(struct input *in, struct fw_line_faults *faults)
{
    faults->lose = take_u8(in);
    faults->flip = take_u8(in);
    faults->twice = take_u8(in);
}

static void live_argos(struct fw_argos *fw)
{
    uint8_t sent[300];
    int lives = 0;

    while (fw_argos_advance(fw, now_us)) {
        check_body(&fw->body, 1000);
        CHECK(++lives < 100000);
    }
    CHECK(fw->got <= EPUCK_ARGOS_ACTUATOR_LEN && fw->uart.rx.count <= FW_LINE_CAPACITY);
    CHECK(fw_argos_transmit(fw, sent, sizeof sent, now_us) <= sizeof sent);
    (void)fw_argos_due_us(fw);
}

static void try_argos(struct input *in)
{
    static struct fw_argos fw;
    const uint8_t *bytes;
    size_t len;
    int i;

    fw_argos_init(&fw);
    fw.body.watchdog_us = guarded ? WATCHDOG_US : 0;
    for (i = 0; i < STEPS && in->left > 0; i++) {
        switch (take_below(in, 8)) {
        case 0:
            fw_argos_reset(&fw, now_us);
            break;
        case 1:
            set_faults(in, take_u8(in) & 1 ? &fw.uart.rx.faults : &fw.uart.tx.faults);
            break;
        case 2:
            take_into(in, &fw.body.inputs, sizeof fw.body.inputs);
            fw.rab_hears = take_u8(in);
            break;
        default:
            bytes = hear(in, &len);
            CHECK(fw_argos_receive(&fw, bytes, len, now_us) <= len);
            pass(in);
        }
        live_argos(&fw);
    }
    now_us += 100 * (uint64_t)WATCHDOG_US;
    live_argos(&fw);
    check_silence(&fw.body);
}

static void live_asercom(struct fw_asercom *fw)
{
    uint8_t sent[300];
    int lives = 0;

    while (fw_asercom_advance(fw, now_us)) {
        check_body(&fw->body, 1000);
        CHECK(++lives < 100000);
    }
    CHECK(fw->reply_len <= FW_ASERCOM_REPLY_MAX && fw->uart.tx.count <= FW_LINE_CAPACITY);
    CHECK(fw_asercom_transmit(fw, sent, sizeof sent, now_us) <= sizeof sent);
    (void)fw_asercom_due_us(fw);
}

static void try_asercom(struct input *in)
{
    static struct fw_asercom fw;
    const uint8_t *bytes;
    size_t len;
    int i;

    fw_asercom_init(&fw, (int)take_below(in, EPUCK_ASERCOM_MODES));
    fw.body.watchdog_us = guarded ? WATCHDOG_US : 0;
    for (i = 0; i < STEPS && in->left > 0; i++) {
        switch (take_below(in, 8)) {
        case 0:
            fw_asercom_reset(&fw, take_u8(in) & 1, now_us);
            break;
        case 1:
            set_faults(in, take_u8(in) & 1 ? &fw.uart.rx.faults : &fw.uart.tx.faults);
            break;
        case 2:
            take_into(in, &fw.body.inputs, sizeof fw.body.inputs);
            break;
        default:
            bytes = hear(in, &len);
            CHECK(fw_asercom_receive(&fw, bytes, len, now_us) <= len);
            pass(in);
        }
        live_asercom(&fw);
    }
    now_us += 100 * (uint64_t)WATCHDOG_US;
    live_asercom(&fw);
    check_silence(&fw.body);
}

static struct {
    struct fw_i2c wires;
    struct fw_gctronic gctronic;
    struct fw_york york;
    struct fw_ground ground;
    struct fw_rab rab;
    struct fw_adc adc;
    struct fw_rgb rgb;
    struct fw_imu imu;
} bus;

static void start_bus(struct input *in, int has_york)
{
    fw_i2c_init(&bus.wires);
    fw_gctronic_init(&bus.gctronic);
    fw_york_init(&bus.york);
    fw_ground_init(&bus.ground);
    fw_rab_init(&bus.rab);
    fw_adc_init(&bus.adc);
    fw_rgb_init(&bus.rgb);
    fw_imu_init(&bus.imu, (int)take_below(in, EPUCK_IMUS));
    bus.york.is_epuck2 = take_u8(in) & 1;
    bus.rab.is_stock = take_u8(in) & 1;
    bus.gctronic.body.watchdog_us = bus.york.body.watchdog_us = guarded ? WATCHDOG_US : 0;
    CHECK(fw_i2c_add(&bus.wires, has_york ? &bus.york.device : &bus.gctronic.device) == 0);
    CHECK(fw_i2c_add(&bus.wires, &bus.ground.device) == 0);
    CHECK(fw_i2c_add(&bus.wires, &bus.rab.device) == 0);
    CHECK(fw_i2c_add(&bus.wires, &bus.adc.device) == 0);
    CHECK(fw_i2c_add(&bus.wires, &bus.rgb.device) == 0);
    CHECK(fw_i2c_add(&bus.wires, &bus.imu.device) == 0);
}

static void live_bus(void)
{
    (void)fw_gctronic_advance(&bus.gctronic, now_us);
    (void)fw_york_advance(&bus.york, now_us);
    (void)fw_gctronic_due_us(&bus.gctronic);
    (void)fw_york_due_us(&bus.york);
    check_body(&bus.gctronic.body, EPUCK_GCTRONIC_SPEED_MAX);
    check_body(&bus.york.body, EPUCK_GCTRONIC_SPEED_MAX);
    CHECK(bus.rab.queue_count <= EPUCK_RAB_QUEUE && bus.york.answer_len <= 2);
}

static void transfer(struct input *in)
{
    static const uint8_t addresses[] = {EPUCK_GCTRONIC_ADDRESS, EPUCK_GROUND_ADDRESS,
                                        EPUCK_RAB_ADDRESS, EPUCK_ADC_ADDRESS, EPUCK_RGB_ADDRESS,
                                        0x68, 0x6A, 0x11};
    uint8_t got[64];
    size_t wanted = take_below(in, sizeof got);
    uint8_t address = addresses[take_below(in, sizeof addresses)];
    size_t len;
    const uint8_t *bytes = hear(in, &len);
    uint32_t made = bus.wires.transactions;

    (void)fw_i2c_transfer(&bus.wires, address, bytes, len, got, wanted, now_us);
    CHECK(bus.wires.transactions == made + 1);
    if (now_us < bus.wires.free_us)
        now_us = bus.wires.free_us;
}

/* What its owner writes lies in the ranges of its header. */
static void set_surroundings(struct input *in)
{
    struct epuck_rab_message message = {{1, 2, 3, 4}, (int16_t)take_u16(in), take_u16(in)};
    int i;

    fw_rab_hear(&bus.rab, &message);
    for (i = 0; i < 3; i++)
        bus.ground.ground[i] = (int16_t)(take_u16(in) & 1023);
    bus.adc.channels_mv[0] = take_u16(in);
    bus.york.tear = take_u8(in);
    take_into(in, &bus.gctronic.body.inputs, sizeof bus.gctronic.body.inputs);
    bus.york.body.inputs = bus.gctronic.body.inputs;
}

static void try_bus(struct input *in)
{
    int i;

    start_bus(in, take_u8(in) & 1);
    for (i = 0; i < STEPS && in->left > 0; i++) {
        switch (take_below(in, 8)) {
        case 0:
            fw_gctronic_reset(&bus.gctronic, now_us);
            fw_york_reset(&bus.york, now_us);
            break;
        case 1:
            bus.wires.faults.refuse = take_u8(in);
            bus.wires.faults.flip_write = take_u8(in);
            bus.wires.faults.flip_read = take_u8(in);
            bus.wires.stuck = take_u8(in) & 1;
            break;
        case 2:
            set_surroundings(in);
            break;
        case 3:
            pass(in);
            break;
        default:
            transfer(in);
        }
        live_bus();
    }
    now_us += 100 * (uint64_t)WATCHDOG_US;
    live_bus();
    check_silence(&bus.gctronic.body);
    check_silence(&bus.york.body);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static void (*const tries[])(struct input *) = {try_argos, try_asercom, try_bus};
    struct input in = {data, size};
    uint32_t which = take_u8(&in);

    now_us = 1000000;
    heard_us = 0;
    guarded = which >> 7;
    tries[which % 3](&in);
    return 0;
}
