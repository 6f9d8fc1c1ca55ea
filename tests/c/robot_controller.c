/* SPDX-License-Identifier: MIT */
/* What a controller sees through controller.h, and what the pollutant controller does. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "check.h"
#include "robot.h"
#include "vs_bytes.h"

#define MS UINT64_C(1000000)

struct world {
    struct vs_session session;
    struct vs_robot robot;
    uint64_t state[VS_CONTROLLER_STATE_MAX / 8];
    int complaints;
    char complaint[80];
};

static void complain(void *context, const char *what, const char *name)
{
    struct world *w = context;

    w->complaints++;
    snprintf(w->complaint, sizeof w->complaint, "%s '%s'", what, name);
}

static void add(struct world *w, uint8_t direction, const char *name, const char *layout)
{
    struct vs_table *table = &w->session.table;

    CHECK(vs_table_add(table, (uint8_t)table->count, direction, name, layout) == VS_OK);
}

static void begin(struct world *w, const char *params)
{
    struct vs_session_config config;

    memset(w, 0, sizeof *w);
    memset(&config, 0, sizeof config);
    config.tag = 5;
    CHECK(vs_session_init(&w->session, &config) == VS_OK);
    w->session.seed = 42;
    w->session.timestep_ns = 100 * MS;
    w->session.timestep_s = 0.1;
    strcpy(w->session.params, params);
    w->session.capture_ns = 5000 * MS;
    w->robot.complain = complain;
    w->robot.context = w;
    w->robot.session_ns = 9000 * MS;
    w->robot.now_ns = 1000 * MS;
    /* host's clock = ours - 4 s, known exactly */
    CHECK(vs_clock_sample(&w->session.clock, 1, (uint64_t)1 - 4000 * MS, 0, 1) == VS_OK);
    vs_robot_begin(&w->robot, &w->session);
}

static void put(struct world *w, const char *name, const uint8_t *data, uint32_t older_us)
{
    const struct vs_entry *e = &w->session.table.entries[vs_table_find(&w->session.table, name)];

    memcpy(w->session.state.payload + e->offset, data, e->size);
    w->session.state.older_us[e->rank] = older_us;
}

static void test_every_layout(void)
{
    static const struct {
        const char *layout;
        uint8_t data[8];
        double values[2];
    } rows[] = {
        {"2*u1", {0, 255}, {0, 255}},
        {"2*i2", {0xFF, 0x7F, 0, 0x80}, {32767, -32768}},
        {"2*u2", {0xFF, 0xFF, 1, 0}, {65535, 1}},
        {"2*i4", {0xFF, 0xFF, 0xFF, 0xFF, 1, 0, 0, 0x80}, {-1, -2147483647}},
        {"2*u4", {0xFF, 0xFF, 0xFF, 0xFF, 1, 0, 0, 0x80}, {4294967295.0, 2147483649.0}},
        {"2*f4", {0, 0, 0x80, 0x3F, 0, 0, 0x20, 0xC0}, {1, -2.5}},
    };
    size_t i;

    for (i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        struct world w;
        double values[3] = {7, 7, 7};
        int sensor;

        begin(&w, "");
        add(&w, VS_SENSOR, "before", "3*u1");
        add(&w, VS_SENSOR, "it", rows[i].layout);
        put(&w, "it", rows[i].data, 0);
        sensor = vs_robot_sensor(&w.robot, "it");
        CHECK(vs_robot_values(&w.robot, sensor, values, 3) == 2);
        CHECK(fabs(values[0] - rows[i].values[0]) < 1e-12);
        CHECK(fabs(values[1] - rows[i].values[1]) < 1e-12);
        CHECK(fabs(values[2] - 7) < 1e-12);
        CHECK(vs_robot_values(&w.robot, sensor, values, 0) == 2);
        CHECK(w.robot.bound == 2 && w.complaints == 0);
    }
}

static void test_age_and_staleness(void)
{
    static const uint8_t one[] = {1};
    struct world w;
    struct vs_reading reading;
    int sensor;

    begin(&w, "");
    add(&w, VS_SENSOR, "it", "u1");
    sensor = vs_robot_sensor(&w.robot, "it");
    put(&w, "it", one, VS_NEVER_US);
    reading = vs_robot_read(&w.robot, sensor);
    CHECK(!reading.known && reading.stale && reading.age_ns == UINT64_MAX);
    put(&w, "it", one, 0);
    reading = vs_robot_read(&w.robot, sensor);
    CHECK(reading.known && !reading.stale && reading.age_ns == 0);
    put(&w, "it", one, 250000);
    reading = vs_robot_read(&w.robot, sensor);
    CHECK(reading.known && !reading.stale && reading.age_ns == 250 * MS);
    put(&w, "it", one, 250001);
    reading = vs_robot_read(&w.robot, sensor);
    CHECK(reading.known && reading.stale && reading.age_ns == 250001000u);
    vs_clock_init(&w.session.clock, 0);
    reading = vs_robot_read(&w.robot, sensor);
    CHECK(reading.known && reading.stale && reading.age_ns == UINT64_MAX);
}

static void test_own_sensors_and_their_virtual_twins(void)
{
    static const uint8_t data[] = {9};
    struct world w;
    struct vs_reading reading;
    double values[8];
    int sensor;

    begin(&w, "");
    sensor = vs_robot_sensor(&w.robot, "proximity");
    CHECK(!vs_robot_read(&w.robot, sensor).known);
    w.robot.base_ns = 700 * MS;
    w.robot.base.prox[7] = 4000;
    w.robot.base.light[0] = 77;
    w.robot.base.battery_low = VS_UNKNOWN;
    reading = vs_robot_read(&w.robot, sensor);
    CHECK(reading.known && reading.stale && reading.age_ns == 300 * MS);
    CHECK(vs_robot_values(&w.robot, sensor, values, 8) == 8 && values[7] > 3999);
    CHECK(vs_robot_read(&w.robot, vs_robot_sensor(&w.robot, "light")).value > 76);
    CHECK(!vs_robot_read(&w.robot, vs_robot_sensor(&w.robot, "battery_low")).known);
    w.robot.base.battery_low = 1;
    CHECK(vs_robot_read(&w.robot, vs_robot_sensor(&w.robot, "battery_low")).value > 0);
    add(&w, VS_SENSOR, "light", "u1");
    put(&w, "light", data, 0);
    CHECK(vs_robot_values(&w.robot, vs_robot_sensor(&w.robot, "light"), values, 8) == 1);
    CHECK(w.complaints == 0);
    sensor = vs_robot_sensor(&w.robot, "smell");
    CHECK(w.complaints == 1 && strcmp(w.complaint, "nobody offers the sensor 'smell'") == 0);
    CHECK(!vs_robot_read(&w.robot, sensor).known);
    CHECK(vs_robot_values(&w.robot, sensor, values, 8) == 0);
}

/* The virtual walls of a table's "+proximity", as the robot feels them among real ones. */
static void test_virtual_part_is_fused_with_the_real_one(void)
{
    static const uint8_t walls[] = {0, 16, 100, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 200, 0};
    static const uint8_t nothing[16] = {0};
    struct world w;
    double values[8];
    int sensor;

    begin(&w, "");
    add(&w, VS_SENSOR, "before", "f4");
    add(&w, VS_SENSOR, "+proximity", "8*u2");
    sensor = vs_robot_sensor(&w.robot, "proximity");
    CHECK(w.robot.bound == 2 && w.complaints == 0);
    put(&w, "+proximity", walls, 0);
    CHECK(vs_robot_values(&w.robot, sensor, values, 8) == 0);
    CHECK(!vs_robot_read(&w.robot, sensor).known);
    w.robot.base_ns = 900 * MS;
    w.robot.base.prox[1] = 300;
    w.robot.base.prox[7] = 150;
    CHECK(vs_robot_values(&w.robot, sensor, values, 8) == 8);
    CHECK(values[0] > 4095 && values[1] > 299 && values[2] < 1 && values[7] > 199);
    CHECK(vs_robot_values(&w.robot, sensor, values, 1) == 8);
    CHECK(vs_robot_read(&w.robot, sensor).value > 4095);
    CHECK(vs_robot_read(&w.robot, sensor).age_ns == 100 * MS);
    CHECK(!vs_robot_read(&w.robot, sensor).stale);
    put(&w, "+proximity", walls, 260000);
    CHECK(vs_robot_values(&w.robot, sensor, values, 8) == 8);
    CHECK(values[0] < 1 && values[1] > 299 && values[7] < 151);
    put(&w, "+proximity", nothing, VS_NEVER_US);
    CHECK(vs_robot_values(&w.robot, sensor, values, 8) == 8 && values[0] < 1 && values[1] > 299);
    put(&w, "+proximity", nothing, 0);
    CHECK(vs_robot_values(&w.robot, sensor, values, 8) == 8 && values[0] < 1 && values[1] > 299);
    sensor = vs_robot_sensor(&w.robot, "+proximity");
    put(&w, "+proximity", walls, 0);
    CHECK(vs_robot_values(&w.robot, sensor, values, 8) == 8 && values[0] > 4095 && values[1] < 101);
}

static void test_odd_parts_are_fused_as_far_as_they_go(void)
{
    static const uint8_t data[] = {7, 8, 9, 10, 11, 12, 13, 14, 15, 16};
    struct world w;
    double values[10] = {0};
    int sensor;

    begin(&w, "");
    w.robot.base_ns = w.robot.now_ns;
    add(&w, VS_SENSOR, "+proximity", "2*u1");
    add(&w, VS_SENSOR, "+light", "10*u1");
    add(&w, VS_SENSOR, "+smell", "u1");
    add(&w, VS_ACTUATOR, "+battery_low", "u1");
    put(&w, "+proximity", data, 0);
    put(&w, "+light", data, 0);
    put(&w, "+smell", data, 0);
    sensor = vs_robot_sensor(&w.robot, "proximity");
    CHECK(vs_robot_values(&w.robot, sensor, values, 10) == 8);
    CHECK(values[1] > 7 && values[2] < 1);
    sensor = vs_robot_sensor(&w.robot, "light");
    CHECK(vs_robot_values(&w.robot, sensor, values, 10) == 8);
    CHECK(values[7] > 13 && values[8] < 1);
    CHECK(vs_robot_read(&w.robot, vs_robot_sensor(&w.robot, "smell")).value > 6);
    CHECK(!vs_robot_read(&w.robot, vs_robot_sensor(&w.robot, "battery_low")).value);
    CHECK(w.complaints == 0);
    CHECK(vs_robot_sensor(&w.robot, "name_with_exactly_31_characters") == -1);
    CHECK(w.complaints == 1);
}

/* A name without "+" is the host's word alone. */
static void test_exact_name_wins_over_the_fused_one(void)
{
    static const uint8_t data[] = {9};
    struct world w;
    double values[8];

    begin(&w, "");
    w.robot.base_ns = w.robot.now_ns;
    w.robot.base.prox[0] = 4000;
    add(&w, VS_SENSOR, "+proximity", "8*u1");
    add(&w, VS_SENSOR, "proximity", "u1");
    put(&w, "proximity", data, 0);
    CHECK(vs_robot_values(&w.robot, vs_robot_sensor(&w.robot, "proximity"), values, 8) == 1);
    CHECK(values[0] < 10);
}

static void test_actuators_are_clipped_to_their_type(void)
{
    static const uint8_t expected[] = {255, 0, 0x00, 0x80, 0xFF, 0x7F, 0, 0, 0x20, 0xC0};
    struct world w;
    int paint;
    int pump;
    int horn;

    begin(&w, "");
    add(&w, VS_SENSOR, "eye", "u1");
    add(&w, VS_ACTUATOR, "paint", "2*u1");
    add(&w, VS_ACTUATOR, "pump", "2*i2");
    add(&w, VS_ACTUATOR, "horn", "f4");
    paint = vs_robot_actuator(&w.robot, "paint");
    pump = vs_robot_actuator(&w.robot, "pump");
    horn = vs_robot_actuator(&w.robot, "horn");
    vs_robot_actuate(&w.robot, paint, 0, 300.0);
    vs_robot_actuate(&w.robot, paint, 1, (double)NAN);
    vs_robot_actuate(&w.robot, paint, 2, 1.0);
    vs_robot_actuate(&w.robot, paint, -1, 1.0);
    vs_robot_actuate(&w.robot, pump, 0, -40000.0);
    vs_robot_actuate(&w.robot, pump, 1, 40000.0);
    vs_robot_actuate(&w.robot, horn, 0, 1e300);
    CHECK(vs_load_f4(w.robot.actuators + w.session.table.entries[horn].offset) == FLT_MAX);
    vs_robot_actuate(&w.robot, horn, 0, (double)-INFINITY);
    CHECK(vs_load_f4(w.robot.actuators + w.session.table.entries[horn].offset) == -FLT_MAX);
    vs_robot_actuate(&w.robot, horn, 0, -2.5);
    CHECK(memcmp(w.robot.actuators, expected, sizeof expected) == 0);
    vs_robot_actuate(&w.robot, vs_robot_actuator(&w.robot, "eye"), 0, 1.0);
    vs_robot_actuate(&w.robot, vs_robot_actuator(&w.robot, "wing"), 0, 1.0);
    CHECK(w.complaints == 2 && memcmp(w.robot.actuators, expected, sizeof expected) == 0);
}

static void test_parameters(void)
{
    struct world w;

    begin(&w, "a=1.5\nab=2\nbad=3 apples\nendless=inf\nlast=-7");
    CHECK(fabs(vs_robot_param(&w.robot, "a", 9) - 1.5) < 1e-12);
    CHECK(fabs(vs_robot_param(&w.robot, "ab", 9) - 2) < 1e-12);
    CHECK(fabs(vs_robot_param(&w.robot, "last", 9) + 7) < 1e-12);
    CHECK(fabs(vs_robot_param(&w.robot, "b", 9) - 9) < 1e-12);
    CHECK(w.complaints == 0);
    CHECK(fabs(vs_robot_param(&w.robot, "bad", 9) - 9) < 1e-12);
    CHECK(fabs(vs_robot_param(&w.robot, "endless", 9) - 9) < 1e-12);
    CHECK(w.complaints == 2);
}

static void test_parameters_within_bounds(void)
{
    struct world w;

    begin(&w, "a=1.5\nlow=-0.1\nhuge=1e20\nbad=x");
    CHECK(fabs(vs_robot_param_in(&w.robot, "a", 9, 1, 2) - 1.5) < 1e-12);
    CHECK(fabs(vs_robot_param_in(&w.robot, "huge", 9, 0, INT_MAX) - 1e20) < 1e8);
    CHECK(fabs(vs_robot_param_in(&w.robot, "absent", 9, 0, 1) - 9) < 1e-12);
    CHECK(w.complaints == 0);
    CHECK(fabs(vs_robot_param_in(&w.robot, "low", 9, 0, INT_MAX)) < 1e-12);
    CHECK(fabs(vs_robot_param_in(&w.robot, "a", 9, 0, 1) - 1) < 1e-12);
    CHECK(fabs(vs_robot_param_in(&w.robot, "a", 9, 2, 3) - 2) < 1e-12);
    CHECK(fabs(vs_robot_param_in(&w.robot, "bad", 9, 0, 1) - 9) < 1e-12);
    CHECK(w.complaints == 4);
}

/* A misspelt parameter must not pass unseen. */
static void test_parameters_that_nobody_asks_for(void)
{
    struct world w;
    const char *param;

    begin(&w, "");
    CHECK(vs_robot_unasked_param(&w.robot, NULL) == NULL);
    begin(&w, "sped=1\nspeed=2\nspeeds=3\nwalk=x");
    (void)vs_robot_param(&w.robot, "speed", 9);
    (void)vs_robot_param(&w.robot, "absent", 9);
    param = vs_robot_unasked_param(&w.robot, NULL);
    CHECK(param == w.session.params);
    param = vs_robot_unasked_param(&w.robot, param);
    CHECK(strncmp(param, "speeds=3\n", 9) == 0);
    param = vs_robot_unasked_param(&w.robot, param);
    CHECK(strcmp(param, "walk=x") == 0);
    CHECK(vs_robot_unasked_param(&w.robot, param) == NULL);
    (void)vs_robot_param(&w.robot, "sped", 9);
    (void)vs_robot_param(&w.robot, "speeds", 9);
    (void)vs_robot_param(&w.robot, "walk", 9);
    CHECK(vs_robot_unasked_param(&w.robot, NULL) == NULL);
    vs_robot_begin(&w.robot, &w.session);
    CHECK(vs_robot_unasked_param(&w.robot, NULL) == w.session.params);
    memset(w.session.params, 'x', VS_PARAMS_ROOM - 2);
    memcpy(w.session.params + VS_PARAMS_ROOM - 5, "\ny=1\n", 6);
    CHECK(vs_robot_param(&w.robot, "y", 9) < 2 && w.complaints == 1);
    param = vs_robot_unasked_param(&w.robot, NULL);
    CHECK(vs_robot_unasked_param(&w.robot, param) == NULL);
}

static void test_text_parameters(void)
{
    struct world w;
    char text[8];

    begin(&w, "speed=2\ngenome=0.1;-3\nempty=\nlast=end");
    CHECK(vs_robot_param_text(&w.robot, "genome", text, sizeof text) == 6);
    CHECK(strcmp(text, "0.1;-3") == 0);
    CHECK(vs_robot_param_text(&w.robot, "genome", text, 4) == 6 && strcmp(text, "0.1") == 0);
    CHECK(vs_robot_param_text(&w.robot, "genome", NULL, 0) == 6);
    CHECK(vs_robot_param_text(&w.robot, "empty", text, sizeof text) == 0 && text[0] == '\0');
    CHECK(vs_robot_param_text(&w.robot, "last", text, sizeof text) == 3);
    CHECK(strcmp(text, "end") == 0);
    strcpy(text, "kept");
    CHECK(vs_robot_param_text(&w.robot, "absent", text, sizeof text) == -1);
    CHECK(strcmp(text, "kept") == 0);
    CHECK(strncmp(vs_robot_unasked_param(&w.robot, NULL), "speed=2\n", 8) == 0);
    CHECK(vs_robot_unasked_param(&w.robot, w.session.params) == NULL);
}

/* The shown values as text: name=number or name='text', one after the other. */
static const char *shown(const struct vs_robot *robot, char out[1024])
{
    char name[VS_SHOWN_NAME_MAX + 1];
    char text[VS_SHOWN_TEXT_MAX + 1];
    uint8_t kind;
    float number;
    size_t at = 0;

    out[0] = '\0';
    while (vs_shown_next(robot->shown, robot->shown_len, &at, name, &kind, &number, text) == VS_OK)
        if (kind == VS_SHOWN_NUMBER)
            snprintf(out + strlen(out), 1024 - strlen(out), "%s=%g ", name, (double)number);
        else
            snprintf(out + strlen(out), 1024 - strlen(out), "%s='%s' ", name, text);
    CHECK(at == robot->shown_len);
    return out;
}

static void test_shown_values(void)
{
    char out[1024];
    struct world w;
    int i;

    begin(&w, "");
    vs_robot_show(&w.robot, "n", 1.5);
    vs_robot_show(&w.robot, "huge", 1e300);
    vs_robot_show(&w.robot, "n", -2.0);
    CHECK(strcmp(shown(&w.robot, out), "n=-2 huge=3.40282e+38 ") == 0);
    CHECK(w.robot.shown_len == 17 && w.complaints == 0);
    vs_robot_begin(&w.robot, &w.session);
    CHECK(w.robot.shown_len == 0);
    vs_robot_show(&w.robot, "huge", 0.25);
    vs_robot_show(&w.robot, "", 1.0);
    CHECK(w.complaints == 1);
    vs_robot_show(&w.robot, "0123456789abcdef", 1.0);
    vs_robot_show(&w.robot, "\x80", 1.0);
    CHECK(w.complaints == 1); /* once a run */
    vs_robot_begin(&w.robot, &w.session);
    for (i = 0; i < 30; i++)
        vs_robot_show(&w.robot, (char[]){'a', (char)('a' + i), '\0'}, i);
    CHECK(w.robot.shown_len == 240 && w.complaints == 1);
    vs_robot_show(&w.robot, "ab", 7.0);
    CHECK(w.robot.shown_len == 240 && strncmp(shown(&w.robot, out), "aa=0 ab=7 ac=2 ", 15) == 0);
}

static void test_shown_texts(void)
{
    char long_text[VS_SHOWN_TEXT_MAX + 2];
    char out[1024];
    struct world w;

    memset(long_text, 't', sizeof long_text);
    long_text[VS_SHOWN_TEXT_MAX + 1] = '\0';
    begin(&w, "");
    vs_robot_show_text(&w.robot, "state", "search");
    vs_robot_show(&w.robot, "n", 1.0);
    vs_robot_show_text(&w.robot, "state", "go");
    vs_robot_show_text(&w.robot, "n", "none");
    vs_robot_show_text(&w.robot, "state", "avoiding");
    CHECK(strcmp(shown(&w.robot, out), "state='avoiding' n='none' ") == 0);
    vs_robot_show_text(&w.robot, "state", long_text);
    CHECK(w.complaints == 1 && strncmp(shown(&w.robot, out), "state='avoiding' ", 17) == 0);
    vs_robot_show_text(&w.robot, "state", long_text + 1);
    vs_robot_show_text(&w.robot, "b", long_text + 1);
    vs_robot_show_text(&w.robot, "c", long_text + 1);
    vs_robot_show_text(&w.robot, "d", long_text + 1);
    vs_robot_show_text(&w.robot, "e", long_text + 1); /* 56 + 8 + 3 * 52 = 220 are in use */
    CHECK(w.robot.shown_len == 220);
    vs_robot_show_text(&w.robot, "n", long_text + 14);
    CHECK(w.robot.shown_len == 220 - 4 + 35);
}

static void test_log(void)
{
    char line[VS_LOG_MAX + 20];
    struct world w;
    uint32_t number;
    uint32_t i;

    begin(&w, "");
    CHECK(strcmp(vs_log_due(&w.robot.log, &number), "") == 0 && number == 0);
    vs_robot_log(&w.robot, "first");
    vs_robot_log(&w.robot, "two\nlines \x80 gr\xc3\xbc\xc3");
    CHECK(strcmp(vs_log_due(&w.robot.log, &number), "first") == 0 && number == 1);
    vs_log_heard(&w.robot.log, 9); /* of another life */
    CHECK(strcmp(vs_log_due(&w.robot.log, &number), "first") == 0 && number == 1);
    vs_log_heard(&w.robot.log, 1);
    CHECK(strcmp(vs_log_due(&w.robot.log, &number), "two?lines ? gr\xc3\xbc?") == 0);
    CHECK(number == 2);
    vs_log_heard(&w.robot.log, 1);
    CHECK(strncmp(vs_log_due(&w.robot.log, &number), "two", 3) == 0 && number == 2);
    vs_robot_begin(&w.robot, &w.session);
    CHECK(strncmp(vs_log_due(&w.robot.log, &number), "two", 3) == 0 && number == 2);
    for (i = 3; i <= 12; i++) {
        snprintf(line, sizeof line, "line %u", (unsigned int)i);
        vs_robot_log(&w.robot, line);
    }
    CHECK(strcmp(vs_log_due(&w.robot.log, &number), "line 5") == 0 && number == 5);
    vs_log_heard(&w.robot.log, 12);
    memset(line, 'l', sizeof line);
    memcpy(line + VS_LOG_MAX - 1, "\xc3\xa4", 3); /* has no room as a whole */
    vs_robot_log(&w.robot, line);
    CHECK(strlen(vs_log_due(&w.robot.log, &number)) == VS_LOG_MAX - 1 && number == 13);
}

static void test_random_is_the_robots_own(void)
{
    struct world one;
    struct world same;
    struct world other;
    double sum = 0.0;
    int equal = 0;
    int i;

    begin(&one, "");
    begin(&same, "");
    begin(&other, "");
    other.session.config.tag++;
    vs_robot_begin(&other.robot, &other.session);
    for (i = 0; i < 10000; i++) {
        double value = vs_robot_random(&one.robot);
        double twin = vs_robot_random(&same.robot);

        CHECK(value >= 0.0 && value < 1.0);
        CHECK(fabs(value - twin) <= 0.0);
        equal += fabs(vs_robot_random(&other.robot) - value) <= 0.0;
        sum += value;
    }
    CHECK(equal == 0);
    CHECK(fabs(sum / 10000 - 0.5) < 0.02);
}

/* One step of the pollutant controller; returns the LEDs. */
static unsigned int clean(struct world *w, double pollutant, uint32_t older_us)
{
    uint8_t data[4];

    vs_store_f4(data, (float)pollutant);
    put(w, "pollutant", data, older_us);
    vs_controller.step(w->state, &w->robot);
    return w->robot.command.leds;
}

static void begin_cleaner(struct world *w, const char *params)
{
    begin(w, params);
    add(w, VS_SENSOR, "pollutant", "f4");
    w->robot.base_ns = w->robot.now_ns;
    CHECK(vs_controller.state_size <= sizeof w->state);
    vs_controller.init(w->state, &w->robot);
    CHECK(w->complaints == 0);
}

static int moves(const struct world *w)
{
    return w->robot.command.left_steps_s != 0 && w->robot.command.right_steps_s != 0;
}

static void test_cleaner_stops_where_it_senses(void)
{
    struct world w;

    begin_cleaner(&w, "stop_probability=1\n");
    CHECK(clean(&w, 0.0, 0) == 0 && moves(&w));
    CHECK(clean(&w, 1.0, 0) == VS_ROBOT_LED_RING && !moves(&w));
    CHECK(clean(&w, 1.0, 0) == VS_ROBOT_LED_RING && !moves(&w));
    CHECK(clean(&w, 0.0, 0) == 0 && moves(&w));
    CHECK(clean(&w, 1.0, 0) == VS_ROBOT_LED_RING);
    CHECK(clean(&w, 1.0, VS_NEVER_US) == 0 && moves(&w));
}

static void test_cleaner_takes_no_stale_value_for_news(void)
{
    struct world w;

    begin_cleaner(&w, "stop_probability=1\n");
    CHECK(clean(&w, 1.0, 260000) == 0 && moves(&w));
    CHECK(clean(&w, 1.0, 0) == VS_ROBOT_LED_RING && !moves(&w));
    CHECK(clean(&w, 0.0, 260000) == VS_ROBOT_LED_RING && !moves(&w));
    CHECK(clean(&w, 1.0, 260000) == VS_ROBOT_LED_RING && !moves(&w));
    CHECK(clean(&w, 0.0, 0) == 0 && moves(&w));
}

static void test_cleaner_stops_with_its_probability(void)
{
    int stopped = 0;
    int trial;

    for (trial = 0; trial < 4000; trial++) {
        struct world w;

        begin(&w, "");
        add(&w, VS_SENSOR, "pollutant", "f4");
        w.session.seed = (uint32_t)trial;
        vs_robot_begin(&w.robot, &w.session);
        vs_controller.init(w.state, &w.robot);
        stopped += clean(&w, 1.0, 0) != 0;
    }
    CHECK(stopped > 4000 * 27 / 100 && stopped < 4000 * 33 / 100);
}

/* Turns away from what it sees, and in one direction until it is free. */
static void test_cleaner_avoids(void)
{
    int ring;

    for (ring = 0; ring < 8; ring++) {
        int front = ring <= 1 || ring >= 6;
        struct world w;
        int i;

        begin_cleaner(&w, "walk_s=1e9\n");
        clean(&w, 0.0, 0);
        CHECK(w.robot.command.left_steps_s == w.robot.command.right_steps_s);
        w.robot.base.prox[ring] = 1000;
        for (i = 0; i < 30; i++) {
            clean(&w, 0.0, 0);
            CHECK(moves(&w));
            if (front)
                CHECK((w.robot.command.left_steps_s < 0) == (ring <= 1));
            else
                CHECK(w.robot.command.left_steps_s == w.robot.command.right_steps_s);
            w.robot.base.prox[7 - ring] = (int16_t)(front ? 2000 * (i > 10) : 0);
        }
        memset(w.robot.base.prox, 0, sizeof w.robot.base.prox);
        for (i = 0; i < 30; i++)
            clean(&w, 0.0, 0);
        CHECK(w.robot.command.left_steps_s == w.robot.command.right_steps_s);
        CHECK(w.robot.command.left_steps_s == 776);
    }
}

static void test_colours_are_clipped_and_go_out_at_rest(void)
{
    static const uint8_t nothing[4][3];
    static const uint8_t expected[4][3] = {{255, 0, 7}, {0, 0, 0}, {0, 0, 0}, {1, 2, 3}};
    struct vs_robot robot;

    memset(&robot, 0, sizeof robot);
    vs_robot_set_rgb(&robot, 0, 1000, -1, 7);
    vs_robot_set_rgb(&robot, 3, 1, 2, 3);
    vs_robot_set_rgb(&robot, 4, 255, 255, 255);
    vs_robot_set_rgb(&robot, -1, 255, 255, 255);
    vs_robot_set_leds(&robot, VS_ROBOT_LED_RING);
    CHECK(memcmp(robot.command.rgb, expected, sizeof expected) == 0);
    CHECK(vs_robot_rgb_leds(&robot) == 0);
    robot.base.rgb_leds = 4;
    CHECK(vs_robot_rgb_leds(&robot) == 4);
    robot.base.rgb_leds = 0;
    robot.base.boards.there = 1u << VS_BOARD_RGB;
    CHECK(vs_robot_rgb_leds(&robot) == 3);
    vs_robot_rest(&robot);
    CHECK(memcmp(robot.command.rgb, nothing, sizeof nothing) == 0 && robot.command.leds == 0);
}

int main(void)
{
    test_every_layout();
    test_age_and_staleness();
    test_own_sensors_and_their_virtual_twins();
    test_virtual_part_is_fused_with_the_real_one();
    test_odd_parts_are_fused_as_far_as_they_go();
    test_exact_name_wins_over_the_fused_one();
    test_actuators_are_clipped_to_their_type();
    test_parameters();
    test_parameters_within_bounds();
    test_parameters_that_nobody_asks_for();
    test_text_parameters();
    test_shown_values();
    test_shown_texts();
    test_log();
    test_colours_are_clipped_and_go_out_at_rest();
    test_random_is_the_robots_own();
    test_cleaner_stops_where_it_senses();
    test_cleaner_takes_no_stale_value_for_news();
    test_cleaner_stops_with_its_probability();
    test_cleaner_avoids();
    return 0;
}
