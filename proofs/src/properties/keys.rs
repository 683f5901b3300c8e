//! Keys: T27 to T31. A frame is judged by its bytes, a key, and what was heard before; that an HMAC
//! cannot be guessed is taken for granted.

use gantry_tau_core::control::client::Client;
use gantry_tau_core::control::endpoint::{Endpoint, Greeted, Transport};
use gantry_tau_core::control::keys::{
    Cookie, Key, KeyId, Keyring, MacKey, Nonce, Role, SessionOf, Tag, is_same, tag,
};
use gantry_tau_core::control::message::{Capabilities, KeyedHello, Phase, Refusal, Welcome};
use gantry_tau_core::control::session::{Connection, Event, Input, Session};
use gantry_tau_core::control::wire::{
    Body, Collector, HEADER_LEN, Kind, Sealed, Suite, TAG_LEN, enclose,
};
use gantry_tau_core::units::{Epoch, EpochRange, Tick};
use gantry_tau_core::verification::control::keyed::{
    Answer, Coming, Gate, Greeting, SessionKey, decode, enclose as enclose_answer, states_of,
};
use gantry_tau_core::verification::control::{Diagnostics, Internals, Slot, dialogue_of, inbox};

use crate::properties::session::StepInput;

/// Ticks of a window of cookies.
const WINDOW: u64 = 4_096;
/// Place of a key's name in a frame: behind header and Hello.
const KEY_ID: usize = HEADER_LEN + 4;

/// A connection of an endpoint with keys, and what its frames are judged by.
#[derive(Clone, Debug)]
pub struct Door<'a, const N: usize> {
    /// The connection.
    pub slot: Slot,
    /// The endpoint's work with its keys.
    pub gate: Gate,
    /// Its keys.
    pub keyring: &'a Keyring,
    /// Its session.
    pub session: &'a Session<N>,
    /// Epochs that may be granted.
    pub epochs: EpochRange,
    /// The connection owns the session.
    pub is_owner: bool,
}

/// Result of a read: the event, the number of bytes taken, and of frames that are not authentic.
type Heard<const N: usize> = (Option<(Option<Event<N>>, usize)>, u16);

impl<const N: usize> Door<'_, N> {
    /// Takes bytes, as an endpoint does.
    pub fn take(&mut self, bytes: &[u8]) -> Heard<N> {
        let mut input = Input::empty(self.epochs);
        let decoded = decode(
            &mut self.slot,
            bytes,
            self.is_owner,
            &mut self.gate,
            self.session,
            &mut input,
        );
        (decoded, input.unauthentic)
    }

    /// Returns the bytes of the frame that was taken last.
    fn frame<'b>(&'b self, bytes: &'b [u8]) -> &'b [u8] {
        match self.slot.transport {
            Transport::Datagram => bytes,
            Transport::Stream => self.slot.held(),
        }
    }

    /// True if a frame has the tag of who may be heard: of the owner, or over a stream of a Hello of
    /// the holder of a key.
    #[must_use]
    pub fn is_authentic(&self, frame: &[u8]) -> bool {
        let (_, _, session) = self.gate.parts();
        let is_tagged = |key: &MacKey| suite_of(frame) == Some(1) && has_tag(frame, key, &[]);
        if self.is_owner {
            return session.is_some_and(|session| {
                session.epoch == self.session.epoch() && is_tagged(&session.key)
            });
        }
        self.slot.transport == Transport::Stream
            && key_of(self.keyring, frame).is_some_and(|key| is_tagged(key.greeting()))
    }
}

/// True if the last 16 bytes are the tag of all before them and of a context.
#[must_use]
pub fn has_tag(frame: &[u8], key: &MacKey, context: &[u8]) -> bool {
    frame
        .split_last_chunk()
        .is_some_and(|(covered, trailer)| number(trailer) == number(&tag(key, covered, context)))
}

/// Tag as one number.
fn number(tag: &Tag) -> u128 {
    u128::from_le_bytes(*tag)
}

/// Suite in a header.
fn suite_of(frame: &[u8]) -> Option<u16> {
    let header: &[u8; HEADER_LEN] = frame.first_chunk()?;
    Some(u16::from_le_bytes([header[6], header[7]]))
}

/// Key that a Hello names.
fn key_of<'a>(keyring: &'a Keyring, frame: &[u8]) -> Option<&'a Key> {
    let id = frame.get(KEY_ID..)?.first_chunk()?;
    keyring
        .get(KeyId(*id))
        .filter(|_| frame[3] == Kind::KeyedHello.code())
}

/// T27: a frame whose tag is not that of its bytes has no event, takes no frame of the budget, and
/// changes nothing but one count; on a stream it may end its own connection. Returns true for such a
/// frame.
///
/// Composed as: `slot_forgery_is_nothing`.
pub fn forgery_is_nothing<const N: usize>(before: &Door<'_, N>, bytes: &[u8]) -> bool {
    let mut after = before.clone();
    let (decoded, counted) = after.take(bytes);
    let is_datagram = before.slot.transport == Transport::Datagram;
    assert!(
        decoded.is_some() || !is_datagram,
        "T27: a datagram is judged at once"
    );
    let Some((event, consumed)) = decoded else {
        assert!(
            counted == 0 && !after.slot.closing,
            "T27: a part of a frame is not judged"
        );
        nothing_is_changed(before, &after);
        return false;
    };
    assert!(consumed <= bytes.len(), "T27: no more is taken than given");
    if before.is_authentic(after.frame(bytes)) {
        return false;
    }
    let ends = after.slot.closing && !before.slot.closing;
    assert!(
        !(ends && is_datagram),
        "T27: a forgery ends no session over datagrams"
    );
    let is_broken = matches!(event, Some(Event::Broken(_)));
    assert!(event.is_none() || is_broken, "T27: a forgery has no event");
    assert!(
        !is_broken || ends && before.is_owner,
        "T27: a broken stream ends the owner's own connection"
    );
    let ends_own = ends && before.is_owner;
    assert!(
        counted == u16::from(!ends_own),
        "T27: a forgery is counted once"
    );
    nothing_is_changed(before, &after);
    true
}

/// T27: of a connection and the keys nothing is changed, but what ends the connection itself, and what
/// the work cost.
fn nothing_is_changed<const N: usize>(before: &Door<'_, N>, after: &Door<'_, N>) {
    let (old, new) = (&before.slot, &after.slot);
    assert!(
        new.frames == old.frames,
        "T27: a forgery takes no frame of the budget"
    );
    let ends = usize::from(new.closing && !old.closing);
    assert!(
        new.most_events() == old.most_events() + ends,
        "T27: a forgery is no flood"
    );
    assert!(
        new.connection == old.connection
            && new.closed == old.closed
            && (new.closing || !old.closing),
        "T27: a forgery opens and closes no other connection"
    );
    assert!(
        new.answer == old.answer
            || (new.closing && matches!(new.answer, None | Some(Answer::Notice(_)))),
        "T27: a forgery is not answered but by a notice"
    );
    assert!(
        new.hello == old.hello,
        "T27: a forgery leaves no Hello behind"
    );
    let ((old_left, old_seen, old_key), (new_left, new_seen, new_key)) =
        (before.gate.parts(), after.gate.parts());
    assert!(new_seen == old_seen, "T27: a forgery makes no frame old");
    assert!(
        is_same_key(old_key, new_key),
        "T27: a forgery changes no key"
    );
    assert!(
        new_left.tags <= old_left.tags
            && old_left.tags - new_left.tags <= 1
            && new_left.greetings <= old_left.greetings
            && old_left.greetings - new_left.greetings <= 1,
        "T27: a frame costs at most one tag"
    );
}

fn is_same_key(one: Option<&SessionKey>, other: Option<&SessionKey>) -> bool {
    match (one, other) {
        (Some(one), Some(other)) => {
            one.epoch == other.epoch
                && one.tags_states == other.tags_states
                && is_same_mac_key(&one.key, &other.key)
        }
        (None, None) => true,
        _ => false,
    }
}

/// True if two keys have the same states, word by word: a model checker would unwind the comparison of
/// their bytes.
fn is_same_mac_key(one: &MacKey, other: &MacKey) -> bool {
    let [[a, b], [c, d]] = [states_of(one), states_of(other)];
    (0..8).all(|word| a[word] == c[word] && b[word] == d[word])
}

/// T27: a datagram that comes again is nothing, in its tick, and a Command in every later one. Returns
/// true if it was heard the first time.
pub fn replay_is_nothing<const N: usize>(first: &Door<'_, N>, datagram: &[u8]) -> bool {
    if first.slot.transport == Transport::Stream {
        return false;
    }
    let mut again = first.clone();
    let (heard, counted) = again.take(datagram);
    let was_heard = counted == 0;
    assert!(
        was_heard || heard == Some((None, datagram.len())),
        "T27: what is not heard has no event"
    );
    let is_old =
        sequence_of(datagram).is_some_and(|sequence| sequence <= first.session.accepted().0);
    assert!(
        !(was_heard && is_old),
        "T27: a Command is not heard behind an accepted one"
    );
    let before = again.clone();
    let (heard, counted) = again.take(datagram);
    assert!(
        heard == Some((None, datagram.len())),
        "T27: a replay has no event"
    );
    assert!(counted == 1, "T27: a replay is counted once");
    assert!(
        !again.slot.closing || before.slot.closing,
        "T27: a replay ends nothing"
    );
    let (old, new) = (before.gate.parts().0, again.gate.parts().0);
    assert!(
        new.tags == old.tags || !was_heard,
        "T27: a replay costs no tag"
    );
    nothing_is_changed(&before, &again);
    was_heard
}

/// Sequence in a frame of a Command.
fn sequence_of(frame: &[u8]) -> Option<u64> {
    let sequence = frame.get(HEADER_LEN + 8..)?.first_chunk()?;
    (frame[3] == Kind::Command.code()).then(|| u64::from_le_bytes(*sequence))
}

/// T27: frames that are not authentic change the count of non-owners, and nothing else that leaves a
/// session or stays in it.
pub fn unauthentic_is_counted<const N: usize>(input: &StepInput<N>, frames: u16) {
    let mut diagnostics = input.diagnostics.clone();
    diagnostics.count_unauthentic(frames);
    let without = input.diagnostics.counters.non_owner;
    let with = without.saturating_add(u32::from(frames));
    let mut counters = input.diagnostics.counters;
    counters.non_owner = with;
    assert!(
        diagnostics
            == Diagnostics {
                counters,
                ..input.diagnostics.clone()
            },
        "T27: one count rises"
    );
    let ((one, one_output), (other, other_output)) = (
        input.step(),
        StepInput {
            diagnostics,
            ..input.clone()
        }
        .step(),
    );
    let counted = other_output.state.counters.non_owner;
    let [was, is] = [&input.session, &one].map(|session| session.parts().discrete.phase);
    let is_granted = was == Phase::Listening && is == Phase::Handshake;
    assert!(
        counted == with || is_granted && counted == 0,
        "T27: every frame is counted, but before a grant"
    );
    let mut expected = one_output;
    expected.state.counters.non_owner = counted;
    // Quotients of the axes, which are compared below: two dividers are beyond the solver.
    expected.state.ramp_ticks_left = other_output.state.ramp_ticks_left;
    assert!(
        other_output == expected,
        "T27: the outputs are the same but for one count"
    );
    let (one, other) = (one.parts(), other.parts());
    assert!(
        one.discrete == other.discrete && one.axes == other.axes && one.in_force == other.in_force,
        "T27: no reference, and no owner"
    );
    let mut expected = *one;
    expected.counters.non_owner = counted;
    assert!(
        *other == expected,
        "T27: the sessions are the same but for one count"
    );
}

/// T27, of a whole tick: the endpoint's count of frames that are not authentic is that of the State.
pub fn tick_counts_unauthentic<const N: usize>(
    session: &Session<N>,
    input: &Input<N>,
    frames: u16,
) {
    let [(one, mut one_output), (other, other_output)] = [0, frames].map(|frames| {
        let (mut session, mut input) = (*session, input.clone());
        input.unauthentic = frames;
        let output = session.tick(&input);
        (session, output)
    });
    let (before, after) = (
        one_output.state.counters.non_owner,
        other_output.state.counters.non_owner,
    );
    let with = before.saturating_add(u32::from(frames));
    assert!(
        after == with || one_output.welcome.is_some() && after == 0,
        "T27: every frame is counted, but before a grant"
    );
    one_output.state.counters.non_owner = after;
    assert!(
        one_output == other_output,
        "T27: the outputs are the same but for one count"
    );
    assert!(
        one.parts().discrete == other.parts().discrete && one.parts().axes == other.parts().axes,
        "T27: no reference, and no owner"
    );
}

/// Origin of a Hello, and what it is judged by.
#[derive(Clone, Copy)]
#[expect(missing_debug_implementations, reason = "a key is not printed")]
pub struct Greeter<'a, const N: usize> {
    /// The endpoint's work with its keys.
    pub gate: &'a Gate,
    /// Its keys.
    pub keyring: &'a Keyring,
    /// Key of its cookies.
    pub cookie_key: &'a MacKey,
    /// Its session.
    pub session: &'a Session<N>,
    /// Epoch that would be granted.
    pub next: Option<Epoch>,
    /// Address and port.
    pub peer: &'a [u8; 18],
}

impl<const N: usize> Greeter<'_, N> {
    /// Judges bytes, as an endpoint does. `None`: they are not a frame with a tag.
    fn judge(&self, bytes: &[u8]) -> Option<(Gate, Greeting)> {
        let sealed = Sealed::parse(bytes, Suite::Tag).ok()?;
        let coming = Coming {
            session: self.session,
            epoch: self.next,
        };
        let mut gate = self.gate.clone();
        let greeting = gate.judge(sealed, self.peer, &coming);
        Some((gate, greeting))
    }

    /// Returns the cookie of this peer and a nonce in a window of ticks.
    fn cookie(&self, nonce: &Nonce, window: u64) -> Cookie {
        let next = self.next.map_or(0, |next| next.0);
        let next = Epoch(next.saturating_add(self.gate.proven()));
        cookie(self.cookie_key, self.peer, nonce, next, window)
    }

    /// Returns the cookies of a nonce in this window of ticks and in the one before.
    fn fresh(&self, nonce: &Nonce) -> [Cookie; 2] {
        let now = self.session.last_tick().0 / WINDOW;
        [now, now.wrapping_sub(1)].map(|window| self.cookie(nonce, window))
    }
}

/// Returns a cookie by its definition.
#[must_use]
pub fn cookie(key: &MacKey, peer: &[u8; 18], nonce: &Nonce, next: Epoch, window: u64) -> Cookie {
    first(&key.mac(&[&cookie_input(peer, nonce, next, window)]))
}

/// Returns the first half of an HMAC.
fn first(mac: &[u8; 32]) -> [u8; 16] {
    mac.first_chunk().copied().unwrap_or_default()
}

/// Returns the Hello of a greeting. By value: of a reference that is one of several, CBMC does not know
/// that it is none or valid.
#[must_use]
pub const fn hello_of(greeting: Greeting) -> Option<KeyedHello> {
    match greeting {
        Greeting::Silence => None,
        Greeting::Challenge(hello, _) | Greeting::ReadOnly(hello) | Greeting::Proven(hello) => {
            Some(hello)
        }
    }
}

/// T28: a Hello changes nothing but what is left of the budget of its tick. Who is answered has the
/// named key; who is granted had a cookie made for its peer, its nonce and the epoch that is granted,
/// in this window of ticks or in the one before. T29: once it is passed on, its cookie is void.
/// Returns the judgement.
pub fn greeting_is_judged<const N: usize>(
    greeter: &Greeter<'_, N>,
    bytes: &[u8],
) -> Option<Greeting> {
    let (after, greeting) = greeter.judge(bytes)?;
    let ((old_left, old_seen, old_key), (left, seen, key)) = (greeter.gate.parts(), after.parts());
    assert!(
        seen == old_seen && is_same_key(old_key, key) && left.tags == old_left.tags,
        "T28: a Hello changes nothing"
    );
    assert!(
        left.greetings <= old_left.greetings && old_left.greetings - left.greetings <= 1,
        "T28: a Hello costs one greeting at most"
    );
    let passed_on = u64::from(matches!(greeting, Greeting::Proven(_)));
    assert!(
        after.proven() == greeter.gate.proven().saturating_add(passed_on),
        "T29: a Hello that is passed on voids its cookie, and no other does"
    );
    let key = key_of(greeter.keyring, bytes);
    let is_tagged = key.is_some_and(|key| has_tag(bytes, key.greeting(), &[]));
    let Some(hello) = hello_of(greeting) else {
        let is_hello = bytes.len() == HEADER_LEN + KeyedHello::LENGTH + TAG_LEN
            && bytes[3] == Kind::KeyedHello.code()
            && bytes[HEADER_LEN + 1] == 0;
        assert!(
            !(is_hello && is_tagged && old_left.greetings > 0),
            "T28: the holder of a key is answered"
        );
        return Some(greeting);
    };
    assert!(
        is_tagged,
        "T28: only the holder of the named key is answered"
    );
    assert!(
        left.greetings < old_left.greetings,
        "T28: an answer has its place in the budget"
    );
    let mut written = [0; KeyedHello::LENGTH];
    assert!(
        hello.write(&mut written).is_ok()
            && bytes.get(HEADER_LEN..HEADER_LEN + KeyedHello::LENGTH) == Some(&written),
        "T28: the Hello is the one that was sent"
    );
    let [now, before] = greeter.fresh(&hello.nonce);
    let is_fresh = hello.cookie == now || hello.cookie == before;
    let role = key.map(Key::role);
    match greeting {
        Greeting::Silence => {}
        Greeting::Challenge(_, cookie) => {
            assert!(!is_fresh, "T28: who has shown that it hears is not asked");
            assert!(
                cookie == now,
                "T28: a Challenge has the cookie of the coming session"
            );
        }
        Greeting::ReadOnly(_) => assert!(
            is_fresh && role == Some(Role::Read),
            "T28: who may only read is told so"
        ),
        Greeting::Proven(_) => {
            assert!(
                is_fresh,
                "T28: who is granted had a cookie of the epoch that is granted"
            );
            assert!(
                role == Some(Role::Control),
                "T28: who is granted has a key that controls"
            );
        }
    }
    Some(greeting)
}

/// T28: the answer to a Hello is none, or not longer than it; its tag is for the nonce of that Hello.
/// Returns true if there is one.
pub fn greeting_answer_is_shorter<const N: usize>(greeter: &Greeter<'_, N>, bytes: &[u8]) -> bool {
    let Some((gate, greeting)) = greeter.judge(bytes) else {
        return false;
    };
    let mut slot = Slot::new(Connection(0), Transport::Datagram, Suite::Tag);
    slot.greeted::<N>(greeting);
    let hello = hello_of(greeting);
    assert!(
        slot.hello == hello,
        "T28: only a Hello with its tag is kept"
    );
    let mut frame = enclose(Kind::Refusal, &Refusal::Unavailable);
    if let Some(answer) = slot.answer {
        enclose_answer(answer, &mut frame);
    }
    gate.tag_answer(hello.as_ref(), &mut frame);
    let Some(hello) = hello else {
        assert!(frame.is_empty(), "T28: who has no key gets no byte");
        return false;
    };
    assert!(
        frame.len() <= bytes.len(),
        "T28: an answer is not longer than the Hello"
    );
    let key = greeter.keyring.get(hello.key);
    assert!(
        key.is_some_and(|key| has_tag(&frame, key.greeting(), &hello.nonce)),
        "T28: an answer is to one Hello"
    );
    true
}

/// T28, of a whole endpoint: a datagram of a peer without a connection changes neither session nor
/// inbox, unless it has shown that it hears; its answer is none, or not longer than it.
pub fn greet_is_bounded<const N: usize>(
    endpoint: &mut Endpoint<N>,
    peer: &[u8; 18],
    datagram: &[u8],
    is_proven: bool,
) -> Option<Connection> {
    let (session, waiting) = (*endpoint.session(), inbox(endpoint).to_vec());
    let granted = endpoint.granted_key();
    let connection = match endpoint.greet(peer, datagram) {
        Greeted::Nothing => None,
        Greeted::Answer(answer) => {
            assert!(
                answer.len() <= datagram.len(),
                "T28: an answer is not longer than the Hello"
            );
            assert!(
                suite_of(answer) == Some(1),
                "T31: an answer to a Hello has a tag"
            );
            None
        }
        Greeted::Peer(connection) => Some(connection),
    };
    assert!(
        connection.is_none() || is_proven,
        "T28: a place is for who has shown that it hears"
    );
    let events = inbox(endpoint);
    assert!(
        events.starts_with(&waiting)
            && events[waiting.len()..]
                .iter()
                .all(|(from, _)| Some(*from) == connection),
        "T28: a Hello without its cookie is no event"
    );
    assert!(
        *endpoint.session() == session && endpoint.granted_key() == granted,
        "T28: a Hello changes no session"
    );
    assert!(endpoint.is_valid(), "T28: the endpoint stays valid");
    connection
}

/// T27, of a whole endpoint: a frame of the owner's connection without its tag is no event, but that
/// a stream is broken; the session stands, and so does every other connection.
pub fn feed_of_forgery_is_nothing<const N: usize>(
    endpoint: &mut Endpoint<N>,
    connection: Connection,
    bytes: &[u8],
) {
    let (session, waiting) = (*endpoint.session(), inbox(endpoint).to_vec());
    let frames = endpoint.frames_of(connection);
    let is_owner = session.owner() == Some(connection);
    endpoint.feed(connection, bytes);
    let broken = |(from, event): &(Connection, Event<N>)| {
        is_owner && *from == connection && matches!(event, Event::Broken(_))
    };
    let events = inbox(endpoint);
    // Who does not own the session takes its Hello back, when it is closed.
    let stand = !is_owner || events.starts_with(&waiting);
    let is_new = |event: &&(Connection, Event<N>)| !waiting.contains(event);
    assert!(
        stand && events.iter().filter(is_new).all(broken),
        "T27: a forgery has no event"
    );
    assert!(
        endpoint.frames_of(connection) == frames,
        "T27: a forgery takes no frame of the budget"
    );
    assert!(
        *endpoint.session() == session && endpoint.is_valid(),
        "T27: a forgery changes no session"
    );
}

/// Returns what the HMAC of a cookie is of; each value has its own place.
#[must_use]
pub fn cookie_input(peer: &[u8; 18], nonce: &Nonce, next: Epoch, window: u64) -> [u8; 50] {
    let mut input = [0; 50];
    input[..18].copy_from_slice(peer);
    input[18..34].copy_from_slice(nonce);
    input[34..42].copy_from_slice(&next.0.to_le_bytes());
    input[42..].copy_from_slice(&window.to_le_bytes());
    input
}

/// T29: what the HMAC of a cookie is of says peer, nonce, epoch and window, and nothing else.
pub fn mac_input_of_cookie_is_injective(
    start_secret: &[u8; 32],
    (peer, nonce): (&[u8; 18], &Nonce),
    next: Epoch,
    tick: Tick,
) {
    let key = MacKey::new(&MacKey::new(start_secret).mac(&[b"gantry-tau 2 cookie"]));
    let input = cookie_input(peer, nonce, next, tick.0 / WINDOW);
    let cookie = Keyring::new(start_secret).cookie(peer, nonce, next, tick);
    assert!(
        number(&cookie) == number(&first(&key.mac(&[&input]))),
        "T29: a cookie is of its peer, its nonce, its epoch and its window"
    );
    let (said, rest) = input.split_at(18);
    let (nonces, numbers) = rest.split_at(16);
    let Some((one, other)) = numbers.split_first_chunk() else {
        panic!("T29: two numbers")
    };
    assert!(
        said == peer && nonces == nonce,
        "T29: peer and nonce can be read back"
    );
    assert!(
        u64::from_le_bytes(*one) == next.0 && other == (tick.0 / WINDOW).to_le_bytes(),
        "T29: epoch and window can be read back"
    );
}

/// T29: what the HMAC of a session key is of says all terms of the session, and no other HMAC under
/// the secret is of these bytes.
pub fn mac_input_of_session_key_is_injective(secret: &[u8; 32], of: &SessionOf) {
    let key = Key::new(secret, Role::Control);
    let secret = MacKey::new(secret);
    let id: [u8; 8] = first(&secret.mac(&[b"gantry-tau 2 key id"]))
        .first_chunk()
        .copied()
        .unwrap_or_default();
    assert!(
        u64::from_le_bytes(key.id().0) == u64::from_le_bytes(id),
        "T29: the name of a key is of its secret"
    );
    let greeting = MacKey::new(&secret.mac(&[b"gantry-tau 2 greeting"]));
    assert!(
        is_same_mac_key(key.greeting(), &greeting),
        "T29: the key of a greeting is of its secret"
    );
    let mut input = [0; 73];
    input[..20].copy_from_slice(b"gantry-tau 2 session");
    input[20..28].copy_from_slice(&id);
    input[28..44].copy_from_slice(&of.nonce);
    input[44..60].copy_from_slice(&of.cookie);
    input[60..68].copy_from_slice(&of.epoch.0.to_le_bytes());
    input[68] = of.axes;
    input[69..].copy_from_slice(&of.kinematics_checksum.to_le_bytes());
    let session = MacKey::new(&secret.mac(&[&input]));
    assert!(
        is_same_mac_key(&key.session(of), &session),
        "T29: the key of a session is of all its terms"
    );
    assert!(
        input[28..44] == of.nonce
            && input[44..60] == of.cookie
            && input[60..68] == of.epoch.0.to_le_bytes(),
        "T29: the terms can be read back"
    );
}

/// T29: what the tag of a frame is of says header, body and context, and where each begins: the header
/// states the length of the body. A frame is opened under its tag.
pub fn mac_input_of_frame_is_injective<B: Body, const COVERED: usize, const ALL: usize>(
    key: &MacKey,
    (kind, body): (Kind, &B),
    context: &[u8],
) {
    let mut frame = enclose(kind, body);
    frame.tag(key, context);
    let Some((covered, trailer)) = frame.split_first_chunk::<COVERED>() else {
        panic!("T29: a frame covers header and body")
    };
    let header = [covered[3], covered[4], covered[5], covered[6], covered[7]];
    let [l0, l1] = u16::try_from(B::LENGTH).unwrap_or(u16::MAX).to_le_bytes();
    assert!(
        header == [kind.code(), l0, l1, 1, 0] && COVERED == HEADER_LEN + B::LENGTH,
        "T29: the header states kind, length and suite"
    );
    let mut input = [0; ALL];
    input[..COVERED].copy_from_slice(covered);
    input[COVERED..].copy_from_slice(context);
    assert!(
        trailer.first_chunk().map(number) == Some(number(&first(&key.mac(&[&input])))),
        "T29: a tag is of header, body and context"
    );
    assert!(
        trailer.len() == TAG_LEN,
        "T29: behind the body is a tag alone"
    );
    let opened =
        Sealed::parse(&frame, Suite::Tag).and_then(|sealed| sealed.check_tag(key, context));
    assert!(
        opened
            .is_ok_and(|frame| frame.kind_code() == kind.code() && frame.body().len() == B::LENGTH),
        "T29: a frame is opened under its tag"
    );
}

/// T30: two tags are the same exactly if all 16 bytes are.
pub fn tag_comparison_is_exact(one: &Tag, other: &Tag) {
    assert!(
        is_same(one, other) == (number(one) == number(other)),
        "T30: tags are the same exactly if all their bytes are"
    );
}

/// T31: a frame is taken by the side of its suite, and by no other; a stream refuses the other suite
/// behind the header. Returns true if the bytes are a frame of that suite.
pub fn suite_is_kept(bytes: &[u8], suite: Suite) -> bool {
    let stated = suite_of(bytes);
    let is_own = stated == Some(u16::from(suite.code()));
    let is_frame = Sealed::parse(bytes, suite).is_ok();
    assert!(!is_frame || is_own, "T31: a side takes frames of its suite");
    let mut collector = Collector::of(suite);
    let collected = collector.consume(bytes);
    assert!(
        stated.is_none() || is_own || collected.is_err(),
        "T31: the other suite is refused before its body"
    );
    assert!(
        collector.held().len() <= HEADER_LEN || is_own,
        "T31: no byte of the other suite is kept behind its header"
    );
    is_frame
}

/// T31: what a gate makes of a frame has a tag, or is a State for a client that has declined tags, or
/// is nothing.
pub fn sent_suite_is_kept<const N: usize>(
    before: &Gate,
    hello: Option<&KeyedHello>,
    welcome: &Welcome<N>,
    (kind, epoch): (Kind, Epoch),
) {
    // A gate knows of a frame no more than its length.
    let mut answer = enclose(kind, &epoch);
    let mut state = answer.clone();
    let mut granted = answer.clone();
    before.tag_answer(hello, &mut answer);
    assert!(
        suite_of(&answer).is_none_or(|suite| suite == 1),
        "T31: an answer to a Hello has a tag"
    );
    before.tag_state(epoch, &mut state);
    let (_, _, session) = before.parts();
    let session = session.filter(|session| session.epoch == epoch);
    assert!(
        suite_of(&state) == session.map(|session| u16::from(session.tags_states)),
        "T31: a State has a tag, unless its client has declined"
    );
    let mut gate = before.clone();
    gate.tag_welcome(hello, welcome, &mut granted);
    assert!(
        suite_of(&granted).is_none_or(|suite| suite == 1),
        "T31: a Welcome has a tag"
    );
    let (_, _, session) = gate.parts();
    let asked = hello.map(|hello| {
        let asked = hello.hello.capabilities.0;
        asked & Capabilities::TAGGED_STATES.0 != 0
    });
    assert!(
        granted.is_empty()
            || session.is_some_and(
                |session| session.epoch == welcome.epoch && Some(session.tags_states) == asked
            ),
        "T31: the client's choice is kept"
    );
}

/// T31, of a whole endpoint: every frame that it sends is of its suite, or a State to who has declined
/// tags; a notice has none. Returns the number of frames.
pub fn sent_frames_are_of_the_suite<const N: usize>(
    endpoint: &mut Endpoint<N>,
    has_declined: bool,
) -> usize {
    let suite = u16::from(endpoint.suite().code());
    let mut sent = 0;
    while let Some((_, frame)) = endpoint.poll_transmit() {
        let is_notice = frame[2] == 1;
        let is_declined = has_declined && frame[3] == Kind::State.code();
        assert!(
            is_notice || suite_of(frame) == Some(if is_declined { 0 } else { suite }),
            "T31: an endpoint sends frames of its suite"
        );
        sent += 1;
    }
    sent
}

/// T31: a client takes no frame of the other suite: it has no event, and the dialogue goes on as it
/// was.
pub fn client_suite_is_kept<const N: usize>(before: &Client<N>, suite: Suite, bytes: &[u8]) {
    if suite_of(bytes).is_none_or(|stated| stated == u16::from(suite.code())) {
        return;
    }
    let mut after = before.clone();
    let event = after.feed(bytes).poll_event();
    assert!(
        !matches!(event, Some(Ok(_))),
        "T31: a client takes no frame of the other suite"
    );
    let (old, new) = (dialogue_of(before), dialogue_of(&after));
    assert!(
        new.stage == old.stage && new.transport == old.transport,
        "T31: the other suite changes nothing"
    );
}
