//! A server and the owner of its session, tick by tick. What the owner reads is always compared
//! with what was done.

use gantry_tau_core::control::axis::Offsets;
use gantry_tau_core::control::message::{Cause, ClientMessage, Command, Mode, Phase};
use gantry_tau_core::control::wire::encode_client;
use gantry_tau_core::units::{OffsetNm, TorquePermille, VelocityUmS};
use gantry_tau_server::record::TickRecord;

use crate::client::Client;
use crate::server_fixture::{STEP_NM, ServerFixture};

/// A session in progress.
pub struct SessionFixture<const N: usize> {
    /// The server and the machine.
    pub server: ServerFixture<N>,
    /// The session's owner.
    pub client: Client<N>,
}

impl<const N: usize> SessionFixture<N> {
    /// A new client says Hello, and is let in; everybody else keeps silent.
    #[must_use]
    pub fn greeted(server: ServerFixture<N>) -> Self {
        let client = Client::connect(server.address());
        Self::greeted_by(client, server)
    }

    /// The same for this client.
    #[must_use]
    pub fn greeted_by(mut client: Client<N>, mut server: ServerFixture<N>) -> Self {
        client.say_hello();
        let row = server.step_until("the Welcome", |row| row.welcomed);
        assert_eq!(client.welcome().epoch, row.state.epoch);
        assert_eq!(client.state(), row.state);
        assert_eq!(row.state.phase, Phase::Handshake);
        Self { server, client }
    }

    /// A new client on a running server, in Submit.
    #[must_use]
    pub fn submitted_on(server: ServerFixture<N>) -> Self {
        Self::greeted(server).submit()
    }

    /// To Submit.
    #[must_use]
    pub fn submit(mut self) -> Self {
        assert_eq!(self.answer(Mode::Submit, [0; N]).state.phase, Phase::Submit);
        self
    }

    /// A new server and a client, in Obtain, the offsets at `positions`.
    #[must_use]
    pub fn obtained(positions: [i32; N]) -> Self {
        Self::submitted_on(ServerFixture::default()).obtain(positions)
    }

    /// To Obtain, and on until the offsets are at `positions`.
    #[must_use]
    pub fn obtain(mut self, positions: [i32; N]) -> Self {
        let farthest = positions.map(i32::abs).into_iter().max().unwrap();
        for _ in 0..=farthest / STEP_NM {
            let row = self.answer(Mode::Obtain, positions);
            assert_eq!(row.state.phase, Phase::Obtain);
        }
        assert_eq!(self.server.bus.positions(), positions);
        self
    }

    /// The owner's bytes reach the server and are taken in; returns how many of its frames the
    /// coming tick has.
    pub fn deliver(&mut self, bytes: &[u8]) -> u8 {
        self.client.send_bytes(bytes);
        self.server.await_bytes(bytes.len());
        self.server.receive()
    }

    /// The owner says something, and it arrives.
    pub fn say(&mut self, message: &ClientMessage<N>) -> u8 {
        self.deliver(&encode_client(message))
    }

    /// The owner's answer to the last State, in Obtain, arrives; returns how many of its frames the
    /// coming tick has.
    pub fn deliver_answer(&mut self, positions: [i32; N]) -> u8 {
        self.deliver_changed(positions, |_| {})
    }

    /// The same, after a change of the command.
    pub fn deliver_changed(
        &mut self,
        positions: [i32; N],
        change: impl FnOnce(&mut Command<N>),
    ) -> u8 {
        let mut command = self.client.command(Mode::Obtain, positions);
        change(&mut command);
        self.say(&ClientMessage::Command(command))
    }

    /// One tick; the owner reads its State.
    pub fn tick(&mut self) -> TickRecord<N> {
        let row = self.server.step();
        assert_eq!(self.client.state(), row.state);
        row
    }

    /// The owner answers the last State; one tick.
    pub fn answer(&mut self, mode: Mode, positions: [i32; N]) -> TickRecord<N> {
        let frame = self.client.frame(mode, positions);
        assert_eq!(self.deliver(&frame), 1);
        self.tick()
    }

    /// The owner asks for the same offsets on every axis; one tick.
    pub fn answer_all(&mut self, mode: Mode, target: Offsets) -> TickRecord<N> {
        let mut command = self.client.command(mode, [0; N]);
        command.targets = [target; N];
        assert_eq!(self.say(&ClientMessage::Command(command)), 1);
        self.tick()
    }

    /// The coming ramp, which the owner hears of tick by tick; then its connection is closed and
    /// the server listens.
    #[must_use]
    pub fn assert_disconnect(mut self, from: [i32; N], cause: Cause) -> ServerFixture<N> {
        let rows = self.server.assert_ramp(from, Phase::SafeDisconnect);
        assert_eq!(rows[0].ended, Some(cause));
        for row in rows {
            assert_eq!(row.state.cause, cause);
            assert_eq!(self.client.state(), row.state);
        }
        assert_eq!(self.server.step().state.phase, Phase::Listening);
        self.client.assert_closed();
        self.server
    }

    /// The miss that is forgiven: positions stay where they are.
    pub fn assert_held(&mut self) -> TickRecord<N> {
        let before = self.server.bus.positions();
        let row = self.tick();
        assert_eq!(row.state.phase, Phase::Obtain);
        assert_eq!(row.ended, None);
        assert_eq!(self.server.bus.positions(), before);
        row
    }
}

/// Offsets of one axis.
#[must_use]
pub const fn offsets(position: i32, velocity: i32, torque: i16) -> Offsets {
    Offsets {
        position: OffsetNm(position),
        velocity: VelocityUmS(velocity),
        torque: TorquePermille(torque),
    }
}
