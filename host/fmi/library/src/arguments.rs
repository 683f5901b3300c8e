//! Arguments behind pointers. Null, misaligned and endless ones are refused.

use std::ffi::CStr;

use crate::types::fmi2String;

/// Most elements of an array: more than a unit has variables.
const MAX_ELEMENTS: usize = 1 << 16;

/// Borrows an array for the duration of a call. Null is an array without elements.
///
/// # Safety
/// `pointer` is null, or misaligned, or points to `count` elements that are not written to meanwhile.
pub(crate) unsafe fn array<'a, T>(
    name: &str,
    pointer: *const T,
    count: usize,
) -> Result<&'a [T], String> {
    check(name, pointer, count)?;
    if count == 0 {
        return Ok(&[]);
    }
    // SAFETY: neither null nor misaligned, and short; the rest is the caller's promise.
    Ok(unsafe { std::slice::from_raw_parts(pointer, count) })
}

/// Writes elements to an array.
///
/// # Safety
/// `pointer` is null, or misaligned, or points to places for as many elements.
pub(crate) unsafe fn fill<T: Copy>(
    name: &str,
    pointer: *mut T,
    elements: &[T],
) -> Result<(), String> {
    check(name, pointer, elements.len())?;
    for (index, element) in elements.iter().enumerate() {
        // SAFETY: neither null nor misaligned; the rest is the caller's promise.
        unsafe { pointer.add(index).write(*element) };
    }
    Ok(())
}

/// Reads a value that a pointer leads to.
///
/// # Safety
/// `pointer` is null, or misaligned, or points to a `T`.
pub(crate) unsafe fn one<T: Copy>(name: &str, pointer: *const T) -> Result<T, String> {
    check(name, pointer, 1)?;
    // SAFETY: neither null nor misaligned; the rest is the caller's promise.
    Ok(unsafe { pointer.read() })
}

fn check<T>(name: &str, pointer: *const T, count: usize) -> Result<(), String> {
    if count > MAX_ELEMENTS {
        return Err(format!(
            "{name}: {count} elements; expected at most {MAX_ELEMENTS}"
        ));
    }
    if count > 0 && pointer.is_null() {
        return Err(format!("{name}: is null; expected {count} elements"));
    }
    if count > 0 && !pointer.is_aligned() {
        return Err(format!("{name}: is misaligned"));
    }
    Ok(())
}

/// Copies a text.
///
/// # Safety
/// `pointer` is null or points to bytes that end with a zero.
pub(crate) unsafe fn text(name: &str, pointer: fmi2String) -> Result<String, String> {
    if pointer.is_null() {
        return Err(format!("{name}: is null; expected a text"));
    }
    // SAFETY: the caller's promise.
    let bytes = unsafe { CStr::from_ptr(pointer) };
    let text = bytes.to_str();
    text.map(str::to_owned)
        .map_err(|_| format!("{name}: is not UTF-8"))
}
