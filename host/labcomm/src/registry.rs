//! Definitions of a stream: index to name and type.

use crate::cursor::to_usize;
use crate::error::{ErrorKind, Limit};
use crate::number::Version;
use crate::ty::Type;
use crate::ty::scan::Extent;
use crate::walk::value_len;

/// Sample type of a stream.
#[derive(Clone, Copy, Debug)]
pub struct Definition<'a> {
    /// Index.
    pub index: u32,
    /// Name, in UTF-8 unless the sender does otherwise.
    pub name: &'a [u8],
    /// Type.
    pub ty: Type<'a>,
}

/// One definition's place in the bytes of a registry.
#[derive(Clone, Copy, Debug)]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub(crate) struct Entry {
    pub(crate) index: u32,
    /// Begin of the name, of the type behind it, and end of that.
    name: usize,
    ty: usize,
    end: usize,
    pub(crate) extent: Extent,
}

impl Entry {
    /// True if name and type lie within the bytes in use.
    const fn is_within(&self, used: usize) -> bool {
        self.name <= self.ty && self.ty <= self.end && self.end <= used
    }
}

/// Up to `S` definitions, in `B` bytes of names and types.
#[derive(Clone, Debug)]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Registry<const S: usize, const B: usize> {
    version: Version,
    entries: [Entry; S],
    /// Number of entries in use.
    count: usize,
    bytes: [u8; B],
    /// Number of bytes in use.
    used: usize,
}

impl<const S: usize, const B: usize> Registry<S, B> {
    /// A registry without definitions, for types of a version.
    #[must_use]
    pub const fn new(version: Version) -> Self {
        let entry = Entry {
            index: 0,
            name: 0,
            ty: 0,
            end: 0,
            extent: Extent {
                smallest: 0,
                fixed: true,
            },
        };
        Self {
            version,
            entries: [entry; S],
            count: 0,
            bytes: [0; B],
            used: 0,
        }
    }

    /// Forgets every definition; those that follow are of a version.
    pub(crate) const fn restart(&mut self, version: Version) {
        self.version = version;
        self.count = 0;
        self.used = 0;
    }

    /// The invariant: entries and bytes in use exist; name and type of each entry lie within the
    /// bytes in use.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        // Counted over all places, as a model checker knows how many those are.
        let mut entries = self.entries.iter().enumerate();
        self.used <= B
            && self.count <= S
            && entries.all(|(place, entry)| place >= self.count || entry.is_within(self.used))
    }

    /// Version of the types.
    #[must_use]
    pub const fn version(&self) -> Version {
        self.version
    }

    /// Number of definitions.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.count
    }

    /// True if nothing is defined.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Definitions, in the order in which they came.
    pub fn iter(&self) -> impl Iterator<Item = Definition<'_>> {
        self.entries
            .iter()
            .take(self.count)
            .filter_map(|entry| self.definition(entry))
    }

    /// Definition of an index.
    #[must_use]
    pub fn get(&self, index: u32) -> Option<Definition<'_>> {
        self.definition(self.entry(index)?)
    }

    /// Entry of an index.
    pub(crate) fn entry(&self, index: u32) -> Option<&Entry> {
        // Encoders number one by one, so most definitions stand where the first index says.
        let guess = to_usize(index.wrapping_sub(self.entries.first()?.index));
        match self.entries.get(guess) {
            Some(entry) if entry.index == index && guess < self.count => Some(entry),
            _ => self
                .entries
                .iter()
                .take(self.count)
                .find(|entry| entry.index == index),
        }
    }

    /// Number of bytes of the value of an entry at the front of bytes. The type is looked at only
    /// where values differ in length.
    ///
    /// # Errors
    /// Those of [`value_len`].
    pub(crate) fn value_len(&self, entry: &Entry, bytes: &[u8]) -> Result<usize, ErrorKind> {
        if entry.extent.fixed {
            return Ok(to_usize(entry.extent.smallest));
        }
        value_len(
            &self.definition(entry).ok_or(ErrorKind::Incomplete)?.ty,
            bytes,
        )
    }

    /// Adds a definition. A second one of the same index, name and type changes nothing.
    ///
    /// # Errors
    /// `Conflict`, or `Limit` if it is full; the registry is then as before.
    pub fn define(&mut self, index: u32, name: &[u8], ty: &Type<'_>) -> Result<(), ErrorKind> {
        if let Some(known) = self.get(index) {
            let same = known.name == name && known.ty.bytes() == ty.bytes();
            return if same {
                Ok(())
            } else {
                Err(ErrorKind::Conflict(index))
            };
        }
        let entry = self.entries.get_mut(self.count).ok_or(Limit::Definitions)?;
        let ty_at = self.used.saturating_add(name.len());
        let end = ty_at.saturating_add(ty.bytes().len());
        let place = self
            .bytes
            .get_mut(self.used..end)
            .ok_or(Limit::DefinitionBytes)?;
        for (place, byte) in place.iter_mut().zip(name.iter().chain(ty.bytes())) {
            *place = *byte;
        }
        *entry = Entry {
            index,
            name: self.used,
            ty: ty_at,
            end,
            extent: ty.extent(),
        };
        self.used = end;
        self.count = self.count.saturating_add(1);
        Ok(())
    }

    /// Definition of an entry.
    pub(crate) fn definition(&self, entry: &Entry) -> Option<Definition<'_>> {
        let name = self.bytes.get(entry.name..entry.ty)?;
        let ty = self.bytes.get(entry.ty..entry.end)?;
        Some(Definition {
            index: entry.index,
            name,
            ty: Type::checked(self.version, ty, entry.extent),
        })
    }
}
