//! Types that are known at compile time: one code each for their type, their bytes and their value.

use crate::cursor::{Comparer, Counter, Reader, Sink, to_number, to_usize};
use crate::error::{ErrorKind, Limit};
use crate::number::Version;
use crate::registry::Definition;
use crate::ty::Type;
use crate::ty::scan::{ARRAY, Primitive};

/// Type of a field, with its values.
pub trait Field: Copy {
    /// Value of zeros.
    const ZERO: Self;

    /// Writes the type.
    fn write_type<K: Sink>(sink: &mut K);

    /// Writes a value.
    fn write<K: Sink>(&self, sink: &mut K);

    /// Reads a value.
    ///
    /// # Errors
    /// `Incomplete`, a malformed number, or a limit of the type.
    fn read(reader: &mut Reader<'_>) -> Result<Self, ErrorKind>;
}

/// Sample type: a type with a name.
pub trait Sample: Field {
    /// Name.
    const NAME: &'static str;
}

impl Definition<'_> {
    /// True if this is the definition of a sample type: name and type are equal, byte by byte.
    #[must_use]
    pub fn is<T: Sample>(&self) -> bool {
        self.name == T::NAME.as_bytes() && self.ty.is::<T>()
    }
}

impl Type<'_> {
    /// True if this is a type known at compile time, byte by byte.
    #[must_use]
    pub fn is<T: Field>(&self) -> bool {
        let mut comparer = Comparer::new(self.version(), self.bytes());
        T::write_type(&mut comparer);
        comparer.is_equal()
    }
}

/// Number of bytes of a type.
#[must_use]
pub fn type_len<T: Field>(version: Version) -> usize {
    let mut counter = Counter::new(version);
    T::write_type(&mut counter);
    counter.count()
}

/// Number of bytes of a value, without index and length.
#[must_use]
pub fn encoded_value_len<T: Field>(version: Version, value: &T) -> usize {
    let mut counter = Counter::new(version);
    value.write(&mut counter);
    counter.count()
}

/// Implements [`Field`] for numbers, which are written by their bits.
macro_rules! primitive {
    ($($ty:ty, $primitive:ident, $zero:literal;)*) => {$(
        impl Field for $ty {
            const ZERO: Self = $zero;

            fn write_type<K: Sink>(sink: &mut K) {
                sink.number(Primitive::$primitive.code());
            }

            #[inline]
            fn write<K: Sink>(&self, sink: &mut K) {
                sink.array(self.to_be_bytes());
            }

            #[inline]
            fn read(reader: &mut Reader<'_>) -> Result<Self, ErrorKind> {
                reader.array().map(Self::from_be_bytes)
            }
        }
    )*};
}

primitive! {
    u8, Byte, 0;
    i16, Short, 0;
    i32, Int, 0;
    i64, Long, 0;
    f32, Float, 0.0;
    f64, Double, 0.0;
}

/// 0 and 1 are written; any byte but 0 is true.
impl Field for bool {
    const ZERO: Self = false;

    fn write_type<K: Sink>(sink: &mut K) {
        sink.number(Primitive::Boolean.code());
    }

    fn write<K: Sink>(&self, sink: &mut K) {
        sink.array([u8::from(*self)]);
    }

    fn read(reader: &mut Reader<'_>) -> Result<Self, ErrorKind> {
        reader.array().map(|[byte]| byte != 0)
    }
}

/// Array of one index of fixed size.
impl<T: Field, const N: usize> Field for [T; N] {
    const ZERO: Self = [const { T::ZERO }; N];

    fn write_type<K: Sink>(sink: &mut K) {
        sink.number(ARRAY);
        sink.number(1);
        sink.number(to_number(N));
        T::write_type(sink);
    }

    #[inline]
    fn write<K: Sink>(&self, sink: &mut K) {
        for element in self {
            element.write(sink);
        }
    }

    #[inline]
    fn read(reader: &mut Reader<'_>) -> Result<Self, ErrorKind> {
        let mut all = Self::ZERO;
        for element in &mut all {
            *element = T::read(reader)?;
        }
        Ok(all)
    }
}

/// Text of at most `N` bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Text<const N: usize> {
    bytes: [u8; N],
    length: usize,
}

impl<const N: usize> Text<N> {
    /// The front of a text that fits, cut between characters.
    #[must_use]
    pub fn cut(text: &str) -> Self {
        let mut length = text.len().min(N);
        while !text.is_char_boundary(length) {
            length = length.saturating_sub(1);
        }
        Self::copy(text.as_bytes().get(..length).unwrap_or_default())
    }

    /// Copies at most `N` bytes.
    fn copy(from: &[u8]) -> Self {
        let mut bytes = [0; N];
        for (place, byte) in bytes.iter_mut().zip(from) {
            *place = *byte;
        }
        Self {
            bytes,
            length: from.len().min(N),
        }
    }

    /// Returns the bytes; peers may send other than UTF-8.
    #[must_use]
    pub fn as_bytes(&self) -> &[u8] {
        self.bytes.get(..self.length).unwrap_or(&self.bytes)
    }
}

impl<const N: usize> Field for Text<N> {
    const ZERO: Self = Self {
        bytes: [0; N],
        length: 0,
    };

    fn write_type<K: Sink>(sink: &mut K) {
        sink.number(Primitive::String.code());
    }

    fn write<K: Sink>(&self, sink: &mut K) {
        sink.text(self.as_bytes());
    }

    fn read(reader: &mut Reader<'_>) -> Result<Self, ErrorKind> {
        let text = reader.text(N.min(to_usize(crate::MAX_VALUE)), Limit::Value)?;
        Ok(Self::copy(text))
    }
}

/// Declares structures whose fields are written in order, and implements [`Field`] for them.
///
/// A structure without braces, `pub struct Data([i32; 3]);`, has the type of what it wraps.
///
/// ```
/// gantry_tau_labcomm::structure! {
///     /// Position of a tool, m.
///     pub struct Tool { pub tick: i64, pub position: [f64; 3] }
/// }
/// impl gantry_tau_labcomm::Sample for Tool {
///     const NAME: &'static str = "tool";
/// }
/// ```
#[macro_export]
macro_rules! structure {
    ($(
        $(#[$meta:meta])*
        pub struct $name:ident $(<const $size:ident: usize>)? {
            $($(#[$field_meta:meta])* pub $field:ident: $ty:ty),* $(,)?
        }
    )*) => {$(
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub struct $name $(<const $size: usize>)? {
            $($(#[$field_meta])* pub $field: $ty,)*
        }

        impl $(<const $size: usize>)? $crate::Field for $name $(<$size>)? {
            const ZERO: Self = Self { $($field: <$ty as $crate::Field>::ZERO),* };

            fn write_type<K: $crate::Sink>(sink: &mut K) {
                sink.number($crate::STRUCTURE);
                let names: &[&str] = &[$(stringify!($field)),*];
                sink.number(u32::try_from(names.len()).unwrap_or(u32::MAX));
                $(
                    sink.text(stringify!($field).as_bytes());
                    <$ty as $crate::Field>::write_type(sink);
                )*
            }

            #[inline]
            fn write<K: $crate::Sink>(&self, sink: &mut K) {
                $($crate::Field::write(&self.$field, sink);)*
            }

            #[inline]
            fn read(reader: &mut $crate::Reader<'_>) -> Result<Self, $crate::ErrorKind> {
                Ok(Self { $($field: $crate::Field::read(reader)?),* })
            }
        }
    )*};
    ($(
        $(#[$meta:meta])*
        pub struct $name:ident(pub $ty:ty);
    )*) => {$(
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub struct $name(pub $ty);

        impl $crate::Field for $name {
            const ZERO: Self = Self(<$ty as $crate::Field>::ZERO);

            fn write_type<K: $crate::Sink>(sink: &mut K) {
                <$ty as $crate::Field>::write_type(sink);
            }

            #[inline]
            fn write<K: $crate::Sink>(&self, sink: &mut K) {
                $crate::Field::write(&self.0, sink);
            }

            #[inline]
            fn read(reader: &mut $crate::Reader<'_>) -> Result<Self, $crate::ErrorKind> {
                $crate::Field::read(reader).map(Self)
            }
        }
    )*};
}
