//! Types and values as JSON text, written along a walk without a tree of values between.

use std::fmt::Write as _;

use gantry_tau_labcomm::{ErrorKind, Kind, Leaf, Step, Type, Value};

/// Longest text of a value, bytes. A value of numbers or texts, 16 MiB at most, has less; names of
/// fields, repeated for each element, have not.
const MAX_TEXT: usize = 1 << 27;

/// Reason why a value has no text.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum TextError {
    /// Error of the stream.
    #[error("{0}")]
    Stream(ErrorKind),
    /// Longer than [`MAX_TEXT`].
    #[error(
        "the text of a value is longer than {MAX_TEXT} bytes; the names of its fields are repeated too often"
    )]
    TooLong,
}

/// Writes bytes as a JSON string, or as `{"bytes":"hex"}` if they are not UTF-8.
pub(super) fn text(out: &mut String, bytes: &[u8]) {
    match std::str::from_utf8(bytes) {
        Ok(text) => string(out, text),
        Err(_) => {
            out.push_str("{\"bytes\":\"");
            for byte in bytes {
                let _ = write!(out, "{byte:02x}");
            }
            out.push_str("\"}");
        }
    }
}

/// Writes a JSON string.
pub(super) fn string(out: &mut String, text: &str) {
    out.push_str(&serde_json::Value::from(text).to_string());
}

/// Writes a type: `"int"`, `["array",[sizes],type]`, `["struct",[[name,type],...]]`.
pub(super) fn ty(out: &mut String, of: &Type<'_>) {
    match of.kind() {
        Kind::Primitive(primitive) => string(out, primitive.name()),
        Kind::Array(array) => {
            let sizes: Vec<String> = array.indices().map(|size| size.to_string()).collect();
            let _ = write!(out, "[\"array\",[{}],", sizes.join(","));
            // No deeper than a checked type, which is 16.
            ty(out, &array.element());
            out.push(']');
        }
        Kind::Structure(structure) => {
            out.push_str("[\"struct\",[");
            for (number, (name, of)) in structure.fields().enumerate() {
                out.push_str(if number == 0 { "[" } else { ",[" });
                text(out, name);
                out.push(',');
                ty(out, &of);
                out.push(']');
            }
            out.push_str("]]");
        }
    }
}

/// Array or structure around the place of a walk.
enum Container {
    Array {
        /// Elements of a list at each index but the last.
        strides: Vec<u64>,
        /// Elements that are written.
        written: u64,
        /// True with an index at least: an array without one is its only element.
        is_list: bool,
    },
    Structure {
        is_first: bool,
    },
}

/// Form of floats and doubles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Floats {
    /// Numbers; texts for those that are not finite.
    Numbers,
    /// Hex of their bits.
    Bits,
    /// Numbers; `null` for those that are not finite.
    FiniteOrNull,
}

/// Writes a value.
///
/// # Errors
/// [`TextError::TooLong`]. No other for a value that the decoder has checked.
pub(crate) fn value(out: &mut String, of: &Value<'_, '_>, floats: Floats) -> Result<(), TextError> {
    let begin = out.len();
    let mut walk = of.walk();
    let mut levels: Vec<Container> = Vec::new();
    while let Some(step) = walk.step().map_err(TextError::Stream)? {
        if out.len().saturating_sub(begin) > MAX_TEXT {
            return Err(TextError::TooLong);
        }
        match step {
            Step::Field(name) => {
                if let Some(Container::Structure { is_first }) = levels.last_mut() {
                    if !std::mem::take(is_first) {
                        out.push(',');
                    }
                }
                string(out, &String::from_utf8_lossy(name));
                out.push(':');
                continue;
            }
            Step::Array(sizes) => {
                before_element(out, levels.last_mut());
                let sizes: Vec<u64> = sizes.map(u64::from).collect();
                if !sizes.is_empty() {
                    out.push('[');
                }
                // Products of all later sizes, for each index but the last; small, as there are so
                // many elements.
                let inner = if sizes.contains(&0) {
                    1..1
                } else {
                    1..sizes.len()
                };
                let strides = inner
                    .map(|from| sizes.iter().skip(from).product())
                    .collect();
                levels.push(Container::Array {
                    strides,
                    written: 0,
                    is_list: !sizes.is_empty(),
                });
                continue;
            }
            Step::Structure(_) => {
                before_element(out, levels.last_mut());
                out.push('{');
                levels.push(Container::Structure { is_first: true });
                continue;
            }
            Step::Leaf(of) => {
                before_element(out, levels.last_mut());
                leaf(out, of, floats);
            }
            Step::Leave => match levels.pop() {
                Some(Container::Array { is_list: false, .. }) | None => {}
                Some(Container::Array { .. }) => out.push(']'),
                Some(Container::Structure { .. }) => out.push('}'),
            },
            Step::Skipped => {}
        }
        after_element(out, levels.last_mut());
    }
    Ok(())
}

/// Separates an element from the one before, and opens the lists that begin with it.
fn before_element(out: &mut String, level: Option<&mut Container>) {
    if let Some(Container::Array {
        strides, written, ..
    }) = level
    {
        if *written > 0 {
            out.push(',');
        }
        strides
            .iter()
            .filter(|stride| is_multiple(*written, **stride))
            .for_each(|_| out.push('['));
    }
}

/// Counts an element, and closes the lists that end with it.
fn after_element(out: &mut String, level: Option<&mut Container>) {
    if let Some(Container::Array {
        strides, written, ..
    }) = level
    {
        *written = written.saturating_add(1);
        strides
            .iter()
            .filter(|stride| is_multiple(*written, **stride))
            .for_each(|_| out.push(']'));
    }
}

fn is_multiple(number: u64, of: u64) -> bool {
    number.checked_rem(of) == Some(0)
}

fn leaf(out: &mut String, of: Leaf<'_>, floats: Floats) {
    let _ = match of {
        Leaf::Boolean(byte) => write!(out, "{}", byte != 0),
        Leaf::Byte(number) => write!(out, "{number}"),
        Leaf::Short(number) => write!(out, "{number}"),
        Leaf::Int(number) => write!(out, "{number}"),
        Leaf::Long(number) => write!(out, "{number}"),
        Leaf::Reference(index) => write!(out, "{index}"),
        Leaf::Float(float) if floats == Floats::Bits => write!(out, "\"{float:08x}\""),
        Leaf::Double(double) if floats == Floats::Bits => write!(out, "\"{double:016x}\""),
        Leaf::Float(float) => {
            // The shortest text of the 32 bits.
            let float = f32::from_bits(float);
            if float.is_finite() {
                write!(out, "{float:?}")
            } else {
                not_finite(out, float.into(), floats)
            }
        }
        Leaf::Double(double) => {
            let double = f64::from_bits(double);
            if double.is_finite() {
                write!(out, "{double:?}")
            } else {
                not_finite(out, double, floats)
            }
        }
        Leaf::String(bytes) => {
            text(out, bytes);
            Ok(())
        }
    };
}

fn not_finite(out: &mut String, number: f64, floats: Floats) -> std::fmt::Result {
    out.write_str(match number {
        _ if floats == Floats::FiniteOrNull => "null",
        _ if number.is_nan() => "\"nan\"",
        _ if number > 0.0 => "\"inf\"",
        _ => "\"-inf\"",
    })
}
