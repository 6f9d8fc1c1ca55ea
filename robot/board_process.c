/* SPDX-License-Identifier: MIT */
#include "board_process.h"

#include <errno.h>
#include <sys/socket.h>

#include "../c_src/vs_posix.h"

/* Returns 1 if there may be another request, 0 if not. */
static int serve(int socket, struct vs_boards *boards, int board)
{
    struct vs_board_request request;
    struct vs_board_answer answer = {.news = NULL};
    ssize_t len = recv(socket, &request, sizeof request, 0);

    if (len != (ssize_t)sizeof request)
        return len < 0 && errno == EINTR;
    vs_boards_ask(boards, board, &request, vs_posix_now_ns(), &answer.news);
    answer.reading = boards->reading;
    return send(socket, &answer, sizeof answer, MSG_NOSIGNAL) == (ssize_t)sizeof answer;
}

void vs_board_process(int socket, struct vs_boards *boards, int board)
{
    static const struct vs_board_request dark;
    const char *nobody_hears = NULL;

    while (serve(socket, boards, board))
        ;
    if (board == VS_BOARD_RGB)
        vs_boards_ask(boards, board, &dark, vs_posix_now_ns(), &nobody_hears);
}
