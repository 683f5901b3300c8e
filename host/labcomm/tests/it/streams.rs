use gantry_tau_labcomm::{Collector, Decoded, Decoder, ErrorKind, Malformed, Unsupported, Version};
use proptest::prelude::*;

use super::{Seen, decode, hex};

/// The thesis' file from the peer's encoder of March 2012.
const OF_2012: &str = "
    00000002 00000080 00000004 64617461 00000010 00000001 00000003 00000023
    00000002 00000081 0000000b 666f72636573656e736f72 00000010 00000001 00000006 00000025
    00000080 0000002a fffffff9 001e8480
    00000081 43b40000 c1480000 00000000 3e800000 bf800000 40400000";
/// The same of the branch labcomm2014.
const OF_2014: &str = "
    01 0f 0e 4c6162436f6d6d323031342e7631
    02 0b 40 04 64617461 04 10010323
    02 12 41 0b 666f72636573656e736f72 04 10010625
    40 0c 0000002a fffffff9 001e8480
    41 18 43b40000 c1480000 00000000 3e800000 bf800000 40400000";

#[test]
fn the_thesis_file_decodes_in_both_versions() {
    let (data, force) = (
        hex("0000002a fffffff9 001e8480"),
        hex("43b40000c1480000000000003e800000bf80000040400000"),
    );
    let of_2012 = [
        Seen::Define(
            0x80,
            b"data".to_vec(),
            hex("00000010 00000001 00000003 00000023"),
        ),
        Seen::Define(
            0x81,
            b"forcesensor".to_vec(),
            hex("00000010 00000001 00000006 00000025"),
        ),
        Seen::Data(0x80, data.clone()),
        Seen::Data(0x81, force.clone()),
    ];
    let of_2014 = [
        Seen::Version(Version::V2014),
        Seen::Define(0x40, b"data".to_vec(), hex("10010323")),
        Seen::Define(0x41, b"forcesensor".to_vec(), hex("10010625")),
        Seen::Data(0x40, data),
        Seen::Data(0x41, force),
    ];
    assert_eq!(decode(&hex(OF_2012)), (of_2012.to_vec(), true, None));
    assert_eq!(decode(&hex(OF_2014)), (of_2014.to_vec(), true, None));
}

#[test]
fn every_cut_gives_the_events_before_it() {
    for stream in [OF_2012, OF_2014].map(hex) {
        let (whole, ..) = decode(&stream);
        for cut in 0..stream.len() {
            let (seen, _, error) = decode(&stream[..cut]);
            assert_eq!((&seen[..], error), (&whole[..seen.len()], None));
        }
    }
}

/// Events of a stream that comes in chunks, through a collector.
fn in_chunks(stream: &[u8], lengths: &[usize]) -> (Vec<Seen>, Option<ErrorKind>) {
    let mut collector = Collector::<512>::new();
    let mut decoder = Decoder::<8, 1024>::new(100);
    let mut seen = Vec::new();
    let mut rest = stream;
    let mut lengths = lengths.iter().cycle();
    while !rest.is_empty() {
        let length = (lengths.next().unwrap() + 1).min(rest.len());
        let taken = collector.append(&rest[..length]);
        rest = &rest[taken..];
        loop {
            match decoder.decode(collector.held()) {
                Ok(Decoded::Event { event, used }) => {
                    seen.push(event.into());
                    collector.drop_front(used);
                }
                Ok(Decoded::Need(least)) => {
                    assert!(least > collector.held().len() && least <= 512);
                    break;
                }
                Err(error) => return (seen, Some(error.kind)),
            }
        }
    }
    (seen, None)
}

proptest! {
    #[test]
    fn a_stream_means_the_same_however_it_is_cut(lengths in prop::collection::vec(0_usize..40, 1..5), at in 0_usize..200, byte: u8) {
        for stream in [OF_2012, OF_2014].map(hex) {
            let mut stream = [&stream[..], &stream[stream.len() - 44..]].concat();
            let at = at % stream.len();
            stream[at] = byte;
            prop_assert_eq!(in_chunks(&stream, &lengths), in_chunks(&stream, &[127]));
        }
    }
}

/// Error of a stream.
fn refused(text: &str) -> ErrorKind {
    decode(&hex(text)).2.unwrap().kind
}

#[test]
fn other_generations_are_refused_by_name() {
    assert_eq!(
        refused("02 40 04 64617461 10010323"),
        ErrorKind::Version(Unsupported::LabComm2013)
    );
    assert_eq!(
        refused("0b 4c6162436f6d6d32303133"),
        ErrorKind::Version(Unsupported::LabComm2013)
    );
    assert_eq!(
        refused("01 05 04 4c616221"),
        ErrorKind::Version(Unsupported::Text)
    );
    assert_eq!(refused("47 54"), ErrorKind::Malformed(Malformed::Start));
    // The unfinished branch master: intentions in place of the name.
    let master = decode(&hex(
        "01 0c 0b 4c6162436f6d6d32303134 02 0d 40 01 00 04 64617461 04 10010323",
    ));
    assert_eq!(master.0, [Seen::Version(Version::V2014_0)]);
    assert_eq!(
        master.2.unwrap().kind,
        ErrorKind::Malformed(Malformed::PacketLength)
    );
    assert_eq!(master.2.unwrap().at, 14);
}

#[test]
fn unknown_packets_of_2014_are_skipped() {
    let start = hex("01 0f 0e 4c6162436f6d6d323031342e7631");
    let stream = [
        &start[..],
        &hex("04 02 ffff 3f 00 41 01 07 03 05 43 01 63 01 23 05 01 00"),
    ]
    .concat();
    let (seen, at_boundary, error) = decode(&stream);
    assert_eq!((at_boundary, error), (true, None));
    let reference = Seen::Reference(0x43, b"c".to_vec(), vec![0x23]);
    let skipped = [4, 0x3f, 0x41].map(Seen::Skipped);
    assert_eq!(seen[1..4], skipped);
    assert_eq!(seen[4..], [reference, Seen::Skipped(5)]);
}
