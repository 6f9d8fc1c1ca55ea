/* SPDX-License-Identifier: MIT */
/*
 * The daemon's base_asercom against the firmware's own code, over an in-memory line on
 * virtual time, in every mode: whatever was on the line before, it is found; whatever goes
 * wrong, an exchange that says VS_OK was obeyed. argv[1]: how many random worlds; with few
 * of them not every byte gets its fault.
 */
#include <string.h>

#include "base_config.h"
#include "fw_asercom.h"
#include "robot_check.h"

#define MS 1000000u

extern const struct vs_base_ops vs_base_asercom;

struct world {
    struct fw_asercom fw;
    struct vs_base base;
    struct vs_base_reading reading;
    uint64_t now_ns;
    uint64_t delay_ns; /* of what the far end sends: Bluetooth */
    uint32_t random;
    uint8_t late[512]; /* sent, not yet here */
    uint64_t late_ns[512];
    size_t late_count;
};

static void live(struct world *w)
{
    uint8_t sent[64];
    size_t len;
    size_t i;

    while (fw_asercom_advance(&w->fw, w->now_ns / 1000))
        ;
    while ((len = fw_asercom_transmit(&w->fw, sent, sizeof sent, w->now_ns / 1000)) > 0) {
        for (i = 0; i < len && w->late_count < sizeof w->late; i++) {
            w->late[w->late_count] = sent[i];
            w->late_ns[w->late_count++] = w->now_ns + w->delay_ns;
        }
    }
}

static size_t take(struct world *w, uint8_t *buf, size_t cap)
{
    size_t len = 0;

    while (len < cap && len < w->late_count && w->late_ns[len] <= w->now_ns) {
        buf[len] = w->late[len];
        len++;
    }
    w->late_count -= len;
    memmove(w->late, w->late + len, w->late_count);
    memmove(w->late_ns, w->late_ns + len, w->late_count * sizeof w->late_ns[0]);
    return len;
}

static uint64_t io_now(void *context)
{
    return ((struct world *)context)->now_ns;
}

static int io_read(void *context, uint8_t *buf, size_t cap, uint64_t deadline_ns)
{
    struct world *w = context;

    for (;;) {
        size_t len;

        live(w);
        len = take(w, buf, cap);
        if (len > 0 || w->now_ns >= deadline_ns)
            return (int)len;
        w->now_ns += 50000 + draw(&w->random, 150000);
        if (w->now_ns > deadline_ns)
            w->now_ns = deadline_ns;
    }
}

static int io_write(void *context, const uint8_t *buf, size_t len, uint64_t deadline_ns)
{
    struct world *w = context;

    (void)deadline_ns;
    live(w);
    CHECK(fw_asercom_receive(&w->fw, buf, len, w->now_ns / 1000) == len);
    return VS_OK;
}

/* A base as ops->open leaves it, but on our line. */
static void begin(struct world *w, uint8_t mode, uint32_t seed)
{
    struct vs_base_config config = {&vs_base_asercom, "/nowhere", {"", ""}, 2, 115, 0.0867438559f,
                                    {mode, 0}, ""};
    int i;

    if (mode >= EPUCK_ASERCOM_EPUCK2) {
        config.choice[0] = (uint8_t)(mode - EPUCK_ASERCOM_EPUCK2 + EPUCK_ASERCOM_BLUETOOTH);
        config.choice[1] = 1;
    }

    memset(w, 0, sizeof *w);
    w->random = seed * 2654435761u + 1u;
    w->now_ns = 1000 * MS;
    w->base.ops = &vs_base_asercom;
    CHECK(vs_base_asercom.open(&w->base, &config) == VS_ERR_IO);
    w->base.io.context = w;
    w->base.io.now_ns = io_now;
    w->base.io.read = io_read;
    w->base.io.write = io_write;
    fw_asercom_init(&w->fw, mode);
    for (i = 0; i < 8; i++) {
        w->fw.body.inputs.prox[i] = (int16_t)(100 * i + 7);
        w->fw.body.inputs.light[i] = (int16_t)(4000 - 300 * i);
    }
    for (i = 0; i < 3; i++)
        w->fw.body.inputs.ground[i] = (int16_t)(300 + 100 * i);
    for (i = 0; i < 3; i++)
        w->fw.body.inputs.rates[i] = (int16_t)(1000 * i - 1500);
    w->fw.body.inputs.distance_mm = 1234;
}

static void feed(struct world *w, const uint8_t *buf, size_t len)
{
    size_t done = 0;

    while (done < len) {
        done += fw_asercom_receive(&w->fw, buf + done, len - done, w->now_ns / 1000);
        w->now_ns += MS;
        live(w);
    }
}

static void pass(struct world *w, uint64_t ns)
{
    w->now_ns += ns;
    live(w);
}

static int is_at_rest(const struct world *w)
{
    return w->fw.body.outputs.left_steps_s == 0 && w->fw.body.outputs.right_steps_s == 0;
}

static void recover(struct world *w)
{
    int steps = 0;
    int err;

    do {
        uint64_t step_ns = w->now_ns;

        err = vs_base_recover(&w->base);
        CHECK(err == VS_OK || err == VS_ERR_BUSY || err == VS_ERR_SILENT);
        CHECK(w->now_ns - step_ns <= 100 * MS);
        CHECK(++steps < 100);
    } while (err != VS_OK);
    CHECK(is_at_rest(w) && w->fw.body.outputs.leds == 0);
    CHECK(w->fw.state == FW_ASERCOM_IDLE);
}

static int exchange(struct world *w, int16_t left, int16_t right, uint16_t leds)
{
    struct vs_base_command command = {left, right, leds, {0, {0}}, {{0}}};
    uint64_t began_ns = w->now_ns;
    int err = vs_base_exchange(&w->base, &command, &w->reading);

    CHECK(w->now_ns - began_ns <= 30 * MS);
    return err;
}

/* What an exchange that went well promises. */
static void check_obeyed(const struct world *w, int16_t left, int16_t right)
{
    const struct fw_inputs *inputs = &w->fw.body.inputs;
    int i;

    CHECK(w->fw.body.outputs.left_steps_s == left && w->fw.body.outputs.right_steps_s == right);
    for (i = 0; i < 8; i++) {
        CHECK(w->reading.prox[i] == inputs->prox[i]);
        CHECK(w->reading.light[i] == 4095 - inputs->light[i]);
    }
}

static void test_plain_exchange(uint8_t mode)
{
    struct world w;
    uint16_t leds = epuck_asercom_modes[mode].leds & 0x3A5;
    int32_t way;

    begin(&w, mode, 5);
    recover(&w);
    CHECK(exchange(&w, 300, -200, 0x3A5) == VS_OK);
    check_obeyed(&w, 300, -200);
    CHECK(w.fw.body.outputs.leds == leds);
    CHECK(w.reading.battery_low == 0 && w.reading.battery_mv > 3990 && w.reading.battery_mv < 4010);
    CHECK(w.reading.has_steps && w.reading.has_ground == (mode == 2 || mode == 4));
    CHECK(!w.reading.has_ground || w.reading.ground[1] == 400);
    CHECK((w.reading.has_rates != 0) == (mode >= EPUCK_ASERCOM_EPUCK2));
    CHECK(w.reading.distance_mm == (w.reading.has_rates ? 1234 : 0));
    CHECK(!w.reading.has_rates || memcmp(w.reading.rates, w.fw.body.inputs.rates, 6) == 0);
    way = w.reading.steps[0];
    pass(&w, 1000 * MS);
    w.fw.body.inputs.battery_mv = 3300;
    CHECK(exchange(&w, 300, -200, 0x3A5) == VS_OK);
    CHECK(w.reading.steps[0] - way >= 300 && w.reading.steps[0] - way < 320);
    CHECK(w.reading.steps[1] < -190 && w.reading.battery_low == 1);
    CHECK(exchange(&w, 1500, -32768, 0) == VS_OK);
    check_obeyed(&w, 1000, -1000);
    CHECK(w.base.ops->close(&w.base) == VS_OK);
    CHECK(is_at_rest(&w) && w.fw.body.outputs.leds == 0 && w.fw.state == FW_ASERCOM_IDLE);
    CHECK(w.fw.uart.overlapped == 0 && w.fw.uart.overflowed == 0);
}

/* Bytes that look like packets and lines now and then. */
static size_t make_garbage(struct world *w, uint8_t *garbage, size_t cap)
{
    static const char letters[] = "abDELMNOPQguWwRVSDLPNOQE";
    size_t len = draw(&w->random, (uint32_t)cap);
    size_t i;

    for (i = 0; i < len; i++) {
        char letter = letters[draw(&w->random, sizeof letters - 1)];

        garbage[i] = (uint8_t)draw(&w->random, 256);
        if (draw(&w->random, 3) == 0)
            garbage[i] = (uint8_t)(256 - letter);
        else if (draw(&w->random, 3) == 0)
            garbage[i] = (uint8_t)(draw(&w->random, 2) ? letter : "\0\r\n,"[draw(&w->random, 4)]);
    }
    return len;
}

static void test_after_garbage(uint8_t mode, uint32_t seed)
{
    uint8_t garbage[120];
    struct world w;

    begin(&w, mode, seed);
    feed(&w, garbage, make_garbage(&w, garbage, sizeof garbage));
    pass(&w, draw(&w.random, 60) * MS);
    recover(&w);
    CHECK(exchange(&w, 300, -200, 0x105) == VS_OK);
    check_obeyed(&w, 300, -200);
    CHECK(w.fw.body.outputs.leds == (0x105 & w.fw.mode->leds));
}

/* One fault on the line, either way, while it drives, changes LEDs, and stops. */
static void test_fault(uint8_t mode, uint32_t kind, uint32_t at, uint32_t seed)
{
    struct world w;
    uint32_t *faults;
    uint16_t leds = 0;
    int lost = 0;
    int goods = 0;
    int i;

    begin(&w, mode, seed);
    recover(&w);
    faults = kind < 3 ? &w.fw.uart.rx.faults.lose + kind : &w.fw.uart.tx.faults.lose + kind - 3;
    *faults = at;
    for (i = 0; i < 40; i++) {
        int16_t left = (int16_t)(i < 8 ? 100 * i + 3 : 0);
        int err;

        leds = (uint16_t)(i < 8 ? 1u << i : 0x2Au);
        if (lost)
            recover(&w);
        err = exchange(&w, left, (int16_t)-left, leds);
        lost = err != VS_OK && err != VS_ERR_LATE && err != VS_ERR_BUSY;
        goods = err == VS_OK ? goods + 1 : 0;
        /* without a checksum, a sensor's value that was damaged is not noticed */
        if (err == VS_OK && kind < 3)
            check_obeyed(&w, left, (int16_t)-left);
        CHECK(err != VS_OK || w.fw.body.outputs.left_steps_s == left);
        CHECK(err != VS_OK || w.fw.body.outputs.right_steps_s == -left);
        CHECK(goods < EPUCK_ASERCOM_LEDS + 2 || i < 20 ||
              w.fw.body.outputs.leds == (leds & w.fw.mode->leds));
        pass(&w, 5 * MS);
    }
    CHECK(goods > 10 && is_at_rest(&w));
}

/* Reset at any moment, and once more, as at power on: its banner is no answer. */
static void test_reset(uint8_t mode, uint32_t seed)
{
    struct world w;
    int lost = 0;
    int goods = 0;
    int i;

    begin(&w, mode, seed);
    recover(&w);
    for (i = 0; i < 60; i++) {
        int err;

        if (i == 10)
            fw_asercom_reset(&w.fw, 1, w.now_ns / 1000);
        if (lost && vs_base_recover(&w.base) != VS_OK)
            continue;
        err = exchange(&w, 400, 400, 1);
        lost = err != VS_OK && err != VS_ERR_LATE && err != VS_ERR_BUSY;
        goods = err == VS_OK ? goods + 1 : 0;
        CHECK(err != VS_OK || w.fw.state == FW_ASERCOM_BOOT || w.fw.body.outputs.leds == 1);
        pass(&w, draw(&w.random, 20) * MS);
    }
    CHECK(goods > 5);
    check_obeyed(&w, 400, 400);
}

/* Answers that come later than an exchange may take are waited for, not lost. */
static void test_slow_bluetooth(void)
{
    struct world w;
    int late = 0;
    int i;

    begin(&w, EPUCK_ASERCOM_BLUETOOTH, 9);
    recover(&w);
    for (i = 0; i < 50; i++) {
        int err;

        w.delay_ns = draw(&w.random, 100) * MS;
        err = exchange(&w, 200, 250, 3);
        CHECK(err == VS_OK || err == VS_ERR_LATE || err == VS_ERR_BUSY);
        late += err != VS_OK;
        if (err == VS_OK)
            check_obeyed(&w, 200, 250);
    }
    CHECK(late > 10);
    w.delay_ns = 40 * MS; /* longer than any exchange: the second call gets the answer */
    for (i = 0; i < 6 && exchange(&w, 0, 0, 0) != VS_OK; i++)
        ;
    CHECK(i < 6 && is_at_rest(&w));
    for (i = 0; i < 6 && w.base.ops->close(&w.base) != VS_OK; i++)
        ;
    CHECK(i < 6 && w.fw.state == FW_ASERCOM_IDLE);
}

static void test_silence(void)
{
    struct world w;
    int i;

    begin(&w, EPUCK_ASERCOM_EXTENSION, 3);
    fw_asercom_reset(&w.fw, 0, 1000000000);
    CHECK(exchange(&w, 0, 0, 0) == VS_ERR_SILENT);
    for (i = 0; i < 20; i++) {
        uint64_t step_ns = w.now_ns;
        int err = vs_base_recover(&w.base);

        CHECK(err == VS_ERR_BUSY || err == VS_ERR_SILENT);
        CHECK(w.now_ns - step_ns <= 100 * MS);
    }
}

/* A selector that stands wrong is told. */
static void test_wrong_mode(uint8_t mode, uint8_t real, const char *part)
{
    struct world w;
    int i;

    begin(&w, mode, 4);
    w.fw.mode = &epuck_asercom_modes[real];
    for (i = 0; i < 20 && w.base.news == NULL; i++)
        CHECK(vs_base_recover(&w.base) != VS_OK);
    CHECK(w.base.news != NULL && strstr(w.base.news, part) != NULL);
    CHECK(is_at_rest(&w));
}

int main(int argc, char *argv[])
{
    uint32_t worlds = argc > 1 ? (uint32_t)strtoul(argv[1], NULL, 10) : 200;
    uint32_t seed;
    uint32_t kind;
    uint32_t at;
    uint8_t mode;

    for (mode = 0; mode < EPUCK_ASERCOM_MODES; mode++) {
        test_plain_exchange(mode);
        for (kind = 0; kind < 6; kind++)
            for (at = 1; at <= 120; at += worlds < 100 ? 7 : 1)
                test_fault(mode, kind, at, kind + 10 * at);
        for (seed = 1; seed <= worlds; seed++) {
            test_after_garbage(mode, seed);
            test_reset(mode, seed);
        }
    }
    test_slow_bluetooth();
    test_silence();
    test_wrong_mode(EPUCK_ASERCOM_EXTENSION, EPUCK_ASERCOM_BLUETOOTH, "turn its selector to 10");
    test_wrong_mode(EPUCK_ASERCOM_BLUETOOTH, EPUCK_ASERCOM_EXTENSION, "mode=extension");
    test_wrong_mode(EPUCK_ASERCOM_BLUETOOTH_GROUND, EPUCK_ASERCOM_BLUETOOTH, "no ground sensors");
    test_wrong_mode(EPUCK_ASERCOM_BLUETOOTH_GROUND, EPUCK_ASERCOM_EPUCK2_GROUND,
                    "it is an e-puck2: expected model=epuck2");
    test_wrong_mode(EPUCK_ASERCOM_EPUCK2, EPUCK_ASERCOM_BLUETOOTH,
                    "it is an e-puck: expected model=epuck");
    return 0;
}
