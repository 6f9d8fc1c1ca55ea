/* SPDX-License-Identifier: MIT */
/*
 * base_wifi.c - an e-puck2 over its own Wi-Fi (epuck_wifi.h). The robot sends its sensors all the
 * time, and does not say which command it follows. TCP says which bytes its radio has: a stop counts
 * when a packet of sensors came after the robot's side had acknowledged it. While wheels shall turn
 * any new packet will do. What the robot does when the connection breaks nobody here knows, so each
 * new connection begins with a stop; one that is silent for a second is replaced.
 */
#include <string.h>

#include "base_config.h"
#include "number.h"
#include "wifi_line.h"

#include "../c_src/epuck_asercom.h"
#include "../c_src/epuck_wifi.h"
#include "../c_src/vs_posix.h"

#define CONNECT_NS UINT64_C(3000000000) /* [ns] a robot answers within this or is not there */
#define SILENT_NS 1000000000u   /* [ns] without a packet */
#define AGAIN_NS 500000000u     /* [ns] from a connection that failed to the next */
#define READS_MAX 64            /* at once, of 512 bytes */
#define ADDRESS_MAX 15          /* [byte] 255.255.255.255 */

enum { CLOSED = 0, CONNECTING, OPEN, RING_RED = 0xAA /* LEDs of the ring that are coloured */ };

struct wifi {
    uint8_t address[4];
    uint16_t port;
    uint8_t phase;
    uint8_t rests;      /* 1: the newest commands are to rest */
    uint8_t rest_heard; /* 1: the robot's radio has such a one */
    uint8_t grounded;
    uint32_t sent;      /* [byte] on this connection */
    uint32_t rest_at;   /* of them up to the end of the first command to rest */
    uint32_t skip;      /* [byte] of a packet that nobody wants */
    uint64_t begun_ns;  /* the connection, or its end */
    uint64_t heard_ns;  /* newest packet of sensors */
    uint32_t got;
    uint8_t packet[1 + EPUCK_WIFI_SENSORS_LEN];
};

enum { STATE_FITS = 1 / (sizeof(struct wifi) <= VS_BASE_STATE_MAX) };

static struct wifi *of(struct vs_base *base)
{
    return (struct wifi *)(void *)base->state.bytes;
}

static uint64_t now(const struct vs_base *base)
{
    return base->io.now_ns(base->io.context);
}

static int open_wifi(struct vs_base *base, const struct vs_base_config *config)
{
    struct wifi *w = of(base);
    char address[ADDRESS_MAX + 1] = "";
    size_t len = strcspn(config->device, ":");
    int64_t port = EPUCK_WIFI_PORT;

    if (len <= ADDRESS_MAX)
        memcpy(address, config->device, len);
    if (vs_number_address(address, w->address) != 0 ||
        (config->device[len] == ':' &&
         vs_number_whole(config->device + len + 1, 1, 65535, &port) != 0))
        return VS_ERR_ARGUMENT;
    w->port = (uint16_t)port;
    w->grounded = config->choice[0];
    base->body = &vs_body_epuck2;
    base->fd = -1;
    vs_wifi_line_io(&base->io, &base->fd);
    (void)vs_posix_now_ns();
    return VS_OK;
}

/* Ends the connection; the next one is tried at once, or after a pause. */
static int lose(struct vs_base *base, const char *news)
{
    struct wifi *w = of(base);

    if (w->phase == OPEN)
        w->begun_ns = 0;
    else
        w->begun_ns = now(base);
    w->phase = CLOSED;
    vs_wifi_line_close(&base->fd);
    base->news = news;
    return VS_ERR_SILENT;
}

/* Returns 1 if a packet of sensors is complete, 0 if not, -1 if no robot says that. */
static int take(struct wifi *w, uint8_t byte)
{
    if (w->skip > 0) {
        w->skip--;
        return 0;
    }
    if (w->got == 0 && byte == EPUCK_WIFI_PICTURE)
        w->skip = EPUCK_WIFI_PICTURE_LEN;
    if (w->got == 0 && byte != EPUCK_WIFI_SENSORS)
        return byte == EPUCK_WIFI_PICTURE || byte == EPUCK_WIFI_NOTHING ? 0 : -1;
    w->packet[w->got++] = byte;
    if (w->got < sizeof w->packet)
        return 0;
    w->got = 0;
    return 1;
}

/* Waits for bytes and takes those that are there, of a robot that never ends some. VS_OK: *sensors
 * is new, VS_ERR_BUSY: nothing was complete, or the connection is lost. */
static int hear(struct vs_base *base, struct epuck_wifi_sensors *sensors, uint64_t deadline_ns)
{
    struct wifi *w = of(base);
    uint8_t bytes[512];
    int heard = VS_ERR_BUSY;
    int reads = 0;
    int len = 0;
    int i;

    while (reads++ < READS_MAX &&
           (len = base->io.read(base->io.context, bytes, sizeof bytes, deadline_ns)) > 0) {
        deadline_ns = 0;
        for (i = 0; i < len; i++) {
            int complete = take(w, bytes[i]);

            if (complete == 0)
                continue;
            if (complete < 0 || epuck_wifi_get_sensors(w->packet + 1, sensors) != 0)
                return lose(base, "it sends what no e-puck2 does: is its selector at Wi-Fi?");
            heard = VS_OK;
            w->heard_ns = now(base);
        }
    }
    return len < 0 ? lose(base, "its connection broke; connecting again") : heard;
}

static uint8_t percent(uint8_t brightness)
{
    return (uint8_t)((brightness * EPUCK_WIFI_BRIGHTNESS_MAX + UINT8_MAX - 1) / UINT8_MAX);
}

/* A coloured LED that is only to be on is red. */
static int say(struct vs_base *base, const struct vs_base_command *command, uint8_t asks)
{
    struct wifi *w = of(base);
    struct epuck_wifi_command said = {asks, command->left_steps_s, command->right_steps_s,
                                      command->leds, {{0}}};
    int rests = (command->left_steps_s | command->right_steps_s) == 0;
    uint8_t packet[EPUCK_WIFI_COMMAND_LEN];
    int i;

    for (i = 0; i < 3 * VS_BASE_RGB_LEDS; i++)
        said.rgb[i / 3][i % 3] = percent(command->rgb[i / 3][i % 3]);
    for (i = 0; i < VS_BASE_RGB_LEDS; i++)
        if (((command->leds & RING_RED) >> (2 * i + 1) & 1) && !(said.rgb[i][1] | said.rgb[i][2]))
            said.rgb[i][0] = EPUCK_WIFI_BRIGHTNESS_MAX;
    epuck_wifi_put_command(&said, packet);
    if (base->io.write(base->io.context, packet, sizeof packet, 0) != VS_OK)
        return lose(base, "its connection broke; connecting again");
    w->sent += sizeof packet;
    if (rests && !w->rests) {
        w->rest_at = w->sent;
        w->rest_heard = 0;
    }
    w->rests = (uint8_t)rests;
    return VS_OK;
}

static int has_rest(const struct vs_base *base, const struct wifi *w)
{
    int unheard = vs_wifi_line_unheard(base->fd);

    return unheard >= 0 && w->sent - (uint32_t)unheard >= w->rest_at;
}

static void report(struct vs_base *base, const struct epuck_wifi_sensors *sensors,
                   struct vs_base_reading *reading)
{
    vs_base_see(sensors->prox, sensors->light, EPUCK_WIFI_RAW_MAX, reading);
    vs_base_feel(sensors->acceleration, sensors->microphones, 4, reading);
    vs_base_count(base, sensors->steps, reading);
    memcpy(reading->rates, sensors->rates, sizeof reading->rates);
    memcpy(reading->ground, sensors->ground, sizeof reading->ground);
    reading->distance_mm = sensors->distance_mm;
    reading->has_rates = reading->has_distance = 1;
    reading->has_ground = of(base)->grounded;
    reading->battery_mv = epuck_asercom_battery_mv(sensors->battery, 1);
    reading->battery_low = epuck_asercom_battery_low(sensors->battery, 1);
    reading->rgb_leds = VS_BASE_RGB_LEDS;
}

/* Commands, and waits for a packet; a rest that the robot has not got counts for nothing. */
static int talk(struct vs_base *base, const struct vs_base_command *command,
                struct vs_base_reading *reading)
{
    struct wifi *w = of(base);
    uint64_t deadline_ns = vs_posix_now_ns() + VS_BASE_EXCHANGE_NS;
    struct epuck_wifi_sensors sensors;
    int heard = hear(base, &sensors, 0);
    int proven = heard == VS_OK && w->rest_heard;

    if (heard != VS_OK && heard != VS_ERR_BUSY)
        return heard;
    if (now(base) - w->heard_ns > SILENT_NS)
        return lose(base, "it has said nothing for a second; connecting again");
    if (say(base, command, EPUCK_WIFI_STREAM_SENSORS) != VS_OK)
        return VS_ERR_SILENT;
    while (!(heard == VS_OK && (!w->rests || (proven && w->rest_heard)))) {
        int before = w->rest_heard;
        int err;

        if (w->rests && !w->rest_heard)
            w->rest_heard = (uint8_t)has_rest(base, w);
        err = hear(base, &sensors, deadline_ns);
        if (err != VS_OK && err != VS_ERR_BUSY)
            return err;
        if (err == VS_OK)
            heard = VS_OK;
        proven |= err == VS_OK && before;
        if (now(base) >= deadline_ns)
            break;
    }
    if (heard != VS_OK || (w->rests && !(proven && w->rest_heard)))
        return VS_ERR_LATE;
    report(base, &sensors, reading);
    return VS_OK;
}

static int begin(struct vs_base *base)
{
    struct wifi *w = of(base);
    uint64_t until_ns = w->begun_ns == 0 ? 0 : w->begun_ns + AGAIN_NS;

    if (vs_posix_now_ns() < until_ns) {
        (void)vs_posix_wait(-1, 0, until_ns < now(base) + VS_BASE_EXCHANGE_NS
                                       ? until_ns : now(base) + VS_BASE_EXCHANGE_NS);
        return VS_ERR_BUSY;
    }
    w->begun_ns = now(base);
    if (vs_wifi_line_open(w->address, w->port, &base->fd) != VS_OK)
        return VS_ERR_IO;
    w->phase = CONNECTING;
    w->got = w->skip = w->sent = 0;
    w->rests = w->rest_heard = 0;
    return VS_ERR_BUSY;
}

static int recover_wifi(struct vs_base *base)
{
    static const struct vs_base_command rest;
    struct wifi *w = of(base);
    struct vs_base_reading reading;
    int err;

    if (w->phase == CLOSED)
        return begin(base);
    if (w->phase == OPEN) {
        err = talk(base, &rest, &reading);
        return err == VS_ERR_LATE ? VS_ERR_BUSY : err;
    }
    err = vs_wifi_line_await(base->fd, vs_posix_now_ns() + VS_BASE_EXCHANGE_NS);
    if (err == VS_ERR_BUSY && now(base) < w->begun_ns + CONNECT_NS)
        return err;
    if (err != VS_OK)
        return lose(base, "nobody answers at its address: is it on, and its selector at Wi-Fi?");
    w->phase = OPEN;
    w->heard_ns = now(base);
    return say(base, &rest, EPUCK_WIFI_STREAM_SENSORS) == VS_OK ? VS_ERR_BUSY : VS_ERR_SILENT;
}

static int exchange_wifi(struct vs_base *base, const struct vs_base_command *command,
                         struct vs_base_reading *reading)
{
    return of(base)->phase == OPEN ? talk(base, command, reading) : VS_ERR_SILENT;
}

static int close_wifi(struct vs_base *base)
{
    static const struct vs_base_command off;
    struct vs_base_reading reading;
    int err = exchange_wifi(base, &off, &reading);

    if (err == VS_OK) {
        (void)say(base, &off, 0);
        vs_wifi_line_close(&base->fd);
        of(base)->phase = CLOSED;
    }
    return err == VS_ERR_LATE ? VS_ERR_BUSY : err;
}

static const char *const floors[] = {"no", "yes", NULL};
static const struct vs_base_choice choices[] = {{"floor", floors}, {NULL, NULL}};

const struct vs_base_ops vs_base_wifi = {
    "wifi",
    "wifi:ADDRESS[:PORT]  e-puck2 over its own Wi-Fi, without a board; its port is 1000. It may\n"
    "                   drive on when its connection breaks: DRIVERS.md\n"
    "    floor=no|yes       it has ground sensors (default: no)",
    "192.168.1.40",
    0,
    choices,
    open_wifi,
    recover_wifi,
    exchange_wifi,
    close_wifi,
};
