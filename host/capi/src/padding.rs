//! Padding of results. The bytes of a struct that no field has would otherwise show what was on the
//! library's stack.
//!
//! Each module declares the padding of its own results, beside their types.

/// Type of a result. Every one has this, or its functions do not compile.
pub(crate) trait Padded {
    /// Clears every byte that no field has.
    ///
    /// # Safety
    /// `place` points to a value that may be written to.
    unsafe fn clear(place: *mut Self);
}

/// Declares types without padding.
macro_rules! without_padding {
    ($($type:ty)+) => { $(
        impl $crate::padding::Padded for $type {
            unsafe fn clear(_: *mut Self) {}
        }
    )+ };
}
pub(crate) use without_padding;

without_padding!(u8 u16 u32 u64 usize i16 i32 i64 f64);

impl<T> Padded for *mut T {
    unsafe fn clear(_: *mut Self) {}
}

impl<T: Padded, const N: usize> Padded for [T; N] {
    #[inline(always)]
    unsafe fn clear(place: *mut Self) {
        for index in 0..N {
            // SAFETY: an element of the array.
            unsafe { T::clear(place.cast::<T>().add(index)) };
        }
    }
}

/// Clears the bytes of a struct from `start` to `end`.
///
/// # Safety
/// They belong to it.
#[inline(always)]
pub(crate) unsafe fn clear_gap(place: *mut u8, start: usize, end: usize) {
    // SAFETY: the caller's promise.
    unsafe { place.add(start).write_bytes(0, end.saturating_sub(start)) };
}

pub(crate) const fn size_behind<T>(_: *const T) -> usize {
    size_of::<T>()
}

/// Declares the fields of structs, in their order.
macro_rules! padded {
    ($($type:ident { $($field:ident)+ })+) => { $(
        impl $crate::padding::Padded for $type {
            #[inline(always)]
            unsafe fn clear(place: *mut Self) {
                // Every field has its name here, or this does not compile.
                let _ = |all: Self| {
                    let $type { $($field: _),+ } = all;
                };
                let end = 0;
                $(
                    let start = ::core::mem::offset_of!($type, $field);
                    // SAFETY: a field of the caller's struct, and the gap before it.
                    let end = unsafe {
                        let field = &raw mut (*place).$field;
                        $crate::padding::clear_gap(place.cast(), end, start);
                        $crate::padding::Padded::clear(field);
                        start.saturating_add($crate::padding::size_behind(field))
                    };
                )+
                // SAFETY: the gap behind the last field.
                unsafe { $crate::padding::clear_gap(place.cast(), end, ::core::mem::size_of::<Self>()) };
            }
        }
    )+ };
}
pub(crate) use padded;
