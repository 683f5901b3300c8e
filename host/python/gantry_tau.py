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

The protocol is specified in wire.md; this file follows the same rules as the client in Rust, `control::client` of the core.
"""

import argparse
import math
import numbers
import os
import queue
import select
import socket
import struct
import sys
import threading
import time
import traceback
import zlib
from typing import NamedTuple, Optional

# Kinds of frames, modes of a Command, and the phases in which a session lives (wire.md).
HELLO, WELCOME, COMMAND, STATE, GOODBYE, REFUSAL = 1, 2, 3, 4, 5, 7
SUBMIT, OBTAIN = 1, 2
PHASES = ("Listening", "Handshake", "Submit", "Obtain", "SafeDisconnect", "Fault")
LIVE = ("Handshake", "Submit", "Obtain")
CAUSES = (
    "no session has ended", "no command arrived before two consecutive deadlines",
    "two consecutive deadlines passed; commands arrived, but late", "the server overran its cycle",
    "broken frame boundary or checksum on the stream", "the connection was closed, or could not take a State",
    "the client said goodbye", "too many missed deadlines within the window", "stopped",
    "the nominal reference stepped further than its limit", "too many frames in one tick", "no command followed the Welcome in time",
    "offsets were in force that the server did not expect: after a restart or a refused write",
    "an offset was shaken by more than its agitation budget allows",
)
REFUSALS = {
    1: "another client owns the session", 2: "offsets are still ramping to zero; try again in {ticks} ticks",
    3: "the server is stopped ({ticks} ticks of ramp left); it must be re-armed at the machine",
    5: "the server has {detail} axes", 6: "the server needs capabilities {bits:#06x}",
    7: "the server has no room for another connection, or its epochs are used up",
}
# Last words of a server that cannot read a client's frames, or has no room for it: a Refusal of version 1, in every version.
NOTICE = (1, REFUSAL, 8)     # Its version, kind and length; reason and detail are where the suite of other frames is.
NOTICES = {
    4: "the server speaks protocol version {detail}", 7: "the server has no room for another connection",
    8: "the server takes frames of suite {detail} only",
}
VERSION, SUITE = 2, 0        # Of the protocol; of the trailer, a checksum.
LOCKSTEP = 1                 # The only capability that is assigned.
SILENCE_S = 3.0              # Time without a frame after which the server has vanished.
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


def run(controller, server="127.0.0.1:7000", *, needs_wrench=False, submit_only=False, states=None, patience_s=1.0, checksum=None,
        ceiling_nm=CEILING_NM, realtime=False):
    """Runs a controller until Ctrl-C, `Leave`, or the number of `states` is reached, and returns a `Report`; before the Welcome, Ctrl-C
    returns one without States.

    `server` is "HOST:PORT". `needs_wrench`: the session ends without force samples. `submit_only`: never asks for Obtain. `checksum`: refuses a machine with another checksum of its
    kinematic parameters, the lead of its screws included (`gantry-tau header` writes it). `ceiling_nm`: largest position offset that is ever
    asked for, even if the server allows more. `realtime`: takes a real-time priority, on Linux with the right to it. Raises a `Failure` for every other end; in
    each of them the server ramps the offsets to zero by itself.
    """
    connection = None
    try:
        with _granted(server) as connection:
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
    parser.add_argument("--states", type=int, help="leave after this number of States; without it Ctrl-C leaves")
    return parser


def main(controller, options=None, **others):
    """Runs a controller as the program: options of the command line, one sentence at the end, and an exit code as of `gantry-tau client`."""
    options = options or arguments().parse_args()
    try:
        report = run(controller, options.server, submit_only=options.submit_only, states=options.states,
                     realtime=options.realtime, **others)
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
        ready, _, _ = select.select(readable, [], [], min(SILENCE_S, worker.seconds_left()))
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


class _Connection:
    """The client's half of the protocol over a TCP stream."""

    HEADER = struct.Struct("<2sBBHH")
    WELCOME = struct.Struct("<QQIBBHI")
    STATE = struct.Struct("<QQQBBBBIH10IHBB6i")
    AXIS = struct.Struct("<qiihiihqihBB")

    def __init__(self, address):
        self.socket = _connect(address, "server")
        self.rest, self.heard = b"", time.monotonic()
        self.welcome: Optional[Welcome] = None
        self.state: Optional[State] = None
        self.unanswered, self.ended = False, False
        self.sequence, self.states, self.saturated = 0, 0, 0
        self.ceiling_nm = CEILING_NM

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.socket.close()

    def greet(self, axes):
        """Sends Hello and waits for the Welcome."""
        self._send(HELLO, struct.pack("<BBH", axes, 0, LOCKSTEP))
        until = time.monotonic() + SILENCE_S
        while self.welcome is None:
            self._read_until(until, "it does not answer")
            for kind, body in self._frames(most=1):
                if kind == REFUSAL and len(body) == 8:
                    raise _refused(body, axes)
                if kind != WELCOME or len(body) != 28 + 48 * axes:
                    raise Incompatible(f"incompatible server: expected a Welcome for {axes} axes, got kind {kind} of {len(body)} bytes")
                welcome = Welcome(*self.WELCOME.unpack_from(body), _limits(body[28:]))
                if welcome.axes != axes:
                    raise Incompatible(f"incompatible server: a Welcome says {welcome.axes} axes, and has the length of one for {axes}")
                if welcome.cycle_us == 0:
                    raise Incompatible("incompatible server: its cycle is 0 us")
                if welcome.capabilities & ~LOCKSTEP:
                    raise Incompatible(f"incompatible server: it needs capabilities {welcome.capabilities:#06x}")
                self.welcome = welcome

    def receive(self, is_ready=True):
        """Reads what has arrived, if anything; returns its States. The newest is `state`, to be answered."""
        states = self._take_states()  # Those that came with the Welcome.
        if is_ready and not states:
            self._read(SILENCE_S)
            states = self._take_states()
        return states

    def _take_states(self):
        states = []
        for kind, body in self._frames():
            expected = self.STATE.size + self.AXIS.size * self.welcome.axes
            if kind != STATE or len(body) != expected:
                raise Incompatible(f"incompatible server: expected a State of {expected} bytes, got kind {kind} of {len(body)}")
            state = self._parsed(body)
            oldest = self.state.tick + 1 if self.state else self.welcome.tick
            if state.epoch != self.welcome.epoch or state.tick < oldest:
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

        Raises `Ended` if the server has ended the session for another reason before.
        """
        if not self.ended:
            self._send(GOODBYE, struct.pack("<Q", self.welcome.epoch))
        last, until = self.states + GOODBYE_STATES, time.monotonic() + SILENCE_S
        while not self.ended:
            if self.states >= last:
                raise Vanished(f"the server vanished: it has not acknowledged the Goodbye within {GOODBYE_STATES} States")
            if not self._take_states():
                self._read_until(until, "it has not acknowledged the Goodbye")
                self._take_states()
        if self.state.cause != CAUSES[6]:
            raise Ended(f"the server ended the session: {self.state.cause}")

    def check_silence(self):
        """Ends the session without a whole State for long; single bytes are none."""
        if time.monotonic() - self.heard > SILENCE_S:
            raise Vanished("the server vanished: it has been silent for too long")

    def _read_until(self, until, reason):
        """Reads what comes until a time, which is that of a step and not of a read."""
        left = until - time.monotonic()
        if left <= 0.0:
            raise Vanished(f"the server vanished: {reason}")
        try:
            self._read(left)
        except _NothingCame:
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
        frame = self.HEADER.pack(b"GT", VERSION, kind, len(body), SUITE) + body
        self.socket.settimeout(SILENCE_S)
        try:
            self.socket.sendall(frame + struct.pack("<I", zlib.crc32(frame)))
        except OSError as error:
            # A server without room refuses before it has received the Hello, and closes: its answer, if any, is read next.
            if kind != HELLO:
                raise Vanished(f"the server vanished: {error}") from error

    def _read(self, patience_s):
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

    def _frames(self, most=None):
        """Yields kind and body of whole frames, at most so many."""
        while len(self.rest) >= self.HEADER.size and most != 0:
            magic, version, kind, length, suite = self.HEADER.unpack_from(self.rest)
            if magic == b"GT" and (version, kind, length) == NOTICE:
                detail, reason = divmod(suite, 256)
                raise Refused("refused: " + NOTICES.get(reason, "the server gives reason {reason}, detail {detail}").format(reason=reason, detail=detail))
            if magic != b"GT" or version != VERSION or length > 384 or suite != SUITE:
                raise Incompatible(f"incompatible server: the stream is broken (magic {magic!r}, version {version}, length {length}, suite {suite})")
            end = self.HEADER.size + length
            if len(self.rest) < end + 4:
                return
            frame, checksum = self.rest[:end], self.rest[end:end + 4]
            if struct.pack("<I", zlib.crc32(frame)) != checksum:
                raise Incompatible("incompatible server: the stream is broken (the checksum does not match)")
            self.rest = self.rest[end + 4:]
            most = None if most is None else most - 1
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


def _granted(address, axes=3):
    """Connects and greets; a server with another number of axes says which, and is asked again."""
    connection = _Connection(address)
    try:
        connection.greet(axes)
        return connection
    except _OtherAxes as other:
        connection.socket.close()
        if axes != 3:
            raise
        return _granted(address, other.axes)
    except BaseException:
        connection.socket.close()
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
