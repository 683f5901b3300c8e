//! View of a type's bytes: checked once, then total accessors.

pub(crate) mod scan;

use crate::cursor::Reader;
use crate::error::{ErrorKind, Malformed};
use crate::number::Version;

use scan::{ARRAY, Extent, Primitive, STRUCTURE, scan};

/// Type: a view of its bytes, which were checked.
#[derive(Clone, Copy, Debug)]
pub struct Type<'a> {
    bytes: &'a [u8],
    version: Version,
    extent: Extent,
}

/// Kind of a type, with its parts.
#[derive(Clone, Copy, Debug)]
pub enum Kind<'a> {
    /// A value without parts.
    Primitive(Primitive),
    /// An array.
    Array(Array<'a>),
    /// A structure.
    Structure(Structure<'a>),
}

impl<'a> Type<'a> {
    /// Type at the front of bytes, and its length in bytes.
    ///
    /// # Errors
    /// `Incomplete`, malformed, or beyond one of the limits [`MAX_TYPE`](crate::MAX_TYPE),
    /// [`MAX_DEPTH`](crate::MAX_DEPTH), [`MAX_FIELDS`](crate::MAX_FIELDS),
    /// [`MAX_VALUE`](crate::MAX_VALUE).
    pub fn parse(version: Version, bytes: &'a [u8]) -> Result<(Self, usize), ErrorKind> {
        let (extent, length) = scan(version, bytes)?;
        let bytes = bytes.get(..length).unwrap_or_default();
        Ok((
            Self {
                bytes,
                version,
                extent,
            },
            length,
        ))
    }

    /// Type that is all of these bytes.
    ///
    /// # Errors
    /// Those of [`Type::parse`], or `PacketLength` if bytes are left.
    pub fn whole(version: Version, bytes: &'a [u8]) -> Result<Self, ErrorKind> {
        let (ty, length) = Self::parse(version, bytes)?;
        if length == bytes.len() {
            Ok(ty)
        } else {
            Err(Malformed::PacketLength.into())
        }
    }

    /// View of bytes that were checked before.
    pub(crate) const fn checked(version: Version, bytes: &'a [u8], extent: Extent) -> Self {
        Self {
            bytes,
            version,
            extent,
        }
    }

    pub(crate) const fn extent(&self) -> Extent {
        self.extent
    }

    /// Bytes of the type, as in a definition.
    #[must_use]
    pub const fn bytes(&self) -> &'a [u8] {
        self.bytes
    }

    /// Version of the numbers in it.
    #[must_use]
    pub const fn version(&self) -> Version {
        self.version
    }

    /// Bytes of every value, if all have as many.
    #[must_use]
    pub fn fixed_size(&self) -> Option<usize> {
        self.extent.fixed.then_some(self.smallest_size())
    }

    /// Bytes of the smallest value.
    #[must_use]
    pub fn smallest_size(&self) -> usize {
        crate::cursor::to_usize(self.extent.smallest)
    }

    /// Kind, with its parts.
    #[must_use]
    pub fn kind(&self) -> Kind<'a> {
        let mut reader = Reader::new(self.version, self.bytes);
        let code = reader.number().unwrap_or_default();
        let left = match code {
            ARRAY | STRUCTURE => reader.number().unwrap_or_default(),
            _ => 0,
        };
        match code {
            ARRAY => Kind::Array(Array { reader, left }),
            STRUCTURE => Kind::Structure(Structure { reader, left }),
            // A checked type is nothing else.
            _ => {
                Kind::Primitive(Primitive::from_code(self.version, code).unwrap_or(Primitive::Byte))
            }
        }
    }
}

/// Array type.
#[derive(Clone, Copy, Debug)]
pub struct Array<'a> {
    reader: Reader<'a>,
    left: u32,
}

impl<'a> Array<'a> {
    /// Size of each index; 0 where every value states its own.
    #[must_use]
    pub const fn indices(&self) -> Indices<'a> {
        Indices {
            reader: self.reader,
            left: self.left,
        }
    }

    /// Type of an element.
    #[must_use]
    pub fn element(&self) -> Type<'a> {
        let mut indices = self.indices();
        indices.by_ref().for_each(drop);
        next_type(&mut indices.reader)
    }
}

/// Sizes of an array's indices.
#[derive(Clone, Debug)]
pub struct Indices<'a> {
    reader: Reader<'a>,
    left: u32,
}

impl Iterator for Indices<'_> {
    type Item = u32;

    fn next(&mut self) -> Option<u32> {
        self.left = self.left.checked_sub(1)?;
        self.reader.number().ok()
    }
}

/// Structure type.
#[derive(Clone, Copy, Debug)]
pub struct Structure<'a> {
    reader: Reader<'a>,
    left: u32,
}

impl<'a> Structure<'a> {
    /// Name and type of each field.
    #[must_use]
    pub const fn fields(&self) -> Fields<'a> {
        Fields {
            reader: self.reader,
            left: self.left,
        }
    }
}

/// Names and types of a structure's fields.
#[derive(Clone, Debug)]
pub struct Fields<'a> {
    reader: Reader<'a>,
    left: u32,
}

impl<'a> Iterator for Fields<'a> {
    type Item = (&'a [u8], Type<'a>);

    fn next(&mut self) -> Option<Self::Item> {
        self.left = self.left.checked_sub(1)?;
        let name = self
            .reader
            .text(crate::MAX_TYPE, crate::Limit::TypeBytes)
            .ok()?;
        Some((name, next_type(&mut self.reader)))
    }
}

/// Takes a type that was checked as a part of another.
fn next_type<'a>(reader: &mut Reader<'a>) -> Type<'a> {
    let version = reader.version();
    let parsed = Type::parse(version, reader.rest());
    let (ty, length) = parsed.unwrap_or((
        Type::checked(
            version,
            &[],
            Extent {
                smallest: 0,
                fixed: true,
            },
        ),
        reader.rest().len(),
    ));
    let _ = reader.read_exact(length);
    ty
}
