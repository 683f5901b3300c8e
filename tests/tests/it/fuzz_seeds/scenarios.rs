//! Sequences with two clients, each a thing that the server must get right.

use gantry_tau_proofs::scenario::{
    Circumstances, ClientAction, Machine, Op, Peer, Rates, Scenario, Shares,
};

use super::Seed;
use super::bytes::{Put, fields, seeds, variants};

fields!(Scenario: machine, in_force, late_in_life, ops);
fields!(Machine: rates, reach, nominal_step, nominal_accel, agitation, budget, echo_window, handshake_ticks, lockstep);
fields!(Rates: max, ramp, step, accel, scale);
fields!(Circumstances: elapsed, stop, rearm, unread, jump, epoch, quit);

impl<A: Put, B: Put> Put for (A, B) {
    fn put(&self, bytes: &mut Vec<u8>) {
        self.0.put(bytes);
        self.1.put(bytes);
    }
}

variants!(Peer, 3: 0 => Owner; 1 => One; 2 => Other;);
variants! { Op, 6:
    0 => Answer { obtain, targets, times };
    1 => Silence(ticks);
    2 => Say(peer, action);
    3 => Tick(circumstances);
    4 => Drift(drift);
    5 => RefusedWrite(shares);
}
variants! { ClientAction, 9:
    0 => Hello { axes, capabilities };
    1 => Command { epoch, ahead, behind, obtain, targets };
    2 => Goodbye { epoch };
    3 => Stop { epoch };
    4 => Malformed;
    5 => Dropped;
    6 => Broken;
    7 => Flood;
    8 => Closed;
}

/// The limits of `robots/l2.toml`, about.
const MACHINE: Machine = {
    const fn rates(max: u16, [ramp, step, accel]: [u8; 3]) -> Rates {
        let scale = 0;
        Rates {
            max,
            ramp,
            step,
            accel,
            scale,
        }
    }
    let off = rates(0, [0; 3]);
    let position = rates(3_000, [99, 200, 100]);
    let push = rates(500, [9, 40, 0]);
    Machine {
        rates: [[position, push, push], [position, off, off]],
        reach: [[1_000_000; 2], [400_000, 1_000_000]],
        nominal_step: [2_000, 3_000],
        nominal_accel: [None; 2],
        agitation: [None; 2],
        budget: None,
        echo_window: 0,
        handshake_ticks: 9,
        lockstep: false,
    }
};

const PUSH: Shares = [[90, 50, -50], [-40, 0, 0]];
const BACK: Shares = [[-90, 50, -50], [40, 0, 0]];
const HELLO: ClientAction = ClientAction::Hello {
    axes: 0,
    capabilities: 0,
};
const TICK: Circumstances = Circumstances {
    elapsed: 1,
    stop: false,
    rearm: false,
    unread: false,
    jump: None,
    epoch: 0,
    quit: false,
};

fn command(ahead: i32, behind: i8) -> ClientAction {
    ClientAction::Command {
        epoch: 0,
        ahead,
        behind,
        obtain: true,
        targets: PUSH,
    }
}

fn owner(action: ClientAction) -> Op {
    Op::Say(Peer::Owner, action)
}

fn answers(obtain: bool, times: u8) -> Op {
    Op::Answer {
        obtain,
        targets: PUSH,
        times,
    }
}

/// The first client is welcomed, submits, and obtains; then this.
fn obtained(then: &[Op]) -> Vec<Op> {
    let before = [
        Op::Say(Peer::One, HELLO),
        Op::Silence(1),
        answers(false, 3),
        answers(true, 20),
    ];
    [&before, then].concat()
}

fn elapsed(elapsed: u32) -> Op {
    Op::Tick(Circumstances { elapsed, ..TICK })
}

fn scenario(machine: Machine, ops: Vec<Op>) -> Scenario {
    Scenario {
        machine,
        in_force: [[0; 3]; 2],
        late_in_life: false,
        ops,
    }
}

/// A session that obtains, and then this.
fn usual(then: &[Op]) -> Scenario {
    scenario(MACHINE, obtained(then))
}

fn other(action: ClientAction) -> Op {
    Op::Say(Peer::Other, action)
}

pub(crate) fn seeds() -> Vec<Seed> {
    let stop = Op::Tick(Circumstances { stop: true, ..TICK });
    let quit = Op::Tick(Circumstances { quit: true, ..TICK });
    let rearm = Op::Tick(Circumstances {
        rearm: true,
        ..TICK
    });
    let unread = Op::Tick(Circumstances {
        unread: true,
        ..TICK
    });
    seeds! {
        "silence_ends_it" => usual(&[Op::Silence(60)]);
        "one_miss_does_not" => usual(&[Op::Silence(1), answers(true, 3), Op::Silence(1), answers(true, 3)]);
        "goodbye" => usual(&[owner(ClientAction::Goodbye { epoch: 0 }), Op::Silence(60)]);
        "goodbye_of_another_epoch" => usual(&[owner(ClientAction::Goodbye { epoch: -1 }), answers(true, 2)]);
        "back_to_submit" => usual(&[answers(false, 40), answers(true, 5)]);
        "stop_by_the_owner" => usual(&[owner(ClientAction::Stop { epoch: 0 }), Op::Silence(60), rearm, Op::Silence(2)]);
        "stop_at_the_machine_and_rearm" => usual(&[stop, Op::Silence(60), rearm, Op::Say(Peer::Other, HELLO), Op::Silence(2),
            answers(false, 3)]);
        "rearm_that_is_stuck" => usual(&[Op::Tick(Circumstances { stop: true, rearm: true, ..TICK }), rearm, rearm, Op::Silence(1),
            rearm]);
        "stop_while_it_quits" => usual(&[quit, quit, Op::Tick(Circumstances { stop: true, quit: true, ..TICK }), quit, Op::Silence(60)]);
        "stop_with_a_hello" => scenario(MACHINE, vec![Op::Say(Peer::One, HELLO), stop, other(HELLO), Op::Silence(2)]);
        "other_peer_knocks" => usual(&[other(HELLO), other(command(1, 0)), other(ClientAction::Stop { epoch: 0 }),
            other(ClientAction::Broken), answers(true, 2)]);
        "two_ask_at_once" => scenario(MACHINE, vec![other(HELLO), Op::Say(Peer::One, HELLO), Op::Silence(1), answers(false, 4)]);
        "hello_while_it_ramps" => usual(&[Op::Silence(3), other(HELLO), Op::Silence(60), other(HELLO), Op::Silence(1)]);
        "hello_of_another_machine" => scenario(MACHINE, vec![Op::Say(Peer::One, ClientAction::Hello { axes: 1, capabilities: 0 }),
            Op::Silence(2)]);
        "hello_without_lockstep" => scenario(Machine { lockstep: true, ..MACHINE }, vec![Op::Say(Peer::One, HELLO), Op::Silence(2)]);
        "no_epoch_left" => Scenario { late_in_life: true, ..usual(&[Op::Silence(90)]) };
        "handshake_takes_too_long" => scenario(MACHINE, vec![Op::Say(Peer::One, HELLO), Op::Silence(30)]);
        "obtain_before_submit" => scenario(MACHINE, vec![Op::Say(Peer::One, HELLO), Op::Silence(1), owner(command(1, 0)), Op::Silence(1)]);
        "server_skips_one_cycle" => usual(&[owner(command(1, 0)), elapsed(2), answers(true, 2)]);
        "server_skips_two_cycles" => usual(&[owner(command(1, 0)), elapsed(3), Op::Silence(2)]);
        "answers_to_old_states" => usual(&[owner(command(1, 1)), Op::Silence(1), owner(command(1, 2)), Op::Silence(2)]);
        "answers_within_the_window" => scenario(Machine { echo_window: 2, ..MACHINE }, obtained(&[owner(command(1, 2)), Op::Silence(1),
            owner(command(2, 3)), Op::Silence(1)]));
        "sequence_at_the_end_of_its_window" => usual(&[owner(command(65_536, 0)), Op::Silence(1), owner(command(65_537, 0)),
            Op::Silence(1)]);
        "several_in_one_tick" => usual(&[owner(command(5, 0)), owner(command(7, 0)), owner(command(5, 0)), owner(command(0, 0)),
            owner(command(-1, 0)), Op::Silence(1)]);
        "target_out_of_range" => usual(&[Op::Answer { obtain: true, targets: [[101, 0, 0]; 2], times: 2 }]);
        "reversal" => usual(&[Op::Answer { obtain: true, targets: [[-90, -50, 50], [40, 0, 0]], times: 30 }]);
        "shakes_beyond_the_budget" => scenario(Machine { agitation: [Some(3), None], ..MACHINE }, obtained(&[PUSH, BACK, PUSH, BACK,
            PUSH, BACK, PUSH, BACK].map(|targets| Op::Answer { obtain: true, targets, times: 2 })));
        "shakes_within_the_budget" => scenario(Machine { agitation: [Some(3_000), Some(3_000)], ..MACHINE }, obtained(&[PUSH, BACK, PUSH,
            BACK].map(|targets| Op::Answer { obtain: true, targets, times: 9 })));
        "broken_stream" => usual(&[owner(ClientAction::Broken), Op::Silence(5)]);
        "flood_with_a_stop" => usual(&[owner(ClientAction::Flood), owner(ClientAction::Stop { epoch: 0 }), Op::Silence(5)]);
        "flood" => usual(&[owner(ClientAction::Flood), Op::Silence(5)]);
        "goodbye_in_the_handshake" => scenario(MACHINE, vec![Op::Say(Peer::One, HELLO), Op::Silence(1),
            owner(ClientAction::Goodbye { epoch: 0 }), Op::Silence(3)]);
        "epoch_that_was_given_before" => scenario(MACHINE, vec![Op::Say(Peer::One, HELLO), Op::Tick(Circumstances { epoch: -1,
            ..TICK }), Op::Silence(1)]);
        "answer_to_a_state_that_was_never_sent" => usual(&[owner(command(1, -1)), Op::Silence(1)]);
        "one_miss_in_submit" => usual(&[answers(false, 40), Op::Silence(1), answers(false, 2)]);
        "skipped_and_lost" => usual(&[elapsed(2), Op::Silence(2)]);
        "skipped_for_hours" => usual(&[elapsed(u32::MAX), Op::Silence(2)]);
        "other_peer_hangs_up" => usual(&[other(HELLO), other(ClientAction::Closed), other(ClientAction::Flood), answers(true, 2)]);
        "owner_hangs_up_while_it_ramps" => usual(&[Op::Silence(4), owner(ClientAction::Closed), Op::Silence(3)]);
        "closed" => usual(&[owner(ClientAction::Closed), Op::Silence(60), Op::Say(Peer::One, HELLO), Op::Silence(1)]);
        "frames_with_bad_content" => usual(&[owner(ClientAction::Malformed), owner(ClientAction::Dropped), owner(HELLO),
            answers(true, 1)]);
        "nominal_moves" => scenario(MACHINE, [vec![Op::Drift([100, -100])], obtained(&[Op::Silence(3)])].concat());
        "nominal_steps" => usual(&[Op::Drift([101, 0]), answers(true, 2), Op::Silence(40)]);
        "nominal_accelerates" => scenario(Machine { nominal_accel: [Some((999, false)), Some((999, true))], ..MACHINE }, obtained(&[
            Op::Drift([50, 0]), answers(true, 3), Op::Drift([-50, 0]), answers(true, 2), elapsed(2), Op::Drift([0, 50]), Op::Silence(1),
            answers(true, 2), Op::RefusedWrite([[10, 0, 0]; 2]), Op::Drift([-50, 34]), Op::Silence(40)]));
        "nominal_jumps_out_of_travel" => usual(&[Op::Tick(Circumstances { jump: Some(i64::MIN), ..TICK }), Op::Silence(5)]);
        "one_in_four_lost" => scenario(Machine { budget: Some((9, 2)), ..MACHINE }, obtained(&[Op::Silence(1), answers(true, 3),
            Op::Silence(1), answers(true, 3), Op::Silence(1), answers(true, 3)]));
        "restart_with_offsets" => Scenario { in_force: PUSH, ..scenario(MACHINE, vec![Op::Say(Peer::One, HELLO), Op::Silence(60)]) };
        "restart_beyond_the_limits" => Scenario { in_force: [[127; 3]; 2], ..scenario(MACHINE, vec![Op::Silence(1)]) };
        "machine_did_not_take_them" => usual(&[Op::RefusedWrite([[10, 0, 0]; 2]), Op::Silence(20), Op::RefusedWrite([[127; 3]; 2])]);
        "machine_cannot_be_read" => usual(&[Op::Drift([50, -50]), unread, answers(true, 2), unread, Op::Silence(30), rearm, rearm]);
        "path_moves_on_in_an_outage" => usual(&[Op::Drift([60, -60]), Op::RefusedWrite([[127; 3]; 2]), Op::Silence(3), Op::RefusedWrite([[10; 3]; 2]), Op::Silence(5), Op::Drift([0; 2]),
            Op::Tick(Circumstances { jump: Some(0), ..TICK }), Op::Silence(3)]);
        "datagrams" => scenario(MACHINE, vec![other(HELLO), Op::Silence(1), answers(false, 3), owner(ClientAction::Dropped),
            answers(true, 4), owner(ClientAction::Broken), answers(true, 2)]);
    }
}
