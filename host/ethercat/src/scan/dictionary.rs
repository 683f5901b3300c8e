//! Objects of a device that matter to the server.

use super::mailbox::Mailbox;
use super::{Options, ScanError};

/// Objects of a drive that the server uses or compares: the first axis, and the second one.
pub const FIRST_AXIS: [u16; 12] = [
    0x607A, 0x60B0, 0x60B1, 0x60B2, 0x6064, 0x606C, 0x6077, 0x603F, 0x608F, 0x607D, 0x6085, 0x6007,
];
/// The same objects of a second axis, 800h above.
pub const SECOND_AXIS: [u16; 12] = [
    0x687A, 0x68B0, 0x68B1, 0x68B2, 0x6864, 0x686C, 0x6877, 0x683F, 0x688F, 0x687D, 0x6885, 0x6807,
];
/// PDOs of one assignment that are listed, and entries of a PDO that are tried.
const MAX_ASSIGNED: u8 = 16;
const MAX_ENTRIES: u8 = 32;

/// Answer to the question for an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Answer {
    /// The object's value.
    Value(u32),
    /// The device has no such object, or refuses it: the abort code.
    Aborted(u32),
    /// No answer came in time.
    Silent,
}

impl Answer {
    /// Returns the value.
    #[must_use]
    pub const fn value(self) -> Option<u32> {
        match self {
            Self::Value(value) => Some(value),
            Self::Aborted(_) | Self::Silent => None,
        }
    }
}

/// Answer of a PDO mapping to a write of what it held.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mapping {
    /// It takes a write.
    Written,
    /// It aborted a write: it is fixed.
    Fixed(u32),
    /// It has more entries, or more PDOs are assigned, than a scan writes: nothing was written.
    TooLong,
    /// It was written to, and does not hold what it held before: power the device off and on.
    NotRestored,
    /// No answer came in time.
    Silent,
}

/// Objects of a device.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Dictionary {
    /// Supported modes of operation, 6502h.
    pub modes: Answer,
    /// Present mode of operation, 6061h.
    pub mode: Answer,
    /// Types of synchronisation, 1C32h:04 and 1C33h:04.
    pub synchronisation: [Answer; 2],
    /// Objects of [`FIRST_AXIS`].
    pub first_axis: [Answer; 12],
    /// Objects of [`SECOND_AXIS`]; all like the first of them where that one is missing.
    pub second_axis: [Answer; 12],
    /// Turns of 608Fh, sub-index 2; its counts are among the objects.
    pub turns: Answer,
    /// PDOs assigned by 1C12h and 1C13h.
    pub assigned: [Vec<u16>; 2],
    /// Answers of 1600h and 1A00h to such a write; `None` without being asked for.
    pub mapping: Option<[Mapping; 2]>,
}

impl Dictionary {
    /// Returns the answer for an object of the first axis.
    #[must_use]
    pub fn of_first_axis(&self, index: u16) -> Answer {
        let mut objects = FIRST_AXIS.iter().zip(self.first_axis);
        objects
            .find(|(object, _)| **object == index)
            .map_or(Answer::Silent, |(_, answer)| answer)
    }

    /// True if the device is a drive: it has a target position, or modes of operation.
    #[must_use]
    pub fn is_of_drive(&self) -> bool {
        self.modes.value().is_some() || self.of_first_axis(0x607A).value().is_some()
    }
}

/// Sub-index by which an object is asked for: records (607Dh, 608Fh) by their first member.
const fn sub(object: u16) -> u8 {
    match object & 0x00FF {
        0x7D | 0x8F => 1,
        _ => 0,
    }
}

/// Reads the objects of a device.
pub(super) async fn read(
    mailbox: &mut Mailbox<'_>,
    options: Options,
) -> Result<Dictionary, ScanError> {
    let modes = ask(mailbox, 0x6502, 0).await?;
    let mode = ask(mailbox, 0x6061, 0).await?;
    let synchronisation = [
        ask(mailbox, 0x1C32, 4).await?,
        ask(mailbox, 0x1C33, 4).await?,
    ];
    let first_axis = axis(mailbox, &FIRST_AXIS).await?;
    let second_axis = axis(mailbox, &SECOND_AXIS).await?;
    let turns = ask(mailbox, 0x608F, 2).await?;
    let assigned = [
        assigned(mailbox, 0x1C12).await?,
        assigned(mailbox, 0x1C13).await?,
    ];
    let mut dictionary = Dictionary {
        modes,
        mode,
        synchronisation,
        first_axis,
        second_axis,
        turns,
        assigned,
        mapping: None,
    };
    if options.tries_mapping && dictionary.is_of_drive() {
        dictionary.mapping = Some([
            try_mapping(mailbox, 0x1C12, 0x1600).await?,
            try_mapping(mailbox, 0x1C13, 0x1A00).await?,
        ]);
    }
    Ok(dictionary)
}

async fn ask(mailbox: &mut Mailbox<'_>, index: u16, sub: u8) -> Result<Answer, ScanError> {
    Ok(match mailbox.upload(index, sub).await? {
        Some(Ok(value)) => Answer::Value(value),
        Some(Err(code)) => Answer::Aborted(code),
        None => Answer::Silent,
    })
}

/// Asks for the objects of an axis; for the first alone where it is missing and the axis is the
/// second.
async fn axis(mailbox: &mut Mailbox<'_>, objects: &[u16; 12]) -> Result<[Answer; 12], ScanError> {
    let mut answers = [Answer::Silent; 12];
    for (answer, &object) in answers.iter_mut().zip(objects) {
        *answer = ask(mailbox, object, sub(object)).await?;
        if object == 0x687A && answer.value().is_none() {
            return Ok([*answer; 12]);
        }
    }
    Ok(answers)
}

/// Reads an assignment.
async fn assigned(mailbox: &mut Mailbox<'_>, assignment: u16) -> Result<Vec<u16>, ScanError> {
    let count = ask(mailbox, assignment, 0).await?.value().unwrap_or(0);
    let count = u8::try_from(count).unwrap_or(u8::MAX).min(MAX_ASSIGNED);
    let mut pdos = Vec::new();
    for sub in 1..=count {
        if let Some(pdo) = ask(mailbox, assignment, sub).await?.value() {
            pdos.push(pdo as u16);
        }
    }
    Ok(pdos)
}

/// Reads a mapping or an assignment whole, or tells why it cannot be tried.
async fn held(
    mailbox: &mut Mailbox<'_>,
    object: u16,
    most: u8,
) -> Result<Result<Vec<u32>, Mapping>, ScanError> {
    let mut entries = Vec::new();
    let mut count = 0;
    let mut sub = 0;
    while sub <= count {
        match ask(mailbox, object, sub).await? {
            Answer::Value(found) if sub == 0 && found > most.into() => {
                return Ok(Err(Mapping::TooLong));
            }
            Answer::Value(found) if sub == 0 => count = found as u8,
            Answer::Value(entry) => entries.push(entry),
            Answer::Aborted(code) => return Ok(Err(Mapping::Fixed(code))),
            Answer::Silent => return Ok(Err(Mapping::Silent)),
        }
        sub += 1;
    }
    Ok(Ok(entries))
}

/// Write of an object: index, sub-index, value, bytes.
type Write = (u16, u8, u32, u8);

/// Writes of the entries of an object, from its count of zero to its count.
fn writes_of(object: u16, entries: &[u32], bytes: u8) -> Vec<Write> {
    let count = u32::try_from(entries.len()).unwrap_or(0);
    let places = (1_u8..).zip(entries);
    let mut writes = vec![(object, 0, 0, 1)];
    writes.extend(places.map(|(sub, entry)| (object, sub, *entry, bytes)));
    writes.push((object, 0, count, 1));
    writes
}

/// Writes to a mapping and its assignment what they hold, once all of that is known.
async fn try_mapping(
    mailbox: &mut Mailbox<'_>,
    assignment: u16,
    pdo: u16,
) -> Result<Mapping, ScanError> {
    let assigned = match held(mailbox, assignment, MAX_ASSIGNED).await? {
        Ok(assigned) => assigned,
        Err(reason) => return Ok(reason),
    };
    let entries = match held(mailbox, pdo, MAX_ENTRIES).await? {
        Ok(entries) => entries,
        Err(reason) => return Ok(reason),
    };
    let mut outcome = Mapping::Written;
    let unassign = (assignment, 0, 0, 1);
    for (index, sub, value, bytes) in [unassign].into_iter().chain(writes_of(pdo, &entries, 4)) {
        outcome = match mailbox.download(index, sub, value, bytes).await? {
            Some(Ok(_)) => continue,
            Some(Err(code)) => Mapping::Fixed(code),
            None => Mapping::Silent,
        };
        break;
    }
    // After a refusal in the middle, too, both get back what they held.
    for (index, sub, value, bytes) in [
        writes_of(pdo, &entries, 4),
        writes_of(assignment, &assigned, 2),
    ]
    .concat()
    {
        mailbox.download(index, sub, value, bytes).await?;
    }
    let now = [
        held(mailbox, assignment, MAX_ASSIGNED).await?,
        held(mailbox, pdo, MAX_ENTRIES).await?,
    ];
    Ok(if now == [Ok(assigned), Ok(entries)] {
        outcome
    } else {
        Mapping::NotRestored
    })
}
