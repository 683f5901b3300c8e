"""A session with the server for a program that is slower than its cycle."""

from __future__ import annotations

import collections
import json
import math
import os
import subprocess
import tempfile
import threading
from collections.abc import Iterator, Sequence
from typing import NamedTuple, Optional

from .client import Ended
from .program import path, sentence


class PacedState(NamedTuple):
    """The machine at a time of the server. Lists have one entry per axis."""

    t: float                           # the server's time, s
    phase: str                         # "submit" or "obtain"
    nominal_mm: list[float]            # the machine's own reference
    offset_um: list[float]             # the offset in force
    actual_mm: list[float]             # measured
    force_n: Optional[list[float]]     # of the force sensor, in its axes; None without a sample
    moment_nm: Optional[list[float]]   # N m
    late: int                          # targets of this session that came too late
    limited: int                       # steps of this session that the server held back


class Session:
    """A session, held by `gantry-tau pace` in a process of its own, which no pause of the interpreter delays.

        with Session("127.0.0.1:7000") as session:
            for state in session:
                session.target([10.0, 0.0, 0.0], t=state.t)

    A target is played `latency_s` after its time, on straight lines between one and the next. Without a target for `hold_s` the offsets stay
    where they are, without one for `give_up_s` the session ends. Whatever ends it, the server ramps the offsets to zero.

    `server` is "HOST:PORT", `robot` the machine ("l2", "f1" or a robot file), `key` a key file, `rate_hz` the States per second.
    Raises `Ended`, with the cause, when the session cannot begin, and from every method once it has ended.
    """

    def __init__(self, server: str = "127.0.0.1:7000", *, robot: str | os.PathLike[str] = "l2", key: str | os.PathLike[str] | None = None,
                 udp: bool = False, rate_hz: int = 100, latency_s: float = 0.066, hold_s: float = 0.2, give_up_s: float = 1.0):
        command = [path(), "pace", server, "--stdio", f"--robot={robot}", f"--rate={rate_hz}", f"--latency-ms={_ms(latency_s)}",
                   f"--hold-ms={_ms(hold_s)}", f"--give-up-ms={_ms(give_up_s)}"]
        command += [f"--key={key}"] if key is not None else []
        command += ["--udp"] if udp else []
        self._log = tempfile.TemporaryFile()
        # In a session of its own: Ctrl-C is for the caller, whose end ends the pacer as well.
        self._pacer = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._log, start_new_session=True)
        assert self._pacer.stdin and self._pacer.stdout
        self._targets, self._rows = self._pacer.stdin, self._pacer.stdout
        self._changed = threading.Condition()
        self._state: PacedState | None = None
        self._count = 0
        self._cause: str | None = None
        self.refused: collections.deque[str] = collections.deque(maxlen=16)
        """Why targets were refused, the newest last."""
        threading.Thread(target=self._read, daemon=True).start()
        try:
            self.wait()
        except BaseException:
            self.close()
            raise

    @property
    def state(self) -> PacedState:
        """The newest `PacedState`."""
        with self._changed:
            return self._alive()

    def wait(self, count: int | None = None) -> PacedState:
        """Waits for a State that is newer than the one of this number, by default the newest, and returns it."""
        with self._changed:
            seen = self._count if count is None else count
            self._changed.wait_for(lambda: self._cause is not None or self._count > seen)
            return self._alive()

    def __iter__(self) -> Iterator[PacedState]:
        """Yields each new State. What came while the program was busy is left out."""
        seen = 0
        while True:
            state = self.wait(seen)
            with self._changed:
                seen = self._count
            yield state

    def target(self, offset_um: Sequence[float], t: float | None = None, mode: str = "obtain") -> None:
        """Asks for position offsets, um, one per axis, at a time of the server, by default that of the newest State.

        `mode`: "obtain", or "submit", in which the server computes and no drive sees an offset. What only the pacer can know, that a target is
        too late or beyond the server's limits, is told in `refused`; the session goes on.
        """
        state = self.state
        if mode not in ("submit", "obtain"):
            raise ValueError(f"mode: {mode!r} is neither 'submit' nor 'obtain'")
        if not hasattr(offset_um, "__iter__"):
            raise ValueError(f"offset_um: one number for {len(state.offset_um)} axes")
        offsets = [float(offset) for offset in offset_um]
        if len(offsets) != len(state.offset_um):
            raise ValueError(f"offset_um: {len(offsets)} numbers for {len(state.offset_um)} axes")
        t = state.t if t is None else float(t)
        if not all(map(math.isfinite, [t, *offsets])):
            raise ValueError(f"offset_um {offsets} at {t} s: not all numbers are finite")
        line = json.dumps({"mode": mode, "t": t, "offset_um": offsets})
        if not self._sent(line):
            self._wait_for_end()

    def close(self) -> None:
        """Ends the session with a Goodbye."""
        if not self._targets.closed:
            try:
                self._targets.close()
            except OSError:
                pass  # The pacer has ended already.
        self._pacer.wait()

    def __enter__(self) -> Session:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _sent(self, line: str) -> bool:
        """False if the pacer has ended."""
        try:
            self._targets.write(line.encode() + b"\n")
            self._targets.flush()
        except (OSError, ValueError):
            return False
        return True

    def _alive(self) -> PacedState:
        if self._cause is not None:
            raise Ended(self._cause)
        assert self._state is not None
        return self._state

    def _wait_for_end(self):
        with self._changed:
            self._changed.wait_for(lambda: self._cause is not None)
            self._alive()

    def _read(self) -> None:
        """Takes the lines of the pacer until they end; the last error is the cause."""
        last_error = None
        for line in self._rows:
            try:
                row = json.loads(line)
                last_error = row.get("error")
                state = None if last_error else PacedState(*(row[name] for name in PacedState._fields))
            except (ValueError, AttributeError, KeyError):
                # Of another version, or cut off.
                last_error = f"the pacer said {line.decode(errors='replace').strip()!r}"
                self._pacer.kill()
                break
            with self._changed:
                if state:
                    self._state, self._count = state, self._count + 1
                else:
                    self.refused.append(last_error)
                self._changed.notify_all()
        self._pacer.wait()
        self._log.seek(0)
        said = sentence(self._log.read().decode(errors="replace"))
        with self._changed:
            self._cause = last_error or said or "the session was closed"
            self._changed.notify_all()


def _ms(seconds: float) -> int:
    return round(seconds * 1e3)
