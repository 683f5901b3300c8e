"""Reads encoder terminals and a force sensor with SOEM, another MainDevice; prints their bytes as JSON."""

import json
import struct
import sys
import time

import pysoem

master = pysoem.Master()
master.open(sys.argv[1])
found = master.config_init()
master.state_check(pysoem.PREOP_STATE, 2_000_000)
_, wide, narrow, sensor = master.slaves


def assign(slave):
    """The counter of 32 bits."""
    for assignment, pdo in ((0x1C12, 0x1603), (0x1C13, 0x1A04)):
        slave.sdo_write(assignment, 0, bytes(1))
        slave.sdo_write(assignment, 1, struct.pack("<H", pdo))
        slave.sdo_write(assignment, 0, bytes([1]))


wide.config_func = lambda *_: assign(wide)
units = [struct.unpack("<i", sensor.sdo_read(0x2040, sub))[0] for sub in (0x31, 0x32)]
size = master.config_map()
safe_op = master.state_check(pysoem.SAFEOP_STATE, 2_000_000)
sensor.output = struct.pack("<II", 2 << 8, 0)
master.send_processdata()
master.receive_processdata(100_000)
master.state = pysoem.OP_STATE
master.write_state()
until = time.monotonic() + 20
state = 0
while state != pysoem.OP_STATE and time.monotonic() < until:
    master.send_processdata()
    counter = master.receive_processdata(100_000)
    state = master.state_check(pysoem.OP_STATE, 1_000)
shown = []
for _ in range(2):
    master.send_processdata()
    counter = master.receive_processdata(100_000)
    shown.append([slave.input.hex() for slave in (wide, narrow, sensor)])
print(
    json.dumps(
        {
            "found": found,
            "size": size,
            "safe_op": safe_op,
            "state": state,
            "counter": counter,
            "outputs": [len(slave.output) for slave in (wide, narrow, sensor)],
            "units": units,
            "shown": shown,
        }
    )
)
master.state = pysoem.INIT_STATE
master.write_state()
master.close()
