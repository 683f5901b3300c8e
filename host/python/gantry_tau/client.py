"""Client of a gantry-tau server for a controller of your own, in Python 3.9 or later with its standard library only.

    import gantry_tau

    def controller(state, wrench):
        return [1_000, 0, 0]             # targets of the position offsets, nm, one per axis

    gantry_tau.main(controller)          # or gantry_tau.run(controller, server="127.0.0.1:7000")

A controller is a callable `(state, wrench) -> targets`, or an object with a method `step(state, wrench)`. It may also have

- `start(welcome)`, called once before the first step;
- `obtain`, read after each step: False asks for Submit (targets are computed and reported, no drive sees them), True, the default,
  for Obtain (the offsets act).

`state` is a `State`. `wrench` is the newest sample of the server's force sensor: force (N) and moment (N m) in the sensor's axes; None before
the first one, without a sensor, and when none has come for too long. Targets are a list, tuple or numpy array of one finite number per axis, rounded to whole nanometres and cut to
the limits of the server, which approaches them as fast as it allows. `raise Leave` in a step ends the session in good order.

A controller that fails (it raises an error, returns anything else, or does not return within `patience_s`) is never answered for: no old target
is repeated. The client says Goodbye, the server ramps every offset to zero, and `run` raises `ControllerFailed`. In real time a step that
hangs ends the session before that, by silence: the server begins the ramp at the second deadline missed, after two cycles.

With `key="FILE"` (`gantry-tau key new FILE` makes one) all frames have tags under the key in this file, which the server must have as well.
Only holders of the key can command the machine, and only they can pass for the server. Nothing is encrypted.

The protocol is specified in wire.md; this file follows the same rules as the client in Rust, `control::client` of the core.
"""

import argparse
import collections
import hmac
import math
import numbers
import os
import queue
import re
import secrets
import select
import socket
import stat
import struct
import sys
import threading
import time
import traceback
import zlib
from typing import NamedTuple, Optional

__all__ = [
    "BadKeyFile", "ControllerFailed", "Ended", "Failure", "Incompatible", "Leave", "Limits", "Refused", "Report", "SensorSilent", "State",
    "Unreachable", "Vanished", "Welcome", "arguments", "main", "run",
]

# Kinds of frames, modes of a Command, and the phases in which a session lives (wire.md).
HELLO, WELCOME, COMMAND, STATE, GOODBYE, REFUSAL, KEYED_HELLO, CHALLENGE = 1, 2, 3, 4, 5, 7, 8, 9
SUBMIT, OBTAIN = 1, 2
PHASES = ("Listening", "Handshake", "Submit", "Obtain", "SafeDisconnect", "Fault")
LIVE = ("Handshake", "Submit", "Obtain")
CAUSES = (
    "no session has ended", "no command arrived before two consecutive deadlines",
    "two consecutive deadlines passed; commands arrived, but late", "the server overran its cycle",
    "broken frame boundary, checksum or tag on the stream", "the connection was closed, or could not take a State",
    "the client said goodbye", "too many missed deadlines within the window", "stopped",
    "the nominal reference stepped further than its limit", "too many frames in one tick", "no command followed the Welcome in time",
    "offsets were in force that the server did not expect: after a restart or a refused write",
    "an offset was shaken by more than its agitation budget allows",
)
REFUSALS = {
    1: "another client owns the session", 2: "offsets are still ramping to zero; try again in {ticks} ticks",
    3: "the server is stopped ({ticks} ticks of ramp left); it must be re-armed at the machine",
    5: "the server has {detail} axes", 6: "the server needs capabilities {bits:#06x}",
    7: "the server has no room for another connection, or its epochs are used up", 9: "this key may only read",
}
# Last words of a server that cannot read a client's frames, or has no room for it: a Refusal of version 1, in every version.
NOTICE = (1, REFUSAL, 8)     # Its version, kind and length; reason and detail are where the suite of other frames is.
NOTICES = {
    4: "the server speaks protocol version {detail}", 7: "the server has no room for another connection",
    8: "the server takes frames of suite {detail} only",
}
SUITE_NOTICES = {0: "the server has no key; without --key this client speaks to it", 1: "the server needs a key (--key)"}
VERSION = 2                  # Of the protocol.
LOCKSTEP, TAGGED_STATES = 1, 2  # Capabilities.
CHALLENGES = 8               # Challenges that are answered.
KEY_FILE_BYTES = 256         # Bytes of a key file that are read; it has some 100.
SILENCE_S = 3.0              # Time without a frame after which the server has vanished.
REPEAT_S = 0.2               # Time after which a Hello or a Goodbye that brings no State is repeated over UDP.
DATAGRAMS = 64               # Datagrams that are read at a time.
DATAGRAM_BYTES = 1_024       # Bytes of a datagram that are read: more than those of a frame.
CEILING_NM = 10_000_000      # Largest position offset that is ever asked for, even if the server allows more.
WRENCH_SCALE = (1e3,) * 3 + (1e6,) * 3  # mN per N, uN m per N m.
FLAGS_END = 1 << 6           # Flags of an axis are below it.
GOODBYE_STATES = 100         # Live States after a Goodbye in which the server may still not have received it.
FIRST_SAMPLE_STATES = 1_000  # States to wait for the first usable force sample.
PRIORITY = 40                # With --realtime: below the server, which may run on the same computer.
SAMPLE_STATES = 100          # States that the last usable force sample may serve.
RETURN_S = 0.5               # Time in which a step that was only late returns after the end of its session; one that hangs does not.


class Limits(NamedTuple):
    """Limits of a position offset, nm: largest magnitude, change per tick, change of that change, change per tick of the ramp to zero."""

    max: int
    step: int
    accel: int
    ramp: int


class Welcome(NamedTuple):
    """Terms of the session. `limits` are those of the position offsets, one per axis."""

    epoch: int
    tick: int
    cycle_us: int
    echo_window: int
    axes: int
    capabilities: int
    kinematics_checksum: int
    limits: tuple


class State(NamedTuple):
    """The machine in one tick of the server. Tuples have one entry per axis."""

    tick: int
    epoch: int
    accepted: int               # sequence of the last accepted command
    phase: str                  # one of PHASES
    cause: str                  # why the last session ended
    on_time_of_100: int         # deadlines kept of the last 100
    ramp_ticks_left: int        # length of a ramp that would begin now
    arrival_us: int             # arrival of the last command after the previous State left, us; 0: not timed
    wrench: Optional[tuple]     # force sensor, its axes: force, N, then moment, N m; None without a usable sample
    wrench_age: int             # ticks since it was measured; 255: 255 or more
    counters: tuple             # received, missed, late, duplicate, stale, malformed, out of range, limited, clamped, non-owner
    nominal_nm: tuple           # reference of the path, without offset
    offset_nm: tuple            # offset in force
    shadow_nm: tuple            # offset as it would be in force, in Submit
    actual_nm: tuple            # measured position
    actual_velocity_um_s: tuple
    actual_torque_permille: tuple
    flags: tuple                # bit 0 clamped to the travel, bit 1 limited by step or accel, bit 4 the nominal stepped too far, bit 5 it accelerated too much


class Report(NamedTuple):
    """Summary of a session that ended with the client's own Goodbye."""

    states: int     # received
    commands: int   # sent
    saturated: int  # commands with a target that was cut to its limit


class Leave(Exception):
    """Raised by a controller to end the session in good order."""


class Failure(Exception):
    """Every end of a session but the client's own Goodbye. The text is one sentence."""

    exit_code = 1


class Unreachable(Failure):
    exit_code = 3


class Refused(Failure):
    exit_code = 4


class Incompatible(Failure):
    exit_code = 5


class Ended(Failure):
    exit_code = 6


class Vanished(Failure):
    exit_code = 7


class SensorSilent(Failure):
    exit_code = 8


class ControllerFailed(Failure):
    exit_code = 10


class BadKeyFile(Failure):
    """A key file cannot be used; nothing was sent."""


def run(controller, server="127.0.0.1:7000", *, needs_wrench=False, submit_only=False, states=None, patience_s=1.0, checksum=None,
        ceiling_nm=CEILING_NM, realtime=False, key=None, udp=False):
    """Runs a controller until Ctrl-C, `Leave`, or the number of `states` is reached, and returns a `Report`; before the Welcome, Ctrl-C
    returns one without States.

    `server` is "HOST:PORT". `needs_wrench`: the session ends without force samples. `submit_only`: never asks for Obtain. `checksum`: refuses a machine with another checksum of its
    kinematic parameters, the lead of its screws included (`gantry-tau header` writes it). `ceiling_nm`: largest position offset that is ever
    asked for, even if the server allows more. `realtime`: takes a real-time priority, on Linux with the right to it. `key`: path of a key
    file, for a server with keys, which must have the same. `udp`: datagrams instead of a TCP stream. Raises a `Failure` for every other end; in
    each of them the server ramps the offsets to zero by itself.
    """
    connection = None
    try:
        with _granted(server, None if key is None else _Key.read(key), udp) as connection:
            connection.ceiling_nm = ceiling_nm
            _hold(connection, _Force(needs_wrench), controller, not submit_only, states, patience_s, checksum, realtime)
    except KeyboardInterrupt:
        if connection:
            raise  # The second one, while the Goodbye was on its way.
        return Report(0, 0, 0)
    return Report(connection.states, connection.sequence, connection.saturated)


def arguments(description=None):
    """Returns a parser with the options that `main` needs, to which a controller adds its own."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("server", nargs="?", default="127.0.0.1:7000", metavar="HOST:PORT", help="address of the server")
    parser.add_argument("--submit-only", action="store_true", help="stay in Submit: no drive sees an offset")
    parser.add_argument("--realtime", action="store_true", help="take a real-time priority (Linux)")
    parser.add_argument("--key", metavar="FILE", help="key file, for a server with keys (gantry-tau key new FILE)")
    parser.add_argument("--udp", action="store_true", help="UDP datagrams instead of a TCP stream; the server needs --udp as well")
    parser.add_argument("--states", type=int, help="leave after this number of States; without it Ctrl-C leaves")
    return parser


def main(controller, options=None, **others):
    """Runs a controller as the program: options of the command line, one sentence at the end, and an exit code as of `gantry-tau client`."""
    options = options or arguments().parse_args()
    try:
        report = run(controller, options.server, submit_only=options.submit_only, states=options.states,
                     realtime=options.realtime, key=options.key, udp=options.udp, **others)
    except Failure as failure:
        print(f"gantry_tau: {failure}", file=sys.stderr)
        sys.exit(failure.exit_code)
    if not report.states:
        print("left before a session was granted")
        return
    print(f"left with Goodbye after {report.states} States ({report.saturated} with a saturated target); the server ramps the offsets to zero")


def _hold(connection, force, controller, may_obtain, states, patience_s, checksum, realtime):
    """Holds a granted session to its end. Returns after the client's own Goodbye; raises the reason of every other end."""
    try:
        found = connection.welcome.kinematics_checksum
        if checksum not in (None, found):
            raise Incompatible(f"incompatible server: its machine has checksum {found:08x}, the client's has {checksum:08x}")
        if realtime:
            _take_priority()
        with _Worker(controller, connection.welcome, patience_s) as worker:
            _answer_until_done(connection, worker, force, may_obtain, states)
    except (Ended, Vanished, Incompatible):
        raise  # Nobody is left to say Goodbye to; without the connection the server ramps.
    except (KeyboardInterrupt, Leave):
        connection.leave()
    except BaseException:
        try:
            connection.leave()
        except Failure:
            pass  # The first failure is the reason.
        raise


def _answer_until_done(connection, worker, force, may_obtain, last_state):
    """Answers the States of a granted session with what the controller returns; raises the reason for the end."""
    readable = [connection.socket, worker.bell]
    while True:
        # What has arrived by the time the step returned is read before its result is taken: the end of the session above all.
        done = worker.is_done()
        ready, _, _ = select.select(readable, [], [], min(SILENCE_S, worker.seconds_left(), connection.seconds_to_repeat()))
        for state in connection.receive(connection.socket in ready):
            if state.phase not in LIVE:
                raise _ended(state, worker)
            force.take(state)
        if done:
            targets, obtain = worker.take()
            if targets is not None:
                # The newest State is answered, also if the step began with an older one.
                connection.answer(targets, obtain and may_obtain)
            if last_state is not None and connection.states >= last_state:
                raise Leave
        if connection.unanswered and not worker.job:
            worker.begin(connection.state, force.wrench)
        connection.repeat_hello()
        worker.check_patience()
        connection.check_silence()


def _ended(state, worker):
    """Returns the failure that the end of the session is."""
    said = f"the server ended the session: {state.cause}"
    if state.cause not in (CAUSES[1], CAUSES[2], CAUSES[11]):
        return Ended(said)
    # A client that was not scheduled is late as well: then the step returns as soon as it runs again.
    if worker.job and not worker.returns_within(RETURN_S):
        return ControllerFailed(f"{worker.job} has not returned after {worker.seconds() * 1e3:.1f} ms; {said}")
    return Ended(f"{said} (the controller's longest step took {worker.longest_s * 1e3:.1f} ms, time without the processor included)")


class _Worker:
    """Runs the controller in a thread of its own: a step that hangs stops nothing but itself. Rings a bell when it has returned."""

    def __init__(self, controller, welcome, patience_s):
        self.axes, self.patience_s = welcome.axes, patience_s
        self.controller, self.step = controller, getattr(controller, "step", controller)
        self.bell, self._ring = socket.socketpair()
        self.tasks, self.results = queue.SimpleQueue(), queue.SimpleQueue()
        self.job, self.since, self.longest_s = None, 0.0, 0.0
        threading.Thread(target=self._work, name="controller", daemon=True).start()
        self._post("the controller's start", lambda: getattr(controller, "start", lambda _: None)(welcome) and None)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.tasks.put(None)  # A step that hangs is left to the end of the program.
        self.bell.close()

    def begin(self, state, wrench):
        """Starts the step of a State."""
        self._post(f"the controller's step of tick {state.tick}", lambda: self._targets(self.step(state, wrench)))

    def is_done(self):
        return not self.results.empty()

    def take(self, end="left with Goodbye"):
        """Returns targets, None after the start, and whether Obtain is asked for; raises what the controller has raised."""
        self.bell.recv(1)
        self.longest_s = max(self.longest_s, self.seconds())
        result, (job, self.job) = self.results.get(), (self.job, None)
        if isinstance(result, ControllerFailed):
            raise ControllerFailed(f"{job} {result}; {end}, the server ramps every offset to zero") from result.__cause__
        if isinstance(result, BaseException):
            raise result
        return result

    def returns_within(self, seconds):
        """Waits for the running step and takes its result; False if it has not returned in this time."""
        ready, _, _ = select.select([self.bell], [], [], seconds)
        if ready:
            self.take("the server had ended the session")
        return bool(ready)

    def seconds(self):
        return time.monotonic() - self.since

    def seconds_left(self):
        return max(0.0, self.patience_s - self.seconds()) if self.job else SILENCE_S

    def check_patience(self):
        if self.job and self.seconds() >= self.patience_s and not self.is_done():
            raise ControllerFailed(f"{self.job} has not returned within {self.patience_s:g} s; left with Goodbye, the server ramps every "
                                   "offset to zero")

    def _post(self, job, task):
        self.job, self.since = job, time.monotonic()
        self.tasks.put(task)

    def _work(self):
        for task in iter(self.tasks.get, None):
            try:
                targets = task()
                result = targets, bool(getattr(self.controller, "obtain", True))
            except BaseException as error:  # SystemExit as well: it would end this thread only.
                result = _reason(error)
            self.results.put(result)
            try:
                self._ring.send(b"!")
            except OSError:
                return  # The session is over.

    def _targets(self, returned):
        """Returns whole nanometres, one per axis."""
        targets = returned.tolist() if hasattr(returned, "tolist") else returned
        if not isinstance(targets, (list, tuple)):
            raise _BadTargets(f"{_short(returned)}: expected {self.axes} numbers in nm, one per axis")
        if len(targets) != self.axes:
            raise _BadTargets(f"{len(targets)} targets: expected {self.axes}, one per axis")
        return [_whole_nm(target, axis) for axis, target in enumerate(targets, 1)]


class _BadTargets(Exception):
    """Targets that cannot be sent."""


def _reason(error):
    """Returns what `take` raises for an error of the controller. Its text is made by code of the controller, which may fail again or hang."""
    if isinstance(error, (Leave, KeyboardInterrupt)):
        return error
    if isinstance(error, _BadTargets):
        return ControllerFailed(f"returned {error}")
    try:
        text = " ".join(str(error).split())
    except BaseException as another:
        text = f"its text raised {type(another).__name__}"
    place = traceback.extract_tb(error.__traceback__)[-1]
    failure = ControllerFailed(f"raised {type(error).__name__}: {text} ({place.filename}, line {place.lineno})")
    failure.__cause__ = error
    return failure


def _whole_nm(number, axis):
    if isinstance(number, bool) or not isinstance(number, numbers.Real):
        raise _BadTargets(f"{_short(number)} for axis {axis}: expected a number in nm")
    value = number if isinstance(number, numbers.Rational) else float(number)
    if isinstance(value, float) and not math.isfinite(value):
        raise _BadTargets(f"{number} for axis {axis}: expected a finite number in nm")
    return int(round(value))


def _short(value):
    return f"{type(value).__name__} {repr(value)[:40]}"


class _Force:
    """The newest usable force sample of the States."""

    def __init__(self, needed):
        self.needed, self.tick, self.wrench, self.fresh_at = needed, None, None, None

    def take(self, state):
        """Takes the sample of a State. Without a usable one for long there is none, and the session ends if it is needed."""
        taken_at = state.tick - state.wrench_age
        if self.fresh_at is None:
            self.fresh_at = state.tick
        # The same sample again is none, and so is one that is old.
        if state.wrench and taken_at != self.tick and state.wrench_age <= SAMPLE_STATES:
            self.tick, self.wrench, self.fresh_at = taken_at, state.wrench, state.tick
        elif state.tick - self.fresh_at > (SAMPLE_STATES if self.wrench else FIRST_SAMPLE_STATES):
            self.wrench = None
            if self.needed:
                raise SensorSilent("no force samples: no usable one has come for too long; left with Goodbye")


class _Key:
    """A shared key. Its text is its id: nothing here shows the secret."""

    def __init__(self, secret):
        self.secret = _mac_key(secret)
        self.id = _mac(self.secret, b"gantry-tau 2 key id")[:8]
        self.greeting = _mac_key(_mac(self.secret, b"gantry-tau 2 greeting"))

    def __repr__(self):
        return f"_Key({self.id.hex()})"

    @classmethod
    def read(cls, path):
        """Reads a key file; raises `BadKeyFile` with the line that is wrong, or what to run if others may read the file."""
        secret, wrong = _parsed_key(_private_bytes(path))
        if wrong:
            raise BadKeyFile(f"key file {path}, {wrong}")
        return cls(secret)

    def of_session(self, nonce, cookie, welcome):
        """Returns the key of the session that the body of a Welcome grants."""
        epoch, _, _, _, axes, _, checksum = _Connection.WELCOME.unpack_from(welcome)
        terms = struct.pack("<8s16s16sQBI", self.id, nonce, cookie, epoch, axes, checksum)
        return _mac_key(_mac(self.secret, b"gantry-tau 2 session" + terms))


def _mac_key(secret):
    return hmac.new(secret, digestmod="sha256")


def _mac(key, message):
    """Returns HMAC-SHA-256 under a key that is kept: a copy costs less than a new one."""
    mac = key.copy()
    mac.update(message)
    return mac.digest()


def _private_bytes(path):
    """Returns the first bytes of a regular file that only its owner may read."""
    try:
        _expect_regular(path, os.lstat(path).st_mode)  # Before it is opened: that of a device can have effects.
        # Neither follows a link nor waits for the writer of a pipe.
        flags = sum(getattr(os, name, 0) for name in ("O_RDONLY", "O_NOFOLLOW", "O_NONBLOCK", "O_BINARY"))
        with open(path, "rb", buffering=0, opener=lambda name, _: os.open(name, flags)) as file:
            found = os.fstat(file.fileno())
            _expect_regular(path, found.st_mode)
            if os.name == "posix":
                _expect_private(path, found)
            else:
                print(f"gantry_tau: who may read {path} is not checked on this system", file=sys.stderr)
            return file.read(KEY_FILE_BYTES)
    except (OSError, ValueError) as error:
        raise BadKeyFile(f"key file {path}: {getattr(error, 'strerror', None) or error}") from error


def _expect_regular(path, mode):
    if not stat.S_ISREG(mode):
        found = ("a symbolic link; name the file itself" if stat.S_ISLNK(mode) else "a folder; name a file" if stat.S_ISDIR(mode)
                 else "a device, a pipe or a socket; name a regular file")
        raise BadKeyFile(f"key file {path}: is {found}")


def _expect_private(path, found):
    mode, user = stat.S_IMODE(found.st_mode), os.geteuid()
    if mode & 0o077:
        raise BadKeyFile(f"key file {path}: others may read or write it (mode {mode:04o}); run: chmod 600 {path}")
    if found.st_uid not in (user, 0):
        raise BadKeyFile(f"key file {path}: belongs to user {found.st_uid}, who could read and exchange it; run: chown {user} {path}")


def _parsed_key(text):
    """Returns the secret in the three lines of a key file, or None and what is wrong."""
    lines = [line[:-1] if line.endswith(b"\r") else line for line in text.split(b"\n")]
    if lines[-1] == b"":
        lines.pop()
    form, role, secret, *rest = lines + [b""] * (3 - len(lines))
    if form != b"gantry-tau-key 1":
        return None, "line 1: expected gantry-tau-key 1"
    if role not in (b"role control", b"role read"):
        return None, "line 2: expected role control, or role read"
    if not re.fullmatch(rb"secret [0-9a-f]{64}", secret):
        return None, "line 3: expected secret, a space and 64 hexadecimal digits in lower case"
    if rest:
        return None, "line 4: expected the end of the file"
    return bytes.fromhex(secret[7:].decode()), None


class _Checksums:
    """Trailers of frames without a key (suite 0): CRC-32 of header and body."""

    suite, size, wrong = 0, 4, "the checksum does not match"
    capabilities, challenges = LOCKSTEP, 0

    def hello(self, axes):
        """Returns kind and body of the Hello."""
        return HELLO, struct.pack("<BBH", axes, 0, self.capabilities)

    def trailer(self, _, frame):
        return struct.pack("<I", zlib.crc32(frame))

    def is_right(self, kind, frame, trailer):
        return trailer == self.trailer(kind, frame)

    def challenged(self, _):
        return False

    def doubt_key(self):
        pass


class _Tags:
    """Trailers of frames under a key (suite 1): HMAC-SHA-256 of header and body, cut to 16 bytes."""

    suite, size, wrong = 1, 16, "the tag does not match"
    capabilities = LOCKSTEP | TAGGED_STATES

    def __init__(self, key):
        self.key, self.session = key, None
        self.nonce, self.cookie, self.challenges = secrets.token_bytes(16), bytes(16), 0

    def hello(self, axes):
        return KEYED_HELLO, struct.pack("<BBH", axes, 0, self.capabilities) + self.key.id + self.nonce + self.cookie

    def trailer(self, kind, frame):
        return _mac(self.key.greeting if kind == KEYED_HELLO else self.session, frame)[:16]

    def is_right(self, kind, frame, trailer):
        """True for a frame of the server with this key that answers this Hello, or is of its session."""
        key = self.session
        if kind in (CHALLENGE, REFUSAL):
            key, frame = self.key.greeting, frame + self.nonce
        elif kind == WELCOME and key is None and len(frame) >= _Connection.HEADER.size + _Connection.WELCOME.size:
            key = self.key.of_session(self.nonce, self.cookie, frame[_Connection.HEADER.size:])
        right = key is not None and hmac.compare_digest(_mac(key, frame)[:16], trailer)
        if right and kind == WELCOME:
            self.session = key
        return right

    def challenged(self, cookie):
        """Takes the cookie of a Challenge. Returns True if the Hello is to be said again with it."""
        if len(cookie) != 16 or cookie == self.cookie:
            return False
        if self.challenges == CHALLENGES:
            raise Incompatible(f"incompatible server: the server asks for another Hello after {CHALLENGES} of them")
        self.cookie, self.challenges = cookie, self.challenges + 1
        return True

    def doubt_key(self):
        """Raises the likely reason for a server that has not answered. One with a Challenge has the key."""
        if not self.challenges:
            raise Vanished(f"the server vanished: no answer: wrong key? its id here is {self.key.id.hex()}; compare with "
                           "`gantry-tau key show-id` at the server")


class _Connection:
    """The client's half of the protocol over a TCP stream or UDP datagrams."""

    HEADER = struct.Struct("<2sBBHH")
    WELCOME = struct.Struct("<QQIBBHI")
    STATE = struct.Struct("<QQQBBBBIH10IHBB6i")
    AXIS = struct.Struct("<qiihiihqihBB")

    def __init__(self, address, key=None, udp=False):
        self.seal = _Checksums() if key is None else _Tags(key)
        self.udp = udp
        self.socket, *self.others = _datagram_sockets(address) if udp else [_connect(address, "server")]
        self.rest, self.datagrams = b"", collections.deque()
        self.said = self.heard = time.monotonic()
        self.hello = HELLO, b""
        self.welcome: Optional[Welcome] = None
        self.state: Optional[State] = None
        self.unanswered, self.ended = False, False
        self.sequence, self.states, self.saturated = 0, 0, 0
        self.ceiling_nm = CEILING_NM

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        for each in (self.socket, *self.others):
            each.close()

    def greet(self, axes):
        """Sends Hello and waits for the Welcome. Over UDP each address of the server has its turn until one answers."""
        try:
            until = time.monotonic() + SILENCE_S
            self._say_hello(axes)
            while self.welcome is None:
                self._read_until(until, "it does not answer")
                for kind, body in self._frames():
                    self._greeted(kind, body, axes)
                    if self.welcome:
                        break
                if self.welcome is None and self._is_to_repeat():
                    if not self.seal.challenges:
                        self.others.append(self.socket)
                        self.socket = self.others.pop(0)
                    self._send(*self.hello)
        except Vanished:
            self.seal.doubt_key()
            raise

    def _say_hello(self, axes):
        self.hello = self.seal.hello(axes)
        self._send(*self.hello)

    def _greeted(self, kind, body, axes):
        """Takes a frame that comes before the Welcome, or the Welcome."""
        if kind == REFUSAL and len(body) == 8:
            raise _refused(body, axes)
        if kind == CHALLENGE and self.seal.challenged(body):
            self._say_hello(axes)
            return
        if self.udp and kind not in (WELCOME, REFUSAL):
            return  # Doubled, or earlier than its Welcome.
        if kind != WELCOME or len(body) != 28 + 48 * axes:
            raise Incompatible(f"incompatible server: expected a Welcome for {axes} axes, got kind {kind} of {len(body)} bytes")
        welcome = Welcome(*self.WELCOME.unpack_from(body), _limits(body[28:]))
        if welcome.axes != axes:
            raise Incompatible(f"incompatible server: a Welcome says {welcome.axes} axes, and has the length of one for {axes}")
        if welcome.cycle_us == 0:
            raise Incompatible("incompatible server: its cycle is 0 us")
        if welcome.capabilities & ~self.seal.capabilities:
            raise Incompatible(f"incompatible server: it needs capabilities {welcome.capabilities:#06x}")
        self.welcome = welcome

    def _is_to_repeat(self):
        return self.udp and time.monotonic() - self.said >= REPEAT_S

    def seconds_to_repeat(self):
        """Returns the time until a frame is to be repeated, if one is."""
        in_handshake = not self.state or self.state.phase == "Handshake"
        return max(0.0, self.said + REPEAT_S - time.monotonic()) if self.udp and in_handshake else SILENCE_S

    def repeat_hello(self):
        """Asks for a State in the handshake over UDP, where it may be lost."""
        if self.seconds_to_repeat() <= 0.0:
            self._send(*self.hello)

    def receive(self, is_ready=True):
        """Reads what has arrived, if anything; returns its States. The newest is `state`, to be answered."""
        states = self._take_states()  # Those that came with the Welcome.
        if is_ready and not states:
            self._read(0.0 if self.udp else SILENCE_S)
            states = self._take_states()
        return states

    def _take_states(self):
        states = []
        for kind, body in self._frames():
            expected = self.STATE.size + self.AXIS.size * self.welcome.axes
            if self.udp and kind != STATE:
                continue  # Doubled, late, or the client's own, which has a right tag as well.
            if kind != STATE or len(body) != expected:
                raise Incompatible(f"incompatible server: expected a State of {expected} bytes, got kind {kind} of {len(body)}")
            state = self._parsed(body)
            oldest = self.state.tick + 1 if self.state else self.welcome.tick
            if state.epoch != self.welcome.epoch or state.tick < oldest:
                if self.udp:
                    continue
                raise Incompatible(f"incompatible server: expected a State of epoch {self.welcome.epoch} and tick {oldest} or later, got "
                                   f"epoch {state.epoch}, tick {state.tick}")
            self.state, self.unanswered = state, state.phase in LIVE
            self.ended |= not self.unanswered
            self.states += 1
            self.heard = time.monotonic()
            states.append(state)
        return states

    def answer(self, targets_nm, obtain):
        """Answers the newest State, if it waits for an answer: targets cut to their limits, and the mode."""
        if not self.unanswered:
            return
        reach = [min(limits.max, self.ceiling_nm) for limits in self.welcome.limits]
        cut = [max(-most, min(most, target)) for target, most in zip(targets_nm, reach)]
        self.saturated += cut != targets_nm
        # Obtain only where the server has accepted a command that asked for Submit.
        submitted = self.sequence > 0 and self.state.phase in ("Submit", "Obtain")
        mode = OBTAIN if obtain and submitted else SUBMIT
        self.sequence += 1
        self.unanswered = False
        head = struct.pack("<QQQBBH", self.welcome.epoch, self.sequence, self.state.tick, mode, self.welcome.axes, 0)
        self._send(COMMAND, head + b"".join(struct.pack("<iih", target, 0, 0) for target in cut))

    def leave(self):
        """Sends Goodbye and waits until the server has received it: a connection closed at once would be the cause instead.

        Over UDP it may be lost, and is repeated. Raises `Ended` if the server has ended the session for another reason before.
        """
        goodbye = GOODBYE, struct.pack("<Q", self.welcome.epoch)
        if not self.ended:
            self._send(*goodbye)
        last, until = self.states + GOODBYE_STATES, time.monotonic() + SILENCE_S
        while not self.ended:
            if self.states >= last:
                raise Vanished(f"the server vanished: it has not acknowledged the Goodbye within {GOODBYE_STATES} States")
            states = self._take_states()
            if not states:
                self._read_until(until, "it has not acknowledged the Goodbye")
                states = self._take_states()
            if not self.ended and (self.udp and states or self._is_to_repeat()):
                self._send(*goodbye)
        if self.state.cause != CAUSES[6]:
            raise Ended(f"the server ended the session: {self.state.cause}")

    def check_silence(self):
        """Ends the session without a whole State for long; single bytes are none."""
        if time.monotonic() - self.heard > SILENCE_S:
            raise Vanished("the server vanished: it has been silent for too long")

    def _read_until(self, until, reason):
        """Reads what comes until a time, which is that of a step and not of a read; over UDP until a frame is to be repeated."""
        left = until - time.monotonic()
        if left <= 0.0:
            raise Vanished(f"the server vanished: {reason}")
        try:
            self._read(min(left, REPEAT_S) if self.udp else left)
        except _NothingCame:
            if not self.udp:
                raise Vanished(f"the server vanished: {reason}") from None

    def _parsed(self, body):
        tick, epoch, accepted, phase, cause, axes, on_time, ramp, arrival, *rest = self.STATE.unpack_from(body)
        counters, (sensor, age, *components) = rest[:11], rest[11:]
        if axes != self.welcome.axes or phase >= len(PHASES) or cause >= len(CAUSES):
            raise Incompatible(f"incompatible server: a State has {axes} axes, phase {phase}, cause {cause}")
        if sensor not in (0, 1, 3) or sensor == 0 and (age, any(components)) != (0, False):
            raise Incompatible(f"incompatible server: a State has a sensor with bits {sensor}, age {age}, components {components}")
        rows = list(self.AXIS.iter_unpack(body[self.STATE.size:]))
        nominal, offset, _, _, shadow, _, _, actual, velocity, torque, flags, reserved = zip(*rows)
        if any(reserved) or any(axis >= FLAGS_END for axis in flags):
            raise Incompatible(f"incompatible server: a State has flags {flags} and reserved bytes {reserved}")
        # A component that was cut to its range is no measurement.
        wrench = tuple(value / scale for value, scale in zip(components, WRENCH_SCALE)) if sensor == 1 else None
        return State(tick, epoch, accepted, PHASES[phase], CAUSES[cause], on_time, ramp, arrival, wrench, age, tuple(counters),
                     nominal, offset, shadow, actual, velocity, torque, flags)

    def _send(self, kind, body):
        frame = self.HEADER.pack(b"GT", VERSION, kind, len(body), self.seal.suite) + body
        self.said = time.monotonic()
        self.socket.settimeout(SILENCE_S)
        try:
            self.socket.sendall(frame + self.seal.trailer(kind, frame))
        except OSError as error:
            # A server without room refuses before it has received the Hello, and closes: its answer, if any, is read next.
            if kind not in (HELLO, KEYED_HELLO) and not (self.udp and isinstance(error, ConnectionError)):
                raise Vanished(f"the server vanished: {error}") from error

    def _read(self, patience_s):
        if self.udp:
            return self._read_datagrams(patience_s)
        self.socket.settimeout(patience_s)
        try:
            data = self.socket.recv(65_536)
        except socket.timeout as error:
            raise _NothingCame("the server vanished: it has been silent for too long") from error
        except OSError as error:
            raise Vanished(f"the server vanished: {error}") from error
        if not data:
            raise Vanished("the server vanished: it closed the connection")
        self.rest += data

    def _read_datagrams(self, patience_s):
        """Reads the first datagram that comes, and those that have come with it."""
        try:
            for place in range(DATAGRAMS):
                self.socket.settimeout(0.0 if place else patience_s)
                self.datagrams.append(self.socket.recv(DATAGRAM_BYTES))
        except BlockingIOError:
            pass
        except socket.timeout as error:
            raise _NothingCame("the server vanished: it has been silent for too long") from error
        except ConnectionError:
            pass  # The server was absent when an earlier datagram came; its silence counts.
        except OSError as error:
            raise Vanished(f"the server vanished: {error}") from error

    def _frames(self):
        """Yields kind and body of whole frames with a right trailer. Datagrams of anything else are dropped."""
        while self.datagrams:
            datagram = self.datagrams.popleft()
            if len(datagram) < self.HEADER.size:
                continue
            magic, version, kind, length, suite = self.HEADER.unpack_from(datagram)
            end = self.HEADER.size + length
            fits = length <= 384 and len(datagram) == end + self.seal.size
            if fits and (magic, version, suite) == (b"GT", VERSION, self.seal.suite) and self.seal.is_right(kind, datagram[:end], datagram[end:]):
                yield kind, datagram[self.HEADER.size:end]
        while len(self.rest) >= self.HEADER.size:
            magic, version, kind, length, suite = self.HEADER.unpack_from(self.rest)
            if magic == b"GT" and (version, kind, length) == NOTICE:
                detail, reason = divmod(suite, 256)
                said = NOTICES.get(reason, "the server gives reason {reason}, detail {detail}").format(reason=reason, detail=detail)
                raise Refused("refused: " + (SUITE_NOTICES.get(detail, said) if reason == 8 else said))
            if magic != b"GT" or version != VERSION or length > 384 or suite != self.seal.suite:
                raise Incompatible(f"incompatible server: the stream is broken (magic {magic!r}, version {version}, length {length}, suite {suite})")
            end = self.HEADER.size + length
            last = end + self.seal.size
            if len(self.rest) < last:
                return
            frame, trailer = self.rest[:end], self.rest[end:last]
            if not self.seal.is_right(kind, frame, trailer):
                raise Incompatible(f"incompatible server: the stream is broken ({self.seal.wrong})")
            self.rest = self.rest[last:]
            yield kind, frame[self.HEADER.size:]


class _NothingCame(Vanished):
    """The time of a read is over."""


def _refused(body, axes):
    """Returns the failure that a Refusal is."""
    reason, detail, bits, ticks = struct.unpack("<BBHI", body)
    used = {2: (0, 0, ticks), 3: (0, 0, ticks), 5: (detail, 0, 0), 6: (0, bits, 0)}.get(reason, (0, 0, 0))
    if reason not in REFUSALS or used != (detail, bits, ticks):
        return Incompatible(f"incompatible server: a Refusal has reason {reason}, detail {detail}, bits {bits:#06x}, ticks left {ticks}")
    if reason == 5 and detail not in (0, axes):
        return _OtherAxes(detail)
    return Refused("refused: " + REFUSALS[reason].format(detail=detail, bits=bits, ticks=ticks))


def _limits(body):
    """Returns the limits of the position offsets, axis order, after a check of those of every channel."""
    channels = [Limits(*values) for values in struct.iter_unpack("<4i", body)]
    for number, limits in enumerate(channels):
        if not (limits.max >= 0 and 0 < limits.ramp <= limits.step and limits.step + limits.ramp <= limits.accel):
            channel = ("position", "velocity", "torque")[number % 3]
            raise Incompatible(f"incompatible server: {channel} limits of axis {number // 3 + 1} are max {limits.max}, step {limits.step}, "
                               f"accel {limits.accel}, ramp {limits.ramp}; expected 0 <= max, 0 < ramp <= step, step + ramp <= accel")
    return tuple(channels[::3])


class _OtherAxes(Failure):
    """The server has another number of axes than the Hello."""

    exit_code = Refused.exit_code

    def __init__(self, axes):
        super().__init__(f"refused: the server has {axes} axes")
        self.axes = axes


def _granted(address, key=None, udp=False, axes=3):
    """Connects and greets; a server with another number of axes says which, and is asked again."""
    connection = _Connection(address, key, udp)
    try:
        connection.greet(axes)
        return connection
    except _OtherAxes as other:
        connection.close()
        if axes != 3:
            raise
        return _granted(address, key, udp, other.axes)
    except BaseException:
        connection.close()
        raise


def _take_priority():
    """Takes a real-time priority for this thread and those that it starts, or says why not."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except (AttributeError, OSError) as error:
        print(f"gantry_tau: no real-time priority: {error}", file=sys.stderr)


def _connect(address, what):
    host, _, port = address.rpartition(":")
    try:
        connected = socket.create_connection((host.strip("[]"), int(port)), SILENCE_S)
    except (OSError, ValueError) as error:
        raise Unreachable(f"the {what} at {address} cannot be reached: {error}") from error
    connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return connected


def _datagram_sockets(address):
    """Returns a socket for each address of a server, which hears that address only."""
    host, _, port = address.rpartition(":")
    sockets, failure = [], None
    try:
        addresses = socket.getaddrinfo(host.strip("[]"), int(port), type=socket.SOCK_DGRAM)
    except (OSError, ValueError) as error:
        raise Unreachable(f"the server at {address} cannot be reached: {error}") from error
    for family, kind, protocol, _, peer in addresses:
        try:
            connected = socket.socket(family, kind, protocol)
            connected.connect(peer)
            sockets.append(connected)
        except OSError as error:
            failure = error
    if not sockets:
        raise Unreachable(f"the server at {address} cannot be reached: {failure}") from failure
    return sockets
