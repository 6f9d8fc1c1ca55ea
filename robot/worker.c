/* SPDX-License-Identifier: MIT */
#include "worker.h"

#include <errno.h>
#include <string.h>
#include <unistd.h>

#include "guard_rights.h"
#include "random.h"
#include "report.h"
#include "signals.h"
#include "trace.h"
#include "watchdog.h"
#include "../c_src/vs_posix.h"

#define PACKETS_AT_ONCE 64   /* then guard and steps get their turn */
#define LATE_NS 10000000u    /* [ns] a wake-up later than this is worth an excuse */
#define SAME_SIGNAL_MS 20    /* [ms] between the two processes' receipt of Ctrl-C */

static const char GONE[] = "the base is gone";
static const char MUTE[] = "the base did not answer at the end";

enum { FD_NET = 0, FD_SIGNALS = 2, FD_GUARD = 3, FD_BOARDS = 4, FD_COUNT = FD_BOARDS + VS_BOARDS };

static void read_clock(struct vs_worker *w)
{
    int64_t ppb = w->options->clock_drift_ppb;
    uint64_t base_ns = vs_posix_now_ns();

    w->now.base_ns = base_ns;
    w->now.session_ns = base_ns + (uint64_t)w->options->clock_offset_ns;
    if (ppb != 0)
        w->now.session_ns += (uint64_t)((int64_t)(base_ns / 1000000000u) * ppb +
                                        (int64_t)(base_ns % 1000000000u) * ppb / 1000000000);
}

/* How long to stay away after a GOODBYE. Two robots with one uid would take the session
 * from each other for ever. */
static uint64_t stay_away_ns(const struct vs_session *session)
{
    return session->notice.code == VS_BYE_TAKEN_OVER ? VS_NET_TAKEN_NS : VS_NET_RETRY_NS;
}

static void on_event(struct vs_worker *w, enum vs_event event)
{
    uint64_t now_ns = w->now.base_ns;

    vs_loop_event(&w->loop, event, &w->now);
    vs_talk_event(&w->talk, event, &w->session);
    if (event == VS_EV_REFUSED)
        vs_net_close(&w->net, &w->session, "refused", now_ns, VS_NET_REFUSED_NS);
    else if (event == VS_EV_GOODBYE)
        vs_net_close(&w->net, &w->session, "goodbye", now_ns, stay_away_ns(&w->session));
}

static void on_lost(struct vs_worker *w, enum vs_net_result result)
{
    if (result == VS_NET_NO_WAY)
        vs_report("no way to %s: %s; trying on", w->options->host, vs_trouble(w->net.trouble));
    if (result != VS_NET_LOST)
        return;
    vs_talk_lost(&w->talk, w->net.why);
    vs_loop_event(&w->loop, VS_EV_NONE, &w->now);
}

/* A datagram was there when the clock was read; what TCP has may have come since. */
static int read_net(struct vs_worker *w)
{
    if (!vs_net_read(&w->net))
        return 0;
    if (!w->net.has_datagram)
        read_clock(w);
    return 1;
}

static void serve_net(struct vs_worker *w)
{
    enum vs_event event;
    int i;

    on_lost(w, vs_net_tick(&w->net, &w->session, w->now.base_ns));
    for (i = 0; i < PACKETS_AT_ONCE && read_net(w); i++) {
        enum vs_net_result result =
            vs_net_take(&w->net, &w->session, w->now.base_ns, w->now.session_ns, &event);

        on_lost(w, result);
        if (result == VS_NET_EVENT)
            on_event(w, event);
    }
    vs_session_tick(&w->session, w->now.session_ns, &event);
    if (event != VS_EV_NONE)
        on_event(w, event);
}

static void end(struct vs_worker *w, int status, const char *why)
{
    w->ended = 1;
    w->status = status;
    w->why = status == 0 ? "the daemon was asked to end" : why;
}

/* Without a guard nobody would stop the wheels, so then that comes first. */
static int start_guard(struct vs_worker *w, int found)
{
    int why;

    if (vs_guard_link_start(&w->guard, found) == 0)
        return 0;
    why = errno;
    (void)vs_guard_link_stop_base(&w->guard);
    vs_report("cannot start the guard: %s", vs_trouble(why));
    end(w, 1, "no guard can be started");
    return -1;
}

/* 1 if this process is to end. Ctrl-C reaches both processes, the guard maybe first. */
static int told_to_end(struct vs_worker *w)
{
    struct pollfd fd = {w->signals_fd, POLLIN, 0};
    int wait_ms = w->guard.status == VS_GUARD_STOPPED ? SAME_SIGNAL_MS : 0;

    if (!w->loop.ending && poll(&fd, 1, wait_ms) > 0)
        vs_loop_end(&w->loop);
    return w->loop.ending;
}

/* The guard is dead or silent: stop the wheels, then start another, or end. */
static void replace_guard(struct vs_worker *w, const char *why)
{
    int err;

    vs_guard_link_kill(&w->guard);
    if (told_to_end(w) && w->guard.status == VS_GUARD_STOPPED) {
        end(w, 0, "");
        return;
    }
    vs_loop_guard_lost(&w->loop);
    err = vs_guard_link_stop_base(&w->guard);
    if (err == VS_OK && w->loop.ending)
        err = w->base.ops->close(&w->base);
    vs_report("the guard %s: stopped the base without it: %s", why, vs_base_trouble(err));
    if (err == VS_ERR_HANGUP)
        vs_report("the base hung up");
    if (w->loop.ending || err == VS_ERR_HANGUP) {
        end(w, err == VS_OK ? 0 : 1, err == VS_ERR_HANGUP ? GONE : MUTE);
        return;
    }
    w->guard.restarts++;
    start_guard(w, err == VS_OK);
    read_clock(w);
}

static void trace(struct vs_worker *w)
{
    int err = vs_trace_step(w->trace_fd, &w->loop);

    if (err != 0 && !w->trace_full)
        vs_report("trace: steps are missing, %s",
                  err < 0 ? vs_trouble(errno) : "its reader is too slow");
    w->trace_full = err != 0;
}

static void on_reply(struct vs_worker *w, const struct vs_guard_reply *reply)
{
    vs_talk_guard(&w->talk, reply);
    if (reply->news != NULL)
        vs_log_add(&w->loop.robot.log, reply->news);
    vs_loop_reply(&w->loop, reply, &w->now);
    if (w->loop.talk_due)
        vs_talk_unused(&w->loop.robot, vs_controller.name);
    w->loop.talk_due = 0;
    if (reply->kind == VS_GUARD_CLOSE)
        end(w, reply->result == VS_OK ? 0 : 1, MUTE);
}

static void serve_guard(struct vs_worker *w)
{
    struct vs_guard_request request;
    struct vs_guard_reply reply;
    int late, got = 0;

    if (w->late_ns > LATE_NS)
        vs_guard_link_excuse(&w->guard, w->late_ns);
    late = w->now.base_ns >= vs_guard_link_deadline_ns(&w->guard);
    if (w->guard_spoke || vs_loop_is_answered(&w->loop, &w->now) || late)
        got = vs_guard_link_receive(&w->guard, &reply);
    if (got == 1)
        on_reply(w, &reply);
    else if (got < 0)
        replace_guard(w, "has ended");
    else if (late)
        replace_guard(w, "is silent");
    if (w->ended)
        return;
    if (vs_loop_request(&w->loop, &w->now, &request)) {
        vs_guard_link_send(&w->guard, &request);
        vs_board_links_ask(&w->boards, &w->loop.command, w->now.base_ns);
    }
    if (w->loop.trace_due && w->trace_fd >= 0)
        trace(w);
    w->loop.trace_due = 0;
}

/* The host hears of a board as of what a controller logs. */
static void serve_boards(struct vs_worker *w)
{
    const char *news;

    while ((news = vs_board_links_serve(&w->boards, w->now.base_ns)) != NULL) {
        vs_report("base: %s", news);
        vs_log_add(&w->loop.robot.log, news);
    }
}

static void serve_host(struct vs_worker *w)
{
    const struct vs_instant *now = &w->now;
    struct vs_telemetry telemetry;
    enum vs_telling telling = vs_loop_telemetry(&w->loop, now, &telemetry);

    vs_talk_cause(&w->talk, vs_loop_cause(&w->loop, now), now->base_ns);
    if (telling == VS_TELL_NEWS) {
        telemetry.base_errors = w->guard.base_errors;
        telemetry.base_resets = w->base.resets;
        telemetry.guard_restarts = w->guard.restarts;
        vs_radio_tell(&w->radio, now->base_ns, &telemetry);
        (void)vs_session_telemetry(&w->session, &telemetry, now->session_ns, w->net.sent.bytes,
                                   VS_DATAGRAM_MAX, &w->net.sent_len);
    }
    if (telling != VS_TELL_NOTHING && w->net.sent_len > 0)
        vs_net_send(&w->net, vs_session_over_tcp(&w->session, now->session_ns));
    vs_net_flush(&w->net, &w->session, now->session_ns);
}

static void await(struct vs_worker *w)
{
    struct pollfd fds[FD_COUNT] = {{-1, 0, 0}};
    uint64_t wake_ns = vs_loop_wake_ns(&w->loop, &w->now);
    uint64_t other_ns = vs_net_wake_ns(&w->net);
    int boards;

    if (other_ns < wake_ns)
        wake_ns = other_ns;
    other_ns = vs_guard_link_deadline_ns(&w->guard);
    if (other_ns < wake_ns)
        wake_ns = other_ns;
    vs_net_poll(&w->net, fds + FD_NET);
    fds[FD_SIGNALS].fd = w->loop.ending ? -1 : w->signals_fd;
    fds[FD_SIGNALS].events = POLLIN;
    fds[FD_GUARD].fd = w->guard.socket;
    fds[FD_GUARD].events = vs_loop_is_patient(&w->loop, &w->now) ? 0 : POLLIN;
    boards = vs_board_links_poll(&w->boards, fds + FD_BOARDS);
    poll(fds, (nfds_t)(FD_BOARDS + boards), vs_posix_timeout_ms(w->now.base_ns, wake_ns));
    if (wake_ns < w->round_ns)
        wake_ns = w->round_ns;
    read_clock(w);
    w->round_ns = w->now.base_ns;
    w->late_ns = w->round_ns > wake_ns ? w->round_ns - wake_ns : 0;
    vs_net_polled(&w->net, fds + FD_NET);
    w->guard_spoke = fds[FD_GUARD].revents != 0;
    if (fds[FD_SIGNALS].revents)
        vs_loop_end(&w->loop);
}

/* Gives the session its identity. Returns 0, or the exit status. */
static int open_session(struct vs_worker *w)
{
    const struct vs_options *o = w->options;
    size_t name_len = strlen(vs_controller.name);
    struct vs_session_config config;

    memset(&config, 0, sizeof config);
    memcpy(config.uid, o->uid, sizeof config.uid);
    memcpy(config.key, o->key, sizeof config.key);
    config.keyed = o->keyed;
    memcpy(config.name, o->name, sizeof config.name);
    config.tag = o->tag;
    config.clock_slewed = (uint8_t)vs_posix_clock_is_slewed();
    memcpy(config.version, vsensed_version, sizeof config.version);
    memcpy(config.hash, vsensed_controller_hash, sizeof config.hash);
    if (vs_random_fill(&config.started, sizeof config.started) != 0) {
        vs_report("cannot read /dev/urandom: %s", vs_trouble(errno));
        return 1;
    }
    if (name_len <= VS_NAME_MAX)
        memcpy(config.controller, vs_controller.name, name_len);
    if (name_len <= VS_NAME_MAX && vs_controller.state_size <= VS_CONTROLLER_STATE_MAX &&
        vs_session_init(&w->session, &config) == VS_OK) {
        vs_loop_init(&w->loop, &w->session, &vs_controller, w->state.bytes);
        w->loop.calibration = &o->calibration;
        w->loop.robot.complain = vs_talk_complain;
        w->loop.battery.stop_mv = o->battery_stop_mv;
        return 0;
    }
    vs_report("controller '%s': expected a name of plain text of at most %d bytes and a state of "
              "at most %d bytes", vs_controller.name, VS_NAME_MAX, VS_CONTROLLER_STATE_MAX);
    return 2;
}

static int open_net(struct vs_worker *w)
{
    if (vs_net_open(&w->net, w->options->host, w->options->port) == 0)
        return 0;
    vs_report("--host: expected a numeric IPv4 address, got '%s'", w->options->host);
    return 2;
}

/* Opens trace, signals and base, then gives root's rights up. Returns 0, or the exit status. */
static int open_files(struct vs_worker *w)
{
    const struct vs_options *o = w->options;
    int err;

    if (o->trace != NULL && (w->trace_fd = vs_trace_open(o->trace)) < 0) {
        vs_report("cannot write %s: %s", o->trace, vs_trouble(errno));
        return 1;
    }
    if (vs_signals_open(&w->signals_fd) != 0) {
        vs_report("cannot make a pipe: %s", vs_trouble(errno));
        return 1;
    }
    err = vs_base_open(&w->base, &o->base);
    if (err != VS_OK)
        vs_report("cannot open the base %s: %s", w->base.news,
                  err == VS_ERR_IO ? vs_trouble(errno) : vs_base_trouble(err));
    else if (vs_rights_drop() != 0)
        vs_report("keeps all rights: %s", vs_trouble(errno));
    return err == VS_OK ? 0 : 1;
}

static void say_goodbye(struct vs_worker *w)
{
    vs_report("end: %s", w->why);
    if (vs_session_goodbye(&w->session, w->status ? VS_BYE_BASE : VS_BYE_END, w->why) == VS_OK)
        vs_net_finish(&w->net, &w->session, w->now.session_ns);
}

static void begin(struct vs_worker *w, const struct vs_options *options)
{
    w->options = options;
    w->trace_fd = -1;
    w->guard.base = &w->base;
    w->guard.socket = -1;
    w->guard.foreign = w->foreign;
    w->guard.foreign_count = VS_WORKER_FOREIGN;
    w->guard.argv = options->argv;
    w->guard.spare = &w->net;
    w->guard.spare_len = sizeof *w - offsetof(struct vs_worker, net);
    w->talk.cause = VS_CAUSE_NO_SESSION;
}

static void open_boards(struct vs_worker *w)
{
    int i;

    vs_board_links_init(&w->boards, &w->base, &w->loop.robot.base.boards);
    w->boards.calibration = &w->options->calibration;
    w->boards.raw = &w->loop.robot.raw;
    w->foreign[0] = &w->net.fds[0];
    w->foreign[1] = &w->net.fds[1];
    w->foreign[2] = &w->trace_fd;
    w->foreign[3] = &w->radio.socket;
    for (i = 0; i < VS_BOARDS; i++)
        w->foreign[4 + i] = &w->boards.link[i].socket;
}

int vs_worker_run(struct vs_worker *w, const struct vs_options *options)
{
    int status;

    begin(w, options);
    if ((status = open_session(w)) != 0 || (status = open_net(w)) != 0 ||
        (status = open_files(w)) != 0)
        return status;
    vs_radio_start(&w->radio, w->net.host);
    open_boards(w);
    vs_watchdog_open(options->watchdog);
    if (start_guard(w, 0) != 0)
        return w->status;
    vs_report("up: controller '%s', base %s, host %s:%u", vs_controller.name, options->base.device,
              options->host, (unsigned int)options->port);
    read_clock(w);
    w->round_ns = w->now.base_ns;
    while (!w->ended) {
        serve_net(w);
        serve_boards(w);
        serve_guard(w);
        serve_host(w);
        if (!w->ended)
            await(w);
    }
    vs_guard_link_kill(&w->guard);
    vs_watchdog_end(w->status == 0);
    say_goodbye(w);
    return w->status;
}
