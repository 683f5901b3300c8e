//! Texts of errors: every one of the control half names what, where and why.

use std::error::Error;

use gantry_tau_core::control::axis::Offsets;
use gantry_tau_core::control::channel::{LimitValues, Limits, LimitsError};
use gantry_tau_core::control::client::ClientError;
use gantry_tau_core::control::endpoint::{Full, MotorMap};
use gantry_tau_core::control::message::{
    Capabilities, Cause, ContentError, FrameError, Notice, Phase, Refusal,
};
use gantry_tau_core::control::session::StartError;
use gantry_tau_core::control::session::config::ConfigError;
use gantry_tau_core::control::wire::{Kind, Short};
use gantry_tau_core::units::{Epoch, OffsetNm, Tick, TorquePermille, VelocityUmS};

fn says(error: impl Error, text: &str) {
    assert_eq!(error.to_string(), text);
}

/// Limits, nm.
fn limits(max: i32, step: i32, accel: i32, ramp: i32) -> Result<Limits<OffsetNm>, LimitsError> {
    Limits::new(LimitValues {
        max,
        step,
        accel,
        ramp,
    })
}

#[test]
fn limits_say_what_contradicts_what() {
    says(
        limits(-3, 2, 4, 1).unwrap_err(),
        "max is -3; it must not be negative (0 disables the channel)",
    );
    says(
        limits(1, 2, 4, -7).unwrap_err(),
        "ramp is -7; it must be positive",
    );
    says(limits(1, 2, 9, 3).unwrap_err(), "ramp 3 is above step 2");
    says(
        limits(1, 5, 6, 2).unwrap_err(),
        "accel is 6; step + ramp needs at least 7",
    );
}

#[test]
fn configurations_name_the_axis() {
    says(ConfigError::Axes { axes: 9 }, "9 axes; 1 to 6 are possible");
    says(
        ConfigError::HandshakeTicks,
        "handshake_ticks must be at least 1",
    );
    says(
        ConfigError::BudgetWindow { window: 129 },
        "budget window is 129 ticks; 1 to 128 are possible",
    );
    says(
        ConfigError::TorqueMax { axis: 2 },
        "axis 2: torque max is above 32767 per mille",
    );
    says(
        ConfigError::Travel { axis: 1 },
        "axis 1: lower end of a travel is above its upper end, or an end is beyond 2^61 nm",
    );
    says(
        ConfigError::Margin { axis: 4 },
        "axis 4: machine travel must be wider than nominal travel by the position max at both ends",
    );
    let nm_per_tick = 1_000_001;
    says(
        ConfigError::Agitation {
            axis: 5,
            nm_per_tick,
        },
        "axis 5: agitation budget is 1000001 nm per tick; 1 to 1000000 are possible",
    );
    let map = MotorMap::<3, 2>::new([0, 3]).unwrap_err();
    says(
        map,
        "motor 1 is mapped to axis 3, but there are only 3 axes (counted from 0)",
    );
    let offsets = Offsets {
        position: OffsetNm(7),
        velocity: VelocityUmS(-8),
        torque: TorquePermille(9),
    };
    says(
        StartError::OffsetInForce { axis: 1, offsets },
        "axis 1: the drive has offsets in force beyond their limits (7 nm, -8 um/s, 9 per mille)",
    );
}

#[cfg(feature = "position-loop")]
#[test]
fn position_loops_name_the_value() {
    use gantry_tau_core::control::position_loop::config::{LoopConfig, LoopValues};
    let good = *LoopConfig::DISABLED.values();
    for (values, text) in [
        (
            LoopValues {
                gain: 40_000,
                ..good
            },
            "gain is 40000; it must be from 0 to 32767",
        ),
        (
            LoopValues {
                velocity_feed_forward: 2_000,
                ..good
            },
            "velocity feed-forward is 2000; it must be from 0 to 1228",
        ),
        (
            LoopValues {
                torque_feed_forward: 40_000,
                ..good
            },
            "torque feed-forward is 40000; it must be from 0 to 32767",
        ),
        (
            LoopValues {
                integral: 2_000,
                ..good
            },
            "integral is 2000; it must be from 0 to 1228",
        ),
        (
            LoopValues {
                integral_max: -1,
                ..good
            },
            "largest integral is -1; it must be from 0 to 2147483647",
        ),
        (
            LoopValues { lag: 11, ..good },
            "lag is 11; it must be from 0 to 10",
        ),
        (
            LoopValues {
                window_nm: 0,
                ..good
            },
            "window in nm is 0; it must be from 1 to 16777215",
        ),
        (
            LoopValues {
                window_ticks: 0,
                ..good
            },
            "window in ticks is 0; it must be from 1 to 65535",
        ),
        (
            LoopValues {
                gain: 9_000,
                lag: 3,
                ..good
            },
            "gain is 9000; with a lag of 3 ticks it must be at most 8192 (2^-16 um/s per nm)",
        ),
    ] {
        says(LoopConfig::new(values).unwrap_err(), text);
    }
    let values = LimitValues {
        max: 40_000,
        step: 2,
        accel: 4,
        ramp: 1,
    };
    let torque = Limits::new(values).unwrap();
    says(
        LoopConfig::new(LoopValues { torque, ..good }).unwrap_err(),
        "largest torque is 40000; it must be from 0 to 32767",
    );
}

#[test]
fn frames_say_what_is_wrong_with_them() {
    says(FrameError::Magic, "the frame does not begin with \"GT\"");
    says(
        FrameError::Version { received: 7 },
        "protocol version 7; this side speaks 2",
    );
    says(
        FrameError::TooLong { length: 999 },
        "the header states a body of 999 bytes; at most 384 are allowed",
    );
    says(FrameError::Suite { received: 513 }, "suite 513 is unknown");
    says(
        FrameError::Suite { received: 0 },
        "a frame with a checksum; this side takes frames with tags",
    );
    says(
        FrameError::Suite { received: 1 },
        "a frame with a tag; this side takes frames with checksums",
    );
    says(FrameError::Tag, "the tag is not that of the frame");
    says(
        FrameError::Length,
        "the datagram's length differs from the length in its header",
    );
    says(FrameError::Checksum, "the checksum does not match");
    says(
        ContentError::Kind { received: 77 },
        "kind 77 is unknown or not received by this side",
    );
    says(
        ContentError::Length {
            expected: 4,
            received: 5,
        },
        "expected a body of 4 bytes, got 5",
    );
    says(
        ContentError::Axes {
            expected: 3,
            received: 6,
        },
        "expected 3 axes, got 6",
    );
    says(ContentError::Code { received: 9 }, "unknown code 9");
    says(ContentError::Reserved, "reserved bits are set");
    says(ContentError::Limits, "the limits contradict each other");
    says(Short, "the slice ends before the field");
}

#[test]
fn a_server_says_why_not() {
    says(Full, "all 6 connections are in use");
    let refusals = [
        (Refusal::Busy, "another client owns the session"),
        (
            Refusal::Ramping { ticks_left: 5 },
            "offsets are still ramping to zero; try again in 5 ticks",
        ),
        (
            Refusal::Faulted { ticks_left: 6 },
            "the server is stopped (6 ticks of ramp left); it must be re-armed at the machine",
        ),
        (Refusal::Axes { expected: 3 }, "the server has 3 axes"),
        (
            Refusal::Capability {
                needed: Capabilities(0x12),
            },
            "the server needs capabilities 0x0012",
        ),
        (
            Refusal::Unavailable,
            "the server has no room for another connection, or its epochs are used up",
        ),
        (Refusal::Role, "this key may only read"),
    ];
    let notices = [
        (Notice::VERSION, "the server speaks protocol version 2"),
        (
            Notice::FULL,
            "the server has no room for another connection",
        ),
        (
            Notice::suite(0),
            "the server has no key: it takes frames with checksums only",
        ),
        (
            Notice::suite(1),
            "the server has keys: it takes frames with tags only",
        ),
        (
            Notice {
                reason: 77,
                detail: 6,
            },
            "the server gives reason 77, detail 6",
        ),
    ];
    for (notice, text) in notices {
        assert_eq!(notice.to_string(), text);
        says(FrameError::Notice(notice), text);
        says(ClientError::Notice(notice), text);
    }
    for (refusal, text) in refusals {
        assert_eq!(refusal.to_string(), text);
    }
    assert_eq!(Phase::SafeDisconnect.to_string(), "safe disconnect");
    assert_eq!(Cause::Flood.to_string(), "too many frames in one tick");
    assert_eq!(
        Cause::Agitated.to_string(),
        "an offset was shaken by more than its agitation budget allows"
    );
}

#[test]
fn a_client_says_what_it_expected() {
    says(
        ClientError::Frame(FrameError::Checksum),
        "the stream is broken: the checksum does not match",
    );
    says(
        ClientError::from(ContentError::Reserved),
        "invalid message: reserved bits are set",
    );
    says(
        ClientError::Unexpected {
            received: Kind::State,
        },
        "unexpected State: expected one answer to Hello, then States",
    );
    says(
        ClientError::OldState {
            expected: Tick(8),
            received: Tick(7),
        },
        "expected a State of tick 8 or later, got tick 7",
    );
    says(
        ClientError::Epoch {
            expected: Epoch(3),
            received: Epoch(2),
        },
        "expected a State of epoch 3, got epoch 2",
    );
    says(
        ClientError::Cycle {
            expected_us: 1_000,
            received_us: 2_000,
        },
        "the server's cycle is 2000 us, the client's is 1000 us",
    );
    says(
        ClientError::Checksum {
            expected: 0xab,
            received: 0xcd,
        },
        "the server's machine has checksum 000000cd, the client's has 000000ab",
    );
    says(
        ClientError::Capability {
            needed: Capabilities(3),
        },
        "the server needs capabilities 0x0003",
    );
    says(
        ClientError::GoodbyeUnheard { states: 4 },
        "the session goes on 4 States after the Goodbye; close the connection",
    );
}
