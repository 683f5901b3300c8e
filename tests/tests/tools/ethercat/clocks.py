"""Sets up distributed clocks of emulated drives with SOEM, another MainDevice; prints what it saw as JSON."""

import json
import struct
import sys
import time

import pysoem

from judge_map import map_process_data

CYCLE_NS = 1_000_000
master = pysoem.Master()
master.open(sys.argv[1])
found = master.config_init()
slaves = master.slaves
for slave in slaves:
    slave.config_func = lambda *_, slave=slave: map_process_data(slave)
master.config_map()
has_clock = bool(master.config_dc())
delays = [struct.unpack("<I", slave._fprd(0x0928, 4))[0] for slave in slaves]
safe_op = master.state_check(pysoem.SAFEOP_STATE, 2_000_000)


def exchange():
    master.send_processdata()
    return master.receive_processdata(100_000)


def to_op(cycles):
    """Asks for OP; returns state and AL status of each drive."""
    master.state = pysoem.OP_STATE
    master.write_state()
    for _ in range(cycles):
        exchange()
        if master.state_check(pysoem.OP_STATE, 1_000) == pysoem.OP_STATE:
            break
    master.read_state()
    return [[slave.state, slave.al_status] for slave in slaves]


starts = [struct.unpack("<i", slave.sdo_read(0x6064, 0))[0] for slave in slaves]
for slave, start in zip(slaves, starts):
    slave.output = struct.pack("<HiiihB", 0, start, 0, 0, 0, 8)
for _ in range(1_000):
    exchange()
differences = [struct.unpack("<I", slave._fprd(0x092C, 4))[0] & 0x7FFF_FFFF for slave in slaves]
without = to_op(100)
# Their errors are acknowledged.
master.state = pysoem.SAFEOP_STATE + pysoem.STATE_ACK
master.write_state()
master.state_check(pysoem.SAFEOP_STATE, 2_000_000)
for slave in slaves:
    slave.dc_sync(True, CYCLE_NS)
registers = []
for slave in slaves:
    start = struct.unpack("<Q", slave._fprd(0x0990, 8))[0]
    registers.append(
        {
            "activation": slave._fprd(0x0981, 1)[0],
            "owner": slave._fprd(0x0980, 1)[0],
            "start_is_whole": start % CYCLE_NS == 0,
            "periods": list(struct.unpack("<II", slave._fprd(0x09A0, 8))),
        }
    )
with_sync0 = to_op(2_000)
# Beyond the first pulse.
until = time.monotonic() + 8
counter = 0
while time.monotonic() < until:
    counter = exchange()
master.read_state()
print(
    json.dumps(
        {
            "found": found,
            "has_clock": has_clock,
            "delays": delays,
            "safe_op": safe_op,
            "differences": differences,
            "without": without,
            "registers": registers,
            "with": with_sync0,
            "at_the_end": [[slave.state, slave.al_status] for slave in slaves],
            "counter": [counter, master.expected_wkc],
        }
    )
)
master.state = pysoem.INIT_STATE
master.write_state()
master.close()
