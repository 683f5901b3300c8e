//! Lists of devices, and what a scan leaves as it was.

use gantry_tau_ethercat::emulation::{
    Chain, ClockSetup, Drive, EmulatedWire, EncoderModel, EncoderTerminal, Instrument, Kinematic,
    Node, SubDevice, one_of_every_kind,
};
use gantry_tau_ethercat::scan::{
    Answer, ClockWidth, Device, Mapping, Options, ScanError, Verdict, scan,
};

use crate::bench::{Lossy, Wire, setup, setups, wire};

const READ_ONLY: Options = Options {
    tries_mapping: false,
};

fn every_kind() -> Wire {
    EmulatedWire::new(Chain::of(one_of_every_kind(), Kinematic))
}

fn scanned(wire: &Wire) -> Vec<Device> {
    scan(wire.clone(), READ_ONLY).unwrap()
}

fn verdicts(devices: &[Device]) -> Vec<Verdict> {
    devices.iter().map(Device::verdict).collect()
}

#[test]
fn every_kind_of_device_is_told_apart() {
    let devices = scanned(&every_kind());
    assert_eq!(
        verdicts(&devices),
        [
            Verdict::Unknown,
            Verdict::Encoder,
            Verdict::Encoder,
            Verdict::ForceSensor,
            Verdict::Drivable,
            Verdict::NeedsClocks,
            // Nothing was written, so nothing is known of its mapping.
            Verdict::Drivable,
            Verdict::Partly {
                no_velocity: true,
                no_torque: false
            },
            Verdict::Soe,
        ]
    );
    let names: Vec<&str> = devices.iter().map(|device| &*device.name).collect();
    assert_eq!(names[..3], ["EK1100", "EL5101", "EL5101"]);
    let drive = &devices[5];
    assert_eq!(
        (drive.position, drive.alias, drive.vendor, drive.product),
        (5, 1_002, 0x0A11, 2)
    );
    assert_eq!(
        (drive.revision, drive.serial, drive.clock),
        (1, 102, ClockWidth::Bits64)
    );
    assert_eq!(devices[0].clock, ClockWidth::None);
    let objects = drive.dictionary.as_ref().unwrap();
    assert_eq!(objects.modes, Answer::Value(0x80));
    assert_eq!(objects.synchronisation, [Answer::Value(0x0804); 2]);
    assert_eq!(objects.of_first_axis(0x608F), Answer::Value(1 << 20));
    assert_eq!(objects.second_axis, [Answer::Aborted(0x0602_0000); 12]);
    assert_eq!(objects.assigned, [vec![0x1600], vec![0x1A00]]);
    assert_eq!(objects.mapping, None);
}

/// The emulator's log: every write that a device took.
#[test]
fn a_scan_writes_what_reading_needs_and_nothing_else() {
    let wire = every_kind();
    wire.bench().chain.log_writes();
    scanned(&wire);
    let mut bench = wire.bench();
    assert_eq!(bench.chain.highest_state(), 2, "PRE-OP");
    let writes = bench.chain.writes();
    assert!(writes.len() > 300, "{}", writes.len());
    for write in writes {
        let address = write.address.unwrap();
        let is_expected = match address {
            // Station addresses; AL control, to INIT and PRE-OP; the EEPROM's interface, to read.
            0x0010 => true,
            0x0120 => [[0x11, 0], [2, 0]].contains(&[write.data[0], write.data[1]]),
            0x0500 => write.data == [0],
            0x0502 => [[0, 0], [0, 1]].contains(&[write.data[0], write.data[1]]),
            // Sync managers of the mailboxes.
            0x0800 | 0x0808 => write.data.len() == 8,
            // Requests in a mailbox: uploads of CoE.
            0x1000 => write.data[5] & 0x0F == 3 && write.data[7] == 0x20 && write.data[8] == 0x40,
            _ => false,
        };
        assert!(is_expected, "{write:02x?}");
    }
    drop(bench);
    // Back in INIT.
    wire.idle(2_000);
    let status = crate::strict::broadcast_read(&wire, 0x0130);
    assert_eq!(status, (1, 9));
}

#[test]
fn mappings_are_tried_only_when_asked_for_and_stay_as_they_were() {
    let wire = every_kind();
    let before = scanned(&wire);
    let options = Options {
        tries_mapping: true,
    };
    let tried = scan(wire.clone(), options).unwrap();
    let mappings: Vec<_> = tried
        .iter()
        .map(|device| device.dictionary.as_ref().and_then(|it| it.mapping))
        .collect();
    let written = Some([Mapping::Written; 2]);
    let fixed = Some([Mapping::Fixed(0x0601_0002); 2]);
    assert_eq!(
        mappings,
        [
            None, None, None, None, written, written, fixed, written, None
        ]
    );
    assert_eq!(tried[6].verdict(), Verdict::FixedMapping);
    assert_eq!(scanned(&wire), before, "as it was");
}

#[test]
fn a_mute_device_and_one_with_an_emergency_do_not_end_the_scan() {
    let wire = every_kind();
    {
        let mut bench = wire.bench();
        bench.chain.subdevice_mut(4).unwrap().send_emergency(0x2310);
        bench.chain.subdevice_mut(5).unwrap().mute(true);
        bench.chain.subdevice_mut(7).unwrap().refuse(2, 0x0042);
    }
    let devices = scanned(&wire);
    assert_eq!(devices[4].emergencies, [0x2310]);
    assert_eq!(devices[4].verdict(), Verdict::Drivable);
    assert_eq!(devices[5].verdict(), Verdict::NoAnswer);
    let mute = devices[5].dictionary.as_ref().unwrap();
    assert_eq!(mute.first_axis, [Answer::Silent; 12]);
    assert_eq!(devices[7].verdict(), Verdict::Refused(0x0042));
    assert_eq!(devices[8].verdict(), Verdict::Soe, "the scan went on");
}

#[test]
fn a_sensor_of_another_vendor_is_unknown() {
    use gantry_tau_ethercat::emulation::{ForceTerminal, ForceUnits, Identity};
    let units = ForceUnits {
        force: 2,
        torque: 3,
        counts_per_force: 1,
        counts_per_torque: 1,
    };
    let identity = Identity {
        vendor: 0x0666,
        ..ForceTerminal::IDENTITY
    };
    let sensor = Instrument::Force(ForceTerminal::new(identity, units));
    let chain = Chain::of(vec![Node::Instrument(SubDevice::of(sensor))], Kinematic);
    let devices = scanned(&EmulatedWire::new(chain));
    assert_eq!(verdicts(&devices), [Verdict::Unknown]);
}

#[test]
fn a_drive_without_the_mode_or_a_needed_object_is_not_drivable() {
    let mut setups = setups(2);
    setups[1].missing = vec![0x606C];
    setups.push(setup(2));
    setups[2].missing = vec![0x6061];
    let wire = wire(&setups);
    wire.bench()
        .chain
        .subdevice_mut(0)
        .unwrap()
        .drive_mut()
        .set_object(0x6502, 0, 0x01);
    assert_eq!(
        verdicts(&scanned(&wire)),
        [
            Verdict::NoCsp,
            Verdict::Lacks(0x606C),
            Verdict::Lacks(0x6061)
        ]
    );
}

#[test]
fn more_devices_than_a_server_drives_are_listed_and_an_empty_bus_is_silent() {
    let terminal = || {
        let device = Instrument::Encoder(EncoderTerminal::new(EncoderModel::El5151));
        Node::Instrument(SubDevice::of(device))
    };
    let chain = Chain::of((0..40).map(|_| terminal()).collect(), Kinematic);
    let devices = scanned(&EmulatedWire::new(chain));
    assert_eq!(verdicts(&devices), [Verdict::Encoder; 40]);
    let empty = wire(&setups(1));
    empty.bench().chain.cut_behind(0);
    assert_eq!(scan(empty, READ_ONLY), Err(ScanError::Silent));
}

/// On a bus that loses one frame of seven on its way back, among them answers that a device does not
/// give again.
#[test]
fn lost_frames_change_nothing() {
    let wire = every_kind();
    for tries_mapping in [false, true] {
        let options = Options { tries_mapping };
        let before = scan(wire.clone(), options).unwrap();
        for one_of in [7, 13, 29] {
            let found = scan(Lossy::new(wire.clone(), one_of), options).unwrap();
            assert_eq!(found, before, "one of {one_of}");
        }
    }
    assert_eq!(scanned(&wire), scanned(&every_kind()), "as it was");
}

#[test]
fn a_drive_for_sync0_without_a_clock_is_not_drivable() {
    let drives = [0x0804, 0x0808].map(|types| Drive::new(&setup(0)).with_synchronisation(types));
    let [bare, other] = drives.map(SubDevice::of);
    let nodes = [bare, other.with_clock(ClockSetup::default())].map(Node::Drive);
    let wire = EmulatedWire::new(Chain::of(nodes.into(), Kinematic));
    assert_eq!(
        verdicts(&scanned(&wire)),
        [0x0804, 0x0808].map(Verdict::Synchronisation)
    );
}
