"""The worked example of frames with tags (wire.md), by the client in Python: worked_example.py FOLDER, that of gantry_tau.py."""

import struct
import sys
from unittest import mock

sys.path.insert(0, sys.argv[1])
from gantry_tau import client as gantry_tau

NONCE = bytes(range(0xa0, 0xb0))
COOKIE = bytes.fromhex("6dfcabd16bac3d202769bc2b1d78e0e2")
EPOCH, AXES, CHECKSUM = 7, 3, 0x8f2c1a77


class Wire:
    """Keeps what is sent."""

    def settimeout(self, _):
        pass

    def sendall(self, frame):
        self.sent = frame


def connection():
    """A connection to nobody, whose nonce is that of the example."""
    with mock.patch.object(gantry_tau, "_connect", lambda *_: Wire()), mock.patch.object(gantry_tau.secrets, "token_bytes", lambda _: NONCE):
        return gantry_tau._Connection("", gantry_tau._Key(bytes(range(32))))


def frame(header, body, tag):
    return bytes.fromhex(header) + body + bytes.fromhex(tag)


def tagged(key, kind, body):
    frame = struct.pack("<2sBBHH", b"GT", 2, kind, len(body), 1) + body
    return frame + gantry_tau._mac(key, frame)[:16]


def same(found, expected):
    assert found == expected, f"\nfound    {found.hex()}\nexpected {expected.hex()}"


def heard(link, frame):
    """The frame, taken for one of the server."""
    link.rest = frame
    return next(link._frames())


def every_bit_counts(link, frame):
    """A datagram with one other bit is dropped, in body, header or tag, and so is one of another length."""
    others = [frame[:-1], frame + b"\0", frame[:-16], b"", frame + frame, frame[:8]]
    for bit in range(8 * len(frame)):
        other = bytearray(frame)
        other[bit // 8] ^= 1 << bit % 8
        others.append(bytes(other))
    link.datagrams.extend(others)
    assert list(link._frames()) == []
    link.datagrams.append(frame)
    assert len(list(link._frames())) == 1


def handshake():
    link = connection()
    key = link.seal.key
    same(key.id, bytes.fromhex("91ab2dba9840f109"))
    # A derived key is never shown: what it makes of the empty message is compared.
    greeting = gantry_tau._mac_key(bytes.fromhex("d978f04c54233a7c1f65b497d359aa7907cfc5972e17af909867b9d766fe6fd0"))
    same(gantry_tau._mac(key.greeting, b""), gantry_tau._mac(greeting, b""))
    asked = bytes.fromhex("03000300") + key.id + NONCE
    link._say_hello(AXES)
    same(link.socket.sent, frame("475402082c000100", asked + bytes(16), "c50992aa8c34e280e5106b9a478ce6b1"))
    challenge = frame("4754020910000100", COOKIE, "645a6f97e57550e058e68d2be25a6d7e")
    every_bit_counts(connection(), challenge)
    kind, body = heard(link, challenge)
    link._greeted(kind, body, AXES)
    same(link.socket.sent, frame("475402082c000100", asked + COOKIE, "ffdab22b96ea41d5e497ddf5772112de"))
    return link


def session(link):
    head = struct.pack("<QQIBBHI", EPOCH, 1000, 1000, 0, AXES, 0, CHECKSUM)
    derived = link.seal.key.of_session(NONCE, COOKIE, head)
    expected = gantry_tau._mac_key(bytes.fromhex("c021b073637080ada909f4fd27ac6082f4de47cd8a31111a6799d88a86ecb622"))
    same(gantry_tau._mac(derived, b""), gantry_tau._mac(expected, b""))
    # The example has no bytes of the Welcome: this one has the terms that its key depends on.
    body = head + struct.pack("<4i", 1_000_000, 5_000, 10_000, 100) * 9
    welcome = tagged(expected, gantry_tau.WELCOME, body)
    every_bit_counts(link, welcome)
    link._greeted(gantry_tau.WELCOME, body, AXES)
    assert link.welcome.epoch == EPOCH
    every_bit_counts(link, tagged(expected, gantry_tau.STATE, bytes(102 + 44 * AXES)))
    # The key of a session that has begun is not that of another Welcome.
    cookie, link.seal.cookie = link.seal.cookie, bytes(16)
    again = tagged(link.seal.key.of_session(NONCE, bytes(16), head), gantry_tau.WELCOME, body)
    link.datagrams.append(again)
    assert list(link._frames()) == []
    link.seal.cookie = cookie


def frames_of_the_session(link):
    link.state = mock.Mock(tick=1000, phase="Submit")
    link.sequence, link.unanswered = 41, True
    link.answer([-100_000, 2_500, 0], True)
    command = bytes.fromhex("07000000000000002a00000000000000e803000000000000020300006079feff000000000000c4090000000000000000") + bytes(10)
    same(link.socket.sent, frame("475402033a000100", command, "f135a246b3e56fcde4aa67d8210d6023"))
    link._send(gantry_tau.GOODBYE, struct.pack("<Q", EPOCH))
    same(link.socket.sent, frame("4754020508000100", struct.pack("<Q", EPOCH), "3bbdd95abcd09e00454141f182eeb437"))


def without_a_key():
    with mock.patch.object(gantry_tau, "_connect", lambda *_: Wire()):
        link = gantry_tau._Connection("")
    link.welcome = mock.Mock(epoch=EPOCH, axes=AXES, limits=[gantry_tau.Limits(1_000_000, 1, 2, 1)] * 3)
    link.state = mock.Mock(tick=1000, phase="Submit")
    link.sequence, link.unanswered = 41, True
    link.answer([-100_000, 2_500, 0], True)
    same(link.socket.sent[:8] + link.socket.sent[-4:], bytes.fromhex("475402033a000000baeaa658"))
    for notice, words in (
        ("47 54 01 07 08 00 04 02 00 00 00 00 00 00 da 7f 60 8e", "the server speaks protocol version 2"),
        ("47 54 01 07 08 00 08 01 00 00 00 00 00 00 08 70 27 e8", "the server needs a key (--key)"),
    ):
        try:
            heard(link, bytes.fromhex(notice))
        except gantry_tau.Refused as refused:
            assert words in str(refused), refused
        else:
            raise AssertionError(notice)


def shown():
    """Nothing of the secret is in a text."""
    key = gantry_tau._Key(b"\x5a" * 32)
    texts = [repr(key), str(vars(key)), repr(vars(gantry_tau._Tags(key)))]
    assert not any("5a5a" in text or "ZZ" in text for text in texts), texts


LINK = handshake()
session(LINK)
frames_of_the_session(LINK)
without_a_key()
shown()
