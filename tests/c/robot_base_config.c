/* SPDX-License-Identifier: MIT */
/*
 * The text of --base: what is right is read, what is wrong is refused with what was
 * expected, and no text does harm. And the wheels' counters, which wrap.
 */
#include <string.h>

#include "base_config.h"
#include "robot_check.h"

static char expected[256];

static int configure(struct vs_base_config *config, const char *text)
{
    expected[0] = '\0';
    return vs_base_configure(config, text, expected, sizeof expected);
}

static void test_good(void)
{
    struct vs_base_config config;

    CHECK(configure(&config, "argos:/dev/ttyS0") == 0);
    CHECK(strcmp(config.ops->name, "argos") == 0 && strcmp(config.device, "/dev/ttyS0") == 0);
    CHECK(config.board[0][0] == '\0' && config.board[1][0] == '\0' && config.rab_bytes == 4);
    CHECK(config.rab_power == 115 && config.rab_k_cm == 0.0867438559f); /* as ARGoS has it */
    CHECK(configure(&config, "asercom:/dev/ttyS1") == 0 && config.choice[0] == 0);
    CHECK(configure(&config, "asercom:/dev/rfcomm0,mode=bluetooth+ground") == 0);
    CHECK(config.choice[0] == 2);
    CHECK(configure(&config, "york:unix:/tmp/a,model=epuck2,ground,rab=/dev/i2c-3,rab_bytes=2") == 0);
    CHECK(strcmp(config.device, "unix:/tmp/a") == 0 && config.choice[0] == 1);
    CHECK(strcmp(config.board[VS_BOARD_GROUND], "unix:/tmp/a") == 0);
    CHECK(strcmp(config.board[VS_BOARD_RAB], "/dev/i2c-3") == 0 && config.rab_bytes == 2);
    CHECK(configure(&config, "york:/x,rab,rab_power=0,rab_k=0.1,rab_bytes=4") == 0);
    CHECK(config.rab_power == 0 && config.rab_k_cm == 0.1f && config.rab_bytes == 4);
    CHECK(configure(&config, "york:/x,rab_power=255") == 0 && config.rab_power == 255);
    CHECK(config.reset[0] == '\0' && config.board[VS_BOARD_BATTERY][0] == '\0');
    CHECK(configure(&config, "york:/x,battery=/dev/i2c-11") == 0);
    CHECK(strcmp(config.board[VS_BOARD_BATTERY], "/dev/i2c-11") == 0);
    CHECK(configure(&config, "argos:/x,rgb=/dev/i2c-3") == 0);
    CHECK(config.board[VS_BOARD_IMU][0] == '\0');
    CHECK(strcmp(config.board[VS_BOARD_RGB], "/dev/i2c-3") == 0);
    CHECK(configure(&config, "gctronic:/x,imu") == 0);
    CHECK(strcmp(config.board[VS_BOARD_IMU], "/x") == 0);
    CHECK(configure(&config, "york:/x,reset=24") == 0 && strcmp(config.reset, "24") == 0);
    CHECK(configure(&config, "gctronic:/x,reset=/sys/class/gpio/gpio536,ground") == 0);
    CHECK(strcmp(config.reset, "/sys/class/gpio/gpio536") == 0);
    CHECK(configure(&config, "asercom:/x,model=epuck2") == 0);
    CHECK(config.choice[0] == 0 && config.choice[1] == 1);
    CHECK(configure(&config, "argos:/dev/ttyS0,ground=/dev/i2c-3,ground=/dev/i2c-4") == 0);
    CHECK(strcmp(config.board[VS_BOARD_GROUND], "/dev/i2c-4") == 0);
}

static void test_bad(void)
{
    static const char *const kinds[] = {"", "argos", "yrok:/dev/i2c-1", ":", "argos/dev/ttyS0",
                                        "ARGOS:/dev/ttyS0", "argo:/x", "argoss:/x"};
    static const char *const options[] = {
        "argos:/x,", "argos:/x,ground", "argos:/x,ground=", "argos:/x,,", "argos:/x,mode=bluetooth",
        "asercom:/x,mode", "asercom:/x,mode=", "asercom:/x,mode=bluetoot", "york:/x,model=epuck3",
        "york:/x,rab_bytes=3", "york:/x,rab_bytes", "gctronic:/x,Ground", "york:/x,ground=/y,z",
        "york:/x,rab_power", "york:/x,rab_power=", "york:/x,rab_power=256", "york:/x,rab_power=-1",
        "york:/x,rab_power=1.5", "york:/x,rab_power=9x", "york:/x,rab_k=0", "york:/x,rab_k=-1",
        "york:/x,rab_k=11", "york:/x,rab_k=nan", "york:/x,rab_k",
        "york:/x,reset", "york:/x,reset=", "york:/x,reset=high", "york:/x,reset=24x",
        "york:/x,reset=-1", "york:/x,reset=12345", "argos:/x,reset=24", "argos:/x,rgb", "argos:/x,imu"};
    char text[400];
    struct vs_base_config config;
    size_t i;

    for (i = 0; i < sizeof kinds / sizeof kinds[0]; i++) {
        CHECK_FOR(kinds[i], configure(&config, kinds[i]) == -1);
        CHECK(strstr(expected, "one of argos, asercom, gctronic, york") != NULL);
    }
    for (i = 0; i < sizeof options / sizeof options[0]; i++) {
        CHECK_FOR(options[i], configure(&config, options[i]) == -1);
        CHECK_FOR(options[i], strstr(expected, "rab_k=CM") != NULL);
    }
    CHECK(strstr(expected, "after argos:DEVICE only ground=BUS, rab=BUS") != NULL);
    CHECK(configure(&config, "york:/x,model=epuck3") == -1);
    CHECK(strstr(expected, "after york:DEVICE only model=epuck|epuck2, ground=BUS") != NULL);
    CHECK(configure(&config, "york:") == -1 && strstr(expected, "york:/dev/i2c-12") != NULL);
    CHECK(configure(&config, "argos:,ground=/x") == -1);
    memset(text, 'x', sizeof text);
    memcpy(text, "argos:", 6);
    text[6 + VS_BASE_DEVICE_MAX + 1] = '\0';
    CHECK(configure(&config, text) == -1);
    text[6 + VS_BASE_DEVICE_MAX] = '\0';
    CHECK(configure(&config, text) == 0 && strlen(config.device) == VS_BASE_DEVICE_MAX);
}

/* Who asks for an e-puck2 gets its wheels and its motors' limit: the asercom of an e-puck2 hands
 * speeds to its own motors. Source: e-puck2_main-processor d2e0dbb
 * src/epuck1x/motor_led/advance_one_timer/e_motors.c:81-97, src/motors.h:7. */
static void test_model_of_asercom(void)
{
    static struct vs_base base;
    struct vs_base_config config;

    CHECK(configure(&config, "asercom:/nowhere,model=epuck2") == 0);
    CHECK(vs_base_open(&base, &config) == VS_ERR_IO);
    CHECK(base.body->max_steps_s == 1100 && base.body->step_nm == 125664);
    CHECK(configure(&config, "asercom:/nowhere") == 0);
    CHECK(vs_base_open(&base, &config) == VS_ERR_IO && base.body->max_steps_s == 1000);
}

/* Pieces of good texts in any order: each is read or refused. */
static void test_any_text(uint32_t seed)
{
    static const char *const pieces[] = {"argos", "asercom", "york", ":", ",", "=", "/dev/i2c-1",
                                         "mode", "bluetooth", "ground", "rab", "rab_bytes", "4",
                                         "unix:", "model", "epuck2", "\xFF", " "};
    uint32_t random = seed * 2654435761u + 1u;
    char text[300] = "";
    struct vs_base_config config;
    uint32_t count = draw(&random, 14);
    int err;

    for (; count > 0; count--)
        strcat(text, pieces[draw(&random, sizeof pieces / sizeof pieces[0])]);
    err = configure(&config, text);
    CHECK(err == 0 || (err == -1 && expected[0] != '\0'));
    if (err == 0)
        CHECK(config.ops != NULL && config.device[0] != '\0');
}

static void test_counters_wrap(void)
{
    static struct vs_base base;
    struct vs_base_reading reading;
    uint16_t counters[2] = {65000, 300};
    int i;

    memset(&reading, 0, sizeof reading);
    vs_base_count(&base, counters, &reading);
    CHECK(reading.has_steps && reading.steps[0] == 0 && reading.steps[1] == 0);
    for (i = 1; i <= 300; i++) {
        counters[0] = (uint16_t)(counters[0] + 1000);
        counters[1] = (uint16_t)(counters[1] - 999);
        vs_base_count(&base, counters, &reading);
        CHECK(reading.steps[0] == 1000 * i && reading.steps[1] == -999 * i);
    }
    base.counting = 0; /* it was reset: its counters begin again, the way does not */
    counters[0] = counters[1] = 0;
    vs_base_count(&base, counters, &reading);
    CHECK(reading.steps[0] == 300000 && reading.steps[1] == -299700);
}

int main(void)
{
    uint32_t seed;

    test_good();
    test_bad();
    test_counters_wrap();
    test_model_of_asercom();
    for (seed = 1; seed <= 20000; seed++)
        test_any_text(seed);
    return 0;
}
