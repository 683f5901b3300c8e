"""Process data of the emulated drives, as the judges map them."""

import struct

OUTPUTS = [0x60400010, 0x607A0020, 0x60B00020, 0x60B10020, 0x60B20010, 0x60600008]
INPUTS = [0x60410010, 0x60640020, 0x606C0020, 0x60770010, 0x603F0010]


def map_process_data(slave):
    for assignment, pdo, entries in ((0x1C12, 0x1600, OUTPUTS), (0x1C13, 0x1A00, INPUTS)):
        slave.sdo_write(assignment, 0, bytes(1))
        slave.sdo_write(pdo, 0, bytes(1))
        for number, entry in enumerate(entries, 1):
            slave.sdo_write(pdo, number, struct.pack("<I", entry))
        slave.sdo_write(pdo, 0, bytes([len(entries)]))
        slave.sdo_write(assignment, 1, struct.pack("<H", pdo))
        slave.sdo_write(assignment, 0, bytes([1]))
