/* SPDX-License-Identifier: MIT */
#include "board_link.h"

#include <errno.h>
#include <signal.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include "signals.h"
#include "../c_src/vs_format.h"
#include "../c_src/vs_posix.h"

#define NEWS_MAX 100 /* [byte] */

static const char hangs[] = "bus hangs: going on without this board";
static const char moves[] = "bus moves again";
static const char ended[] = "process ended: starting another";

/* News of a board, until the next ones. */
static const char *tell(int board, const char *what)
{
    static const char *const whose[VS_BOARDS] = {"ground sensors'", "range-and-bearing board's",
                                                 "battery's converter's", "RGB LEDs'", "IMU's"};
    static char news[NEWS_MAX];

    vs_format(news, sizeof news, "the %s %s", whose[board], what);
    return news;
}

void vs_board_links_init(struct vs_board_links *links, struct vs_base *base,
                         struct vs_board_reading *reading)
{
    int i;

    memset(links, 0, sizeof *links);
    links->base = base;
    links->reading = reading;
    *reading = base->boards.reading;
    for (i = 0; i < VS_BOARDS; i++)
        links->link[i].socket = -1;
    links->end = reading->there != 0 ? VS_BOARDS : 0;
}

/* In the child: what it held open would be locked, or another program's, as long as the board
 * hangs. */
static void become_board(struct vs_board_links *links, int board, int socket)
{
    struct vs_boards *boards = &links->base->boards;

    vs_posix_close_but(socket, *(const int *)boards->bus[board].context);
    vs_signals_ignore();
    vs_signals_unblock();
    boards->reading = *links->reading; /* messages are counted on */
    vs_board_process(socket, boards, board);
    _exit(0);
}

static void start(struct vs_board_links *links, int board, uint64_t now_ns)
{
    struct vs_board_link *link = &links->link[board];
    int socket;
    long pid = vs_signals_fork(&socket);

    link->again_ns = now_ns + VS_BOARD_AGAIN_NS;
    if (pid == 0)
        become_board(links, board, socket);
    if (pid < 0)
        return;
    link->pid = pid;
    link->socket = socket;
    link->waiting = 0;
    link->hangs = 0;
}

/* Its end of the socket is closed: it has ended, or is about to. */
static const char *give_up(struct vs_board_links *links, int board, uint64_t now_ns)
{
    struct vs_board_link *link = &links->link[board];

    close(link->socket);
    link->socket = -1;
    link->again_ns = now_ns + VS_BOARD_AGAIN_NS;
    vs_boards_lose(links->reading, board);
    return tell(board, ended);
}

/* One that a driver holds may die at any later time. */
static void bury(struct vs_board_link *link)
{
    if (link->pid != 0 && link->socket < 0 && waitpid((pid_t)link->pid, NULL, WNOHANG) != 0)
        link->pid = 0;
}

/* Nothing came. */
static const char *wait_on(struct vs_board_links *links, int board, uint64_t now_ns)
{
    struct vs_board_link *link = &links->link[board];

    if (!link->waiting || now_ns < link->asked_ns + VS_BOARD_HANGS_NS)
        return NULL;
    if (now_ns >= link->asked_ns + VS_BOARD_KILL_NS)
        kill((pid_t)link->pid, SIGKILL);
    if (link->hangs)
        return NULL;
    link->hangs = 1;
    vs_boards_lose(links->reading, board);
    return tell(board, hangs);
}

static const char *serve(struct vs_board_links *links, int board, uint64_t now_ns)
{
    struct vs_board_link *link = &links->link[board];
    struct vs_board_answer answer;
    ssize_t len;

    bury(link);
    if (link->pid == 0 && now_ns >= link->again_ns)
        start(links, board, now_ns);
    if (link->socket < 0 || !link->waiting)
        return NULL;
    len = recv(link->socket, &answer, sizeof answer, MSG_DONTWAIT);
    if (len < 0 && (errno == EAGAIN || errno == EINTR))
        return wait_on(links, board, now_ns);
    if (len != (ssize_t)sizeof answer)
        return give_up(links, board, now_ns);
    link->waiting = 0;
    if (board == VS_BOARD_GROUND && links->calibration != NULL && !*links->raw)
        vs_calibration_sense_ground(links->calibration, answer.reading.ground);
    vs_boards_take(links->reading, &answer.reading, board);
    if (answer.news == NULL && link->hangs)
        answer.news = tell(board, moves);
    link->hangs = 0;
    return answer.news;
}

const char *vs_board_links_serve(struct vs_board_links *links, uint64_t now_ns)
{
    const char *news = NULL;
    int i;

    for (i = 0; i < links->end && news == NULL; i++)
        if (links->base->boards.bus[i].transfer != NULL)
            news = serve(links, i, now_ns);
    return news;
}

int vs_board_links_poll(const struct vs_board_links *links, struct pollfd *fds)
{
    int i;

    for (i = 0; i < links->end; i++) {
        fds[i].fd = links->link[i].waiting ? links->link[i].socket : -1;
        fds[i].events = POLLIN;
    }
    return links->end;
}

/* 1 if the RGB LEDs show these colours: no need to ask them, and to wake up for the answer. */
static int is_shown(const struct vs_board_links *links, const struct vs_board_request *request)
{
    return links->reading->has[VS_BOARD_RGB] &&
           memcmp(links->rgb, request->rgb, sizeof links->rgb) == 0;
}

void vs_board_links_ask(struct vs_board_links *links, const struct vs_base_command *command,
                        uint64_t now_ns)
{
    struct vs_board_request request;
    int i;

    if (links->end == 0)
        return;
    request.message = command->message;
    memcpy(request.rgb, command->rgb, sizeof request.rgb);
    for (i = 0; i < links->end; i++) {
        struct vs_board_link *link = &links->link[i];

        if (link->socket < 0 || link->waiting)
            continue;
        if (i == VS_BOARD_RGB) {
            if (is_shown(links, &request))
                continue;
            memcpy(links->rgb, request.rgb, sizeof links->rgb);
        }
        link->waiting = 1;
        link->asked_ns = now_ns;
        /* what cannot be sent is not answered, and that is noticed */
        (void)send(link->socket, &request, sizeof request, MSG_NOSIGNAL | MSG_DONTWAIT);
    }
}
