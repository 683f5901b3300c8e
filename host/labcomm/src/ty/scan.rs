//! Check of a type's bytes, front to back, and what every value of the type takes.

use crate::cursor::Reader;
use crate::error::{ErrorKind, Limit, Malformed};
use crate::number::Version;

/// Largest number of bytes of a type.
pub const MAX_TYPE: usize = 2048;
/// Largest number of arrays and structures within each other.
pub const MAX_DEPTH: usize = 16;
/// Largest number of fields in all structures of a type.
pub const MAX_FIELDS: u32 = 256;
/// Largest number of bytes of a value: 16 MiB. A type whose smallest value is larger is refused.
pub const MAX_VALUE: u32 = 1 << 24;

/// Code of an array in a type.
pub const ARRAY: u32 = 0x10;
/// Code of a structure in a type.
pub const STRUCTURE: u32 = 0x11;

/// Type of a value that has no parts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub enum Primitive {
    /// One byte; 0 is false.
    Boolean,
    /// Unsigned, 1 byte.
    Byte,
    /// Two's complement, 2 bytes.
    Short,
    /// Two's complement, 4 bytes.
    Int,
    /// Two's complement, 8 bytes.
    Long,
    /// IEEE 754, 4 bytes.
    Float,
    /// IEEE 754, 8 bytes.
    Double,
    /// A text: number of bytes, bytes.
    String,
    /// Index of a sample type, or 0; 4 bytes. 2014 only.
    Reference,
}

impl Primitive {
    /// Primitive of a code.
    ///
    /// # Errors
    /// `TypeCode`; in 2006 also for a reference.
    pub fn from_code(version: Version, code: u32) -> Result<Self, ErrorKind> {
        Ok(match code {
            0x20 => Self::Boolean,
            0x21 => Self::Byte,
            0x22 => Self::Short,
            0x23 => Self::Int,
            0x24 => Self::Long,
            0x25 => Self::Float,
            0x26 => Self::Double,
            0x27 => Self::String,
            0x28 if version.is_packed() => Self::Reference,
            _ => return Err(Malformed::TypeCode(code).into()),
        })
    }

    /// Code in a type.
    #[must_use]
    pub const fn code(self) -> u32 {
        match self {
            Self::Boolean => 0x20,
            Self::Byte => 0x21,
            Self::Short => 0x22,
            Self::Int => 0x23,
            Self::Long => 0x24,
            Self::Float => 0x25,
            Self::Double => 0x26,
            Self::String => 0x27,
            Self::Reference => 0x28,
        }
    }

    /// Name in the language, as in `int`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Boolean => "boolean",
            Self::Byte => "byte",
            Self::Short => "short",
            Self::Int => "int",
            Self::Long => "long",
            Self::Float => "float",
            Self::Double => "double",
            Self::String => "string",
            Self::Reference => "sample",
        }
    }

    /// Bytes of a value.
    const fn extent(self, version: Version) -> Extent {
        let smallest = match self {
            Self::Boolean | Self::Byte => 1,
            Self::Short => 2,
            Self::Int | Self::Float | Self::Reference => 4,
            Self::Long | Self::Double => 8,
            Self::String => smallest_number(version),
        };
        Extent {
            smallest,
            fixed: !matches!(self, Self::String),
        }
    }
}

/// Bytes of the shortest number.
const fn smallest_number(version: Version) -> u32 {
    if version.is_packed() { 1 } else { 4 }
}

/// Bytes that the values of a type take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Extent {
    /// Bytes of the smallest value, at most [`MAX_VALUE`].
    pub smallest: u32,
    /// True if every value takes as many.
    pub fixed: bool,
}

/// Checks the type at the front of `bytes`; returns the bytes that its values take, and its own
/// length in bytes.
pub fn scan(version: Version, bytes: &[u8]) -> Result<(Extent, usize), ErrorKind> {
    let window = bytes.get(..MAX_TYPE).unwrap_or(bytes);
    let mut scan = Scan {
        reader: Reader::new(version, window),
        place: ScanPlace::START,
    };
    // Each step takes a byte or leaves a level that took one.
    for _ in 0..=window.len().saturating_mul(2) {
        match scan.step() {
            Ok(None) => {}
            Ok(Some(extent)) => {
                return Ok((
                    extent,
                    window.len().saturating_sub(scan.reader.rest().len()),
                ));
            }
            Err(ErrorKind::Incomplete) if bytes.len() > MAX_TYPE => {
                return Err(Limit::TypeBytes.into());
            }
            Err(error) => return Err(error),
        }
    }
    Err(ErrorKind::Incomplete)
}

/// Array or structure around the place of a scan.
#[derive(Clone, Copy, Debug)]
#[cfg_attr(kani, derive(kani::Arbitrary))]
struct Level {
    is_array: bool,
    /// Types that are still to come in it.
    left: u32,
    /// Bytes of what has come.
    sum: Extent,
    /// Fixed sizes of an array, multiplied.
    times: u32,
    /// Bytes of the variable sizes of an array.
    sizes: u32,
}

impl Level {
    const NONE: Self = Self {
        is_array: false,
        left: 0,
        sum: Extent {
            smallest: 0,
            fixed: true,
        },
        times: 1,
        sizes: 0,
    };

    /// True if the counted bytes are within the limits.
    const fn is_within_limits(&self) -> bool {
        self.sum.smallest <= MAX_VALUE && self.times <= MAX_VALUE
    }

    /// Bytes of an array or structure that is complete.
    fn extent(&self) -> Result<Extent, ErrorKind> {
        if !self.is_array {
            return Ok(self.sum);
        } else if self.sum.smallest == 0 {
            return Err(Malformed::EmptyElement.into());
        } else if self.sizes > 0 {
            return Ok(Extent {
                smallest: at_most_a_value(self.sizes.into()).ok_or(Limit::Value)?,
                fixed: false,
            });
        }
        Ok(Extent {
            smallest: product(self.sum.smallest, self.times).ok_or(Limit::Value)?,
            fixed: self.sum.fixed,
        })
    }
}

/// Bytes of a value, if they are not too many.
fn at_most_a_value(bytes: u64) -> Option<u32> {
    u32::try_from(bytes)
        .ok()
        .filter(|bytes| *bytes <= MAX_VALUE)
}

/// Product of two numbers, if it is at most [`MAX_VALUE`]: every number of bytes or elements is
/// one.
pub fn product(one: u32, other: u32) -> Option<u32> {
    at_most_a_value(u64::from(one).saturating_mul(u64::from(other)))
}

/// Next thing that a scan finds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(kani, derive(kani::Arbitrary))]
enum Next {
    Type,
    /// Sizes of this many indices.
    Sizes(u32),
    Name,
    /// End of an array or structure.
    Up,
}

/// Place of a scan.
#[derive(Clone, Copy, Debug)]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct ScanPlace {
    levels: [Level; MAX_DEPTH],
    depth: usize,
    fields: u32,
    next: Next,
}

impl ScanPlace {
    /// Before a type.
    const START: Self = Self {
        levels: [Level::NONE; MAX_DEPTH],
        depth: 0,
        fields: 0,
        next: Next::Type,
    };

    /// The invariant: the stack is not overfull; an end is that of a level; counted fields and
    /// bytes are within the limits.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        let mut levels = self.levels.iter().enumerate();
        self.fields <= MAX_FIELDS
            && (self.depth > 0 || self.next == Next::Type)
            && self.depth <= MAX_DEPTH
            && levels.all(|(depth, level)| depth >= self.depth || level.is_within_limits())
    }

    /// Number of arrays and structures around the place.
    #[must_use]
    pub const fn depth(&self) -> usize {
        self.depth
    }
}

/// Scan of one type.
#[derive(Clone, Debug)]
pub struct Scan<'a> {
    reader: Reader<'a>,
    place: ScanPlace,
}

impl<'a> Scan<'a> {
    /// Scan at a place, if it is a valid one, with the bytes that follow.
    #[must_use]
    pub fn from_parts(version: Version, bytes: &'a [u8], place: ScanPlace) -> Option<Self> {
        place.is_valid().then_some(Self {
            reader: Reader::new(version, bytes),
            place,
        })
    }

    /// Place in the type.
    #[must_use]
    pub const fn place(&self) -> &ScanPlace {
        &self.place
    }

    /// Bytes that are left.
    #[must_use]
    pub const fn rest(&self) -> &'a [u8] {
        self.reader.rest()
    }

    /// One number or name further, or one level up; returns the bytes of the values when the type
    /// is complete.
    ///
    /// # Errors
    /// `Incomplete`, malformed, or beyond a limit.
    pub fn step(&mut self) -> Result<Option<Extent>, ErrorKind> {
        match self.place.next {
            Next::Type => match self.reader.number()? {
                ARRAY => self.enter_array(),
                STRUCTURE => self.enter_structure(),
                code => {
                    let version = self.reader.version();
                    self.complete(Primitive::from_code(version, code)?.extent(version))
                }
            },
            Next::Sizes(left) => self.size(left),
            Next::Name => {
                self.reader.text(MAX_TYPE, Limit::TypeBytes)?;
                self.place.next = Next::Type;
                Ok(None)
            }
            Next::Up => {
                self.place.depth = self.place.depth.saturating_sub(1);
                let extent = self
                    .place
                    .levels
                    .get(self.place.depth)
                    .unwrap_or(&Level::NONE)
                    .extent()?;
                self.complete(extent)
            }
        }
    }

    fn enter_array(&mut self) -> Result<Option<Extent>, ErrorKind> {
        let indices = self.reader.number()?;
        self.enter(Level {
            is_array: true,
            left: 1,
            ..Level::NONE
        })?;
        self.place.next = if indices == 0 {
            Next::Type
        } else {
            Next::Sizes(indices)
        };
        Ok(None)
    }

    fn enter_structure(&mut self) -> Result<Option<Extent>, ErrorKind> {
        let fields = self.reader.number()?;
        let counted = self.place.fields.saturating_add(fields);
        if counted > MAX_FIELDS {
            return Err(Limit::Fields.into());
        }
        self.place.fields = counted;
        self.enter(Level {
            left: fields,
            ..Level::NONE
        })?;
        self.place.next = if fields == 0 { Next::Up } else { Next::Name };
        Ok(None)
    }

    fn enter(&mut self, level: Level) -> Result<(), ErrorKind> {
        *self
            .place
            .levels
            .get_mut(self.place.depth)
            .ok_or(Limit::Depth)? = level;
        self.place.depth = self.place.depth.saturating_add(1);
        Ok(())
    }

    fn size(&mut self, left: u32) -> Result<Option<Extent>, ErrorKind> {
        let version = self.reader.version();
        let size = self.reader.number()?;
        if let Some(level) = self.top() {
            if size == 0 {
                level.sizes = level.sizes.saturating_add(smallest_number(version));
            } else {
                level.times = product(level.times, size).ok_or(Limit::Value)?;
            }
        }
        self.place.next = if left > 1 {
            Next::Sizes(left.saturating_sub(1))
        } else {
            Next::Type
        };
        Ok(None)
    }

    /// A type within the level is complete, or the whole type.
    fn complete(&mut self, extent: Extent) -> Result<Option<Extent>, ErrorKind> {
        let Some(level) = self.top() else {
            self.place.next = Next::Type;
            return Ok(Some(extent));
        };
        let smallest = u64::from(level.sum.smallest).saturating_add(u64::from(extent.smallest));
        let smallest = at_most_a_value(smallest).ok_or(Limit::Value)?;
        level.sum = Extent {
            smallest,
            fixed: level.sum.fixed && extent.fixed,
        };
        level.left = level.left.saturating_sub(1);
        self.place.next = if level.left > 0 { Next::Name } else { Next::Up };
        Ok(None)
    }

    fn top(&mut self) -> Option<&mut Level> {
        self.place.levels.get_mut(self.place.depth.checked_sub(1)?)
    }
}
