/* SPDX-License-Identifier: MIT */
#include "net.h"

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "number.h"
#include "random.h"
#include "../c_src/vs_posix.h"

#define FINISH_NS 50000000u

enum { TCP = 0, UDP = 1 };

const char vs_net_version[] = "it speaks another version of the protocol; bring this robot its "
                              "vsensed with 'vsense robot deploy'";

static int new_socket(int type)
{
    int fd = socket(AF_INET, type, 0);

    if (fd < 0)
        return fd;
    fcntl(fd, F_SETFL, O_NONBLOCK);
    vs_posix_keep_from_children(fd);
    return fd;
}

static struct sockaddr_in address_of(const struct vs_net *net)
{
    struct sockaddr_in address;

    memset(&address, 0, sizeof address);
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = net->host;
    address.sin_port = htons(net->port);
    return address;
}

static int start_connect(const struct vs_net *net, int fd)
{
    struct sockaddr_in address = address_of(net);

    return connect(fd, (const struct sockaddr *)&address, sizeof address);
}

int vs_net_open(struct vs_net *net, const char *address, uint16_t port)
{
    memset(net, 0, offsetof(struct vs_net, datagram));
    net->fds[TCP] = -1;
    net->fds[UDP] = -1;
    if (vs_number_address(address, (uint8_t *)&net->host) != 0)
        return -1;
    net->port = port;
    net->attempt_ns = VS_NET_ATTEMPT_NS;
    net->why = "not connected yet";
    return 0;
}

static void drop(struct vs_net *net, int which)
{
    if (net->fds[which] >= 0)
        close(net->fds[which]);
    net->fds[which] = -1;
    net->readable[which] = 0;
}

void vs_net_close(struct vs_net *net, struct vs_session *session, const char *why,
                  uint64_t now_ns, uint64_t wait_ns)
{
    drop(net, TCP);
    net->phase = VS_NET_DOWN;
    net->next_ns = now_ns + wait_ns;
    net->why = why;
    net->closed = 0;
    net->in_len = net->in_pos = 0;
    net->out_len = net->out_pos = 0;
    net->newest_len = 0;
    vs_session_disconnected(session);
}

/* Returns 0, or -1 and errno. */
static int try_to_connect(struct vs_net *net, uint64_t now_ns)
{
    int on = 1;
    int why;

    net->next_ns = now_ns + VS_NET_RETRY_NS;
    if (net->fds[UDP] < 0)
        net->fds[UDP] = new_socket(SOCK_DGRAM);
    net->fds[TCP] = new_socket(SOCK_STREAM);
    if (net->fds[UDP] >= 0 && net->fds[TCP] >= 0) {
        setsockopt(net->fds[TCP], IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
        if (start_connect(net, net->fds[TCP]) == 0 || errno == EINPROGRESS) {
            net->phase = VS_NET_CONNECTING;
            net->next_ns = now_ns + net->attempt_ns;
            net->trouble = 0;
            return 0;
        }
    }
    why = errno;
    drop(net, TCP);
    errno = why;
    return -1;
}

/* 1: connected, 0: not yet, -1: it failed. */
static int is_connected(const struct vs_net *net)
{
    struct pollfd fd = {net->fds[TCP], POLLOUT, 0};
    int error = 0;
    socklen_t len = sizeof error;

    if (poll(&fd, 1, 0) <= 0)
        return 0;
    if (getsockopt(net->fds[TCP], SOL_SOCKET, SO_ERROR, &error, &len) != 0 || error != 0)
        return -1;
    return 1;
}

static void connecting(struct vs_net *net, struct vs_session *session, uint64_t now_ns)
{
    uint8_t nonce[VS_NONCE_SIZE];
    int connected = is_connected(net);

    if (connected == 1 && vs_random_fill(nonce, sizeof nonce) != 0) {
        vs_net_close(net, session, "/dev/urandom cannot be read", now_ns, VS_NET_RETRY_NS);
    } else if (connected == 1) {
        net->phase = VS_NET_UP;
        net->attempt_ns = VS_NET_ATTEMPT_NS;
        net->heard_ns = now_ns;
        /* The clock counts from the board's start. */
        vs_session_connected(session, nonce, (uint32_t)(now_ns / 1000000000u));
    } else if (connected < 0 || now_ns >= net->next_ns) {
        if (connected == 0) {
            net->attempt_ns *= 2;
            if (net->attempt_ns > VS_NET_LONGEST_NS)
                net->attempt_ns = VS_NET_LONGEST_NS;
        }
        vs_net_close(net, session, net->why, now_ns, VS_NET_RETRY_NS);
    }
}

enum vs_net_result vs_net_tick(struct vs_net *net, struct vs_session *session,
                               uint64_t now_ns)
{
    if (net->phase == VS_NET_DOWN && now_ns >= net->next_ns &&
        try_to_connect(net, now_ns) != 0 && net->trouble != errno) {
        net->trouble = errno;
        return VS_NET_NO_WAY;
    }
    if (net->phase == VS_NET_CONNECTING)
        connecting(net, session, now_ns);
    if (net->phase == VS_NET_UP && now_ns - net->heard_ns >= VS_NET_SILENCE_NS) {
        vs_net_close(net, session, "the host is silent", now_ns, VS_NET_RETRY_NS);
        return VS_NET_LOST;
    }
    return VS_NET_NOTHING;
}

/* 1, once, if poll() said so. */
static int is_readable(struct vs_net *net, int which)
{
    int readable = net->readable[which];

    net->readable[which] = 0;
    return readable;
}

static int read_datagram(struct vs_net *net)
{
    struct sockaddr_in from;
    socklen_t size = sizeof from;
    ssize_t len;

    if (!is_readable(net, UDP))
        return 0;
    len = recvfrom(net->fds[UDP], net->datagram.bytes, sizeof net->datagram.bytes, 0,
                   (struct sockaddr *)&from, &size);
    net->has_datagram =
        len >= 0 && from.sin_addr.s_addr == net->host && from.sin_port == htons(net->port);
    net->datagram_len = net->has_datagram ? (size_t)len : 0;
    return net->has_datagram;
}

static int read_stream(struct vs_net *net)
{
    ssize_t len;

    if (net->phase != VS_NET_UP)
        return 0;
    if (net->in_pos < net->in_len)
        return 1;
    if (!is_readable(net, TCP))
        return 0;
    len = recv(net->fds[TCP], net->in, sizeof net->in, 0);
    if (len < 0 && (errno == EAGAIN || errno == EINTR))
        return 0;
    net->closed = len <= 0;
    net->in_pos = 0;
    net->in_len = len > 0 ? (size_t)len : 0;
    return 1;
}

int vs_net_read(struct vs_net *net)
{
    return read_datagram(net) || read_stream(net);
}

static void take_datagram(struct vs_net *net, struct vs_session *session, uint64_t now_ns,
                          uint64_t session_ns, enum vs_event *event)
{
    net->has_datagram = 0;
    if (vs_session_udp_in(session, net->datagram.bytes, net->datagram_len, session_ns,
                          event) == VS_OK)
        net->heard_ns = now_ns;
}

enum vs_net_result vs_net_take(struct vs_net *net, struct vs_session *session,
                               uint64_t now_ns, uint64_t session_ns, enum vs_event *event)
{
    size_t used;
    int err;

    *event = VS_EV_NONE;
    if (net->has_datagram) {
        take_datagram(net, session, now_ns, session_ns, event);
        return VS_NET_EVENT;
    }
    if (net->closed) {
        vs_net_close(net, session, "the host closed it", now_ns, VS_NET_RETRY_NS);
        return VS_NET_LOST;
    }
    err = vs_session_tcp_in(session, net->in + net->in_pos, net->in_len - net->in_pos,
                            session_ns, &used, event);
    if (err != VS_OK) {
        vs_net_close(net, session, err == VS_ERR_VERSION ? vs_net_version
                     : "the host broke the protocol", now_ns, VS_NET_REFUSED_NS);
        return VS_NET_LOST;
    }
    net->in_pos += used;
    if (*event != VS_EV_NONE && *event != VS_EV_DOUBTED)
        net->heard_ns = now_ns;
    return VS_NET_EVENT;
}

void vs_net_send(struct vs_net *net, int over_tcp)
{
    struct sockaddr_in host = address_of(net);

    /* a datagram that the system does not take is a lost one */
    (void)sendto(net->fds[UDP], net->sent.bytes, net->sent_len, MSG_NOSIGNAL,
                 (const struct sockaddr *)&host, sizeof host);
    if (over_tcp && net->phase == VS_NET_UP) {
        memcpy(net->newest, net->sent.bytes, net->sent_len);
        net->newest_len = net->sent_len;
    }
}

/* Puts the next packet into out. Returns 1 if there is one. */
static int next_packet(struct vs_net *net, struct vs_session *session, uint64_t session_ns)
{
    net->out_pos = 0;
    if (vs_session_tcp_out(session, net->out, sizeof net->out, session_ns, &net->out_len) != VS_OK)
        net->out_len = 0;
    if (net->out_len == 0 && net->newest_len > 0) {
        memcpy(net->out, net->newest, net->newest_len);
        net->out_len = net->newest_len;
        net->newest_len = 0;
    }
    return net->out_len > 0;
}

void vs_net_flush(struct vs_net *net, struct vs_session *session, uint64_t session_ns)
{
    while (net->phase == VS_NET_UP) {
        ssize_t len;

        if (net->out_pos == net->out_len && !next_packet(net, session, session_ns))
            return;
        len = send(net->fds[TCP], net->out + net->out_pos, net->out_len - net->out_pos,
                   MSG_NOSIGNAL);
        if (len <= 0)
            return; /* full: poll says when; broken: reading says so */
        net->out_pos += (size_t)len;
    }
}

void vs_net_finish(struct vs_net *net, struct vs_session *session, uint64_t session_ns)
{
    struct pollfd fd = {net->fds[TCP], POLLIN, 0};
    uint64_t now_ns = vs_posix_now_ns();
    uint64_t until_ns = now_ns + FINISH_NS;

    if (net->phase != VS_NET_UP)
        return;
    net->newest_len = 0;
    vs_net_flush(net, session, session_ns);
    /* closing with unread bytes would reset the connection and lose the goodbye */
    shutdown(net->fds[TCP], SHUT_WR);
    while (now_ns < until_ns && poll(&fd, 1, vs_posix_timeout_ms(now_ns, until_ns)) > 0 &&
           recv(net->fds[TCP], net->in, sizeof net->in, 0) > 0)
        now_ns = vs_posix_now_ns();
}

void vs_net_poll(const struct vs_net *net, struct pollfd fds[2])
{
    fds[TCP].fd = net->fds[TCP];
    fds[TCP].events = POLLIN;
    if (net->phase == VS_NET_CONNECTING || net->out_pos < net->out_len)
        fds[TCP].events |= POLLOUT;
    fds[UDP].fd = net->fds[UDP];
    fds[UDP].events = POLLIN;
}

void vs_net_polled(struct vs_net *net, const struct pollfd fds[2])
{
    net->readable[TCP] = fds[TCP].revents != 0;
    net->readable[UDP] = fds[UDP].revents != 0;
}

uint64_t vs_net_wake_ns(const struct vs_net *net)
{
    return net->phase == VS_NET_UP ? net->heard_ns + VS_NET_SILENCE_NS : net->next_ns;
}
