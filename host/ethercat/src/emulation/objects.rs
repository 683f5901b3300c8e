//! Object dictionary of an emulated drive.

/// Abort codes of SDO transfers; ETG1000.6.
pub(super) mod abort {
    pub(in super::super) const COMMAND: u32 = 0x0504_0001;
    pub(in super::super) const UNSUPPORTED: u32 = 0x0601_0000;
    pub(in super::super) const READ_ONLY: u32 = 0x0601_0002;
    pub(in super::super) const NO_COMPLETE_ACCESS: u32 = 0x0601_0004;
    pub(in super::super) const NO_OBJECT: u32 = 0x0602_0000;
    pub(in super::super) const NOT_MAPPABLE: u32 = 0x0604_0041;
    pub(in super::super) const PDO_TOO_LONG: u32 = 0x0604_0042;
    pub(in super::super) const LENGTH: u32 = 0x0607_0010;
    pub(in super::super) const NO_SUBINDEX: u32 = 0x0609_0011;
    pub(in super::super) const RANGE: u32 = 0x0609_0030;
    pub(in super::super) const STATE: u32 = 0x0800_0022;
}

/// Direction in which an object may be mapped into process data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Mappable {
    No,
    Output,
    Input,
}

/// One entry of the dictionary: at most four bytes.
#[derive(Clone, Copy, Debug)]
pub(super) struct ObjectEntry {
    pub(super) index: u16,
    pub(super) sub: u8,
    pub(super) bits: u8,
    pub(super) writable: bool,
    pub(super) mappable: Mappable,
    pub(super) value: u32,
}

impl ObjectEntry {
    /// Returns the value, sign extended.
    pub(super) fn signed(&self) -> i32 {
        let unused = 32 - u32::from(self.bits.clamp(1, 32));
        (self.value << unused) as i32 >> unused
    }

    fn bytes(&self) -> usize {
        usize::from(self.bits / 8)
    }
}

/// The dictionary: at most a hundred entries, searched in order.
#[derive(Clone, Debug)]
pub(super) struct Objects(Vec<ObjectEntry>);

impl Objects {
    pub(super) fn new(entries: Vec<ObjectEntry>) -> Self {
        Self(entries)
    }

    pub(super) fn find(&self, index: u16, sub: u8) -> Option<&ObjectEntry> {
        self.0
            .iter()
            .find(|entry| entry.index == index && entry.sub == sub)
    }

    fn find_mut(&mut self, index: u16, sub: u8) -> Option<&mut ObjectEntry> {
        self.0
            .iter_mut()
            .find(|entry| entry.index == index && entry.sub == sub)
    }

    /// Returns an object's value, or 0 where it is missing.
    pub(super) fn get(&self, index: u16, sub: u8) -> i32 {
        self.find(index, sub).map_or(0, ObjectEntry::signed)
    }

    pub(super) fn has(&self, index: u16) -> bool {
        self.0.iter().any(|entry| entry.index == index)
    }

    /// Sets a value from inside the drive.
    pub(super) fn set(&mut self, index: u16, sub: u8, value: i32) {
        if let Some(entry) = self.find_mut(index, sub) {
            entry.value = value as u32;
        }
    }

    pub(super) fn extend(&mut self, entries: Vec<ObjectEntry>) {
        self.0.extend(entries);
    }

    pub(super) fn remove(&mut self, index: u16) {
        self.0.retain(|entry| entry.index != index);
    }

    /// Returns the bytes of an entry.
    pub(super) fn upload(&self, index: u16, sub: u8) -> Result<([u8; 4], usize), u32> {
        let missing = if self.has(index) {
            abort::NO_SUBINDEX
        } else {
            abort::NO_OBJECT
        };
        let entry = self.find(index, sub).ok_or(missing)?;
        Ok((entry.value.to_le_bytes(), entry.bytes()))
    }

    /// Takes the bytes of an entry, if their number is right and the entry may be written.
    pub(super) fn download(&mut self, index: u16, sub: u8, bytes: &[u8]) -> Result<(), u32> {
        let missing = if self.has(index) {
            abort::NO_SUBINDEX
        } else {
            abort::NO_OBJECT
        };
        let entry = self.find_mut(index, sub).ok_or(missing)?;
        if !entry.writable {
            return Err(abort::READ_ONLY);
        }
        if bytes.len() != entry.bytes() {
            return Err(abort::LENGTH);
        }
        entry.value = bytes
            .iter()
            .rev()
            .fold(0, |value, byte| value << 8 | u32::from(*byte));
        Ok(())
    }
}

/// Entries that every drive of this emulation has: index, sub-index, bits, writable, value.
pub(super) fn entries(rows: &[(u16, u8, u8, bool, Mappable, i64)]) -> Vec<ObjectEntry> {
    let entry =
        |&(index, sub, bits, writable, mappable, value): &(u16, u8, u8, bool, Mappable, i64)| {
            ObjectEntry {
                index,
                sub,
                bits,
                writable,
                mappable,
                value: value as u32,
            }
        };
    rows.iter().map(entry).collect()
}
