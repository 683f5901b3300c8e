//! Every cause of Fault times every end of a server, before, during and after each other: a stop is
//! never forgotten, and a quit is none.

use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::time::Duration;

use gantry_tau_core::control::message::{ClientMessage, Phase};
use gantry_tau_server::record::TickRecord;
use gantry_tau_server::server::cycle::OperatorInputs;
use gantry_tau_server::state::{FirstRun, LatchFlusher, MachineState, StatePlace, StopLatch};
use gantry_tau_tests::fake_plant::Bus;
use gantry_tau_tests::server_fixture::{NOMINAL_STEP_NM, ServerFixture};
use gantry_tau_tests::session_fixture::SessionFixture;

/// Offsets in Obtain, nm: a ramp of ten ticks.
const OFFSETS: [i32; 2] = [1_000, -700];
/// Ticks of that ramp.
const RAMP: u32 = 10;
/// A tick in its middle.
const DURING: u32 = RAMP / 2;
/// Its last tick.
const LAST: u32 = RAMP - 1;

/// Something that asserts a stop, for one tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stop {
    /// None: the end comes alone.
    None,
    /// The stop at the machine.
    AtTheMachine,
    /// The owner's Stop.
    ByTheOwner,
    /// A step of the nominal reference above its limit.
    Nominal,
    /// The machine cannot be read.
    FailedRead,
    /// The drives do not take the references.
    RefusedWrite,
}

impl Stop {
    const ALL: [Self; 6] = [
        Self::None,
        Self::AtTheMachine,
        Self::ByTheOwner,
        Self::Nominal,
        Self::FailedRead,
        Self::RefusedWrite,
    ];
}

/// End of the server.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum End {
    /// Asked to end, until it may.
    Quit,
    /// Killed between two ticks.
    Kill,
    /// Killed in a tick, when the drives are to be written.
    KillInWrite,
    /// The power fails between two ticks: the file has what was last flushed.
    PowerLoss,
}

impl End {
    const ALL: [Self; 4] = [Self::Quit, Self::Kill, Self::KillInWrite, Self::PowerLoss];
}

/// Time of the stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Time {
    /// In Obtain, before a quit.
    Before,
    /// The same, and it was re-armed before the quit.
    BeforeAndRearmed,
    /// In the first tick of the quit.
    AtFirst,
    /// In the middle of its ramp.
    During,
    /// In the last tick of its ramp.
    AtLast,
    /// In the tick in which the server ends.
    AtTheEnd,
}

impl Time {
    const ALL: [Self; 6] = [
        Self::Before,
        Self::BeforeAndRearmed,
        Self::AtFirst,
        Self::During,
        Self::AtLast,
        Self::AtTheEnd,
    ];
}

/// A latch on disk, and a server in Obtain that has it.
struct Bench {
    folder: tempfile::TempDir,
    session: SessionFixture<2>,
    flusher: LatchFlusher,
    /// Contents of the latch when it was last flushed.
    flushed: String,
    /// Asked to end.
    quit: bool,
}

/// The latch of a server that begins, written by a thread as that of `serve`. The lock is given
/// back at once: killed servers are not owners.
fn open(folder: &Path) -> StopLatch {
    let state = MachineState::own(&StatePlace::named(&folder.join("epoch")), "test").unwrap();
    let mut latch = state.begin(FirstRun::Harmless).unwrap().latch;
    // A busy machine is not a disk that hangs.
    latch.start_writer(Duration::from_secs(120)).unwrap();
    latch
}

impl Bench {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let bus = Bus::default();
        let latch = open(folder.path());
        let flusher = LatchFlusher::of(&latch).unwrap();
        let server = ServerFixture::with_latch(bus.clone(), latch);
        bus.record().latch = Some(folder.path().join("epoch.stop"));
        let session = SessionFixture::submitted_on(server).obtain(OFFSETS);
        Self {
            folder,
            session,
            flusher,
            flushed: "released\n".to_owned(),
            quit: false,
        }
    }

    /// Contents of the latch.
    fn latch(&self) -> String {
        fs::read_to_string(self.folder.path().join("epoch.stop")).unwrap()
    }

    /// One tick.
    fn step(&mut self, stop: bool) -> TickRecord<2> {
        let row = self.session.server.step_with(
            1,
            OperatorInputs {
                stop,
                quit: self.quit,
                ..OperatorInputs::default()
            },
        );
        self.see(&row);
        row
    }

    fn see(&mut self, row: &TickRecord<2>) {
        if self.flusher.see(row.latched, row.latch_lost) {
            self.flushed = self.latch();
        }
    }

    /// One tick in which this asserts a stop, which the file has before the drives have the
    /// references.
    fn assert_stop(&mut self, stop: Stop) {
        let bus = self.session.server.bus.clone();
        match stop {
            Stop::None | Stop::AtTheMachine => {}
            Stop::ByTheOwner => {
                let stop = ClientMessage::Stop(self.session.client.epoch);
                assert_eq!(self.session.say(&stop), 1);
            }
            Stop::Nominal => bus.record().nominal[0].0 += i64::from(NOMINAL_STEP_NM) + 1,
            Stop::FailedRead => bus.record().read_fails = true,
            Stop::RefusedWrite => {
                // The tick after learns of it.
                bus.record().write_fails = true;
                self.step(false);
                bus.record().write_fails = false;
            }
        }
        let row = self.step(stop == Stop::AtTheMachine);
        bus.record().read_fails = false;
        if stop != Stop::None {
            assert_eq!((row.state.phase, row.latched), (Phase::Fault, true));
            assert_eq!(
                bus.record().latch_at_write,
                "stopped \n",
                "latched after the drives were written"
            );
        }
    }

    fn rearm(&mut self) {
        for _ in 0..=RAMP {
            self.step(false);
        }
        let row = self.session.server.step_rearmed();
        assert_eq!((row.state.phase, row.latched), (Phase::Listening, false));
        self.see(&row);
    }

    /// The stop at its time, then the end.
    fn run(&mut self, stop: Stop, time: Time, end: End, quits: bool) {
        if matches!(time, Time::Before | Time::BeforeAndRearmed) {
            self.assert_stop(stop);
        }
        if time == Time::BeforeAndRearmed {
            self.rearm();
        }
        self.quit = quits;
        for tick in 0..RAMP {
            match (time, tick) {
                (Time::AtFirst, 0) | (Time::During, DURING) | (Time::AtLast, LAST) => {
                    self.assert_stop(stop)
                }
                _ => drop(self.step(false)),
            }
        }
        let bus = self.session.server.bus.clone();
        match (time, end) {
            (Time::AtTheEnd, End::KillInWrite) => {
                bus.record().dies = true;
                assert!(catch_unwind(AssertUnwindSafe(|| self.assert_stop(stop))).is_err());
            }
            (Time::AtTheEnd, _) => self.assert_stop(stop),
            (_, End::KillInWrite) => {
                bus.record().dies = true;
                assert!(catch_unwind(AssertUnwindSafe(|| self.step(false))).is_err());
            }
            _ => {}
        }
        if end == End::Quit {
            for _ in 0..=RAMP {
                if self.session.server.may_end(true) {
                    return;
                }
                self.step(false);
            }
            panic!("the server does not end");
        }
    }

    /// The next server on this machine: its folder, and its phase at the start.
    fn restart(self, end: End) -> (tempfile::TempDir, ServerFixture<2>) {
        let Self {
            folder,
            session,
            flusher,
            flushed,
            ..
        } = self;
        let bus = session.server.bus.clone();
        drop((session, flusher));
        if end == End::PowerLoss {
            fs::write(folder.path().join("epoch.stop"), flushed).unwrap();
        }
        let mut record = bus.record();
        (record.dies, record.read_fails) = (false, false);
        drop(record);
        let server = ServerFixture::with_latch(bus, open(folder.path()));
        (folder, server)
    }
}

#[test]
fn a_stop_is_never_forgotten_and_a_quit_is_none() {
    let mut cases = 0;
    for stop in Stop::ALL {
        for (time, end) in Time::ALL
            .into_iter()
            .flat_map(|time| End::ALL.map(|end| (time, end)))
        {
            for quits in [false, true] {
                let no_stop_to_rearm = stop == Stop::None && time == Time::BeforeAndRearmed;
                // A quit is asked of a server; the reference that is refused in its last write
                // was never written.
                let unheard =
                    end == End::KillInWrite && time == Time::AtTheEnd && stop == Stop::RefusedWrite;
                if no_stop_to_rearm || unheard || (end == End::Quit && !quits) {
                    continue;
                }
                let mut bench = Bench::new();
                bench.run(stop, time, end, quits);
                let (_folder, server) = bench.restart(end);
                let is_stopped = stop != Stop::None && time != Time::BeforeAndRearmed;
                let case = format!("{stop:?}, {time:?}, {end:?}, asked to quit: {quits}");
                assert_eq!(server.phase() == Phase::Fault, is_stopped, "{case}");
                cases += 1;
            }
        }
    }
    assert_eq!(cases, 6 * 6 * 7 - 7 - 2);
}
