/* SPDX-License-Identifier: MIT */
/* Many robots in one process: each hears its own values, keeps its own state, obeys safety. */
#include <math.h>
#include <string.h>

#include "check.h"
#include "inprocess.h"
#include "loop.h"
#include "vs_bytes.h"

#define MS UINT64_C(1000000)
#define ROBOTS 3
#define SENSOR_BYTES 5 /* "f4" and "u1" */

struct seen {
    int ground;
    int heard;
    int proximity;
    int acceleration;
    int gyroscope;
    int microphones;
    int unknown;
    int wheels;
    int steps;
};

static volatile struct vs_inprocess_progress progress;
static uint32_t robots_seen; /* who was in its control step, as bits; tests only */

static void init(void *state, struct vs_robot *robot)
{
    struct seen *seen = state;

    CHECK(seen->steps == 0);
    seen->ground = vs_robot_sensor(robot, "ground");
    seen->proximity = vs_robot_sensor(robot, "proximity");
    seen->acceleration = vs_robot_sensor(robot, "accelerometer");
    seen->microphones = vs_robot_sensor(robot, "microphones");
    seen->gyroscope = vs_robot_sensor(robot, "gyroscope");
    seen->wheels = vs_robot_sensor(robot, "wheels");
    seen->unknown = vs_robot_sensor(robot, "moonlight");
    seen->heard = vs_robot_actuator(robot, "heard");
    (void)vs_robot_param(robot, "speed", 1.0);
}

static void step(void *state, struct vs_robot *robot)
{
    struct seen *seen = state;
    struct vs_reading ground = vs_robot_read(robot, seen->ground);
    char line[] = "line0";
    double prox[8];
    double raw[4];
    double ways_cm[2];

    seen->steps++;
    /* 1000 and -70 steps/s for 100 ms, with the 0.128805 mm of a step. */
    CHECK(vs_robot_values(robot, seen->wheels, ways_cm, 2) == 2);
    if (seen->steps == 1)
        CHECK(ways_cm[0] == 0.0 && ways_cm[1] == 0.0);
    if (seen->steps == 2)
        CHECK(fabs(ways_cm[0] - 1.28805) < 1e-9 && fabs(ways_cm[1] + 0.0901635) < 1e-9);
    CHECK(progress.robot >= 1 && progress.robot <= ROBOTS);
    robots_seen |= 1u << progress.robot;
    CHECK(vs_robot_values(robot, seen->proximity, prox, 8) == 8);
    CHECK(vs_robot_values(robot, seen->acceleration, raw, 3) == 3 && raw[2] > raw[0]);
    CHECK(vs_robot_values(robot, seen->microphones, raw, 4) == 3 && raw[0] == raw[2]);
    /* -70 and 1000 steps/s to the left and the right of 53 mm: 1070 * 0.128805 / 53 rad/s. */
    CHECK(vs_robot_values(robot, seen->gyroscope, raw, 3) == 3 && raw[0] == 0.0);
    if (seen->steps == 1)
        CHECK(raw[2] == 0.0);
    if (seen->steps == 2)
        CHECK(fabs(raw[2] + 1070.0 * 0.128805 / 53.0) < 1e-3);
    CHECK(!vs_robot_read(robot, seen->unknown).known);
    vs_robot_actuate(robot, seen->heard, 0, ground.known ? ground.value : -1.0);
    vs_robot_actuate(robot, seen->heard, 1, (double)ground.age_ns / 1e6);
    vs_robot_actuate(robot, seen->heard, 2, prox[0] + seen->steps);
    vs_robot_set_wheels(robot, 2000, -(int)vs_robot_param(robot, "speed", 1.0));
    vs_robot_set_leds(robot, 0xFFFF);
    if (seen->steps == 1)
        vs_robot_show(robot, "ground", ground.value);
    if (seen->steps == 2 && progress.robot == 2)
        for (line[4] = '0'; line[4] < '0' + 10; line[4]++)
            vs_robot_log(robot, line);
}

const struct vs_controller vs_controller = {"listener", sizeof(struct seen), init, step, NULL};

struct world {
    struct vs_inprocess *all;
    struct vs_inprocess_timestep now;
    uint8_t values[ROBOTS * SENSOR_BYTES];
    int64_t captures_ns[ROBOTS * 2];
    int16_t prox[ROBOTS * 8];
    int16_t light[ROBOTS * 8];
    int16_t wheels[ROBOTS * 2];
    uint16_t leds[ROBOTS];
    uint8_t reports[ROBOTS * 12];
    uint8_t shown[ROBOTS * (1 + VS_SHOWN_MAX)];
};

static size_t make_welcome(uint8_t *packet, size_t cap)
{
    static struct vs_welcome welcome;
    struct vs_header header;
    size_t len;

    memset(&header, 0, sizeof header);
    memset(&welcome, 0, sizeof welcome);
    vs_table_init(&welcome.table);
    CHECK(vs_table_add(&welcome.table, 1, VS_SENSOR, "ground", "f4") == VS_OK);
    CHECK(vs_table_add(&welcome.table, 2, VS_SENSOR, "smell", "u1") == VS_OK);
    CHECK(vs_table_add(&welcome.table, 3, VS_ACTUATOR, "heard", "3*f4") == VS_OK);
    welcome.timestep_us = 100000;
    welcome.params = "speed=70\ncolour=3\n";
    welcome.params_len = (uint16_t)strlen(welcome.params);
    header.table_hash = welcome.table.hash;
    CHECK(vs_encode_welcome(&header, &welcome, packet, cap, &len) == VS_OK);
    return len;
}

static void begin(struct world *w)
{
    uint8_t packet[VS_PACKET_MAX];
    size_t len = make_welcome(packet, sizeof packet);
    uint16_t i;

    memset(w, 0, sizeof *w);
    w->all = malloc(vs_inprocess_size(ROBOTS));
    CHECK(w->all != NULL && vs_inprocess_init(w->all, ROBOTS, &progress) == VS_OK);
    for (i = 0; i < ROBOTS; i++) {
        CHECK(vs_inprocess_welcome(w->all, i, i, packet, len - 1) != VS_OK);
        CHECK(vs_inprocess_welcome(w->all, i, (uint16_t)(100 + i), packet, len) == VS_OK);
        vs_store_f4(w->values + SENSOR_BYTES * i, 10.0f * (float)(i + 1));
        w->prox[8 * i] = (int16_t)(1000 * i);
    }
    w->now.from_timestep = 3;
    w->now.capture_ns = 1000 * MS;
    w->now.values = w->values;
    w->now.captures_ns = w->captures_ns;
    w->now.prox = w->prox;
    w->now.light = w->light;
    w->now.wheels_steps_s = w->wheels;
    w->now.leds = w->leds;
    w->now.reports = w->reports;
    w->now.shown = w->shown;
}

/* One timestep; every value was measured when the arena was seen, but the last robot's never. */
static void live(struct world *w, uint8_t wanted, uint64_t later_ns)
{
    int i;

    w->now.wanted = wanted;
    w->now.timestep++;
    w->now.capture_ns += later_ns;
    w->now.now_ns = w->now.capture_ns + 20 * MS;
    for (i = 0; i < 2 * ROBOTS; i++)
        w->captures_ns[i] = i < 2 * ROBOTS - 2 ? (int64_t)w->now.capture_ns : -1;
    CHECK(vs_inprocess_step(w->all, &w->now) == VS_OK);
    CHECK(progress.timestep == w->now.timestep && progress.robot == 0);
}

static float heard(const struct world *w, int robot, int number)
{
    return vs_load_f4(w->reports + 12 * robot + 4 * number);
}

static void test_each_robot_lives_its_own_life(struct world *w)
{
    int i;

    live(w, VS_IDLE, 100 * MS);
    live(w, VS_RUN, 100 * MS);
    for (i = 0; i < ROBOTS; i++)
        CHECK(w->wheels[2 * i] == 0 && w->leds[i] == 0 && heard(w, i, 2) == 0.0f);
    CHECK(vs_inprocess_complaints(w->all)[0] == '\0');
    live(w, VS_RUN, 100 * MS);
    live(w, VS_RUN, 100 * MS);
    for (i = 0; i < ROBOTS; i++) {
        CHECK(w->wheels[2 * i] == VS_ROBOT_MAX_STEPS_S && w->wheels[2 * i + 1] == -70);
        CHECK(w->leds[i] == 0x3FF);
        CHECK(heard(w, i, 2) == (float)(1000 * i + 2));
    }
    CHECK(heard(w, 0, 0) == 10.0f && heard(w, 1, 0) == 20.0f && heard(w, 2, 0) == -1.0f);
    CHECK(heard(w, 0, 1) == 20.0f && heard(w, 2, 1) > 1e12f);
    CHECK(robots_seen == (1u << 1 | 1u << 2 | 1u << 3));
}

/* Right after the second control step, in which robot 1 (from 0) logged ten lines. */
static void test_shown_and_logged(struct world *w)
{
    const char *line = NULL;
    uint32_t number;
    uint32_t robot;
    uint32_t i;

    for (i = 0; i < ROBOTS; i++) {
        const uint8_t *shown = w->shown + i * (1 + VS_SHOWN_MAX);

        CHECK(shown[0] == 12 && memcmp(shown + 1, "\6ground\0", 8) == 0);
        CHECK(vs_load_f4(shown + 9) == (i < 2 ? 10.0f * (float)(i + 1) : 0.0f));
    }
    CHECK(w->now.logged == VS_LOG_LINES);
    for (i = 3; i <= 10; i++) {
        char expected[] = {'l', 'i', 'n', 'e', (char)('0' + i - 1), '\0'};

        CHECK(vs_inprocess_log(w->all, &robot, &number, &line) == 1);
        CHECK(robot == 1 && number == i && strcmp(line, expected) == 0);
    }
    CHECK(vs_inprocess_log(w->all, &robot, &number, &line) == 0);
}

static void test_complaints_in_the_daemons_words(struct world *w)
{
    static const char words[] =
        "controller 'listener': nobody offers the sensor 'moonlight'\n"
        "controller 'listener' does not know 'smell': ignored\n"
        "controller 'listener' does not know the parameter 'colour': ignored\n";

    CHECK(strcmp(vs_inprocess_complaints(w->all), words) == 0);
}

/* Three fresh states in a row, none of them 400 ms after the one before. */
static void test_silence_stops_the_wheels(struct world *w)
{
    live(w, VS_RUN, 500 * MS);
    CHECK(w->wheels[0] == 0 && w->leds[0] == 0x3FF);
    live(w, VS_RUN, 100 * MS);
    CHECK(w->wheels[0] == 0);
    live(w, VS_RUN, 100 * MS);
    CHECK(w->wheels[0] == VS_ROBOT_MAX_STEPS_S);
}

static void test_pause_and_stop(struct world *w)
{
    float steps = heard(w, 0, 2);

    live(w, VS_PAUSE, 100 * MS);
    CHECK(w->wheels[0] == 0 && w->leds[0] == 0x3FF && heard(w, 0, 2) == steps);
    live(w, VS_STOP, 100 * MS);
    CHECK(w->wheels[0] == 0 && w->leds[0] == 0);
}

/* A loop that has ended asks to be closed again and again. */
static void test_nothing_happens_after_the_end(struct world *w)
{
    struct vs_inprocess_timestep before;

    vs_inprocess_end(w->all);
    w->now.timestep++;
    w->now.logged = 77;
    before = w->now;
    CHECK(vs_inprocess_step(w->all, &w->now) == VS_ERR_STATE);
    CHECK(memcmp(&before, &w->now, sizeof before) == 0);
    CHECK(progress.timestep == w->now.timestep - 1 && progress.robot == 0);
}

int main(void)
{
    static struct world w;

    CHECK(strcmp(vs_inprocess_controller(), "listener") == 0);
    begin(&w);
    test_each_robot_lives_its_own_life(&w);
    test_shown_and_logged(&w);
    test_complaints_in_the_daemons_words(&w);
    test_silence_stops_the_wheels(&w);
    test_pause_and_stop(&w);
    test_nothing_happens_after_the_end(&w);
    free(w.all);
    return 0;
}
