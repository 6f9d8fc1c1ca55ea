/* SPDX-License-Identifier: MIT */
#include "talk.h"

#include <string.h>

#include "guard_rights.h"
#include "report.h"

static void opened(struct vs_talk *talk, const struct vs_session *session)
{
    talk->connected = 1;
    talk->refusal[0] = '\0';
    vs_report("connected: %u sensors, %u actuators, timestep %lu ms",
              (unsigned int)session->table.sensors, (unsigned int)session->table.actuators,
              (unsigned long)(session->timestep_ns / 1000000u));
}

/* A host that refuses is asked again each second, and mostly gives the same reason. */
static void refused(struct vs_talk *talk, const char *why)
{
    if (strcmp(talk->refusal, why) == 0)
        return;
    memcpy(talk->refusal, why, strlen(why) + 1);
    vs_report("the host refuses: %s; trying on", why);
}

/* Anybody may have said it, and it changes nothing. */
static void doubted(struct vs_talk *talk, const struct vs_session *session)
{
    const char *why = session->open ? "goodbye" : session->notice.text;

    if (strcmp(talk->refusal, why) == 0)
        return;
    memcpy(talk->refusal, why, strlen(why) + 1);
    if (session->open) {
        vs_report("somebody without this session's key ends it in the host's name; going on");
        return;
    }
    vs_report("a host that does not know this robot's key refuses: %s; bring the key again with "
              "'vsense robot deploy'", why);
}

static void dismissed(struct vs_talk *talk, const struct vs_session *session)
{
    vs_talk_lost(talk, session->notice.text);
    if (session->notice.code == VS_BYE_TAKEN_OVER)
        vs_report("another robot has the same uid: give each its own with --uid");
}

void vs_talk_event(struct vs_talk *talk, enum vs_event event, const struct vs_session *session)
{
    if (event == VS_EV_OPEN)
        opened(talk, session);
    else if (event == VS_EV_REFUSED)
        refused(talk, session->notice.text);
    else if (event == VS_EV_DOUBTED)
        doubted(talk, session);
    else if (event == VS_EV_GOODBYE)
        dismissed(talk, session);
    else if (event == VS_EV_UDP_LOST)
        vs_report("no UDP from the host for 1 s: going on over TCP");
    else if (event == VS_EV_UDP_UP)
        vs_report("UDP is back");
}

void vs_talk_lost(struct vs_talk *talk, const char *why)
{
    if (why == vs_net_version)
        refused(talk, why);
    else if (talk->connected)
        vs_report("connection lost: %s; trying on", why);
    talk->connected = 0;
}

void vs_talk_unused(const struct vs_robot *robot, const char *controller)
{
    const struct vs_table *table = &robot->session->table;
    const char *param = NULL;
    uint32_t i;

    for (i = 0; i < table->count; i++)
        if ((robot->bound >> i & 1u) == 0)
            vs_report("controller '%s' does not know '%s': ignored", controller,
                      table->entries[i].name);
    while ((param = vs_robot_unasked_param(robot, param)) != NULL)
        vs_report("controller '%s' does not know the parameter '%.*s': ignored", controller,
                  (int)strcspn(param, "="), param);
}

void vs_talk_complain(void *context, const char *what, const char *name)
{
    (void)context;
    vs_report("controller '%s': %s '%s'", vs_controller.name, what, name);
}

void vs_talk_guard(struct vs_talk *talk, const struct vs_guard_reply *reply)
{
    char text[VS_RIGHTS_TEXT];

    if (reply->news != NULL)
        vs_report("base: %s", reply->news);
    if ((reply->refused & ~talk->refused) != 0) {
        vs_rights_text(reply->refused, text);
        vs_report("the guard runs %s: the system refuses; run vsensed as root", text);
    }
    talk->refused |= reply->refused;
}

static const char *cause_text(enum vs_stop_cause cause)
{
    static const char *const texts[] = {
        "wheels free",
        "wheels held: the host wants no run now",
        "wheels held: no session with the host",
        "wheels held: nothing fresh from the host for 400 ms",
        "wheels held: no completed control step for 250 ms",
        "wheels held: the base does not answer",
        "wheels held: the guard was replaced",
        "wheels held: the daemon ends",
        "wheels held: the battery is empty",
    };

    return texts[cause < sizeof texts / sizeof texts[0] ? cause : VS_CAUSE_BASE];
}

void vs_talk_cause(struct vs_talk *talk, enum vs_stop_cause cause, uint64_t now_ns)
{
    int starting = !talk->free && (cause == VS_CAUSE_BASE || cause == VS_CAUSE_STALE);

    if (!starting)
        talk->since_ns = now_ns;
    if (cause == talk->cause || (starting && now_ns - talk->since_ns < VS_TALK_PATIENCE_NS))
        return;
    talk->cause = (uint8_t)cause;
    talk->free |= cause == VS_CAUSE_NONE;
    vs_report("%s", cause_text(cause));
}
