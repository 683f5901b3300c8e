"""Lists the devices of a bus with SOEM, another MainDevice, as JSON."""

import json
import sys

import pysoem

master = pysoem.Master()
master.open(sys.argv[1])
found = master.config_init()
state = master.state_check(pysoem.PREOP_STATE, 2_000_000)
devices = [[slave.name, slave.man, slave.id, slave.rev] for slave in master.slaves]
print(json.dumps({"found": found, "state": state, "devices": devices}))
master.state = pysoem.INIT_STATE
master.write_state()
master.close()
