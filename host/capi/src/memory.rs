//! Pointers that come from C, and objects in the caller's memory.
//!
//! The caller's promises about pointers are at the head of the header. Null and misaligned pointers
//! are refused here. Structs are copied in and out: no reference to a struct of the caller is held.
//! Objects carry a tag with their type.

use core::ffi::c_void;
use core::ptr::NonNull;

use crate::code::gt_code;
use crate::error::{count, gt_error};
use crate::padding::Padded;

/// Alignment for every object on every target; that of malloc and GT_MEMORY.
pub const GT_ALIGN: usize = 16;

/// Result of a call.
pub(crate) type Reply<T = ()> = Result<T, gt_error>;

/// Makes a call: returns its code, and writes the details if `error` is not null.
///
/// # Safety
/// As [`put_some`].
#[inline(always)]
pub(crate) unsafe fn reply(error: *mut gt_error, call: impl FnOnce() -> Reply) -> gt_code {
    let answer = call().err().unwrap_or(gt_error::OK);
    // SAFETY: the caller's promise.
    unsafe { put_some(error, answer) };
    answer.code
}

/// As [`reply`], for a call with a result. A call that cannot return its result changes nothing.
///
/// # Safety
/// As [`reply`], for `result` too.
#[inline(always)]
pub(crate) unsafe fn answer<T: Padded>(
    result: *mut T,
    error: *mut gt_error,
    call: impl FnOnce() -> Reply<T>,
) -> gt_code {
    // SAFETY: the caller's promise.
    unsafe {
        reply(error, || {
            let place = checked(result)?;
            place.write(call()?);
            T::clear(place.as_ptr());
            Ok(())
        })
    }
}

/// Refuses null and misaligned pointers. Places for results are checked first, before anything is
/// changed.
pub(crate) fn checked<T>(pointer: *const T) -> Reply<NonNull<T>> {
    let pointer = NonNull::new(pointer.cast_mut()).ok_or(gt_code::NullPointer)?;
    if pointer.is_aligned() {
        Ok(pointer)
    } else {
        Err(gt_code::Misaligned.into())
    }
}

/// Copies a value of the caller.
///
/// # Safety
/// `pointer` is null, or misaligned, or points to a `T`.
pub(crate) unsafe fn read<T: Copy>(pointer: *const T) -> Reply<T> {
    let pointer = checked(pointer)?;
    // SAFETY: neither null nor misaligned, so it points to a `T`.
    Ok(unsafe { pointer.read() })
}

/// As [`read`]; `None` for null.
///
/// # Safety
/// As [`read`].
pub(crate) unsafe fn read_some<T: Copy>(pointer: *const T) -> Reply<Option<T>> {
    if pointer.is_null() {
        Ok(None)
    } else {
        // SAFETY: the caller's promise.
        unsafe { read(pointer) }.map(Some)
    }
}

/// Borrows bytes of the caller for the duration of the call. Null is allowed with length 0.
///
/// # Safety
/// `pointer` is null or points to `length` bytes that are not written to before the call is over.
pub(crate) unsafe fn bytes<'a>(pointer: *const u8, length: usize) -> Reply<&'a [u8]> {
    let start = start(pointer, length)?;
    // SAFETY: not null, and no longer than an object can be.
    Ok(unsafe { core::slice::from_raw_parts(start.as_ptr(), length) })
}

/// Borrows a buffer of the caller for the duration of the call. Null is allowed with length 0.
///
/// # Safety
/// `pointer` is null or points to `length` initialised bytes that are not used otherwise before the
/// call is over.
pub(crate) unsafe fn buffer<'a>(pointer: *mut u8, length: usize) -> Reply<&'a mut [u8]> {
    let start = start(pointer, length)?;
    // SAFETY: not null, and no longer than an object can be.
    Ok(unsafe { core::slice::from_raw_parts_mut(start.as_ptr(), length) })
}

fn start(pointer: *const u8, length: usize) -> Reply<NonNull<u8>> {
    if length == 0 {
        return Ok(NonNull::dangling());
    }
    let pointer = checked(pointer)?;
    isize::try_from(length).map_err(|_| gt_code::Length)?;
    Ok(pointer)
}

/// Writes a result that the caller may not want.
///
/// # Safety
/// `pointer` is null, or misaligned, or points to a place for a `T`.
pub(crate) unsafe fn put_some<T: Padded>(pointer: *mut T, answer: T) {
    if let Ok(place) = checked(pointer) {
        // SAFETY: neither null nor misaligned, so it points to such a place.
        unsafe {
            place.write(answer);
            T::clear(place.as_ptr());
        }
    }
}

/// Object behind a handle of C.
pub(crate) trait Object: Sized {
    /// Type in C.
    type Handle;
    /// Size in the header, bytes.
    const BYTES: usize;
    /// Distinguishes the object from others and from unused memory.
    const TAG: u64;
}

/// Builds a tag of seven letters and, as its lowest byte, a number for variants of a kind.
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

/// Returns the bytes that an object needs.
pub(crate) const fn size_of<T>() -> usize {
    core::mem::size_of::<Tagged<T>>()
}

/// Creates an object in memory of the caller, who receives its handle.
///
/// # Safety
/// As [`settle`] and [`answer`].
#[inline(always)]
pub(crate) unsafe fn create<T: Object>(
    memory: *mut c_void,
    size: usize,
    handle: *mut *mut T::Handle,
    error: *mut gt_error,
    make: impl FnOnce() -> Reply<T>,
) -> gt_code {
    // SAFETY: the caller's promise; the place is one for a `T`.
    unsafe {
        answer(handle, error, || {
            settle(memory, size, make, |object, place: *mut T| {
                place.write(object)
            })
        })
    }
}

/// Creates an object in memory of the caller: `parts` may refuse, `write` writes every field in
/// place.
///
/// # Safety
/// `memory` is null or points to `size` bytes that belong to the object alone from now on; `write`
/// initialises the whole object.
#[inline(always)]
pub(crate) unsafe fn settle<P, T: Object>(
    memory: *mut c_void,
    size: usize,
    parts: impl FnOnce() -> Reply<P>,
    write: impl FnOnce(P, *mut T),
) -> Reply<*mut T::Handle> {
    const {
        assert!(
            size_of::<T>() <= T::BYTES,
            "the size in the header is too small for this target"
        )
    };
    const {
        assert!(
            align_of::<Tagged<T>>() <= GT_ALIGN,
            "the alignment in the header is too small for this target"
        )
    };
    let memory = checked(memory.cast::<Tagged<T>>())?;
    if size < size_of::<T>() {
        return Err(gt_error::new(gt_code::MemoryTooSmall).value(count(size_of::<T>())));
    }
    let memory = memory.as_ptr();
    // SAFETY: the memory is large enough and aligned. A refusal leaves it without an object, even
    // if it held one before.
    unsafe {
        (&raw mut (*memory).tag).write(0);
        write(parts()?, &raw mut (*memory).object);
        (&raw mut (*memory).tag).write(T::TAG);
    }
    Ok(memory.cast())
}

/// Copies an object to other memory of the caller, who receives the handle of the copy.
///
/// # Safety
/// As [`tag_of`] for the handle, of an object that is not written to before the call is over, and as
/// [`settle`] for the memory.
pub(crate) unsafe fn duplicate<T: Object>(
    handle: *const T::Handle,
    memory: *mut c_void,
    size: usize,
) -> Reply<*mut T::Handle> {
    // SAFETY: the caller's promise.
    let from = unsafe { tagged::<T>(handle) }?;
    if from.addr().get().abs_diff(memory.addr()) < size_of::<T>() {
        return Err(gt_code::Overlap.into());
    }
    let write = |from: NonNull<Tagged<T>>, place: *mut T| {
        // SAFETY: a live object, apart from the place for one. Core has no allocation and no
        // pointers, so that its bytes are all of it; objects are never dropped. (As a value half a
        // megabyte would be on the stack.)
        unsafe { (&raw const (*from.as_ptr()).object).copy_to_nonoverlapping(place, 1) }
    };
    // SAFETY: the caller's promise; `write` writes a whole object.
    unsafe { settle(memory, size, || Ok(from), write) }
}

/// Reads the tag behind a handle.
///
/// # Safety
/// `handle` is null, or misaligned, or points to 8 bytes that can be read.
pub(crate) unsafe fn tag_of<H>(handle: *const H) -> Reply<u64> {
    // SAFETY: the caller's promise.
    unsafe { read(handle.cast()) }
}

/// Borrows the object of a handle.
///
/// # Safety
/// As [`tag_of`]; an object with this tag was made by [`settle`] and is not written to before the
/// call is over.
pub(crate) unsafe fn object<'a, T: Object>(handle: *const T::Handle) -> Reply<&'a T> {
    // SAFETY: the caller's promise.
    unsafe { Ok(&tagged::<T>(handle)?.as_ref().object) }
}

/// Borrows the object of a handle mutably.
///
/// # Safety
/// As [`object`]; no other call uses it before this one is over.
pub(crate) unsafe fn object_mut<'a, T: Object>(handle: *mut T::Handle) -> Reply<&'a mut T> {
    // SAFETY: the caller's promise.
    unsafe { Ok(&mut tagged::<T>(handle)?.as_mut().object) }
}

/// The live object of a handle.
///
/// # Safety
/// As [`tag_of`].
unsafe fn tagged<T: Object>(handle: *const T::Handle) -> Reply<NonNull<Tagged<T>>> {
    // SAFETY: the caller's promise.
    if unsafe { tag_of(handle) }? != T::TAG {
        return Err(gt_code::NoObject.into());
    }
    checked(handle.cast())
}

/// Returns the first `N` entries of an array, or all of them and then `rest`.
pub(crate) fn resized<T: Copy, const M: usize, const N: usize>(all: &[T; M], rest: T) -> [T; N] {
    core::array::from_fn(|index| all.get(index).copied().unwrap_or(rest))
}
