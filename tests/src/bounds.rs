//! What no traffic may break: how far the offsets in force move in a tick.

use gantry_tau_core::control::axis::Offsets;
use gantry_tau_core::control::message::{AxisLimits, Phase};

/// The offsets of the last tick, and how they got there.
#[derive(Clone, Debug)]
pub struct Bounds<const N: usize> {
    limits: [AxisLimits; N],
    offsets: [Offsets; N],
    changes: [[i64; 3]; N],
}

impl<const N: usize> Bounds<N> {
    /// From offsets at rest.
    #[must_use]
    pub const fn new(limits: [AxisLimits; N], offsets: [Offsets; N]) -> Self {
        Self {
            limits,
            offsets,
            changes: [[0; 3]; N],
        }
    }

    /// Goes on from other offsets, at rest.
    pub const fn resume(&mut self, offsets: [Offsets; N]) {
        self.offsets = offsets;
        self.changes = [[0; 3]; N];
    }

    /// One tick: every channel within M, its change within S, the change of that within A; a ramping server moves by exactly rho
    /// towards zero; an idle one has all offsets at zero; nobody is let in before they are.
    pub fn check(&mut self, now: &[Offsets; N], phase: Phase, welcomed: bool) {
        if welcomed {
            assert!(at_zero(&self.offsets), "let in during a ramp");
        }
        if matches!(phase, Phase::Listening | Phase::Handshake | Phase::Submit) {
            assert!(at_zero(now), "offsets in {phase:?}");
        }
        for (axis, offsets) in now.iter().enumerate() {
            self.check_axis(axis, offsets, phase);
        }
        self.offsets = *now;
    }

    fn check_axis(&mut self, axis: usize, now: &Offsets, phase: Phase) {
        let before = channels(&self.offsets[axis]);
        let limits = &self.limits[axis];
        let limits = [limits.position, limits.velocity, limits.torque];
        for (channel, (now, limits)) in channels(now).into_iter().zip(limits).enumerate() {
            let (old, last) = (before[channel], self.changes[axis][channel]);
            let change = now - old;
            assert!(now.abs() <= i64::from(limits.max()));
            assert!(change.abs() <= i64::from(limits.step()), "{old} to {now}");
            assert!((change - last).abs() <= i64::from(limits.accel()));
            if matches!(phase, Phase::SafeDisconnect | Phase::Fault) {
                let ramp = i64::from(limits.ramp()).min(old.abs());
                assert_eq!(change, -old.signum() * ramp, "{phase:?}: {old} to {now}");
            }
            self.changes[axis][channel] = change;
        }
    }
}

fn at_zero<const N: usize>(offsets: &[Offsets; N]) -> bool {
    *offsets == [Offsets::default(); N]
}

fn channels(offsets: &Offsets) -> [i64; 3] {
    [
        offsets.position.0.into(),
        offsets.velocity.0.into(),
        offsets.torque.0.into(),
    ]
}
