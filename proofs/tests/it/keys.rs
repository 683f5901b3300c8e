//! T27 to T31 on stable Rust, with HMAC-SHA-256 itself: forgeries that are nearly right, replays, and
//! endpoints with keys under attack.

use gantry_tau_core::control::axis::Offsets;
use gantry_tau_core::control::endpoint::{Budget, Endpoint, Transport};
use gantry_tau_core::control::keys::{Cookie, Key, KeyId, Keyring, MacKey, Nonce, Role, SessionOf};
use gantry_tau_core::control::message::{
    Capabilities, Challenge, ClientMessage, Command, Hello, KeyedHello, Mode, PROTOCOL_VERSION,
    Phase, Refusal, State,
};
use gantry_tau_core::control::session::{Connection, Event, Input, NoRecorder, Session, Start};
use gantry_tau_core::control::wire::{Body, HEADER_LEN, Kind, Suite, TAG_LEN};
use gantry_tau_core::units::{Epoch, EpochRange, PositionNm, Sequence, Tick};
use gantry_tau_core::verification::control::keyed::{
    Gate, Keyed, Seen, SessionKey, peer_of_stream,
};
use gantry_tau_core::verification::control::{Guard, Slot, client_from_parts, inbox};
use gantry_tau_core::{AxisLimits, Config, Parameters};
use gantry_tau_proofs::properties::endpoint::{EndpointOp, Told, takes_anything};
use gantry_tau_proofs::properties::keys::{self, Door, Greeter};
use gantry_tau_proofs::properties::session::StepInput;
use gantry_tau_proofs::properties::wire::crc_32;
use proptest::collection::vec;
use proptest::option;
use proptest::prelude::*;
use proptest::sample::select;

use crate::any;
use crate::client_monitor::dialogue;

const CONTROL: [u8; 32] = [1; 32];
const READ: [u8; 32] = [2; 32];
const STRANGE: [u8; 32] = [3; 32];
const SESSION: [u8; 32] = [4; 32];
const START: [u8; 32] = [5; 32];
const NONCE: Nonce = [0xa5; 16];

fn control() -> Key {
    Key::new(&CONTROL, Role::Control)
}

/// Two keys: the first controls, the second reads.
fn keyring() -> Keyring {
    let mut keyring = Keyring::new(&START);
    keyring.add(control()).unwrap();
    keyring.add(Key::new(&READ, Role::Read)).unwrap();
    keyring
}

fn cookie_key() -> MacKey {
    MacKey::new(&MacKey::new(&START).mac(&[b"gantry-tau 2 cookie"]))
}

/// A trailer, right or nearly.
#[derive(Clone, Debug)]
enum Seal {
    Right,
    /// One bit of the trailer or of what it covers is flipped.
    Bit(usize),
    /// The last byte of the trailer is another one.
    Last(u8),
    /// The first byte of the trailer is right, and no other.
    FirstOnly,
    /// The tag of the body without its header.
    OfBody,
    /// The tag of the frame and a context.
    WithContext(Nonce),
    /// The tag under another key of this machine.
    Under([u8; 32]),
    /// A checksum, and suite 0 in the header.
    Checksum,
    /// Suite 0 in the header, and a tag of that.
    OtherSuite,
    /// Suite 1 in the header, and a checksum of that.
    OtherTrailer,
    /// So many bytes of a right frame.
    Cut(usize),
    /// Right, with a byte behind.
    Longer(u8),
    Zero,
}

fn seal() -> impl Strategy<Value = Seal> {
    prop_oneof![
        6 => Just(Seal::Right),
        2 => any::<usize>().prop_map(Seal::Bit),
        1 => (1..=u8::MAX).prop_map(Seal::Last),
        1 => Just(Seal::FirstOnly),
        1 => Just(Seal::OfBody),
        1 => prop_oneof![Just(NONCE), any::<Nonce>()].prop_map(Seal::WithContext),
        1 => select(vec![CONTROL, READ, STRANGE, SESSION, [0; 32]]).prop_map(Seal::Under),
        1 => Just(Seal::Checksum),
        1 => Just(Seal::OtherSuite),
        1 => Just(Seal::OtherTrailer),
        1 => any::<usize>().prop_map(Seal::Cut),
        1 => any::<u8>().prop_map(Seal::Longer),
        1 => Just(Seal::Zero),
    ]
}

/// A frame of a kind, sealed under a key: by the page `wire.md`, without core.
fn sealed((kind, body): &(u8, Vec<u8>), key: &MacKey, seal: &Seal) -> Vec<u8> {
    let length = u16::try_from(body.len()).unwrap();
    let mut bytes = vec![b'G', b'T', PROTOCOL_VERSION, *kind];
    bytes.extend_from_slice(&length.to_le_bytes());
    let is_suite_0 = matches!(seal, Seal::Checksum | Seal::OtherSuite);
    bytes.extend_from_slice(&u16::from(!is_suite_0).to_le_bytes());
    bytes.extend_from_slice(body);
    let tag = |parts: &[&[u8]], key: &MacKey| key.mac(parts)[..TAG_LEN].to_vec();
    let right = tag(&[&bytes], key);
    let trailer = match seal {
        Seal::OfBody => tag(&[body], key),
        Seal::WithContext(context) => tag(&[&bytes, context], key),
        Seal::Under(secret) => tag(&[&bytes], Key::new(secret, Role::Control).greeting()),
        Seal::Checksum | Seal::OtherTrailer => crc_32(&bytes).to_le_bytes().to_vec(),
        Seal::Zero => vec![0; TAG_LEN],
        Seal::FirstOnly => right
            .iter()
            .enumerate()
            .map(|(at, byte)| if at == 0 { *byte } else { !byte })
            .collect(),
        _ => right,
    };
    bytes.extend_from_slice(&trailer);
    let bits = 8 * bytes.len();
    match seal {
        Seal::Bit(bit) => bytes[bit % bits / 8] ^= 1 << (bit % 8),
        Seal::Last(mask) => bytes[bits / 8 - 1] ^= mask,
        Seal::Cut(length) => bytes.truncate(length % (bits / 8)),
        Seal::Longer(byte) => bytes.push(*byte),
        _ => {}
    }
    bytes
}

fn body_of<B: Body>(kind: Kind, body: &B) -> (u8, Vec<u8>) {
    let mut bytes = vec![0; B::LENGTH];
    body.write(&mut bytes).unwrap();
    (kind.code(), bytes)
}

fn a_few(number: u64) -> impl Strategy<Value = u64> {
    prop_oneof![8 => (0..4_u64).prop_map(move |few| number.saturating_add(few)), 1 => Just(number), 1 => any::number()]
}

/// Kind and body of a client's message, most of them of this session and new.
/// Boxed, as everything with a session is: a thread of tests has a small stack.
fn message<const N: usize>(session: &Session<N>) -> BoxedStrategy<(u8, Vec<u8>)> {
    let (epoch, tick) = (session.epoch(), session.last_tick());
    let of_session = prop_oneof![6 => Just(epoch), 1 => any::number().prop_map(Epoch)];
    let command = (
        any::command::<N>(),
        a_few(session.accepted().0),
        of_session.clone(),
        0..4_u64,
    )
        .prop_map(move |(command, sequence, epoch, behind)| {
            let echo = Tick(tick.0.saturating_sub(behind));
            body_of(
                Kind::Command,
                &Command {
                    epoch,
                    sequence: Sequence(sequence),
                    echo,
                    ..command
                },
            )
        });
    let hello = Hello {
        axes: u8::try_from(N).unwrap(),
        capabilities: Capabilities(2),
    };
    let other = (prop_oneof![0..11_u8, any::<u8>()], vec(any::<u8>(), 0..90));
    prop_oneof![
        6 => command,
        2 => of_session.clone().prop_map(|epoch| body_of(Kind::Goodbye, &epoch)),
        2 => of_session.prop_map(|epoch| body_of(Kind::Stop, &epoch)),
        2 => keyed_hello(session, NONCE).prop_map(|hello| body_of(Kind::KeyedHello, &hello)),
        1 => Just(body_of(Kind::Hello, &hello)),
        1 => other,
    ]
    .boxed()
}

/// A Hello, often with a cookie that is nearly right.
fn keyed_hello<const N: usize>(
    session: &Session<N>,
    nonce: Nonce,
) -> impl Strategy<Value = KeyedHello> + use<N> {
    let tick = session.last_tick();
    let next = EpochRange::VOLATILE
        .after(session.epoch())
        .unwrap_or(Epoch(0));
    let id = prop_oneof![
        6 => Just(control().id()),
        2 => Just(Key::new(&READ, Role::Read).id()),
        1 => Just(Key::new(&STRANGE, Role::Control).id()),
        1 => any::<[u8; 8]>().prop_map(KeyId),
    ];
    (id, cookie(nonce, next, tick), any::<u16>(), any::<bool>()).prop_map(
        move |(key, cookie, bits, is_other)| KeyedHello {
            hello: Hello {
                axes: 3,
                capabilities: Capabilities(bits),
            },
            key,
            nonce: if is_other && bits % 16 == 0 {
                [0; 16]
            } else {
                nonce
            },
            cookie,
        },
    )
}

/// A cookie of the peer of [`PEER`], or of one with another peer, nonce, epoch or window.
fn cookie(nonce: Nonce, next: Epoch, tick: Tick) -> impl Strategy<Value = Cookie> {
    let keyring = keyring();
    let of = move |peer: &[u8; 18], nonce: &Nonce, next: Epoch, tick: u64| {
        keyring.cookie(peer, nonce, next, Tick(tick))
    };
    (0..12_u8, any::<Cookie>()).prop_map(move |(kind, other)| {
        let mut far = PEER;
        far[17] ^= 1;
        match kind {
            0 => [0; 16],
            1 => other,
            2 => of(&far, &nonce, next, tick.0),
            3 => of(&PEER, &[0; 16], next, tick.0),
            4 => of(&PEER, &nonce, Epoch(next.0.wrapping_add(1)), tick.0),
            5 => of(&PEER, &nonce, Epoch(next.0.wrapping_sub(1)), tick.0),
            6 => of(&PEER, &nonce, next, tick.0.wrapping_sub(8_192)),
            7 => of(&PEER, &nonce, next, tick.0.wrapping_add(4_096)),
            8 => of(&PEER, &nonce, next, tick.0.wrapping_sub(4_096)),
            _ => of(&PEER, &nonce, next, tick.0),
        }
    })
}

/// Number of a stream in the place of an address, so that one cookie serves both transports.
const PEER: [u8; 18] = [1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0];

prop_compose! {
    fn budget()(tags in prop_oneof![4 => Just(16), 1 => 0..3_u8], greetings in prop_oneof![4 => Just(4), 1 => 0..3_u8]) -> Budget {
        Budget { tags, greetings }
    }
}

prop_compose! {
    fn seen(accepted: u64)(sequence in option::of(a_few(accepted)), goodbye in prop::bool::weighted(0.2), stop in prop::bool::weighted(0.2)) -> Seen {
        Seen { sequence: sequence.map(Sequence), goodbye, stop }
    }
}

prop_compose! {
    /// Most have the key of this session.
    fn gate(epoch: Epoch, accepted: u64)(
        left in budget(), seen in seen(accepted), has_key in prop::bool::weighted(0.9), tags_states: bool,
        epoch in prop_oneof![8 => Just(epoch), 1 => any::number().prop_map(Epoch)],
        proven in prop_oneof![4 => Just(0), 1 => 0..3_u64, 1 => any::<u64>()],
    ) -> Gate {
        let session = has_key.then(|| SessionKey { epoch, tags_states, key: MacKey::new(&SESSION) });
        Gate::from_parts(keyring(), (Budget::default(), left), seen, session, proven)
    }
}

/// Kind and body.
type Said = (u8, Vec<u8>);

fn session() -> BoxedStrategy<Session<3>> {
    any::session::<3>().boxed()
}

fn gate_of(session: &Session<3>) -> BoxedStrategy<Gate> {
    gate(session.epoch(), session.accepted().0).boxed()
}

/// A session, a gate that is in its tick, and frames of its client: with their trailers, most under the
/// key of the session.
type Scene = (Session<3>, Gate, Vec<(Said, Seal, bool)>);

fn scene() -> BoxedStrategy<Scene> {
    let scene = session().prop_flat_map(|session| {
        // Most under the key of the session, the others under that of a greeting.
        let frame = (message(&session), seal(), prop::bool::weighted(0.8));
        (Just(session), gate_of(&session), vec(frame, 1..16))
    });
    scene.boxed()
}

/// A session, a gate that is in its tick, and a Hello, or something else.
fn greeting() -> BoxedStrategy<(Session<3>, Gate, Said)> {
    let scene = session().prop_flat_map(|session| {
        let hello = keyed_hello(&session, NONCE);
        let hello = hello.prop_map(|hello| body_of(Kind::KeyedHello, &hello));
        let said = prop_oneof![12 => hello, 1 => message(&session)];
        (Just(session), gate_of(&session), said)
    });
    scene.boxed()
}

/// A session, a gate that is in its tick, and who is answered.
fn answered() -> BoxedStrategy<(Session<3>, Gate, Option<KeyedHello>)> {
    let scene = session().prop_flat_map(|session| {
        let hello = option::weighted(0.9, keyed_hello(&session, NONCE));
        (Just(session), gate_of(&session), hello)
    });
    scene.boxed()
}

fn key_of_frame(kind: u8, is_of_session: bool) -> MacKey {
    if is_of_session && kind != Kind::KeyedHello.code() {
        MacKey::new(&SESSION)
    } else {
        control().greeting().clone()
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    /// Connections over which some frames have come already, in one piece or two.
    #[test]
    fn forgeries_are_nothing((session, gate, frames) in scene(), is_stream: bool, is_owner: bool, cut in option::of(0..120_usize)) {
        let transport = if is_stream { Transport::Stream } else { Transport::Datagram };
        let keyring = keyring();
        let mut door = Door {
            slot: Slot::new(Connection(1), transport, Suite::Tag),
            gate,
            keyring: &keyring,
            session: &session,
            epochs: EpochRange::VOLATILE,
            is_owner,
        };
        for (message, seal, is_of_session) in &frames {
            let bytes = sealed(message, &key_of_frame(message.0, *is_of_session), seal);
            let (one, other) = bytes.split_at(cut.filter(|_| is_stream).unwrap_or(0).min(bytes.len()));
            for part in [one, other] {
                if door.slot.is_read() && !(is_stream && part.is_empty()) {
                    let _is_forged = keys::forgery_is_nothing(&door, part);
                    door.take(part);
                }
            }
        }
    }

    #[test]
    fn replays_are_nothing((session, gate, frames) in scene(), is_owner in prop::bool::weighted(0.9)) {
        let keyring = keyring();
        let mut door = Door {
            slot: Slot::new(Connection(1), Transport::Datagram, Suite::Tag),
            gate,
            keyring: &keyring,
            session: &session,
            epochs: EpochRange::VOLATILE,
            is_owner,
        };
        for (message, seal, is_of_session) in &frames {
            let bytes = sealed(message, &key_of_frame(message.0, *is_of_session), seal);
            if door.slot.is_read() {
                let _was_heard = keys::replay_is_nothing(&door, &bytes);
                door.take(&bytes);
            }
        }
    }

    #[test]
    fn unauthentic_frames_are_counted(
        session in session(), tick in any::tick_input(), last_write in any::last_write(), epochs in any::epochs(),
        events in vec((any::connection(), any::event()), 0..8), frames in prop_oneof![0..3_u16, any::<u16>()],
    ) {
        let events = events.into_iter().collect();
        let input = Input { tick, last_write, arrival_us: 0, unauthentic: 0, epochs, events };
        keys::tick_counts_unauthentic(&session, &input, frames);
        keys::unauthentic_is_counted(&StepInput::after_events(&session, &input), frames);
    }

    /// Hellos of known and unknown keys, with cookies that are nearly right.
    #[test]
    fn greetings_are_judged(
        (session, gate, hello) in greeting(),
        seal in prop_oneof![3 => Just(Seal::Right), 1 => seal()], key in select(vec![CONTROL, READ, STRANGE]), own in prop::bool::weighted(0.8),
    ) {
        let keyring = keyring();
        let named = hello.1.get(4..12).and_then(|id| keyring.get(KeyId(*id.first_chunk()?)));
        let key = named.filter(|_| own).map_or_else(|| Key::new(&key, Role::Control), Clone::clone);
        let bytes = sealed(&hello, key.greeting(), &seal);
        let greeter = Greeter {
            gate: &gate,
            keyring: &keyring,
            cookie_key: &cookie_key(),
            session: &session,
            next: EpochRange::VOLATILE.after(session.epoch()),
            peer: &PEER,
        };
        let _greeting = keys::greeting_is_judged(&greeter, &bytes);
        let _is_answered = keys::greeting_answer_is_shorter(&greeter, &bytes);
    }

    #[test]
    fn inputs_of_tags_are_injective(
        (secret, nonce, cookie) in any::<([u8; 32], Nonce, Cookie)>(), peer: [u8; 18], epoch in any::number(),
        tick in prop_oneof![any::number(), 4_094..4_098_u64], axes: u8, kinematics_checksum: u32,
    ) {
        let (epoch, tick) = (Epoch(epoch), Tick(tick));
        keys::mac_input_of_cookie_is_injective(&secret, (&peer, &nonce), epoch, tick);
        keys::mac_input_of_session_key_is_injective(&secret, &SessionOf { nonce, cookie, epoch, axes, kinematics_checksum });
        let key = MacKey::new(&secret);
        keys::mac_input_of_frame_is_injective::<_, 16, 16>(&key, (Kind::Stop, &epoch), &[]);
        keys::mac_input_of_frame_is_injective::<_, 24, 40>(&key, (Kind::Challenge, &Challenge { cookie }), &nonce);
    }

    /// Two tags of which all bytes, all but one, or the first are the same.
    #[test]
    fn tags_are_compared(one: [u8; 16], other: [u8; 16], same in 0..=17_usize, at in 0..16_usize, mask: u8) {
        let mut near = one;
        near[at] ^= mask;
        keys::tag_comparison_is_exact(&one, &near);
        near[..same.min(16)].copy_from_slice(&one[..same.min(16)]);
        near[same.min(16)..].copy_from_slice(&other[same.min(16)..]);
        keys::tag_comparison_is_exact(&one, &near);
        keys::tag_comparison_is_exact(&one, &one);
    }

    #[test]
    fn suites_are_kept(
        version in prop_oneof![6 => Just(PROTOCOL_VERSION), 1 => any::<u8>()], kind in prop_oneof![0..10_u8, any::<u8>()],
        length in prop_oneof![6 => 0..64_u16, 1 => any::<u16>()], suite in prop_oneof![6 => 0..3_u16, 1 => any::<u16>(), 1 => Just(256)],
        extra in prop_oneof![6 => select(vec![4_usize, 16]), 1 => 0..40_usize],
    ) {
        let mut bytes = [b"GT".as_slice(), &[version, kind], &length.to_le_bytes(), &suite.to_le_bytes()].concat();
        bytes.resize(HEADER_LEN + usize::from(length % 512) + extra, 0);
        for side in [Suite::Checksum, Suite::Tag] {
            let is_frame = keys::suite_is_kept(&bytes, side);
            let is_right = version == PROTOCOL_VERSION && length < 64 && suite == u16::from(side.code()) && extra == side.trailer_len();
            prop_assert_eq!(is_frame, is_right || is_frame && length <= 384);
        }
    }

    #[test]
    fn sent_suites_are_kept(
        (session, gate, hello) in answered(),
        kind in select(vec![Kind::State, Kind::Welcome, Kind::Refusal, Kind::Challenge]), is_own in prop::bool::weighted(0.9),
    ) {
        let epoch = if is_own { session.epoch() } else { Epoch(77) };
        keys::sent_suite_is_kept(&gate, hello.as_ref(), &session.welcome(), (kind, epoch));
    }

    /// Frames of either suite, for clients with and without a key.
    #[test]
    fn clients_keep_their_suite(dialogue in dialogue(), kind in 0..11_u8, epoch in 0..2_u64, has_key: bool, seal in seal(), noise in vec(any::<u8>(), 0..60)) {
        let guard = if has_key { Guard::Tag(Keyed::new(control(), NONCE)) } else { Guard::Checksum };
        let suite = if has_key { Suite::Tag } else { Suite::Checksum };
        let client = client_from_parts(dialogue, guard);
        let bodies = [
            (kind, noise),
            body_of(Kind::State, &state(epoch)),
            body_of(Kind::Refusal, &Refusal::Busy),
            body_of(Kind::Challenge, &Challenge { cookie: [7; 16] }),
        ];
        for body in &bodies {
            for seal in [Seal::Checksum, Seal::OtherSuite, Seal::OtherTrailer, Seal::Right, Seal::WithContext(NONCE), seal.clone()] {
                keys::client_suite_is_kept(&client, suite, &sealed(body, control().greeting(), &seal));
            }
        }
    }
}

/// A State that a dialogue can take.
fn state(epoch: u64) -> State<2> {
    let mut session = Session::new(
        Config::new(Parameters::thesis(
            [any::axis_of(AxisLimits::DISABLED, 0, 0); 2],
        ))
        .unwrap(),
        &Start::at_rest([PositionNm(0); 2]),
    )
    .unwrap();
    let state = session.tick(&Input::empty(EpochRange::VOLATILE)).state;
    State {
        epoch: Epoch(epoch),
        phase: Phase::Submit,
        tick: Tick(9),
        ..state
    }
}

/// Act of a peer of an endpoint with keys.
#[derive(Clone, Debug)]
enum Move {
    Op(EndpointOp<2>),
    /// A Hello with the cookie that is due, or another, from an address or over a stream.
    Hello {
        secret: [u8; 32],
        seal: Seal,
        cookie: Option<Cookie>,
        is_late: bool,
        bits: u16,
        stream: Option<u64>,
    },
    /// A frame of the session, from the owner's connection: new by so much, so many times.
    Frame {
        kind: Kind,
        ahead: u64,
        seal: Seal,
        times: usize,
    },
    Tick,
}

fn moves() -> BoxedStrategy<Vec<Move>> {
    let transport = prop_oneof![3 => Just(Transport::Stream), 1 => Just(Transport::Datagram)];
    let connection = (0..8_u64).prop_map(Connection);
    let op = prop_oneof![
        2 => transport.prop_map(EndpointOp::Open),
        1 => connection.clone().prop_map(EndpointOp::Close),
        1 => (connection, vec(any::<u8>(), 0..40)).prop_map(|(from, bytes)| EndpointOp::Feed(from, bytes)),
        1 => (any::tick_input(), any::told()).prop_map(|(tick, told)| EndpointOp::Tick(tick, told)),
    ];
    let secret = prop_oneof![8 => Just(CONTROL), 1 => Just(READ), 1 => Just(STRANGE)];
    let often_right = || prop_oneof![3 => Just(Seal::Right), 1 => seal()];
    let hello = (
        secret,
        often_right(),
        option::weighted(0.2, prop_oneof![Just([0; 16]), any::<Cookie>()]),
        prop::bool::weighted(0.1),
        any::<u16>(),
        option::of(0..8_u64),
    );
    let hello = hello.prop_map(
        |(secret, seal, cookie, is_late, bits, stream)| Move::Hello {
            secret,
            seal,
            cookie,
            is_late,
            bits,
            stream,
        },
    );
    let kind =
        prop_oneof![12 => Just(Kind::Command), 1 => Just(Kind::Goodbye), 1 => Just(Kind::Stop)];
    let times = prop_oneof![6 => Just(1), 1 => 1..12_usize];
    let frame =
        (kind, 0..3_u64, often_right(), times).prop_map(|(kind, ahead, seal, times)| Move::Frame {
            kind,
            ahead,
            seal,
            times,
        });
    vec(
        prop_oneof![2 => op.prop_map(Move::Op), 4 => hello, 8 => frame, 10 => Just(Move::Tick)],
        0..80,
    )
    .boxed()
}

const ADDRESS: [u8; 18] = [7; 18];

/// An endpoint with keys, and what its owner knows.
struct Attacked {
    endpoint: Endpoint<2>,
    /// Hellos with their tags, by connection.
    hellos: Vec<(Connection, KeyedHello)>,
    key: Option<MacKey>,
    has_declined: bool,
    granted: usize,
}

impl Attacked {
    fn does(&mut self, one: &Move) {
        match one {
            Move::Op(op) => {
                takes_anything(&mut self.endpoint, op, &mut NoRecorder);
                if matches!(op, EndpointOp::Tick(..)) {
                    self.learn();
                }
            }
            Move::Hello {
                secret,
                seal,
                cookie,
                is_late,
                bits,
                stream,
            } => {
                self.hello(secret, seal, *cookie, *is_late, *bits, *stream);
            }
            Move::Frame {
                kind,
                ahead,
                seal,
                times,
            } => {
                let session = self.endpoint.session();
                let (epoch, echo) = (session.epoch(), session.last_tick());
                for time in 0..u64::try_from(*times).unwrap() {
                    let session = self.endpoint.session();
                    let sequence = Sequence(session.accepted().0.saturating_add(ahead + time));
                    let said = match kind {
                        Kind::Command => body_of(
                            *kind,
                            &Command::<2> {
                                epoch,
                                sequence,
                                echo,
                                mode: Mode::Submit,
                                targets: [Offsets::ZERO; 2],
                            },
                        ),
                        _ => body_of(*kind, &epoch),
                    };
                    let key = self
                        .key
                        .clone()
                        .unwrap_or_else(|| control().greeting().clone());
                    let bytes = sealed(&said, &key, seal);
                    let owner = self.endpoint.session().owner().unwrap_or(Connection(0));
                    // Behind its end a stream may go on.
                    let is_forged = !matches!(seal, Seal::Longer(_))
                        && (self.key.is_none()
                            || !keys::has_tag(&bytes, &key, &[])
                            || bytes.get(6) != Some(&1));
                    if is_forged {
                        keys::feed_of_forgery_is_nothing(&mut self.endpoint, owner, &bytes);
                    } else {
                        takes_anything(
                            &mut self.endpoint,
                            &EndpointOp::Feed(owner, bytes),
                            &mut NoRecorder,
                        );
                    }
                }
            }
            Move::Tick => self.tick(),
        }
        if self.endpoint.session().owner().is_none() {
            self.key = None;
        }
    }

    fn hello(
        &mut self,
        secret: &[u8; 32],
        seal: &Seal,
        other: Option<Cookie>,
        is_late: bool,
        bits: u16,
        stream: Option<u64>,
    ) {
        let session = self.endpoint.session();
        let next = EpochRange::VOLATILE
            .after(session.epoch())
            .unwrap_or(Epoch(0));
        let peer = stream.map_or(ADDRESS, |number| peer_of_stream(Connection(number)));
        let tick = session.last_tick().0;
        let of = |tick| keyring().cookie(&peer, &NONCE, next, Tick(tick));
        let fresh = [
            of(tick),
            keyring().cookie(&peer, &NONCE, next, Tick(tick.wrapping_sub(4_096))),
        ];
        let cookie = other.unwrap_or_else(|| {
            of(if is_late {
                tick.wrapping_add(8_192)
            } else {
                tick
            })
        });
        let key = Key::new(secret, Role::Control);
        let hello = KeyedHello {
            hello: Hello {
                axes: 2,
                capabilities: Capabilities(bits & 2),
            },
            key: key.id(),
            nonce: NONCE,
            cookie,
        };
        let bytes = sealed(&body_of(Kind::KeyedHello, &hello), key.greeting(), seal);
        // Behind its end a stream may go on.
        let whole = bytes.get(..HEADER_LEN + KeyedHello::LENGTH + TAG_LEN);
        let frame = whole.filter(|_| stream.is_some()).unwrap_or(&bytes);
        let is_proven = *secret == CONTROL
            && fresh.contains(&cookie)
            && keys::has_tag(frame, key.greeting(), &[])
            && bytes.get(6) == Some(&1);
        let connection = match stream.map(Connection) {
            Some(connection) => {
                let waiting = inbox(&self.endpoint).len();
                takes_anything(
                    &mut self.endpoint,
                    &EndpointOp::Feed(connection, bytes),
                    &mut NoRecorder,
                );
                let events = inbox(&self.endpoint).get(waiting..).unwrap_or_default();
                let asks = |(from, event): &(Connection, Event<2>)| {
                    *from == connection && matches!(event, Event::Message(ClientMessage::Hello(_)))
                };
                events.iter().any(asks).then_some(connection)
            }
            None => keys::greet_is_bounded(&mut self.endpoint, &ADDRESS, &bytes, is_proven),
        };
        assert!(connection.is_none() || is_proven);
        if let Some(connection) = connection {
            self.hellos.retain(|(from, _)| *from != connection);
            self.hellos.push((connection, hello));
        }
    }

    /// One cycle on time.
    fn tick(&mut self) {
        Told::Accepted.say(self.endpoint.tick(&Input::empty(EpochRange::VOLATILE).tick));
        self.learn();
        let _sent = keys::sent_frames_are_of_the_suite(&mut self.endpoint, self.has_declined);
    }

    /// A client that is welcomed knows its key.
    fn learn(&mut self) {
        let Some(connection) = self.endpoint.output().and_then(|output| output.welcome) else {
            return;
        };
        let (_, hello) = self
            .hellos
            .iter()
            .find(|(from, _)| *from == connection)
            .unwrap();
        let welcome = self.endpoint.session().welcome();
        self.key = Some(control().session(&SessionOf {
            nonce: hello.nonce,
            cookie: hello.cookie,
            epoch: welcome.epoch,
            axes: 2,
            kinematics_checksum: welcome.kinematics_checksum,
        }));
        self.has_declined = hello.hello.capabilities.0 & 2 == 0;
        self.granted += 1;
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    /// Whoever is granted has said a Hello with its tag and its cookie; the frames of its session are
    /// heard, and no others.
    #[test]
    fn an_endpoint_is_attacked(config in any::config::<2>().boxed(), moves in moves()) {
        let session = Session::new(config, &Start::at_rest([PositionNm(0); 2])).unwrap();
        let endpoint = Endpoint::keyed(session, EpochRange::VOLATILE, keyring(), Budget::default());
        let mut attacked = Attacked { endpoint, hellos: Vec::new(), key: None, has_declined: false, granted: 0 };
        for one in &moves {
            attacked.does(one);
            while attacked.endpoint.poll_close().is_some() {}
        }
    }
}
