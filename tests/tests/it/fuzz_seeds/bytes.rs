//! From a value to the bytes that `arbitrary` makes it of. Its format may change, so every seed is
//! read back and compared.

use std::fmt::Debug;

use arbitrary::Arbitrary;
use gantry_tau_tests::fuzzed::input;

/// Writes itself as `arbitrary` reads it.
pub(crate) trait Put {
    fn put(&self, bytes: &mut Vec<u8>);
}

/// The bytes of a seed, which mean what they shall.
pub(crate) fn bytes_of<T>(value: &T) -> Vec<u8>
where
    T: Put + PartialEq + Debug + for<'a> Arbitrary<'a>,
{
    let mut bytes = Vec::new();
    value.put(&mut bytes);
    // NaN differs from itself, and is written the same.
    let read = format!("{:?}", input::<T>(&bytes));
    assert_eq!(read, format!("{:?}", Some(value)), "a seed is read back");
    bytes
}

macro_rules! numbers {
    ($($number:ty),*) => {$(
        impl Put for $number {
            fn put(&self, bytes: &mut Vec<u8>) {
                bytes.extend_from_slice(&self.to_le_bytes());
            }
        }
    )*};
}
numbers!(u8, u16, u32, i8, i16, i32, i64, f64);

/// Each field after the other.
macro_rules! fields {
    ($type:ty: $($field:ident),*) => {
        impl crate::fuzz_seeds::bytes::Put for $type {
            fn put(&self, bytes: &mut Vec<u8>) {
                $(self.$field.put(bytes);)*
            }
        }
    };
}

/// An enum as the number of its variant out of `$count`, and its fields one after the other.
macro_rules! variants {
    ($type:ty, $count:literal: $($number:literal => $variant:ident $({$($field:ident),*})? $(($($value:ident),*))?;)*) => {
        impl crate::fuzz_seeds::bytes::Put for $type {
            fn put(&self, bytes: &mut Vec<u8>) {
                match self {$(
                    Self::$variant $({$($field),*})? $(($($value),*))? => {
                        crate::fuzz_seeds::bytes::put_variant($number, $count, bytes);
                        $($($field.put(bytes);)*)?
                        $($($value.put(bytes);)*)?
                    }
                )*}
            }
        }
    };
}

/// Seeds by name.
macro_rules! seeds {
    ($($name:literal => $value:expr;)*) => {
        vec![$(($name.to_owned(), crate::fuzz_seeds::bytes::bytes_of(&$value))),*]
    };
}
pub(crate) use {fields, seeds, variants};

impl Put for bool {
    fn put(&self, bytes: &mut Vec<u8>) {
        bytes.push(u8::from(*self));
    }
}

impl<T: Put> Put for Option<T> {
    fn put(&self, bytes: &mut Vec<u8>) {
        self.is_some().put(bytes);
        if let Some(value) = self {
            value.put(bytes);
        }
    }
}

impl<T: Put, const K: usize> Put for [T; K] {
    fn put(&self, bytes: &mut Vec<u8>) {
        self.iter().for_each(|value| value.put(bytes));
    }
}

/// Before each element, that there is one.
impl<T: Put> Put for Vec<T> {
    fn put(&self, bytes: &mut Vec<u8>) {
        for value in self {
            true.put(bytes);
            value.put(bytes);
        }
    }
}

/// Writes one of `count` variants as the number whose share of all numbers it is.
pub(crate) fn put_variant(number: u32, count: u32, bytes: &mut Vec<u8>) {
    let share = (u64::from(number) << 32).div_ceil(count.into());
    u32::try_from(share).unwrap().put(bytes);
}
