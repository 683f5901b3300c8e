//! Pointers that come from C, and objects in the caller's memory.
//!
//! What is promised of every pointer stands at the head of the header. Here null and misaligned ones are refused, structs are copied
//! in and out, so that no reference to the caller's structs is ever held, and objects carry a tag that tells what they are.

use core::ffi::c_void;
use core::ptr::NonNull;

use crate::code::gt_code;
use crate::error::{count, gt_error};

/// Alignment that is enough for every object on every target; what malloc gives, and GT_MEMORY.
pub const GT_ALIGN: usize = 16;

/// What a call leads to.
pub(crate) type Reply<T = ()> = Result<T, gt_error>;

/// The end of a call: its code, and the whole error where it is wanted.
///
/// # Safety
/// `error` is null, or points to a place for a `gt_error`.
pub(crate) unsafe fn reply(error: *mut gt_error, result: Reply) -> gt_code {
    let answer = result.err().unwrap_or(gt_error::OK);
    // SAFETY: the caller's promise.
    if let Ok(place) = unsafe { place(error) } {
        place.put(answer);
    }
    answer.code
}

fn checked<T>(pointer: *const T) -> Reply<NonNull<T>> {
    let pointer = NonNull::new(pointer.cast_mut()).ok_or(gt_code::NullPointer)?;
    if pointer.is_aligned() {
        Ok(pointer)
    } else {
        Err(gt_code::Misaligned.into())
    }
}

/// What a pointer points to, copied.
///
/// # Safety
/// `pointer` is null, or misaligned, or points to a `T`.
pub(crate) unsafe fn read<T: Copy>(pointer: *const T) -> Reply<T> {
    let pointer = checked(pointer)?;
    // SAFETY: neither null nor misaligned, so it points to a `T`.
    Ok(unsafe { pointer.read() })
}

/// As [`read`], where null means that there is nothing.
///
/// # Safety
/// As [`read`].
pub(crate) unsafe fn read_some<T: Copy>(pointer: *const T) -> Reply<Option<T>> {
    if pointer.is_null() {
        return Ok(None);
    }
    // SAFETY: the caller's promise.
    unsafe { read(pointer) }.map(Some)
}

/// `N` numbers.
///
/// # Safety
/// As [`read`], for `[f64; N]`.
pub(crate) unsafe fn numbers<const N: usize>(pointer: *const f64) -> Reply<[f64; N]> {
    // SAFETY: the caller's promise.
    unsafe { read(pointer.cast()) }
}

/// Bytes, for as long as the call lasts. Null will do where there are none.
///
/// # Safety
/// `pointer` is null or points to `length` bytes that nobody writes to before the call is over.
pub(crate) unsafe fn bytes<'a>(pointer: *const u8, length: usize) -> Reply<&'a [u8]> {
    if length == 0 {
        return Ok(&[]);
    }
    let pointer = checked(pointer)?;
    check_length(length)?;
    // SAFETY: not null, and no longer than an object can be.
    Ok(unsafe { core::slice::from_raw_parts(pointer.as_ptr(), length) })
}

/// A buffer of the caller, for as long as the call lasts. Null will do where it has no length.
///
/// # Safety
/// `pointer` is null or points to `length` initialised bytes that nobody else touches before the call is over.
pub(crate) unsafe fn buffer<'a>(pointer: *mut u8, length: usize) -> Reply<&'a mut [u8]> {
    if length == 0 {
        return Ok(&mut []);
    }
    let pointer = checked(pointer)?;
    check_length(length)?;
    // SAFETY: not null, and no longer than an object can be.
    Ok(unsafe { core::slice::from_raw_parts_mut(pointer.as_ptr(), length) })
}

fn check_length(length: usize) -> Reply {
    isize::try_from(length).map_err(|_| gt_code::Length)?;
    Ok(())
}

/// A place of the caller for an answer.
pub(crate) struct Place<T>(NonNull<T>);

/// The place that a pointer points to. It is looked for before anything is done, so that a call that cannot answer changes nothing.
///
/// # Safety
/// `pointer` is null, or misaligned, or points to a place for a `T` that is there until the call is over.
pub(crate) unsafe fn place<T>(pointer: *mut T) -> Reply<Place<T>> {
    checked(pointer).map(Place)
}

impl<T> Place<T> {
    /// Puts the answer there.
    pub(crate) fn put(self, answer: T) {
        // SAFETY: it was promised where the place was made, and it is used up.
        unsafe { self.0.write(answer) };
    }
}

/// What a handle of C stands for.
pub(crate) trait Object: Sized {
    /// The type that C knows.
    type Handle;
    /// Bytes that the header asks for.
    const BYTES: usize;
    /// Tells it from other objects, and from memory that is none.
    const TAG: u64;
}

/// A tag of eight letters; its lowest byte is a small number that tells variants of one kind apart.
pub(crate) const fn tag(letters: &[u8; 7], variant: u8) -> u64 {
    let [a, b, c, d, e, f, g] = *letters;
    u64::from_le_bytes([variant, a, b, c, d, e, f, g])
}

/// An object in the caller's memory.
#[repr(C)]
pub(crate) struct Tagged<T> {
    tag: u64,
    object: T,
}

/// Bytes that an object needs.
pub(crate) const fn size_of<T>() -> usize {
    core::mem::size_of::<Tagged<T>>()
}

/// Whether the bytes that the header asks for are enough for an object, and [`GT_ALIGN`] for its alignment.
const fn fits<T: Object>() -> bool {
    size_of::<T>() <= T::BYTES && align_of::<Tagged<T>>() <= GT_ALIGN
}

/// Makes an object in memory of the caller.
///
/// # Safety
/// `memory` is null or points to `size` bytes that are the object's from here on, and nobody else's.
pub(crate) unsafe fn settle<T: Object>(
    memory: *mut c_void,
    size: usize,
    make: impl FnOnce() -> Reply<T>,
) -> Reply<*mut T::Handle> {
    // SAFETY: the caller's promise; the place is one for a `T`.
    unsafe {
        settle_in_parts(memory, size, make, |object, place: *mut T| {
            place.write(object)
        })
    }
}

/// Makes an object in memory of the caller: `parts` may refuse, `write` writes every field of the object to the place it is given.
///
/// # Safety
/// As [`settle`]; after `write` the object is whole.
#[inline(always)]
pub(crate) unsafe fn settle_in_parts<P, T: Object>(
    memory: *mut c_void,
    size: usize,
    parts: impl FnOnce() -> Reply<P>,
    write: impl FnOnce(P, *mut T),
) -> Reply<*mut T::Handle> {
    const { assert!(fits::<T>(), "the header asks for enough, on this target") };
    let memory = checked(memory.cast::<Tagged<T>>())?;
    if size < size_of::<T>() {
        return Err(gt_error::new(gt_code::MemoryTooSmall).value(count(size_of::<T>())));
    }
    let memory = memory.as_ptr();
    // SAFETY: the memory is large enough and aligned. Where a part is refused, it holds no object, whatever it held before.
    unsafe {
        (&raw mut (*memory).tag).write(0);
        write(parts()?, &raw mut (*memory).object);
        (&raw mut (*memory).tag).write(T::TAG);
    }
    Ok(memory.cast())
}

/// The tag of what a handle points to.
///
/// # Safety
/// `handle` is null, or misaligned, or points to 8 bytes that can be read.
pub(crate) unsafe fn tag_of<H>(handle: *const H) -> Reply<u64> {
    // SAFETY: the caller's promise.
    unsafe { read(handle.cast()) }
}

/// The object of a handle, to look at.
///
/// # Safety
/// As [`tag_of`]; an object with this tag was made by [`settle`] and is not written to before the call is over.
pub(crate) unsafe fn object<'a, T: Object>(handle: *const T::Handle) -> Reply<&'a T> {
    // SAFETY: the caller's promise.
    if unsafe { tag_of(handle) }? != T::TAG {
        return Err(gt_code::NoObject.into());
    }
    let tagged = checked(handle.cast::<Tagged<T>>())?;
    // SAFETY: the tag says what it is.
    Ok(unsafe { &tagged.as_ref().object })
}

/// The object of a handle, to change.
///
/// # Safety
/// As [`object`]; nobody else looks at it before the call is over.
pub(crate) unsafe fn object_mut<'a, T: Object>(handle: *mut T::Handle) -> Reply<&'a mut T> {
    // SAFETY: the caller's promise.
    if unsafe { tag_of(handle) }? != T::TAG {
        return Err(gt_code::NoObject.into());
    }
    let mut tagged = checked(handle.cast::<Tagged<T>>())?;
    // SAFETY: the tag says what it is.
    Ok(unsafe { &mut tagged.as_mut().object })
}
