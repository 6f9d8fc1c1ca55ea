/* SPDX-License-Identifier: MIT */
#include "board_process.h"

#include <errno.h>
#include <sys/socket.h>

#include "../c_src/vs_posix.h"

#define TALKS 8 /* at the most before an answer: its queue may never be empty */

static void ask_board(struct vs_boards *boards, int board, const struct vs_board_message *message,
                      const char **news)
{
    uint64_t now_ns = vs_posix_now_ns();
    int i = 0;

    if (board == VS_BOARD_GROUND) {
        vs_boards_read_ground(boards, now_ns + VS_BOARD_READ_NS, news);
        return;
    }
    if (board == VS_BOARD_BATTERY) {
        vs_boards_read_battery(boards, now_ns + VS_BOARD_READ_NS, news);
        return;
    }
    while (vs_boards_talk(boards, message, now_ns + VS_BOARD_TALK_NS, news) && ++i < TALKS)
        now_ns = vs_posix_now_ns();
}

void vs_board_process(int socket, struct vs_boards *boards, int board)
{
    for (;;) {
        struct vs_board_request request;
        struct vs_board_answer answer = {.news = NULL};
        ssize_t len = recv(socket, &request, sizeof request, 0);

        if (len < 0 && errno == EINTR)
            continue;
        if (len != (ssize_t)sizeof request)
            return;
        ask_board(boards, board, &request.message, &answer.news);
        answer.reading = boards->reading;
        if (send(socket, &answer, sizeof answer, MSG_NOSIGNAL) != (ssize_t)sizeof answer)
            return;
    }
}
