//! Any connection, any keys, any bytes: the tag is an unknown function of them. What a frame says is
//! replaced by any message.

use gantry_tau_core::control::endpoint::Transport;
use gantry_tau_core::control::keys::{Keyring, MacKey};
use gantry_tau_core::control::message::{
    Challenge, ClientMessage, Command, ContentError, Counters, KeyedHello, ServerMessage,
};
use gantry_tau_core::control::session::{OWNER_FRAMES, Session};
use gantry_tau_core::control::wire::{
    Body, Frame, HEADER_LEN, Kind, PROTOCOL_VERSION, Short, Suite, TAG_LEN,
};
use gantry_tau_core::units::Epoch;
use gantry_tau_core::verification::control::keyed::{Gate, Greeting, Keyed};
use gantry_tau_core::verification::control::{Diagnostics, Guard, Slot, client_from_parts};

use super::kani;
use crate::properties::keys::{self, Door, Greeter};
use crate::properties::session::StepInput;
use crate::stand_in::{self, Places};

/// Bytes of the longest frame of a client of one axis, but a Hello.
const LONGEST: usize = whole(Command::<1>::LENGTH);
/// The same of three axes.
const LONGEST_OF_THREE: usize = whole(Command::<3>::LENGTH);
/// Bytes of a Hello.
const HELLO: usize = HEADER_LEN + KeyedHello::LENGTH + TAG_LEN;

/// Any message of a frame, or none.
#[cfg_attr(
    not(kani),
    allow(dead_code, reason = "Kani puts it in the place of the decoder")
)]
fn any_message<const N: usize>(_: &Frame<'_>) -> Result<ClientMessage<N>, ContentError> {
    if kani::any() {
        Ok(kani::any())
    } else {
        Err(kani::any())
    }
}

/// Any message to a client, or none.
#[cfg_attr(
    not(kani),
    allow(dead_code, reason = "Kani puts it in the place of the decoder")
)]
fn any_answer<const N: usize>(_: &Frame<'_>) -> Result<ServerMessage<N>, ContentError> {
    if kani::any() {
        Ok(kani::any())
    } else {
        Err(kani::any())
    }
}

/// Any length that is at most this.
fn any_length(most: usize) -> usize {
    let length = kani::any();
    assume!(length <= most, length == most, "the longest");
    length
}

/// Any places in what is given to a stand-in, which is shorter than 256 bytes: of a place of 64 bits a
/// remainder is dear, and is computed for every tag and cookie.
fn any_places() -> Places {
    let any = || usize::from(kani::any::<u8>());
    Places {
        secret: any(),
        word: any(),
        byte: any(),
        context: any(),
        salt: kani::any(),
    }
}

/// No keys.
fn no_keys() -> Keyring {
    stand_in::choose_tag(any_places());
    Keyring::new(&kani::any())
}

/// One key of any role.
fn any_keyring() -> Keyring {
    stand_in::choose_tag(any_places());
    let mut keyring = Keyring::new(&kani::any());
    assert!(keyring.add(kani::any()).is_ok(), "there is room");
    keyring
}

/// Any work with these keys, in the middle of any tick.
fn any_gate(keyring: &Keyring) -> Gate {
    let budgets = (kani::any(), kani::any());
    Gate::from_parts(
        keyring.clone(),
        budgets,
        kani::any(),
        kani::any(),
        kani::any(),
    )
}

/// A new connection of a transport, after any frames of this tick, over any session.
fn any_door<'a, const N: usize>(
    keyring: &'a Keyring,
    session: &'a Session<N>,
    transport: Transport,
    is_owner: bool,
) -> Door<'a, N> {
    let mut slot = Slot::new(kani::any(), transport, Suite::Tag);
    slot.frames = any_frames();
    Door {
        slot,
        gate: any_gate(keyring),
        keyring,
        session,
        epochs: kani::any(),
        is_owner,
    }
}

/// Any datagram of at most three axes, most of them no frame with its tag. The key of the session is
/// the gate's.
fn check_forgery<const N: usize>() {
    let (keyring, session) = (no_keys(), kani::any());
    let door: Door<'_, N> = any_door(&keyring, &session, Transport::Datagram, kani::any());
    let bytes: [u8; LONGEST_OF_THREE] = kani::any();
    let bytes = &bytes[..any_length(LONGEST_OF_THREE)];
    let is_forged = keys::forgery_is_nothing(&door, bytes);
    kani::cover!(
        is_forged & door.is_owner,
        "a forgery from the owner's address"
    );
    kani::cover!(
        !is_forged & !bytes.is_empty(),
        "a frame with its tag, or a part of one"
    );
}

/// These first bytes of the owner's stream.
fn check_forgery_of<const N: usize>(bytes: &[u8]) {
    let (keyring, session) = (no_keys(), kani::any());
    let door: Door<'_, N> = any_door(&keyring, &session, Transport::Stream, true);
    let is_forged = keys::forgery_is_nothing(&door, bytes);
    kani::cover!(is_forged, "a frame without its tag");
    kani::cover!(!is_forged, "a frame with its tag");
}

/// Frames that were read in a tick.
fn any_frames() -> u8 {
    let frames = kani::any();
    assume!(
        frames <= OWNER_FRAMES,
        frames == OWNER_FRAMES,
        "no budget is left"
    );
    frames
}

/// Any bytes behind the good header of a kind.
fn framed<const LENGTH: usize>(kind: Kind) -> [u8; LENGTH] {
    let mut bytes: [u8; LENGTH] = kani::any();
    bytes[0] = b'G';
    bytes[1] = b'T';
    bytes[2] = PROTOCOL_VERSION;
    bytes[3] = kind.code();
    bytes[4] = u8::try_from(LENGTH - HEADER_LEN - TAG_LEN).unwrap_or(0);
    bytes[5] = 0;
    bytes[6] = Suite::Tag.code();
    bytes[7] = 0;
    bytes
}

/// Length of a whole frame.
const fn whole(body: usize) -> usize {
    HEADER_LEN + body + TAG_LEN
}

/// Any Hello of 68 bytes from any peer, under any key.
fn check_greeting<const N: usize>(property: impl FnOnce(&Greeter<'_, N>, &[u8])) {
    let keyring = any_keyring();
    let gate = any_gate(&keyring);
    let session = kani::any();
    let greeter = Greeter {
        gate: &gate,
        keyring: &keyring,
        // Cookies do not depend on it here.
        cookie_key: &kani::any(),
        session: &session,
        next: kani::any(),
        peer: &kani::any(),
    };
    let bytes: [u8; HELLO] = kani::any();
    property(&greeter, &bytes);
}

/// Kinds of a judgement: proven, asked again, may only read, not answered. In a function of its own: of
/// a cover over a `match` the compiler makes one for each of its arms, and most of those cannot be met.
fn kinds(greeting: Option<Greeting>) -> [bool; 4] {
    [
        matches!(greeting, Some(Greeting::Proven(_))),
        matches!(greeting, Some(Greeting::Challenge(..))),
        matches!(greeting, Some(Greeting::ReadOnly(_))),
        matches!(greeting, Some(Greeting::Silence)),
    ]
}

/// Any counts; the refusals are written, never read.
fn any_diagnostics() -> Diagnostics {
    Diagnostics {
        counters: kani::any::<Counters>(),
        late: kani::any(),
        ..Diagnostics::default()
    }
}

/// Any body of a frame.
struct Bytes<const LENGTH: usize>([u8; LENGTH]);

impl<const LENGTH: usize> Body for Bytes<LENGTH> {
    const LENGTH: usize = LENGTH;

    fn write(&self, body: &mut [u8]) -> Result<(), Short> {
        *body.first_chunk_mut().ok_or(Short)? = self.0;
        Ok(())
    }

    fn read(body: &[u8]) -> Result<Self, ContentError> {
        body.first_chunk()
            .map(|bytes| Self(*bytes))
            .ok_or(ContentError::Reserved)
    }
}

/// Any body of a length, behind a header and before a context.
fn check_input<const BODY: usize, const COVERED: usize, const CONTEXT: usize, const ALL: usize>() {
    stand_in::choose_tag(any_places());
    let (key, context): (MacKey, [u8; CONTEXT]) = (kani::any(), kani::any());
    let body = Bytes::<BODY>(kani::any());
    keys::mac_input_of_frame_is_injective::<_, COVERED, ALL>(&key, (kani::any(), &body), &context);
}

/// Any client of a suite.
fn check_client<const N: usize>(guard: Guard, suite: Suite) {
    let client = client_from_parts::<N>(kani::any(), guard);
    let bytes: [u8; 48] = kani::any();
    let bytes = &bytes[..any_length(48)];
    keys::client_suite_is_kept(&client, suite, bytes);
    kani::cover!(
        (bytes.len() > HEADER_LEN) & (bytes.get(6) != Some(&suite.code())),
        "a frame of the other suite"
    );
}

harnesses! {
    slot_forgery_is_nothing [minisat, unwind 89, stub(gantry_tau_core::control::keys::tag, crate::stand_in::tag), stub(gantry_tau_core::control::keys::MacKey::mac, crate::stand_in::mac), stub(gantry_tau_core::control::keys::MacKey::new, crate::stand_in::new_key), stub(gantry_tau_core::control::wire::decode_client, any_message)] { check_forgery::<3>(); }
    slot_forgery_of_goodbye_is_nothing [minisat, unwind 33, stub(gantry_tau_core::control::keys::tag, crate::stand_in::tag), stub(gantry_tau_core::control::keys::MacKey::mac, crate::stand_in::mac), stub(gantry_tau_core::control::keys::MacKey::new, crate::stand_in::new_key), stub(gantry_tau_core::control::wire::decode_client, any_message)] { check_forgery_of::<1>(&framed::<{ whole(Epoch::LENGTH) }>(Kind::Goodbye)); }
    slot_replay_is_nothing [minisat, unwind 17, stub(gantry_tau_core::control::keys::tag, crate::stand_in::tag), stub(gantry_tau_core::control::keys::MacKey::mac, crate::stand_in::mac), stub(gantry_tau_core::control::keys::MacKey::new, crate::stand_in::new_key), stub(gantry_tau_core::control::wire::decode_client, any_message)] {
        let (keyring, session) = (no_keys(), kani::any());
        let door = any_door::<1>(&keyring, &session, Transport::Datagram, kani::any());
        let bytes: [u8; LONGEST] = kani::any();
        let was_heard = keys::replay_is_nothing(&door, &bytes[..any_length(LONGEST)]);
        kani::cover!(was_heard, "a frame is heard once");
    }
    session_unauthentic_is_counted [minisat, unwind 14, stub(gantry_tau_core::verification::control::nominal_stepped, crate::stand_in::nominal_stepped), stub(gantry_tau_core::verification::control::nominal_accelerated, crate::stand_in::nominal_accelerated), stub(gantry_tau_core::verification::control::decide, crate::stand_in::decide), stub(gantry_tau_core::verification::control::Axis::act, crate::stand_in::act)] {
        stand_in::choose_bit(kani::any());
        stand_in::choose_argument(kani::any(), kani::any());
        let input: StepInput<1> = StepInput {
            session: kani::any(),
            tick: kani::any(),
            refused: kani::any(),
            accepted: kani::any(),
            diagnostics: any_diagnostics(),
        };
        let frames: u16 = kani::any();
        keys::unauthentic_is_counted(&input, frames);
        kani::cover!(frames > 0, "some frames are not authentic");
    }
    greeting_is_judged [minisat, unwind 51, stub(gantry_tau_core::control::keys::tag, crate::stand_in::tag), stub(gantry_tau_core::control::keys::MacKey::mac, crate::stand_in::mac), stub(gantry_tau_core::control::keys::MacKey::new, crate::stand_in::new_key), stub(gantry_tau_core::control::keys::Keyring::cookie_of_window, crate::stand_in::cookie_of_keyring), stub(crate::properties::keys::cookie, crate::stand_in::cookie_of_definition)] {
        check_greeting::<1>(|greeter, bytes| {
            let [proven, asked, reads, silence] = kinds(keys::greeting_is_judged(greeter, bytes));
            kani::cover!(proven, "some are proven");
            kani::cover!(asked, "some are asked again");
            kani::cover!(reads, "some may only read");
            kani::cover!(silence, "some are not answered");
        });
    }
    greeting_answer_is_shorter [minisat, unwind 51, stub(gantry_tau_core::control::keys::tag, crate::stand_in::tag), stub(gantry_tau_core::control::keys::MacKey::mac, crate::stand_in::mac), stub(gantry_tau_core::control::keys::MacKey::new, crate::stand_in::new_key), stub(gantry_tau_core::control::keys::Keyring::cookie_of_window, crate::stand_in::cookie_of_keyring), stub(crate::properties::keys::cookie, crate::stand_in::cookie_of_definition), stub(gantry_tau_core::verification::control::checksum, crate::stand_in::checksum)] {
        stand_in::choose_checksum(kani::any(), kani::any());
        check_greeting::<1>(|greeter, bytes| {
            let is_answered = keys::greeting_answer_is_shorter(greeter, bytes);
            kani::cover!(is_answered, "some are answered");
            kani::cover!(!is_answered, "some are not answered");
        });
    }
    mac_input_of_cookie_is_injective [minisat, unwind 51, stub(gantry_tau_core::control::keys::MacKey::mac, crate::stand_in::mac), stub(gantry_tau_core::control::keys::MacKey::new, crate::stand_in::new_key)] {
        stand_in::choose_tag(any_places());
        keys::mac_input_of_cookie_is_injective(&kani::any(), (&kani::any(), &kani::any()), kani::any(), kani::any());
    }
    mac_input_of_session_key_is_injective [minisat, unwind 74, stub(gantry_tau_core::control::keys::MacKey::mac, crate::stand_in::mac), stub(gantry_tau_core::control::keys::MacKey::new, crate::stand_in::new_key)] {
        stand_in::choose_tag(any_places());
        keys::mac_input_of_session_key_is_injective(&kani::any(), &kani::any());
    }
    mac_input_of_frame_is_injective [minisat, unwind 17, stub(gantry_tau_core::control::keys::MacKey::mac, crate::stand_in::mac), stub(gantry_tau_core::verification::control::checksum, crate::stand_in::checksum)] {
        stand_in::choose_checksum(kani::any(), kani::any());
        check_input::<{ Epoch::LENGTH }, { HEADER_LEN + Epoch::LENGTH }, 0, { HEADER_LEN + Epoch::LENGTH }>();
        check_input::<{ Challenge::LENGTH }, { HEADER_LEN + Challenge::LENGTH }, 16, { HEADER_LEN + Challenge::LENGTH + 16 }>();
    }
    tag_comparison_is_exact [minisat, unwind 17] { keys::tag_comparison_is_exact(&kani::any(), &kani::any()); }
    suite_is_kept [minisat, unwind 25] {
        let bytes: [u8; 24] = kani::any();
        let is_frame = keys::suite_is_kept(&bytes[..any_length(24)], kani::any());
        kani::cover!(is_frame, "the shortest frame");
    }
    sent_suite_is_kept [minisat, unwind 17, stub(gantry_tau_core::control::keys::tag, crate::stand_in::tag), stub(gantry_tau_core::control::keys::MacKey::mac, crate::stand_in::mac), stub(gantry_tau_core::control::keys::MacKey::new, crate::stand_in::new_key), stub(gantry_tau_core::verification::control::checksum, crate::stand_in::checksum)] {
        stand_in::choose_checksum(kani::any(), kani::any());
        let keyring = any_keyring();
        let hello: Option<KeyedHello> = kani::any();
        keys::sent_suite_is_kept::<1>(&any_gate(&keyring), hello.as_ref(), &kani::any(), (kani::any(), kani::any()));
        kani::cover!(hello.is_some_and(|hello| keyring.get(hello.key).is_some()), "a Hello of a known key");
    }
    client_suite_is_kept [minisat, unwind 49, stub(gantry_tau_core::verification::control::checksum, crate::stand_in::checksum), stub(gantry_tau_core::control::wire::decode_server, any_answer)] {
        stand_in::choose_checksum(kani::any(), kani::any());
        check_client::<1>(Guard::Checksum, Suite::Checksum);
    }
    client_suite_with_a_key_is_kept [minisat, unwind 49, stub(gantry_tau_core::control::wire::decode_server, any_answer), stub(gantry_tau_core::control::keys::tag, crate::stand_in::tag), stub(gantry_tau_core::control::keys::MacKey::mac, crate::stand_in::mac), stub(gantry_tau_core::control::keys::MacKey::new, crate::stand_in::new_key)] {
        stand_in::choose_tag(any_places());
        check_client::<1>(Guard::Tag(kani::any::<Keyed>()), Suite::Tag);
    }
}
