//! PDO mapping and assignment of an emulated drive: one PDO each way, with contents that are
//! written in PRE-OP.

use super::device::MAX_PROCESS_DATA;
use super::objects::{Mappable, ObjectEntry, Objects, abort};

/// Largest number of entries of a PDO.
const ENTRIES: usize = 8;

/// An entry of a PDO.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Mapped {
    pub(super) index: u16,
    pub(super) sub: u8,
    pub(super) bits: u8,
}

impl Mapped {
    /// An object without sub-indices.
    pub(super) const fn whole(index: u16, bits: u8) -> Self {
        Self {
            index,
            sub: 0,
            bits,
        }
    }
}

/// One PDO: its object (1600h or 1A00h) with its assignment (1C12h or 1C13h).
#[derive(Clone, Debug)]
pub(super) struct Pdo {
    direction: Mappable,
    object: u16,
    assignment: u16,
    entries: [Option<Mapped>; ENTRIES],
    count: u8,
    assigned: Option<u16>,
    is_assigned: bool,
    /// The contents cannot be written.
    is_fixed: bool,
}

impl Pdo {
    /// Creates a PDO that is assigned, with the contents that the drive leaves the factory with.
    pub(super) fn new(
        direction: Mappable,
        object: u16,
        assignment: u16,
        contents: &[Mapped],
    ) -> Self {
        let mut entries = [None; ENTRIES];
        for (place, mapped) in entries.iter_mut().zip(contents) {
            *place = Some(*mapped);
        }
        let count = contents.len() as u8;
        Self {
            direction,
            object,
            assignment,
            entries,
            count,
            assigned: Some(object),
            is_assigned: true,
            is_fixed: false,
        }
    }

    /// Refuses writes of the contents from now on.
    pub(super) const fn fix(&mut self) {
        self.is_fixed = true;
    }

    /// True if an object belongs to this PDO.
    pub(super) const fn owns(&self, index: u16) -> bool {
        index == self.object || index == self.assignment
    }

    /// Returns the entries in force, none while the PDO is not assigned.
    pub(super) fn active(&self) -> impl Iterator<Item = Mapped> + '_ {
        let count = if self.is_assigned {
            usize::from(self.count)
        } else {
            0
        };
        self.entries.iter().take(count).flatten().copied()
    }

    /// Returns the length in force, bytes.
    pub(super) fn length(&self) -> usize {
        self.active()
            .map(|mapped| usize::from(mapped.bits / 8))
            .sum()
    }

    pub(super) fn upload(&self, index: u16, sub: u8) -> Result<([u8; 4], usize), u32> {
        if index == self.assignment {
            return match sub {
                0 => Ok(([u8::from(self.is_assigned), 0, 0, 0], 1)),
                1 => Ok((u32::from(self.assigned.unwrap_or(0)).to_le_bytes(), 2)),
                _ => Err(abort::NO_SUBINDEX),
            };
        }
        if sub == 0 {
            return Ok(([self.count, 0, 0, 0], 1));
        }
        let place = self
            .entries
            .get(usize::from(sub) - 1)
            .ok_or(abort::NO_SUBINDEX)?;
        let word = place.map_or(0, |it| {
            u32::from(it.index) << 16 | u32::from(it.sub) << 8 | u32::from(it.bits)
        });
        Ok((word.to_le_bytes(), 4))
    }

    /// Takes a write to the PDO or its assignment, as ETG1000.6 orders them: count to zero,
    /// contents, count.
    pub(super) fn download(
        &mut self,
        index: u16,
        sub: u8,
        bytes: &[u8],
        objects: &Objects,
    ) -> Result<(), u32> {
        let value = bytes
            .iter()
            .rev()
            .fold(0_u32, |value, byte| value << 8 | u32::from(*byte));
        if index == self.assignment {
            return self.assign(
                sub,
                value,
                expect_length(bytes, if sub == 0 { 1 } else { 2 }),
            );
        }
        if self.is_fixed {
            return Err(abort::READ_ONLY);
        }
        if sub == 0 {
            expect_length(bytes, 1)?;
            return self.count(value, objects);
        }
        expect_length(bytes, 4)?;
        let place = self
            .entries
            .get_mut(usize::from(sub) - 1)
            .ok_or(abort::NO_SUBINDEX)?;
        if self.count != 0 || self.is_assigned {
            return Err(abort::UNSUPPORTED);
        }
        let mapped = Mapped {
            index: (value >> 16) as u16,
            sub: (value >> 8) as u8,
            bits: value as u8,
        };
        let entry = objects
            .find(mapped.index, mapped.sub)
            .ok_or(abort::NO_OBJECT)?;
        if entry.mappable != self.direction || entry.bits != mapped.bits {
            return Err(abort::NOT_MAPPABLE);
        }
        *place = Some(mapped);
        Ok(())
    }

    fn assign(&mut self, sub: u8, value: u32, length: Result<(), u32>) -> Result<(), u32> {
        length?;
        match sub {
            0 if value > 1 => Err(abort::RANGE),
            0 => {
                self.is_assigned = value == 1;
                Ok(())
            }
            1 if self.is_assigned => Err(abort::UNSUPPORTED),
            1 if value != u32::from(self.object) => Err(abort::NOT_MAPPABLE),
            1 => {
                self.assigned = Some(self.object);
                Ok(())
            }
            _ => Err(abort::NO_SUBINDEX),
        }
    }

    fn count(&mut self, value: u32, objects: &Objects) -> Result<(), u32> {
        if self.is_assigned {
            return Err(abort::UNSUPPORTED);
        }
        let wanted = value as usize;
        if wanted > ENTRIES || self.entries.iter().take(wanted).any(Option::is_none) {
            return Err(abort::RANGE);
        }
        let length: usize = self
            .entries
            .iter()
            .take(wanted)
            .flatten()
            .map(|it| usize::from(it.bits / 8))
            .sum();
        if length > MAX_PROCESS_DATA {
            return Err(abort::PDO_TOO_LONG);
        }
        let missing = self
            .entries
            .iter()
            .take(wanted)
            .flatten()
            .any(|it| objects.find(it.index, it.sub).is_none());
        if missing {
            return Err(abort::NO_OBJECT);
        }
        if wanted == 0 {
            self.entries = [None; ENTRIES];
        }
        self.count = value as u8;
        Ok(())
    }

    /// Spreads process data over the objects.
    pub(super) fn unpack(&self, mut data: &[u8], objects: &mut Objects) {
        for mapped in self.active() {
            let Some((bytes, rest)) = data.split_at_checked(usize::from(mapped.bits / 8)) else {
                return;
            };
            let value = bytes
                .iter()
                .rev()
                .fold(0_u32, |value, byte| value << 8 | u32::from(*byte));
            objects.set(mapped.index, mapped.sub, value as i32);
            data = rest;
        }
    }

    /// Collects process data from the objects; returns its length.
    pub(super) fn pack(&self, objects: &Objects, data: &mut [u8; MAX_PROCESS_DATA]) -> usize {
        let mut at = 0;
        for mapped in self.active() {
            let length = usize::from(mapped.bits / 8);
            let value = objects
                .find(mapped.index, mapped.sub)
                .map_or(0, |entry: &ObjectEntry| entry.value)
                .to_le_bytes();
            if let (Some(place), Some(bytes)) = (data.get_mut(at..at + length), value.get(..length))
            {
                place.copy_from_slice(bytes);
            }
            at += length;
        }
        at
    }
}

/// Refuses a value of another length.
const fn expect_length(bytes: &[u8], length: usize) -> Result<(), u32> {
    if bytes.len() == length {
        Ok(())
    } else {
        Err(abort::LENGTH)
    }
}
