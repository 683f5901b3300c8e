//! The real client with its force from a LabComm stream: compensates as with the samples of the States,
//! and leaves as with it.

use gantry_tau::demo::ALLOWED_SHARE;
use gantry_tau_client::force_sensor::SensorSource;
use gantry_tau_core::control::message::{Cause, Phase};
use gantry_tau_core::model::robot::ARMS;
use gantry_tau_labcomm::Version;
use gantry_tau_labcomm::samples::ForceSensor;
use gantry_tau_server::publication::{Publication, SampleName};
use gantry_tau_tests::server_fixture::LOOPBACK;

use super::lockstep::{Lockstep, PULLED, SETTLED, Session, displacement_m, stream};
use super::reader::{RESOLUTION_M, floats};
use super::stream::{Counts, Decoy, Doubles, Program, Unknown, unknown};

const VERSIONS: [Version; 3] = [Version::V2006, Version::V2014, Version::V2014_0];
/// Ticks of a session.
const TICKS: usize = PULLED + SETTLED;
/// States that a client answers without its first sample.
const FIRST_SAMPLE_STATES: usize = 3_000;
/// Tick in which the stream of a session goes wrong: the offsets have not settled, so that every
/// change of the force would show.
const WRONG: usize = PULLED + 100;
/// States that the last sample serves, as the client's documentation says.
const SAMPLE_STATES: usize = 100;

fn by_states() -> Session {
    let mut server = Lockstep::start(Vec::new());
    server.session(SensorSource::States, TICKS, |_, _| {})
}

/// Offsets of two sessions differ by no more than the rounding of the force, to `float` and to mN.
fn assert_near(ours: &[i32; ARMS], own: &[i32; ARMS]) {
    assert!(
        ours.iter()
            .zip(own)
            .all(|(ours, own)| (ours - own).abs() <= 1),
        "{ours:?} and {own:?}"
    );
}

#[test]
fn the_stream_of_a_server_compensates_as_its_states() {
    let own = by_states();
    let uncompensated_m = Lockstep::start(Vec::new()).uncompensated_m();
    for version in VERSIONS {
        let names = [SampleName::Data, SampleName::ForceSensor];
        let port = Publication::bind::<ARMS>(LOOPBACK, version, &names, RESOLUTION_M).unwrap();
        let source = stream(port.address().unwrap());
        let session = Lockstep::start(vec![port]).session(source, TICKS, |_, _| {});
        assert!(session.client.is_ok(), "{:?}", session.client);
        session.assert_on_time();
        let (ours, theirs) = (session.obtained(), own.obtained());
        assert_eq!(ours.len(), theirs.len());
        ours.iter()
            .zip(&theirs)
            .for_each(|(ours, theirs)| assert_near(ours, theirs));
        let settled = session
            .rows
            .iter()
            .rfind(|row| row.state.phase == Phase::Obtain)
            .unwrap();
        let share = displacement_m(settled) / uncompensated_m;
        assert!(share < ALLOWED_SHARE, "{version:?}: {share}");
    }
}

/// Definitions and samples around those of the force, the force as doubles, and a second index for
/// it.
#[test]
fn a_stream_with_samples_that_a_client_does_not_know_compensates_as_well() {
    let own = by_states().obtained();
    for (version, is_double) in VERSIONS
        .into_iter()
        .flat_map(|version| [(version, false), (version, true)])
    {
        let mut server = Lockstep::start(Vec::new());
        let mut program = Program::of(version);
        let (source, first) = (program.source(), program.first());
        let session = server.session(source, TICKS, |tick, row| {
            let wrench = row.tool.unwrap().sensor;
            if tick == 0 {
                program.send(|encoder| {
                    encoder.version()?;
                    encoder.define::<Decoy>(first)?;
                    encoder.define::<Unknown>(first + 2)
                });
            }
            // The force is defined later than the first sample of another kind, and then again, as
            // peers do.
            for (at, index) in [(3, first + 1), (WRONG, first + 3)] {
                if tick == at {
                    program.send(|encoder| match is_double {
                        true => encoder.define::<Doubles>(index),
                        false => encoder.define::<ForceSensor>(index),
                    });
                }
            }
            program.send(|encoder| {
                encoder.data(first + 2, &unknown(tick))?;
                encoder.data(first, &Decoy([1e6; 6]))?;
                match (tick, is_double) {
                    (..=3, _) => Ok(()),
                    (_, true) => encoder.data(first + 1, &Doubles(wrench)),
                    (_, false) => {
                        let index = if tick > WRONG { first + 3 } else { first + 1 };
                        encoder.data(index, &ForceSensor(floats(row)))
                    }
                }?;
                encoder.data(first, &Decoy([f32::NAN; 6]))
            });
            if version != Version::V2006 {
                // Data without a definition, and a pragma: their lengths lead past them.
                program.send_bytes(&[0x7f, 0x03, 0x02, 0x40, 0x00, 0x3f, 0x02, 0x40, 0x02]);
            }
        });
        assert!(session.client.is_ok(), "{version:?}: {:?}", session.client);
        session.assert_on_time();
        assert_near(session.obtained().last().unwrap(), own.last().unwrap());
    }
}

/// Ways of a stream to go wrong in tick [`WRONG`].
#[derive(Clone, Copy, Debug, PartialEq)]
enum Wrong {
    Ends,
    Stalls,
    StallsWithinASample,
    ChangesTheDefinition,
    DefinesAnotherType,
    IsGarbage,
    HasTheWrongType,
    HasAnotherName,
}

/// Runs a client whose stream goes wrong.
fn session(version: Version, wrong: Wrong) -> Session {
    let mut server = Lockstep::start(Vec::new());
    let mut program = Program::of(version);
    let (source, index) = (program.source(), program.first());
    let ticks = if wrong == Wrong::HasAnotherName {
        FIRST_SAMPLE_STATES + SETTLED
    } else {
        TICKS
    };
    server.session(source, ticks, |tick, row| {
        let force = ForceSensor(floats(row));
        match (tick, wrong) {
            (0, Wrong::HasTheWrongType) => program.send(|encoder| {
                encoder.version()?;
                encoder.define::<Counts>(index)
            }),
            (0, Wrong::HasAnotherName) => program.send(|encoder| {
                encoder.version()?;
                encoder.define::<Unknown>(index)
            }),
            (_, Wrong::HasTheWrongType | Wrong::HasAnotherName) => {}
            (0, _) => program.send(|encoder| {
                encoder.version()?;
                encoder.define::<ForceSensor>(index)?;
                encoder.data(index, &force)
            }),
            (..WRONG, _) => program.send(|encoder| encoder.data(index, &force)),
            (WRONG, Wrong::Ends) => program.end(),
            (WRONG, Wrong::StallsWithinASample) => {
                let sample = program.encoded(|encoder| encoder.data(index, &force));
                program.send_bytes(&sample[..sample.len() - 1]);
            }
            (WRONG, Wrong::ChangesTheDefinition) => {
                program.send(|encoder| encoder.define::<Counts>(index))
            }
            (WRONG, Wrong::DefinesAnotherType) => {
                program.send(|encoder| encoder.define::<Counts>(index + 1))
            }
            (WRONG, Wrong::IsGarbage) => program.send_bytes(&[0; 64]),
            (WRONG.., _) => {}
        }
    })
}

/// When anything goes wrong, the client leaves with Goodbye and says why; the server ramps.
#[test]
fn a_stream_that_goes_wrong_ends_the_compensation_and_nothing_else() {
    let types = "has the type [\"array\",[6],\"int\"]; expected [\"array\",[6],\"float\"] or [\"array\",[6],\"double\"]";
    let cases = [
        (Wrong::Ends, 0, "has closed the connection"),
        (Wrong::Stalls, SAMPLE_STATES, "none has come for too long"),
        (
            Wrong::StallsWithinASample,
            SAMPLE_STATES,
            "none has come for too long",
        ),
        (
            Wrong::ChangesTheDefinition,
            0,
            "is defined again, with another name or type",
        ),
        (Wrong::DefinesAnotherType, 0, types),
        (Wrong::IsGarbage, 0, "starts neither a definition nor data"),
    ];
    for ((wrong, states, reason), version) in cases.into_iter().zip(VERSIONS.into_iter().cycle()) {
        let session = session(version, wrong);
        assert_left(&session, wrong, reason);
        let left = session
            .rows
            .iter()
            .position(|row| row.ended.is_some())
            .unwrap();
        // The State of the tick without a sample is the first of those; the Goodbye that answers
        // the last of them ends the next tick.
        assert_eq!(left, WRONG + 2 + states, "{wrong:?}");
        assert!(
            session
                .obtained()
                .iter()
                .any(|offsets| offsets[1] < -10_000),
            "{wrong:?}: it compensated until then"
        );
        // The last correction was held meanwhile: the force of a stream that is silent is not
        // extrapolated.
        let before = &session.rows[left - 1].state.axes;
        assert!(
            states == 0
                || before.map(|axis| axis.offsets)
                    == session.rows[left - 2].state.axes.map(|axis| axis.offsets)
        );
    }
}

#[test]
fn a_stream_of_the_wrong_type_never_obtains() {
    let types = "has the type [\"array\",[6],\"int\"]; expected [\"array\",[6],\"float\"] or [\"array\",[6],\"double\"]";
    for version in VERSIONS {
        let session = session(version, Wrong::HasTheWrongType);
        assert_left(&session, Wrong::HasTheWrongType, types);
        assert!(session.obtained().is_empty());
    }
}

#[test]
fn a_stream_without_the_sample_never_obtains_and_its_names_are_told() {
    let session = session(Version::V2014, Wrong::HasAnotherName);
    assert_left(
        &session,
        Wrong::HasAnotherName,
        "does not define a sample \"forcesensor\"; it defines \"places\"",
    );
    assert!(session.obtained().is_empty());
}

/// The client left in good order with `reason`; then the offsets ramped to zero, and the server
/// listens.
fn assert_left(session: &Session, wrong: Wrong, reason: &str) {
    let error = session.client.as_ref().unwrap_err();
    assert_eq!(error.exit_code(), 8, "{wrong:?}");
    assert!(error.to_string().contains(reason), "{wrong:?}: {error}");
    session.assert_on_time();
    let ended: Vec<Cause> = session.rows.iter().filter_map(|row| row.ended).collect();
    assert_eq!(ended, [Cause::Goodbye], "{wrong:?}");
    let offsets: Vec<_> = (session.rows.iter())
        .map(|row| row.state.axes.map(|axis| axis.offsets.position.0))
        .collect();
    for (row, pair) in session.rows[1..].iter().zip(offsets.windows(2)) {
        if row.state.phase == Phase::SafeDisconnect {
            let ramped = pair[0].map(|nm| nm - nm.signum() * nm.abs().min(100));
            assert_eq!(pair[1], ramped, "{wrong:?}");
        }
    }
    assert_eq!(*offsets.last().unwrap(), [0; ARMS]);
}
