"""Brings emulated drives to OP and enables them with SOEM, another MainDevice; prints what it saw as JSON."""

import json
import struct
import sys
import time

import pysoem

from judge_map import map_process_data

def command(status):
    """The control word towards operation enabled."""
    for mask, value, word in ((0x4F, 0x40, 0x06), (0x6F, 0x21, 0x07), (0x6F, 0x23, 0x0F), (0x6F, 0x27, 0x0F)):
        if status & mask == value:
            return word
    return 0


master = pysoem.Master()
master.open(sys.argv[1])
found = master.config_init()
# The mailboxes are answered from PRE-OP on.
pre_op = master.state_check(pysoem.PREOP_STATE, 2_000_000)
slaves = master.slaves
names = [[slave.name, slave.man, slave.id, slave.rev] for slave in slaves]
aborted = []
for slave in slaves:
    slave.config_func = lambda *_, slave=slave: map_process_data(slave)
    # Not a writable object; and one that is not there.
    for object in (0x6064, 0x2000):
        try:
            slave.sdo_write(object, 0, bytes(4))
        except pysoem.SdoError as error:
            aborted.append(error.abort_code)
size = master.config_map()
safe_op = master.state_check(pysoem.SAFEOP_STATE, 2_000_000)


def exchange():
    master.send_processdata()
    return master.receive_processdata(100_000)


starts = [struct.unpack("<i", slave.sdo_read(0x6064, 0))[0] for slave in slaves]
for slave, start in zip(slaves, starts):
    slave.output = struct.pack("<HiiihB", 0, start, 0, 0, 0, 8)
counter = exchange()
master.state = pysoem.OP_STATE
master.write_state()
operational = 0
for _ in range(2_000):
    exchange()
    operational = master.state_check(pysoem.OP_STATE, 1_000)
    if operational == pysoem.OP_STATE:
        break

states = []
offset = 0
until = time.monotonic() + 20
while time.monotonic() < until:
    counter = exchange()
    states = [struct.unpack("<HiihH", slave.input) for slave in slaves]
    enabled = all(state[0] & 0x6F == 0x27 for state in states)
    offset += 5 if enabled and offset <= 1_000 else 0
    for slave, state, start in zip(slaves, states, starts):
        slave.output = struct.pack("<HiiihB", command(state[0]), start, offset, 0, 0, 8)
    # How far a drive lags depends on how fast frames come: it has time to arrive, and to swing.
    if offset > 1_000 and all(abs(offset - (state[1] - start)) <= 20 for state, start in zip(states, starts)):
        break

offsets = [struct.unpack("<i", slave.sdo_read(0x60B0, 0))[0] for slave in slaves]
# Leaving OP takes the power from drives that follow.
master.state = pysoem.SAFEOP_STATE
master.write_state()
master.state_check(pysoem.SAFEOP_STATE, 2_000_000)
time.sleep(0.2)
after = [struct.unpack("<H", slave.sdo_read(0x6041, 0))[0] & 0x4F for slave in slaves]
print(
    json.dumps(
        {
            "found": found,
            "names": names,
            "aborted": aborted,
            "size": size,
            "pre_op": pre_op,
            "safe_op": safe_op,
            "operational": operational,
            "counter": [counter, master.expected_wkc],
            "status": [state[0] for state in states],
            "moved": [state[1] - start for state, start in zip(states, starts)],
            "offset": offset,
            "offsets": offsets,
            "after": after,
        }
    )
)
master.state = pysoem.INIT_STATE
master.write_state()
master.close()
