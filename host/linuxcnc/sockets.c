/* Sockets of the server inside a realtime thread (sockets.h). As host/server/src/server/connections has them. */
#include "sockets.h"

#include <arpa/inet.h>
#include <errno.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

enum {
    CLOSED = -1,
    BACKLOG = 16,
    /* Bytes taken from one connection at a time. */
    CHUNK = 1024,
    /* Reads from one stream per visit: more than the owner's frames of a tick, and a bound on the work a flood can cause. */
    STREAM_READS = 4,
    /* Datagrams taken per visit: more than the budgets of all peers. */
    DATAGRAM_READS = 64,
    /* New connections accepted per visit. */
    ACCEPTS = 2
};

/* A peer that the server knows. A stream has a socket of its own, a sender of datagrams an address. */
struct peer {
    int is_open;
    /* A write failed or the peer closed; the server is told in the next visit. */
    int is_gone;
    int socket;
    uint64_t connection;
    struct sockaddr_in address;
};

static int uses_datagrams;
static int listener = CLOSED;
static struct peer peers[GT_MAX_CONNECTIONS];

static void shut(int *socket)
{
    if (*socket != CLOSED) {
        close(*socket);
    }
    *socket = CLOSED;
}

/* Binds a socket, and lets a stream listen. Returns it, or CLOSED with errno. */
static int bind_to(const struct sockaddr_in *at, int type)
{
    const int yes = 1;
    int bound = socket(AF_INET, type | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    /* Of a stream alone: two sockets could share a port of datagrams. */
    const int is_stream = type == SOCK_STREAM;

    if (bound == CLOSED) {
        return CLOSED;
    }
    if ((is_stream && setsockopt(bound, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes) != 0) ||
        bind(bound, (const struct sockaddr *)at, sizeof *at) != 0 || (is_stream && listen(bound, BACKLOG) != 0)) {
        const int reason = errno;
        shut(&bound);
        errno = reason;
    }
    return bound;
}

int sockets_open(const char *address, int port, int udp, char *error, size_t size)
{
    struct sockaddr_in place;
    uses_datagrams = udp;
    memset(&place, 0, sizeof place);
    place.sin_family = AF_INET;
    place.sin_port = htons((uint16_t)port);
    if (port < 1 || port > 65535) {
        snprintf(error, size, "port=%d is not a port, 1 to 65535", port);
        return -1;
    }
    if (inet_pton(AF_INET, address, &place.sin_addr) != 1) {
        snprintf(error, size, "address=%s is not an IPv4 address, such as 127.0.0.1", address);
        return -1;
    }
    listener = bind_to(&place, udp ? SOCK_DGRAM : SOCK_STREAM);
    if (listener == CLOSED) {
        snprintf(error, size, "cannot listen on %s:%d: %s", address, port, strerror(errno));
        return -1;
    }
    return 0;
}

static void forget(struct peer *peer)
{
    if (!uses_datagrams) {
        shut(&peer->socket);
    }
    peer->is_open = 0;
}

void sockets_shut(void)
{
    for (int i = 0; i < GT_MAX_CONNECTIONS; i++) {
        if (peers[i].is_open) {
            forget(&peers[i]);
        }
    }
    shut(&listener);
}

static struct peer *find(uint64_t connection)
{
    for (int i = 0; i < GT_MAX_CONNECTIONS; i++) {
        if (peers[i].is_open && peers[i].connection == connection) {
            return &peers[i];
        }
    }
    return NULL;
}

/* Returns a free place; NULL if there is none. */
static struct peer *free_place(void)
{
    for (int i = 0; i < GT_MAX_CONNECTIONS; i++) {
        if (!peers[i].is_open) {
            return &peers[i];
        }
    }
    return NULL;
}

static void seat(struct peer *peer, uint64_t connection)
{
    peer->connection = connection;
    peer->is_open = 1;
    peer->is_gone = 0;
}

/* Registers a new stream with the server. Returns it; NULL if there is no room. */
static struct peer *enter(gt_server *server)
{
    struct peer *peer = free_place();
    uint64_t connection;
    if (peer == NULL || gt_server_open(server, GT_TRANSPORT_STREAM, &connection) != GT_CODE_OK) {
        return NULL;
    }
    seat(peer, connection);
    return peer;
}

static int is_usable(int stream)
{
    const int yes = 1;
    return setsockopt(stream, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes) == 0;
}

/* Best effort: the peer is about to be closed anyway. */
static void refuse(int stream)
{
    gt_frame refusal;
    if (gt_server_refusal(GT_TRANSPORT_STREAM, &refusal) == GT_CODE_OK) {
        (void)send(stream, refusal.bytes, refusal.length, MSG_NOSIGNAL);
    }
}

/* Refuses and closes the stream that is to make room. Returns 0, or -1 without one. */
static int close_longest_idle(gt_server *server)
{
    uint64_t connection;
    struct peer *idle = NULL;
    if (gt_server_longest_idle(server, &connection) == GT_CODE_OK) {
        idle = find(connection);
    }
    if (idle == NULL) {
        return -1;
    }
    refuse(idle->socket);
    gt_server_close(server, connection);
    forget(idle);
    return 0;
}

static void accept_streams(gt_server *server)
{
    for (int i = 0; i < ACCEPTS; i++) {
        struct peer *peer;
        int stream = accept4(listener, NULL, NULL, SOCK_NONBLOCK | SOCK_CLOEXEC);
        if (stream == CLOSED) {
            return;
        }
        if (!is_usable(stream)) {
            shut(&stream);
            continue;
        }
        peer = enter(server);
        if (peer == NULL && close_longest_idle(server) == 0) {
            peer = enter(server);
        }
        if (peer != NULL) {
            peer->socket = stream;
            continue;
        }
        refuse(stream);
        shut(&stream);
    }
}

static void read_stream(gt_server *server, struct peer *peer)
{
    uint8_t bytes[CHUNK];
    for (int i = 0; i < STREAM_READS && !peer->is_gone; i++) {
        const ssize_t count = recv(peer->socket, bytes, sizeof bytes, 0);
        if (count > 0) {
            gt_server_feed(server, peer->connection, bytes, (size_t)count, NULL);
        } else if (count == 0 || (errno != EAGAIN && errno != EWOULDBLOCK && errno != EINTR)) {
            peer->is_gone = 1;
        } else if (errno != EINTR) {
            return;
        }
    }
}

static void receive_streams(gt_server *server)
{
    accept_streams(server);
    for (int i = 0; i < GT_MAX_CONNECTIONS; i++) {
        struct peer *peer = &peers[i];
        if (peer->is_open) {
            read_stream(server, peer);
        }
        if (peer->is_open && peer->is_gone) {
            gt_server_close(server, peer->connection);
            forget(peer);
        }
    }
}

static struct peer *sender(const struct sockaddr_in *from)
{
    for (int i = 0; i < GT_MAX_CONNECTIONS; i++) {
        const struct sockaddr_in *known = &peers[i].address;
        if (peers[i].is_open && known->sin_port == from->sin_port && known->sin_addr.s_addr == from->sin_addr.s_addr) {
            return &peers[i];
        }
    }
    return NULL;
}

/* Address and port as gt_server_greet takes them: IPv4 as it is mapped into IPv6. */
static void octets(const struct sockaddr_in *from, uint8_t peer[GT_PEER])
{
    memset(peer, 0, GT_PEER);
    peer[10] = peer[11] = 0xff;
    memcpy(peer + 12, &from->sin_addr.s_addr, 4);
    memcpy(peer + 16, &from->sin_port, 2);
}

/* Takes a datagram of a peer without a connection. */
static void greet(gt_server *server, const struct sockaddr_in *from, const uint8_t *bytes, size_t length)
{
    static gt_greeting greeting;
    uint8_t address[GT_PEER];
    struct peer *peer = free_place();
    octets(from, address);
    if (gt_server_greet(server, address, bytes, length, &greeting) != GT_CODE_OK) {
        return;
    }
    if (greeting.what == GT_GREETED_ANSWER) {
        (void)sendto(listener, greeting.frame.bytes, greeting.frame.length, 0, (const struct sockaddr *)from, sizeof *from);
    } else if (greeting.what == GT_GREETED_PEER && peer != NULL) {
        seat(peer, greeting.frame.connection);
        peer->address = *from;
        peer->socket = listener;
    }
}

static void receive_datagrams(gt_server *server)
{
    /* A datagram longer than any frame is cut, and then has the wrong length. */
    uint8_t bytes[GT_MAX_FRAME + 1];
    for (int i = 0; i < DATAGRAM_READS; i++) {
        struct sockaddr_in from;
        struct peer *peer;
        socklen_t size = sizeof from;
        const ssize_t count = recvfrom(listener, bytes, sizeof bytes, 0, (struct sockaddr *)&from, &size);
        if (count < 0) {
            if (errno == EAGAIN || errno == EWOULDBLOCK) {
                return;
            }
            continue; /* an error of an earlier datagram: a peer's port is closed */
        }
        peer = sender(&from);
        if (peer == NULL) {
            greet(server, &from, bytes, (size_t)count);
        } else {
            gt_server_feed(server, peer->connection, bytes, (size_t)count, NULL);
        }
    }
}

void sockets_receive(gt_server *server)
{
    if (uses_datagrams) {
        receive_datagrams(server);
    } else {
        receive_streams(server);
    }
}

void sockets_send(const gt_frame *frame)
{
    struct peer *peer = find(frame->connection);
    if (peer == NULL || peer->is_gone) {
        return;
    }
    if (uses_datagrams) {
        /* One that the system does not take is lost, like any other on its way. */
        (void)sendto(listener, frame->bytes, frame->length, 0, (const struct sockaddr *)&peer->address, sizeof peer->address);
    } else if (send(peer->socket, frame->bytes, frame->length, MSG_NOSIGNAL) != (ssize_t)frame->length) {
        peer->is_gone = 1;
    }
}

void sockets_close(uint64_t connection)
{
    struct peer *peer = find(connection);
    if (peer != NULL) {
        forget(peer);
    }
}

void sockets_wait(uint64_t connection, long timeout_ns)
{
    const struct timespec timeout = {.tv_nsec = timeout_ns};
    struct peer *peer = find(connection);
    struct pollfd readable = {.fd = peer == NULL ? CLOSED : peer->socket, .events = POLLIN};
    (void)ppoll(&readable, 1, &timeout, NULL);
}
