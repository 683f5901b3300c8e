/* The client's side of the wire (wire.md), as far as the example needs it: frames to send, and numbers from received ones. */
#ifndef EXAMPLE_WIRE_H
#define EXAMPLE_WIRE_H

#include <stddef.h>
#include <stdint.h>

enum { WELCOME = 2, STATE = 4, SUBMIT = 1, OBTAIN = 2, MAX_FRAME = 128, WIRE_HEADER = 8 };

typedef struct {
    uint8_t bytes[MAX_FRAME];
    size_t length;
} wire_frame;

static void wire_put(wire_frame *frame, uint64_t value, int bytes)
{
    for (int i = 0; i < bytes; i++) {
        frame->bytes[frame->length++] = (uint8_t)(value >> (8 * i));
    }
}

static uint64_t wire_get(const uint8_t *bytes, int count)
{
    uint64_t value = 0;
    for (int i = 0; i < count; i++) {
        value |= (uint64_t)bytes[i] << (8 * i);
    }
    return value;
}

static uint32_t wire_crc(const uint8_t *bytes, size_t length)
{
    uint32_t crc = 0xFFFFFFFFu;
    for (size_t i = 0; i < length; i++) {
        crc ^= bytes[i];
        for (int bit = 0; bit < 8; bit++) {
            crc = (crc >> 1) ^ (0xEDB88320u & (0u - (crc & 1u)));
        }
    }
    return ~crc;
}

static void wire_begin(wire_frame *frame, uint8_t kind)
{
    frame->length = 0;
    wire_put(frame, 0x5447, 2); /* "GT" */
    wire_put(frame, 2, 1);      /* version */
    wire_put(frame, kind, 1);
    wire_put(frame, 0, 2); /* length: wire_end */
    wire_put(frame, 0, 2); /* suite: a checksum */
}

static void wire_end(wire_frame *frame)
{
    const size_t body = frame->length - WIRE_HEADER;
    frame->bytes[4] = (uint8_t)body;
    frame->bytes[5] = (uint8_t)(body >> 8);
    wire_put(frame, wire_crc(frame->bytes, frame->length), 4);
}

/* Requests a session. */
static void wire_hello(wire_frame *frame, uint8_t axes)
{
    wire_begin(frame, 1);
    wire_put(frame, axes, 1);
    wire_put(frame, 0, 1); /* reserved */
    wire_put(frame, 0, 2); /* capabilities */
    wire_end(frame);
}

/* Answers the State of tick `echo`, with position offsets as targets. */
static void wire_command(wire_frame *frame, uint64_t epoch, uint64_t sequence, uint64_t echo,
                         uint8_t mode, uint8_t axes, const int32_t *position_nm)
{
    wire_begin(frame, 3);
    wire_put(frame, epoch, 8);
    wire_put(frame, sequence, 8);
    wire_put(frame, echo, 8);
    wire_put(frame, mode, 1);
    wire_put(frame, axes, 1);
    wire_put(frame, 0, 2); /* reserved */
    for (int axis = 0; axis < axes; axis++) {
        wire_put(frame, (uint32_t)position_nm[axis], 4);
        wire_put(frame, 0, 4); /* velocity */
        wire_put(frame, 0, 2); /* torque */
    }
    wire_end(frame);
}

#endif
