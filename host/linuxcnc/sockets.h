/*
 * Sockets of the server inside a realtime thread: opened at load, non-blocking, a fixed number, no allocation.
 *
 * One object per process; IPv4. All functions but sockets_open and sockets_shut are called from the thread, and their work is bounded.
 */
#ifndef GANTRY_TAU_SOCKETS_H
#define GANTRY_TAU_SOCKETS_H

#include <stddef.h>
#include <stdint.h>

#include "gantry_tau.h"

/* Listens for clients on `port` (TCP, or UDP if `udp` is not 0). Returns 0, or -1 with one sentence in `error`; nothing is then open. */
int sockets_open(const char *address, int port, int udp, char *error, size_t size);

/* Closes every socket. */
void sockets_shut(void);

/* Accepts new peers and feeds what has arrived to the server. When all places are taken, the connection of gt_server_longest_idle makes room. */
void sockets_receive(gt_server *server);

/* Writes a whole frame, or takes note that its connection is lost. Does not wait. */
void sockets_send(const gt_frame *frame);

/* Closes a connection. */
void sockets_close(uint64_t connection);

/* Waits until a connection has bytes to read, at most `timeout_ns`. For lock-step only. */
void sockets_wait(uint64_t connection, long timeout_ns);

#endif
