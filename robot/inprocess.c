/* SPDX-License-Identifier: MIT */
#include "inprocess.h"

#include <string.h>

#include "hosted.h"
#include "loop.h"
#include "../c_src/epuck_argos.h"
#include "../c_src/vs_offer.h"

#define LINE_BYTES 128
#define COMPLAINTS_BYTES 4096
#define STEP_E9 1000000000
#define RUN 1                  /* the session's only one */
#define AXLE_UM 53000          /* of an e-puck */

struct mind {
    struct vs_session session;
    struct vs_loop loop;
    struct vs_base_command in_force; /* what the perfect guard's perfect base does */
    uint64_t rolled_ns;              /* its steps are counted up to here, 0: from now on */
    int64_t steps_e9[2];             /* [1e-9 step] of the left and the right wheel */
    union vs_controller_state state;
};

struct vs_inprocess {
    uint32_t robots;
    uint32_t ended; /* a loop that has ended asks to be closed, for ever */
    volatile struct vs_inprocess_progress *progress;
    int16_t max_steps_s; /* of their motors, 0: an e-puck's */
    uint32_t step_nm;
    int32_t rate_e3; /* [1e-3/EPUCK_IMU_DIGITS rad/s] of turning when a wheel makes a step a second
                        more than the other one */
    size_t said;
    char complaints[COMPLAINTS_BYTES];
    struct mind minds[];
};

const char *vs_inprocess_controller(void)
{
    return vs_controller.name;
}

size_t vs_inprocess_size(uint32_t robots)
{
    return sizeof(struct vs_inprocess) + robots * sizeof(struct mind);
}

const char *vs_inprocess_complaints(const struct vs_inprocess *all)
{
    return all->complaints;
}

/* Notes a line unless it stands there already, or there is no room for all of it. */
static void note(struct vs_inprocess *all, const char *line)
{
    size_t len = strlen(line);
    const char *at = all->complaints;

    for (at = strstr(at, line); at != NULL; at = strstr(at + 1, line))
        if ((at == all->complaints || at[-1] == '\n') && at[len] == '\n')
            return;
    if (all->said + len + 1 >= COMPLAINTS_BYTES)
        return;
    memcpy(all->complaints + all->said, line, len);
    all->said += len;
    all->complaints[all->said++] = '\n';
}

/* Appends at most most bytes of text to a line of LINE_BYTES. */
static void append(char *line, const char *text, size_t most)
{
    size_t len = strlen(line);
    size_t more = strlen(text);

    more = more < most ? more : most;
    more = more < LINE_BYTES - 1 - len ? more : LINE_BYTES - 1 - len;
    memcpy(line + len, text, more);
    line[len + more] = '\0';
}

/* One complaint: controller 'NAME'WHAT 'THING'END. */
static void say(struct vs_inprocess *all, const char *what, const char *thing, size_t len,
                const char *end)
{
    char line[LINE_BYTES] = "controller '";

    append(line, vs_controller.name, VS_NAME_MAX);
    append(line, "'", 1);
    append(line, what, LINE_BYTES);
    append(line, " '", 2);
    append(line, thing, len);
    append(line, "'", 1);
    append(line, end, LINE_BYTES);
    note(all, line);
}

static void complain(void *context, const char *what, const char *name)
{
    char text[LINE_BYTES] = ": ";

    append(text, what, LINE_BYTES);
    say(context, text, name, LINE_BYTES, "");
}

/* What the host offers and the controller does not know. */
static void complain_of_unused(struct vs_inprocess *all, const struct vs_robot *robot)
{
    const struct vs_table *table = &robot->session->table;
    const char *param = NULL;
    uint32_t i;

    for (i = 0; i < table->count; i++)
        if ((robot->bound >> i & 1u) == 0)
            say(all, " does not know", table->entries[i].name, VS_NAME_MAX, ": ignored");
    while ((param = vs_robot_unasked_param(robot, param)) != NULL)
        say(all, " does not know the parameter", param, strcspn(param, "="), ": ignored");
}

void vs_inprocess_embody(struct vs_inprocess *all, int16_t max_steps_s, uint32_t step_nm,
                         uint32_t axle_um)
{
    all->max_steps_s = max_steps_s;
    all->step_nm = step_nm;
    all->rate_e3 = (int32_t)(step_nm * EPUCK_IMU_DIGITS / axle_um + 0.5);
}

int vs_inprocess_init(struct vs_inprocess *all, uint32_t robots,
                      volatile struct vs_inprocess_progress *progress)
{
    struct vs_session_config config;
    uint32_t i;

    if (vs_controller.state_size > VS_CONTROLLER_STATE_MAX)
        return VS_ERR_SPACE;
    if (strlen(vs_controller.name) > VS_NAME_MAX)
        return VS_ERR_TEXT;
    memset(all, 0, vs_inprocess_size(robots));
    memset(&config, 0, sizeof config);
    memcpy(config.controller, vs_controller.name, strlen(vs_controller.name));
    all->robots = robots;
    all->progress = progress;
    vs_inprocess_embody(all, 0, VS_EPUCK_STEP_NM, AXLE_UM);
    progress->timestep = 0;
    progress->robot = 0;
    for (i = 0; i < robots; i++) {
        struct mind *mind = &all->minds[i];
        int err = vs_session_init(&mind->session, &config);

        if (err != VS_OK)
            return err;
        vs_loop_init(&mind->loop, &mind->session, &vs_controller, mind->state.bytes);
        mind->loop.robot.complain = complain;
        mind->loop.robot.context = all;
    }
    return VS_OK;
}

int vs_inprocess_welcome(struct vs_inprocess *all, uint32_t robot, uint16_t tag,
                         const uint8_t *packet, size_t len)
{
    struct vs_session *session = &all->minds[robot].session;
    struct vs_header header;
    struct vs_welcome welcome;
    struct vs_instant now = {0, 0};
    const uint8_t *body;
    size_t body_len;
    int err = vs_packet_open(packet, len, NULL, &header, &body, &body_len);

    if (err == VS_OK && header.type != VS_WELCOME)
        err = VS_ERR_TYPE;
    if (err == VS_OK)
        err = vs_decode_welcome(body, body_len, &welcome);
    if (err != VS_OK)
        return err;
    err = vs_session_offer(session, &welcome);
    if (err != VS_OK)
        return err;
    session->config.tag = tag;
    vs_loop_event(&all->minds[robot].loop, VS_EV_OPEN, &now);
    return VS_OK;
}

/* When a value was measured, as STATE says it. */
static uint32_t older_us(uint64_t capture_ns, int64_t value_ns)
{
    uint64_t older;

    if (value_ns < 0 || (uint64_t)value_ns > capture_ns)
        return VS_NEVER_US;
    older = (capture_ns - (uint64_t)value_ns) / 1000;
    return older < VS_NEVER_US ? (uint32_t)older : VS_NEVER_US;
}

/* The robot hears the timestep's STATE over a clock that it shares with the host. */
static void hear(struct mind *mind, uint32_t robot, const struct vs_inprocess_timestep *now)
{
    struct vs_session *s = &mind->session;
    size_t bytes = s->table.sensor_bytes;
    uint32_t sensors = s->table.sensors;
    uint32_t i;

    s->state.wanted = s->wanted = now->wanted;
    s->state.from_timestep = s->from_timestep = now->from_timestep;
    if (now->goals != NULL) {
        s->state.goal_x_mm = now->goals[3 * robot];
        s->state.goal_y_mm = now->goals[3 * robot + 1];
        s->state.goal_heading = now->goals[3 * robot + 2];
    }
    if (bytes > 0)
        memcpy(s->state.payload, now->values + robot * bytes, bytes);
    for (i = 0; i < sensors; i++)
        s->state.older_us[i] = older_us(now->capture_ns, now->captures_ns[robot * sensors + i]);
    s->run = RUN;
    s->timestep = now->timestep;
    s->capture_ns = s->newest_capture_ns = now->capture_ns;
    s->received_ns = s->fresh_ns = now->now_ns;
    (void)vs_clock_sample(&s->clock, now->now_ns, now->now_ns, 0, now->now_ns);
}

/* A stepper motor makes its steps, whatever its wheel slides on. */
static void roll(struct mind *mind, uint64_t now_ns)
{
    int64_t passed_ns = mind->rolled_ns == 0 ? 0 : (int64_t)(now_ns - mind->rolled_ns);

    mind->steps_e9[0] += mind->in_force.left_steps_s * passed_ns;
    mind->steps_e9[1] += mind->in_force.right_steps_s * passed_ns;
    mind->rolled_ns = now_ns;
}

/* [1/EPUCK_IMU_DIGITS rad/s] around its z axis, counter-clockwise; a gyroscope has its limit. */
static int16_t turning(const struct vs_base_command *command, int32_t rate_e3)
{
    int32_t rate = (command->right_steps_s - command->left_steps_s) * rate_e3 / 1000;

    if (rate > INT16_MAX)
        return INT16_MAX;
    return (int16_t)(rate < -INT16_MAX ? -INT16_MAX : rate);
}

/* Its accelerometer feels gravity only, its gyroscope the wheels, and nothing makes a noise. */
static void read_base(struct vs_base_reading *reading, const struct vs_inprocess *all,
                      uint32_t robot, const struct vs_inprocess_timestep *now)
{
    const struct mind *mind = &all->minds[robot];
    static const int16_t acceleration[3] = {EPUCK_ARGOS_REST_RAW, EPUCK_ARGOS_REST_RAW,
                                            EPUCK_ARGOS_REST_RAW + EPUCK_ARGOS_GRAVITY_RAW};
    static const int16_t microphones[3] = {EPUCK_ARGOS_REST_RAW, EPUCK_ARGOS_REST_RAW,
                                           EPUCK_ARGOS_REST_RAW};

    memset(reading, 0, sizeof *reading);
    memcpy(reading->acceleration, acceleration, sizeof acceleration);
    memcpy(reading->microphones, microphones, sizeof microphones);
    reading->microphone_count = 3;
    memcpy(reading->prox, now->prox + 8 * robot, sizeof reading->prox);
    memcpy(reading->light, now->light + 8 * robot, sizeof reading->light);
    reading->has_rates = 1;
    reading->rates[2] = turning(&mind->in_force, all->rate_e3);
    reading->has_steps = 1;
    reading->step_nm = all->step_nm;
    reading->max_steps_s = all->max_steps_s;
    reading->steps[0] = (int32_t)(mind->steps_e9[0] / STEP_E9);
    reading->steps[1] = (int32_t)(mind->steps_e9[1] / STEP_E9);
}

/* The guard does at once what the loop asks for, until it asks for nothing more. */
static void act(struct vs_inprocess *all, uint32_t robot, const struct vs_inprocess_timestep *now)
{
    struct mind *mind = &all->minds[robot];
    struct vs_instant instant = {now->now_ns, now->now_ns};
    struct vs_guard_request request;

    while (vs_loop_request(&mind->loop, &instant, &request)) {
        struct vs_guard_reply reply;

        memset(&reply, 0, sizeof reply);
        reply.kind = (uint8_t)request.kind;
        if (request.kind == VS_GUARD_ACT)
            mind->in_force = request.command;
        reply.command = mind->in_force;
        reply.sensed = request.kind != VS_GUARD_PING;
        reply.reading_ns = now->now_ns;
        read_base(&reply.reading, all, robot, now);
        vs_loop_reply(&mind->loop, &reply, &instant);
    }
}

int vs_inprocess_log(struct vs_inprocess *all, uint32_t *robot, uint32_t *number,
                     const char **line)
{
    for (*robot = 0; *robot < all->robots; ++*robot) {
        struct vs_log *log = &all->minds[*robot].loop.robot.log;

        *line = vs_log_due(log, number);
        if (*number != 0) {
            vs_log_heard(log, *number);
            return 1;
        }
    }
    return 0;
}

const char *vs_inprocess_failure(const struct vs_inprocess *all, uint32_t *robot)
{
    for (*robot = 0; *robot < all->robots; ++*robot) {
        const char *words = all->minds[*robot].loop.robot.failure;

        if (words[0] != '\0')
            return words;
    }
    return NULL;
}

void vs_inprocess_begin(struct vs_inprocess *all)
{
    uint32_t i;

    for (i = 0; i < all->robots; i++) {
        all->progress->robot = i + 1;
        all->minds[i].session.run = RUN;
        vs_loop_begin(&all->minds[i].loop);
    }
    all->progress->robot = 0;
}

void vs_inprocess_end(struct vs_inprocess *all)
{
    uint32_t i;

    all->ended = 1;
    for (i = 0; i < all->robots; i++) {
        all->progress->robot = i + 1;
        vs_loop_end(&all->minds[i].loop);
    }
    all->progress->robot = 0;
}

uint32_t vs_inprocess_robots(const struct vs_inprocess *all)
{
    return all->robots;
}

struct vs_robot *vs_inprocess_robot(const struct vs_inprocess *all, uint32_t robot)
{
    return (struct vs_robot *)&all->minds[robot].loop.robot;
}

void vs_hosted_sense(struct vs_inprocess *all, const struct vs_inprocess_timestep *now)
{
    uint32_t i;

    for (i = 0; i < all->robots; i++) {
        struct vs_robot *robot = &all->minds[i].loop.robot;

        hear(&all->minds[i], i, now);
        roll(&all->minds[i], now->now_ns);
        read_base(&robot->base, all, i, now);
        robot->base_ns = robot->now_ns = robot->session_ns = now->now_ns;
    }
}

static void give_notes(const struct vs_robot *robot, uint8_t *shown,
                       struct vs_inprocess_timestep *now)
{
    shown[0] = robot->shown_len;
    memcpy(shown + 1, robot->shown, robot->shown_len);
    now->logged += robot->log.newest - robot->log.heard;
    now->failed += robot->failure[0] != '\0';
}

int vs_inprocess_step(struct vs_inprocess *all, struct vs_inprocess_timestep *now)
{
    struct vs_instant instant = {now->now_ns, now->now_ns};
    uint32_t i;

    if (all->ended)
        return VS_ERR_STATE;
    now->logged = now->failed = 0;
    all->progress->timestep = now->timestep;
    for (i = 0; i < all->robots; i++) {
        struct mind *mind = &all->minds[i];
        uint32_t bytes = mind->session.table.actuator_bytes;

        hear(mind, i, now);
        roll(mind, now->now_ns);
        all->progress->robot = i + 1;
        vs_loop_event(&mind->loop, VS_EV_STATE, &instant);
        act(all, i, now);
        all->progress->robot = 0;
        if (mind->loop.talk_due)
            complain_of_unused(all, &mind->loop.robot);
        mind->loop.talk_due = 0;
        now->wheels_steps_s[2 * i] = mind->in_force.left_steps_s;
        now->wheels_steps_s[2 * i + 1] = mind->in_force.right_steps_s;
        now->leds[i] = mind->in_force.leds;
        memcpy(now->reports + i * bytes, mind->loop.robot.actuators, bytes);
        give_notes(&mind->loop.robot, now->shown + (size_t)i * (1 + VS_SHOWN_MAX), now);
    }
    return VS_OK;
}
