//! Black boxes of sessions with random settings and random clients, seeded.

use gantry_tau_core::control::agitation::AgitationBudget;
use gantry_tau_core::control::axis::{Actual, InForce, Offsets};
use gantry_tau_core::control::channel::{LimitValues, Limits};
use gantry_tau_core::control::message::{
    AxisLimits, Capabilities, ClientMessage, Command, ContentError, FrameError, Hello, Mode,
};
use gantry_tau_core::control::session::config::{
    AxisConfig, Config, MissBudget, Parameters, Travel,
};
use gantry_tau_core::control::session::{
    BlackBox, Connection, Event, Events, Input, LastWrite, Reading, Session, Start, TickInput,
};
use gantry_tau_core::units::{
    Epoch, EpochRange, ForceMn, MomentUnm, OffsetNm, PositionNm, Sequence, Tick, TorquePermille,
    VelocityUmS, WrenchSample,
};
use gantry_tau_server::black_box::Window;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const OWNER: Connection = Connection(u64::MAX);

fn limits<U>(max: i32, step: i32, accel: i32, ramp: i32) -> Limits<U> {
    let values = LimitValues {
        max,
        step,
        accel,
        ramp,
    };
    Limits::new(values).unwrap()
}

fn config<const N: usize>(random: &mut ChaCha8Rng) -> Config<N> {
    let step = random.random_range(100..50_000);
    let limits = AxisLimits {
        position: limits(2_000_000, step, 2 * step, random.random_range(1..=step)),
        velocity: limits(5_000, 200, 400, 50),
        torque: limits(50, 5, 10, 1),
    };
    let reach = Travel::around_zero(random.random_range(1_000..1_000_000_000));
    let agitation = AgitationBudget::new(random.random_range(1..=2_000));
    let axis = AxisConfig {
        limits,
        agitation: agitation.filter(|_| random.random_bool(0.5)),
        ..AxisConfig::position_only(limits.position, reach, random.random())
    };
    let budget = MissBudget {
        window: random.random_range(1..=128),
        allowed: random.random(),
    };
    Config::new(Parameters {
        budget: random.random_bool(0.5).then_some(budget),
        capabilities: Capabilities(random.random()),
        kinematics_checksum: random.random(),
        echo_window: random.random(),
        ..Parameters::thesis([axis; N])
    })
    .unwrap()
}

fn offset(is_small: bool, small: i32, random: &mut ChaCha8Rng) -> i32 {
    if is_small {
        random.random_range(-small..=small)
    } else {
        random.random()
    }
}

fn position(wild: bool, random: &mut ChaCha8Rng) -> PositionNm {
    PositionNm(if wild {
        random.random()
    } else {
        random.random_range(-99..99)
    })
}

fn offsets(random: &mut ChaCha8Rng) -> Offsets {
    let is_small = random.random_bool(0.9);
    Offsets {
        position: OffsetNm(offset(is_small, 9_999, random)),
        velocity: VelocityUmS(offset(is_small, 999, random)),
        torque: TorquePermille(random.random_range(-50..=50)),
    }
}

/// Returns the command that answers the last State; `accepted` is the sequence of the last accepted
/// command.
fn answer<const N: usize>(
    session: &Session<N>,
    accepted: Sequence,
    random: &mut ChaCha8Rng,
) -> Event<N> {
    Event::Message(ClientMessage::Command(Command {
        epoch: session.epoch(),
        sequence: Sequence(accepted.0 + random.random_range(1..3)),
        echo: session.last_tick(),
        mode: if random.random_bool(0.8) {
            Mode::Obtain
        } else {
            Mode::Submit
        },
        targets: std::array::from_fn(|_| offsets(random)),
    }))
}

/// Returns an event of any kind.
fn event<const N: usize>(
    session: &Session<N>,
    accepted: Sequence,
    random: &mut ChaCha8Rng,
) -> Event<N> {
    let received = random.random();
    match random.random_range(0..19) {
        0 => Event::Flood,
        1 => Event::Closed,
        2 => Event::Broken(FrameError::Checksum),
        3 => Event::Broken(FrameError::Version { received }),
        4 => Event::Dropped(FrameError::Magic),
        5 => Event::Dropped(FrameError::Length),
        6 => Event::Dropped(FrameError::TooLong {
            length: random.random(),
        }),
        7 => Event::Malformed(ContentError::Reserved),
        8 => Event::Malformed(ContentError::Limits),
        9 => Event::Malformed(ContentError::Kind { received }),
        10 => Event::Malformed(ContentError::Code { received }),
        11 => Event::Malformed(ContentError::Axes {
            expected: N,
            received,
        }),
        12 => Event::Malformed(ContentError::Length {
            expected: 0,
            received: random.random_range(0..usize::MAX),
        }),
        13 => Event::Message(ClientMessage::Stop(Epoch(random.random()))),
        14 => Event::Message(ClientMessage::Goodbye(session.epoch())),
        15 => Event::Message(ClientMessage::Hello(Hello {
            axes: received,
            capabilities: Capabilities(random.random()),
        })),
        16 => Event::Message(ClientMessage::Command(Command {
            epoch: Epoch(random.random()),
            sequence: Sequence(random.random()),
            echo: Tick(random.random()),
            mode: Mode::Submit,
            targets: std::array::from_fn(|_| offsets(random)),
        })),
        _ => answer(session, accepted, random),
    }
}

fn input<const N: usize>(
    session: &Session<N>,
    accepted: Sequence,
    epochs: EpochRange,
    random: &mut ChaCha8Rng,
) -> Input<N> {
    let mut events = Events::new();
    let parameters = session.config().parameters();
    if session.owner().is_none() && random.random_bool(0.5) {
        let hello = ClientMessage::Hello(Hello {
            axes: u8::try_from(N).unwrap(),
            capabilities: parameters.capabilities,
        });
        events.push((OWNER, Event::Message(hello))).unwrap();
    } else if random.random_bool(0.9) {
        let answer = answer(session, accepted, random);
        events.push((OWNER, answer)).unwrap();
    }
    let is_odd = random.random_bool(0.1);
    let others = if is_odd { random.random_range(1..8) } else { 0 };
    for _ in 0..others {
        let is_owner = random.random_bool(0.3);
        let other = (!is_owner).then(|| Connection(random.random()));
        let event = event(session, accepted, random);
        events.push((other.unwrap_or(OWNER), event)).unwrap();
    }
    let wild = random.random_bool(0.02);
    let last_write = match random.random_range(0..100) {
        0 => LastWrite::Unknown,
        1 => LastWrite::Refused {
            in_force: std::array::from_fn(|_| InForce {
                nominal: position(wild, random),
                offsets: offsets(random),
            }),
        },
        _ => LastWrite::Accepted,
    };
    let tick = TickInput {
        elapsed_cycles: if wild { random.random() } else { 1 },
        reading: random.random_bool(0.98).then(|| Reading {
            nominal: std::array::from_fn(|_| position(wild, random)),
            actual: std::array::from_fn(|_| Actual {
                position: PositionNm(random.random()),
                velocity: VelocityUmS(random.random()),
                torque: TorquePermille(random.random()),
            }),
        }),
        sensor: random.random_bool(0.9).then(|| WrenchSample {
            age: random.random(),
            is_cut: random.random(),
            force: std::array::from_fn(|_| ForceMn(random.random())),
            moment: std::array::from_fn(|_| MomentUnm(random.random())),
        }),
        stop: random.random_bool(0.02),
        quit: random.random_bool(0.01),
        rearm: random.random_bool(0.5),
    };
    Input {
        tick,
        last_write,
        arrival_us: random.random(),
        unauthentic: random.random(),
        epochs,
        events,
    }
}

/// Returns a window of a session with random events.
#[must_use]
pub fn window<const N: usize>(seed: u64) -> Window<N> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let offsets = Offsets {
        position: OffsetNm(random.random_range(-9..9)),
        ..Offsets::default()
    };
    let nominal = PositionNm(0);
    let start = Start {
        in_force: [InForce { nominal, offsets }; N],
        stop_latched: random.random_bool(0.1),
    };
    let epochs = EpochRange {
        first: Epoch(random.random_range(1..u64::MAX / 2)),
        last: Epoch(u64::MAX),
    };
    let mut session = Session::new(config(&mut random), &start).unwrap();
    let mut accepted = Sequence(0);
    let mut black_box = Box::new(BlackBox::<N, 16>::new());
    for _ in 0..random.random_range(1..200) {
        let input = input(&session, accepted, epochs, &mut random);
        black_box.before_tick(&session);
        let output = session.tick(&input);
        black_box.after_tick(&input, &output, output.ended.is_some());
        accepted = output.state.accepted;
    }
    Window::of(&black_box).unwrap()
}
