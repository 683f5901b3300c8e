//! A chain with one device of every kind.

use super::distributed_clock::ClockSetup;
use super::drive::{Drive, DriveSetup};
use super::instrument::{
    EncoderModel, EncoderTerminal, ForceTerminal, ForceUnits, Instrument, Plain,
};
use super::sii::Identity;
use super::slots::Node;
use super::subdevice::SubDevice;

/// Vendor of the emulated drives.
const VENDOR: u32 = 0x0000_0A11;

/// Returns a coupler with two encoder terminals, a force sensor, drives that run freely, need
/// SYNC0, have fixed PDOs or lack offsets, and a drive that speaks SoE.
#[must_use]
pub fn one_of_every_kind() -> Vec<Node> {
    let instrument = |device| Node::Instrument(SubDevice::of(device));
    let encoder = |model| {
        let device = Instrument::Encoder(EncoderTerminal::new(model));
        Node::Instrument(SubDevice::of(device).with_clock(ClockSetup::default()))
    };
    let drive = |product, missing: &[u16]| {
        Drive::new(&DriveSetup {
            identity: Identity {
                vendor: VENDOR,
                product,
                revision: 1,
                serial: 100 + product,
            },
            alias: 1_000 + product as u16,
            position: 0,
            missing: missing.to_vec(),
            software_limits: (0, 0),
            encoder: (1 << 20, 1),
            following_error: (20_000, 10),
            quick_stop: 100_000_000,
            has_watchdog: true,
            watchdog_is_writable: true,
        })
    };
    let units = ForceUnits {
        force: 2,
        torque: 4,
        counts_per_force: 1_000_000,
        counts_per_torque: 1_000,
    };
    vec![
        instrument(Instrument::Plain(Plain::coupler())),
        encoder(EncoderModel::El5101),
        encoder(EncoderModel::El5101Old),
        instrument(Instrument::Force(ForceTerminal::new(
            ForceTerminal::IDENTITY,
            units,
        ))),
        Node::Drive(
            SubDevice::of(drive(1, &[]).with_synchronisation(0x0007))
                .with_clock(ClockSetup::default()),
        ),
        Node::Drive(
            SubDevice::of(drive(2, &[]).with_synchronisation(0x0804))
                .with_clock(ClockSetup::default()),
        ),
        Node::Drive(SubDevice::of(drive(3, &[]).with_fixed_pdos())),
        Node::Drive(SubDevice::of(drive(4, &[0x60B0, 0x60B1]))),
        instrument(Instrument::Plain(Plain::soe_drive())),
    ]
}
