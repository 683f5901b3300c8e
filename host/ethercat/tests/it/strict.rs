//! The emulated SubDevices refuse what real ones refuse, asked by frames that are written here byte
//! by byte.

use gantry_tau_ethercat::Wire as _;

use crate::bench::{Wire, setups, wire};

const BWR: u8 = 8;
const FPRD: u8 = 4;
const FPWR: u8 = 5;
const APWR: u8 = 2;
const LRW: u8 = 12;

/// Sends one datagram; returns its data and its working counter.
fn ask(wire: &Wire, command: u8, address: u16, offset: u16, data: &[u8]) -> (Vec<u8>, u16) {
    let mut wire = wire.clone();
    let mut frame = vec![0xFF; 6];
    frame.extend([0x10; 6]);
    frame.extend([0x88, 0xA4]);
    frame.extend((0x1000 | (data.len() as u16 + 12)).to_le_bytes());
    frame.extend([command, 1]);
    frame.extend(address.to_le_bytes());
    frame.extend(offset.to_le_bytes());
    frame.extend((data.len() as u16).to_le_bytes());
    frame.extend([0, 0]);
    frame.extend(data);
    frame.extend([0, 0]);
    wire.send(&frame).unwrap();
    let mut answer = [0; 1_536];
    let length = wire.receive(&mut answer).unwrap();
    assert_eq!(length, frame.len());
    assert_eq!(answer[6], 0x12, "the source address is marked");
    let end = 26 + data.len();
    (
        answer[26..end].to_vec(),
        u16::from_le_bytes([answer[end], answer[end + 1]]),
    )
}

/// Reads a byte of all devices; returns it with the working counter.
pub(crate) fn broadcast_read(wire: &Wire, offset: u16) -> (u8, u16) {
    let (data, counter) = ask(wire, 7, 0, offset, &[0]);
    (data[0], counter)
}

fn word(wire: &Wire, offset: u16) -> u16 {
    let (data, counter) = ask(wire, FPRD, 0x1001, offset, &[0; 2]);
    assert_eq!(counter, 1);
    u16::from_le_bytes([data[0], data[1]])
}

/// Requests a state, waits, and returns AL status with its code.
fn request(wire: &Wire, control: u16) -> (u16, u16) {
    ask(wire, FPWR, 0x1001, 0x0120, &control.to_le_bytes());
    wire.idle(2_000);
    (word(wire, 0x0130), word(wire, 0x0134))
}

fn one_with_an_address() -> Wire {
    let wire = wire(&setups(1));
    assert_eq!(ask(&wire, APWR, 0, 0x0010, &[0x01, 0x10]).1, 1);
    wire
}

fn sync_manager(wire: &Wire, index: u16, start: u16, length: u16, control: u8) {
    let [s, l] = [start.to_le_bytes(), length.to_le_bytes()];
    assert_eq!(
        ask(
            wire,
            FPWR,
            0x1001,
            0x0800 + 8 * index,
            &[s[0], s[1], l[0], l[1], control, 0, 1, 0]
        )
        .1,
        1
    );
}

fn pre_op() -> Wire {
    let wire = one_with_an_address();
    sync_manager(&wire, 0, 0x1000, 128, 0x26);
    sync_manager(&wire, 1, 0x1080, 128, 0x22);
    assert_eq!(request(&wire, 2), (2, 0));
    wire
}

/// Sends an SDO of the drive; returns its answer after the mailbox's header.
fn sdo(wire: &Wire, counter: u8, body: &[u8]) -> Vec<u8> {
    let mut request = vec![10, 0, 0, 0, 0, counter << 4 | 3, 0, 0x20];
    request.extend(body);
    request.resize(128, 0);
    assert_eq!(ask(wire, FPWR, 0x1001, 0x1000, &request).1, 1);
    wire.idle(500);
    let (answer, count) = ask(wire, FPRD, 0x1001, 0x1080, &[0; 128]);
    assert_eq!(count, 1);
    answer[6..16].to_vec()
}

fn download(wire: &Wire, counter: u8, object: u16, sub: u8, value: &[u8]) -> Vec<u8> {
    let [low, high] = object.to_le_bytes();
    let mut body = vec![0x23 | (4 - value.len() as u8) << 2, low, high, sub];
    body.extend(value);
    body.resize(8, 0);
    sdo(wire, counter, &body)
}

fn abort_code(answer: &[u8]) -> u32 {
    assert_eq!(answer[2], 0x80, "{answer:02x?}");
    u32::from_le_bytes(answer[6..10].try_into().unwrap())
}

#[test]
fn states_need_what_they_need_and_take_time() {
    let wire = one_with_an_address();
    ask(&wire, FPWR, 0x1001, 0x0120, &[2, 0]);
    assert_eq!(word(&wire, 0x0130), 1, "not at once");
    wire.idle(2_000);
    assert_eq!(
        (word(&wire, 0x0130), word(&wire, 0x0134)),
        (0x11, 0x0016),
        "no mailboxes"
    );
    sync_manager(&wire, 0, 0x1000, 128, 0x26);
    sync_manager(&wire, 1, 0x1080, 128, 0x22);
    assert_eq!(request(&wire, 2).0, 0x11, "the error is not acknowledged");
    assert_eq!(request(&wire, 0x12), (2, 0));
    assert_eq!(request(&wire, 8), (0x12, 0x0011), "OP from PRE-OP");
    assert_eq!(request(&wire, 0x13), (0x12, 0x0013), "BOOT");
    assert_eq!(request(&wire, 0x14), (0x12, 0x001D), "no outputs");
    sync_manager(&wire, 2, 0x1100, 6, 0x64);
    assert_eq!(request(&wire, 0x14), (0x12, 0x001E), "no inputs");
    sync_manager(&wire, 3, 0x1400, 7, 0x20);
    assert_eq!(request(&wire, 0x14), (0x12, 0x001E), "a byte too many");
    sync_manager(&wire, 3, 0x1400, 6, 0x20);
    assert_eq!(request(&wire, 0x14), (4, 0));
    assert_eq!(request(&wire, 8), (0x14, 0x0019), "no outputs were written");
    assert_eq!(ask(&wire, FPWR, 0x1001, 0x1100, &[0; 6]).1, 1);
    assert_eq!(request(&wire, 0x18), (8, 0));
    assert_eq!(request(&wire, 1), (1, 0));
}

#[test]
fn read_only_registers_and_parts_of_buffers_do_not_count() {
    let wire = pre_op();
    for register in [0x0000, 0x0012, 0x0110, 0x0130, 0x0134, 0x0440] {
        assert_eq!(
            ask(&wire, FPWR, 0x1001, register, &[0xFF, 0xFF]).1,
            0,
            "{register:04x}"
        );
    }
    assert_eq!(
        ask(&wire, FPRD, 0x1002, 0x0130, &[0; 2]).1,
        0,
        "another station"
    );
    assert_eq!(
        ask(&wire, FPWR, 0x1001, 0x1000, &[0; 64]).1,
        0,
        "half a mailbox"
    );
    assert_eq!(
        ask(&wire, FPWR, 0x1001, 0x1080, &[0; 128]).1,
        0,
        "a mailbox of the other direction"
    );
    assert_eq!(
        ask(&wire, FPRD, 0x1001, 0x1080, &[0; 128]).1,
        0,
        "an empty mailbox"
    );
    assert_eq!(ask(&wire, FPWR, 0x1001, 0x1000, &[0; 128]).1, 1);
    assert_eq!(
        ask(&wire, FPWR, 0x1001, 0x1000, &[0; 128]).1,
        0,
        "a full mailbox"
    );
    assert_eq!(ask(&wire, BWR, 0, 0x0120, &[1, 0]).1, 1);
    assert_eq!(ask(&wire, LRW, 0, 0, &[0; 4]).1, 0, "nothing is mapped");
}

/// Abort code of a download that is refused.
fn aborted(wire: &Wire, counter: u8, object: u16, sub: u8, value: &[u8]) -> u32 {
    abort_code(&download(wire, counter, object, sub, value))
}

#[test]
fn objects_are_refused_with_the_codes_of_the_standard() {
    let wire = pre_op();
    assert_eq!(aborted(&wire, 1, 0x2000, 0, &[0; 4]), 0x0602_0000);
    assert_eq!(aborted(&wire, 2, 0x6064, 0, &[0; 4]), 0x0601_0002);
    assert_eq!(aborted(&wire, 3, 0x60B0, 0, &[0; 2]), 0x0607_0010);
    assert_eq!(aborted(&wire, 4, 0x60B0, 9, &[0; 4]), 0x0609_0011);
    assert_eq!(
        aborted(&wire, 5, 0x1600, 1, &0x607A_0020_u32.to_le_bytes()),
        0x0601_0000,
        "its number is not zero"
    );
    assert_eq!(download(&wire, 6, 0x1C12, 0, &[0])[2], 0x60);
    assert_eq!(download(&wire, 7, 0x1600, 0, &[0])[2], 0x60);
    assert_eq!(
        aborted(&wire, 1, 0x1600, 1, &0x6064_0020_u32.to_le_bytes()),
        0x0604_0041,
        "an input"
    );
    assert_eq!(
        aborted(&wire, 2, 0x1600, 1, &0x607A_0010_u32.to_le_bytes()),
        0x0604_0041,
        "another length"
    );
    assert_eq!(
        aborted(&wire, 3, 0x1600, 0, &[1]),
        0x0609_0030,
        "an entry that is not there"
    );
    assert_eq!(download(&wire, 4, 0x1C12, 0, &[1])[2], 0x60);
    // Without outputs there is no SAFE-OP.
    assert_eq!(request(&wire, 4), (0x12, 0x001D));
}

#[test]
fn a_repeated_mailbox_counter_is_ignored() {
    let wire = pre_op();
    assert_eq!(download(&wire, 1, 0x60B0, 0, &[5, 0, 0, 0])[2], 0x60);
    let mut request = vec![
        10,
        0,
        0,
        0,
        0,
        1 << 4 | 3,
        0,
        0x20,
        0x23,
        0xB0,
        0x60,
        0,
        9,
        0,
        0,
        0,
    ];
    request.resize(128, 0);
    assert_eq!(ask(&wire, FPWR, 0x1001, 0x1000, &request).1, 1);
    wire.idle(500);
    assert_eq!(
        ask(&wire, FPRD, 0x1001, 0x1080, &[0; 128]).1,
        0,
        "no answer"
    );
    assert_eq!(
        wire.bench()
            .chain
            .drives()
            .next()
            .unwrap()
            .object(0x60B0, 0),
        5
    );
}

#[test]
fn the_mapping_is_fixed_outside_pre_op() {
    let wire = pre_op();
    sync_manager(&wire, 2, 0x1100, 6, 0x64);
    sync_manager(&wire, 3, 0x1400, 6, 0x20);
    assert_eq!(request(&wire, 4), (4, 0));
    assert_eq!(
        abort_code(&download(&wire, 1, 0x1C12, 0, &[0])),
        0x0800_0022
    );
}

/// Reads two words of the EEPROM, from `word` on. Returns whether the interface was busy, the high
/// byte of the control register, and the data.
fn read_eeprom(wire: &Wire, word: u16) -> (bool, u8, Vec<u8>) {
    let [low, high] = word.to_le_bytes();
    ask(wire, FPWR, 0x1001, 0x0502, &[0, 1, low, high, 0, 0]);
    let busy = ask(wire, FPRD, 0x1001, 0x0502, &[0; 2]).0;
    wire.idle(200);
    let control = ask(wire, FPRD, 0x1001, 0x0502, &[0; 2]).0;
    let data = ask(wire, FPRD, 0x1001, 0x0508, &[0; 4]).0;
    (busy[1] & 0x80 != 0, control[1], data)
}

#[test]
fn the_eeprom_belongs_to_one_of_two() {
    let wire = one_with_an_address();
    assert_eq!(
        read_eeprom(&wire, 8),
        (true, 0, vec![0x11, 0x0A, 0, 0]),
        "the vendor"
    );
    ask(&wire, FPWR, 0x1001, 0x0500, &[1]);
    assert_eq!(
        read_eeprom(&wire, 10).1,
        0x20,
        "it belongs to the application: command error"
    );
    ask(&wire, FPWR, 0x1001, 0x0500, &[0]);
    ask(&wire, FPWR, 0x1001, 0x0502, &[0, 0]);
    assert_eq!(
        read_eeprom(&wire, 10),
        (true, 0, vec![1, 0, 0, 0]),
        "the product"
    );
}

/// Registers of the distributed clock: of devices that have one.
#[test]
fn a_clock_has_its_registers_and_starts_no_pulse_that_is_past() {
    use gantry_tau_ethercat::emulation::{
        Chain, ClockSetup, EmulatedWire, Kinematic, Node, SubDevice,
    };
    let clock = ClockSetup {
        drift_ppb: 0,
        offset_ns: 5_000,
    };
    let nodes = vec![
        Node::Drive(SubDevice::new(&crate::bench::setup(0)).with_clock(clock)),
        Node::Drive(SubDevice::new(&crate::bench::setup(1))),
    ];
    let wire = EmulatedWire::new(Chain::of(nodes, Kinematic));
    assert_eq!(ask(&wire, BWR, 0, 0x0900, &[0; 4]).1, 1, "one has a clock");
    assert_eq!(ask(&wire, APWR, 0, 0x0010, &[0x01, 0x10]).1, 1);
    assert_eq!(ask(&wire, APWR, 0xFFFF, 0x0010, &[0x02, 0x10]).1, 1);
    let (ports, counter) = ask(&wire, FPRD, 0x1001, 0x0900, &[0; 8]);
    assert_eq!(counter, 1);
    let [here, back] = [0, 4].map(|at| u32::from_le_bytes(ports[at..at + 4].try_into().unwrap()));
    assert_eq!(back - here, 620, "to the next one and back");
    assert_eq!(
        ask(&wire, FPRD, 0x1002, 0x0910, &[0; 8]).1,
        0,
        "without a clock"
    );
    assert_eq!(ask(&wire, FPWR, 0x1001, 0x0982, &[1, 0]).1, 0, "read only");
    let time = || {
        let (bytes, _) = ask(&wire, FPRD, 0x1001, 0x0910, &[0; 8]);
        u64::from_le_bytes(bytes.try_into().unwrap())
    };
    let first = time();
    wire.idle(1_000);
    assert_eq!(time() - first, 1_010_000, "the frame takes 10 us");
    ask(&wire, FPWR, 0x1001, 0x0920, &1_000_000_u64.to_le_bytes());
    assert_eq!(time() - first, 1_000_000 + 1_030_000, "with its offset");
    ask(&wire, FPWR, 0x1001, 0x09A0, &1_000_000_u32.to_le_bytes());
    for (start, is_pending) in [(time() - 1, 0), (time() + 1_000_000_000, 1)] {
        ask(&wire, FPWR, 0x1001, 0x0981, &[0]);
        ask(&wire, FPWR, 0x1001, 0x0990, &start.to_le_bytes());
        ask(&wire, FPWR, 0x1001, 0x0981, &[3]);
        assert_eq!(ask(&wire, FPRD, 0x1001, 0x0984, &[0]).0, [is_pending]);
    }
}
