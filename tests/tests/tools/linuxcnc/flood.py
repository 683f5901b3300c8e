#!/usr/bin/python3
"""Floods the port of the component for three seconds: connections, garbage, half a frame. As root, inside.

    flood.py SOCKETS

Exit code 1: the component never had that many sockets, or one that may block; or it took nothing.
"""

import os
import random
import select
import socket
import subprocess
import sys
import time

PORT = 7000
SECONDS = 3.0
NONBLOCK = 0o4000

app = subprocess.run(["pidof", "rtapi_app"], capture_output=True, text=True).stdout.split()[0]


def inodes():
    """Sockets of TCP and UDP in this network."""
    found = set()
    for name in ("tcp", "udp"):
        with open(f"/proc/{app}/net/{name}") as table:
            found |= {line.split()[9] for line in table.readlines()[1:]}
    return found


def blocking():
    """Numbers of sockets that may block, and of all."""
    ours, known = [], inodes()
    for fd in os.listdir(f"/proc/{app}/fd"):
        try:
            target = os.readlink(f"/proc/{app}/fd/{fd}")
            if target.startswith("socket:[") and target[8:-1] in known:
                with open(f"/proc/{app}/fdinfo/{fd}") as info:
                    flags = next(line for line in info if line.startswith("flags:"))
                ours.append(int(flags.split()[1], 8))
        except FileNotFoundError:
            pass
    return sum(1 for flags in ours if not flags & NONBLOCK), len(ours)


def connect(port):
    stream = socket.socket()
    stream.setblocking(False)
    stream.connect_ex(("127.0.0.1", port))
    return stream


def main():
    dice = random.Random(18)
    open_streams, sent = [], 0
    datagrams = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    datagrams.setblocking(False)
    end = time.monotonic() + SECONDS
    # Of those that send garbage a look may find none: each is closed within a period.
    quiet = [connect(PORT) for _ in range(3)]
    time.sleep(0.05)
    most = blocking()[1]
    while time.monotonic() < end:
        open_streams.append(connect(PORT))
        for stream in list(open_streams[-24:]):
            try:
                sent += stream.send(dice.choice((b"", b"GT\x02\x01\x04\x00\x00\x00")) + dice.randbytes(dice.randint(1, 4000)))
            except BlockingIOError:
                pass
            except OSError:
                stream.close()
                open_streams.remove(stream)
        for _ in range(50):
            try:
                sent += datagrams.sendto(dice.randbytes(dice.randint(0, 1400)), ("127.0.0.1", PORT))
            except OSError:
                pass
        while len(open_streams) > 200:
            open_streams.pop(0).close()
        bad, number = blocking()
        most = max(most, number)
        if bad:
            print(f"flood.py: {bad} of {number} sockets of the component may block", file=sys.stderr)
            return 1
        select.select([], [], [], 0.001)
    for stream in quiet:
        stream.close()
    print(f"flood.py: {sent} bytes; at most {most} sockets of the component", file=sys.stderr)
    return 0 if most >= int(sys.argv[1]) and sent > 10_000 else 1


sys.exit(main())
