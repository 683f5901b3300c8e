//! Value of a sample: bytes that were checked against a type.

use crate::cursor::Reader;
use crate::error::{ErrorKind, Malformed};
use crate::sample::Field;
use crate::ty::Type;
use crate::walk::Walk;

/// Value and its type.
#[derive(Clone, Copy, Debug)]
pub struct Value<'t, 'v> {
    ty: Type<'t>,
    bytes: &'v [u8],
}

impl<'t, 'v> Value<'t, 'v> {
    pub(crate) const fn new(ty: Type<'t>, bytes: &'v [u8]) -> Self {
        Self { ty, bytes }
    }

    /// Type.
    #[must_use]
    pub const fn ty(&self) -> Type<'t> {
        self.ty
    }

    /// Bytes, without index and length.
    #[must_use]
    pub const fn bytes(&self) -> &'v [u8] {
        self.bytes
    }

    /// Walk over the value.
    #[must_use]
    pub const fn walk(&self) -> Walk<'t, 'v> {
        Walk::new(&self.ty, self.bytes)
    }

    /// Reads the value as a type known at compile time. [`Definition::is`](crate::Definition::is)
    /// tells if it is one.
    ///
    /// # Errors
    /// The value is of another type and has another length, or exceeds a limit of that type.
    pub fn read<T: Field>(&self) -> Result<T, ErrorKind> {
        let mut reader = Reader::new(self.ty.version(), self.bytes);
        let value = T::read(&mut reader)?;
        if reader.rest().is_empty() {
            Ok(value)
        } else {
            Err(Malformed::PacketLength.into())
        }
    }
}
