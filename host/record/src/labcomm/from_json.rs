//! Types and values out of JSON.

use std::collections::BTreeSet;

use gantry_tau_labcomm::{ARRAY, Array, Kind, Primitive, STRUCTURE, Sink, Type, Version};
use serde_json::Value;

use super::line_error::{LineError, short};

/// Bytes that grow.
pub(super) struct Bytes {
    pub(super) bytes: Vec<u8>,
    version: Version,
}

impl Bytes {
    pub(super) const fn new(version: Version) -> Self {
        Self {
            bytes: Vec::new(),
            version,
        }
    }
}

impl Sink for Bytes {
    fn array<const N: usize>(&mut self, bytes: [u8; N]) {
        self.bytes.extend(bytes);
    }

    fn slice(&mut self, bytes: &[u8]) {
        self.bytes.extend(bytes);
    }

    fn version(&self) -> Version {
        self.version
    }
}

/// Reads a text, or `{"bytes":"hex"}`.
pub(super) fn text(json: &Value) -> Result<Vec<u8>, LineError> {
    let hex = match json {
        Value::String(text) => return Ok(text.clone().into_bytes()),
        Value::Object(object) if object.len() == 1 => object.get("bytes").and_then(Value::as_str),
        _ => None,
    };
    let bytes = hex.and_then(|hex| {
        let pairs = hex.as_bytes().chunks(2).map(|pair| {
            std::str::from_utf8(pair)
                .ok()
                .filter(|pair| pair.len() == 2)
        });
        pairs
            .map(|pair| u8::try_from(from_hex(pair?)?).ok())
            .collect::<Option<Vec<u8>>>()
    });
    bytes.ok_or_else(|| LineError::NotAText { json: short(json) })
}

/// Reads hex digits, without the sign that the standard library takes.
fn from_hex(digits: &str) -> Option<u64> {
    let is_hex = digits.bytes().all(|digit| digit.is_ascii_hexdigit());
    if is_hex {
        u64::from_str_radix(digits, 16).ok()
    } else {
        None
    }
}

/// Writes the bytes of a type.
pub(super) fn ty(out: &mut Bytes, json: &Value) -> Result<(), LineError> {
    if let Value::String(name) = json {
        let codes = 0x20..0x29;
        let primitives = codes.filter_map(|code| Primitive::from_code(Version::V2014, code).ok());
        let primitive = primitives
            .into_iter()
            .find(|primitive| primitive.name() == name)
            .ok_or_else(|| not_a_type(json))?;
        out.number(primitive.code());
        return Ok(());
    }
    match json.as_array().map(Vec::as_slice) {
        Some([kind, Value::Array(sizes), element]) if kind == "array" => {
            out.number(ARRAY);
            out.number(count(sizes)?);
            for size in sizes {
                out.number(
                    size.as_u64()
                        .and_then(|size| size.try_into().ok())
                        .ok_or_else(|| not_a_type(json))?,
                );
            }
            // JSON itself ends at a depth of 128.
            ty(out, element)
        }
        Some([kind, Value::Array(fields)]) if kind == "struct" => {
            out.number(STRUCTURE);
            out.number(count(fields)?);
            let mut keys = BTreeSet::new();
            for field in fields {
                let Some([name, of]) = field.as_array().map(Vec::as_slice) else {
                    return Err(not_a_type(json));
                };
                let name = text(name)?;
                // The fields of a value are found by their names.
                let key = String::from_utf8_lossy(&name).into_owned();
                if !keys.insert(key.clone()) {
                    return Err(LineError::DuplicateField { field: key });
                }
                out.text(&name);
                ty(out, of)?;
            }
            Ok(())
        }
        _ => Err(not_a_type(json)),
    }
}

fn not_a_type(json: &Value) -> LineError {
    LineError::NotAType { json: short(json) }
}

fn count(list: &[Value]) -> Result<u32, LineError> {
    u32::try_from(list.len()).map_err(|_| LineError::TooManyParts)
}

/// Writes the bytes of a value of a type.
pub(super) fn value(out: &mut Bytes, of: &Type<'_>, json: &Value) -> Result<(), LineError> {
    match of.kind() {
        Kind::Primitive(of) => primitive(out, of, json),
        Kind::Array(of) => array(out, &of, json),
        Kind::Structure(of) => {
            let object = json
                .as_object()
                .ok_or_else(|| LineError::NotAnObject { json: short(json) })?;
            let mut fields = 0_usize;
            for (name, of) in of.fields() {
                let name = String::from_utf8_lossy(name);
                let field = object
                    .get(name.as_ref())
                    .ok_or_else(|| LineError::MissingField {
                        field: name.clone().into_owned(),
                    })?;
                value(out, &of, field).map_err(|reason| LineError::Field {
                    field: name.into_owned(),
                    reason: Box::new(reason),
                })?;
                fields = fields.saturating_add(1);
            }
            if fields == object.len() {
                Ok(())
            } else {
                Err(LineError::UnknownField)
            }
        }
    }
}

fn primitive(out: &mut Bytes, of: Primitive, json: &Value) -> Result<(), LineError> {
    if of == Primitive::String {
        out.text(&text(json)?);
        return Ok(());
    }
    number(out, of, json).ok_or_else(|| LineError::NotOfType {
        expected: of.name(),
        json: short(json),
    })
}

/// Writes a value of any primitive type but a text; `None` if it is of another type.
fn number(out: &mut Bytes, of: Primitive, json: &Value) -> Option<()> {
    match of {
        Primitive::Boolean => out.array([u8::from(json.as_bool()?)]),
        Primitive::Byte => out.array(u8::try_from(json.as_i64()?).ok()?.to_be_bytes()),
        Primitive::Short => out.array(i16::try_from(json.as_i64()?).ok()?.to_be_bytes()),
        Primitive::Int => out.array(i32::try_from(json.as_i64()?).ok()?.to_be_bytes()),
        Primitive::Long => out.array(json.as_i64()?.to_be_bytes()),
        Primitive::Reference => out.array(u32::try_from(json.as_i64()?).ok()?.to_be_bytes()),
        Primitive::Float => out.array(float(json)?.to_be_bytes()),
        Primitive::Double => out.array(double(json)?.to_be_bytes()),
        Primitive::String => return None,
    }
    Some(())
}

/// Bits of a 32-bit float: a number, hex of 8 digits, or a word.
fn float(json: &Value) -> Option<u32> {
    match json {
        // Through its digits: there is no conversion that cannot fail.
        Value::Number(number) => {
            let float: f32 = number.to_string().parse().ok()?;
            float.is_finite().then_some(float.to_bits())
        }
        Value::String(text) if text.len() == 8 => {
            from_hex(text).and_then(|bits| u32::try_from(bits).ok())
        }
        Value::String(text) => {
            word(text, [f32::NAN, f32::INFINITY, f32::NEG_INFINITY]).map(f32::to_bits)
        }
        _ => None,
    }
}

/// Bits of a 64-bit float: a number, hex of 16 digits, or a word.
fn double(json: &Value) -> Option<u64> {
    match json {
        Value::Number(number) => number.as_f64().map(f64::to_bits),
        Value::String(text) if text.len() == 16 => from_hex(text),
        Value::String(text) => {
            word(text, [f64::NAN, f64::INFINITY, f64::NEG_INFINITY]).map(f64::to_bits)
        }
        _ => None,
    }
}

fn word<T>(text: &str, [nan, positive, negative]: [T; 3]) -> Option<T> {
    match text {
        "nan" => Some(nan),
        "inf" => Some(positive),
        "-inf" => Some(negative),
        _ => None,
    }
}

/// Writes an array: lists within each other, one level per index.
fn array(out: &mut Bytes, of: &Array<'_>, json: &Value) -> Result<(), LineError> {
    let fixed: Vec<u32> = of.indices().collect();
    let mut sizes = Vec::new();
    let mut rows = vec![json];
    for size in &fixed {
        let Some(lists) = rows
            .iter()
            .map(|row| row.as_array())
            .collect::<Option<Vec<_>>>()
        else {
            return Err(LineError::Depth {
                indices: fixed.len(),
            });
        };
        // Without an element the inner sizes are not said: the type's, or 0.
        let length = lists.first().map_or(0, |list| list.len());
        let length = u32::try_from(length).map_err(|_| LineError::ListTooLong)?;
        if lists
            .iter()
            .any(|list| list.len() != lists.first().map_or(0, |list| list.len()))
        {
            return Err(LineError::Ragged);
        }
        let is_empty = *json == Value::Array(Vec::new()) || lists.is_empty();
        if *size != 0 && length != *size && !is_empty {
            return Err(LineError::ListLength {
                expected: *size,
                length,
            });
        }
        sizes.push(if *size == 0 { length } else { *size });
        rows = lists.into_iter().flatten().collect();
    }
    if rows.is_empty() && !sizes.contains(&0) && !sizes.is_empty() {
        return Err(LineError::EmptyList { sizes });
    }
    for (size, of_type) in sizes.iter().zip(&fixed) {
        if *of_type == 0 {
            out.number(*size);
        }
    }
    let element = of.element();
    rows.into_iter()
        .try_for_each(|row| value(out, &element, row))
}
