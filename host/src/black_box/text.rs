//! Values as JSON text, exactly: what is written is read back to the bit, or refused with the place and the reason.
//!
//! Three macros list the types of core: [`records`], [`choices`] and [`newtypes`]. They take types apart and put them together
//! field by field, so a field that core gains does not compile until it is listed.

use serde_json::{Map, Value};

/// Something that stands in a black-box file.
pub(super) trait Text: Sized {
    /// Appends the value as JSON.
    fn write(&self, text: &mut String);
    /// The value of a piece of JSON.
    fn read(value: Value) -> Result<Self, Problem>;

    /// The value as JSON.
    fn text(&self) -> String {
        let mut text = String::new();
        self.write(&mut text);
        text
    }
}

/// What is wrong with a piece of JSON, and where in it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Problem {
    /// As in `config.axes[0].limits`; empty for the whole.
    pub(super) place: String,
    pub(super) reason: String,
}

impl Problem {
    pub(super) fn new(reason: impl ToString) -> Self {
        Self {
            place: String::new(),
            reason: reason.to_string(),
        }
    }

    /// Seen from outside: the problem is within the field `name`.
    pub(super) fn within(self, name: &str) -> Self {
        Self {
            place: joined(name, &self.place),
            ..self
        }
    }
}

/// `outer.inner`, `outer[0]`, or `outer` alone.
fn joined(outer: &str, inner: &str) -> String {
    let dot = if inner.is_empty() || inner.starts_with('[') {
        ""
    } else {
        "."
    };
    format!("{outer}{dot}{inner}")
}

/// A JSON object whose fields are taken out one by one.
pub(super) struct Object(Map<String, Value>);

impl Object {
    pub(super) fn of(value: Value) -> Result<Self, Problem> {
        match value {
            Value::Object(fields) => Ok(Self(fields)),
            _ => Err(Problem::new("is no object")),
        }
    }

    pub(super) fn take<T: Text>(&mut self, name: &str) -> Result<T, Problem> {
        let value = self
            .0
            .remove(name)
            .ok_or_else(|| Problem::new("is missing").within(name))?;
        T::read(value).map_err(|problem| problem.within(name))
    }

    /// Nothing may be left.
    pub(super) fn end(self) -> Result<(), Problem> {
        match self.0.keys().next() {
            Some(name) => Err(Problem::new("is unknown").within(name)),
            None => Ok(()),
        }
    }
}

/// Appends an object with these fields, in this order; the values are JSON.
pub(super) fn write_object(text: &mut String, fields: &[(&str, String)]) {
    let fields = fields
        .iter()
        .map(|(name, value)| format!("\"{name}\":{value}"));
    text.push('{');
    text.push_str(&fields.collect::<Vec<_>>().join(","));
    text.push('}');
}

/// Appends an array.
pub(super) fn write_array<T: Text>(text: &mut String, items: &[T]) {
    let items = items.iter().map(T::text);
    text.push('[');
    text.push_str(&items.collect::<Vec<_>>().join(","));
    text.push(']');
}

/// The items of an array.
pub(super) fn read_array<T: Text>(value: Value) -> Result<Vec<T>, Problem> {
    let Value::Array(items) = value else {
        return Err(Problem::new("is no array"));
    };
    let item = |(index, item)| {
        let within = |problem: Problem| problem.within(&format!("[{index}]"));
        T::read(item).map_err(within)
    };
    items.into_iter().enumerate().map(item).collect()
}

/// The name of a variant, and what it carries: `"Name"` or `{"Name": ...}`.
pub(super) fn read_variant(value: Value) -> Result<(String, Option<Value>), Problem> {
    let mut fields = match value {
        Value::String(name) => return Ok((name, None)),
        Value::Object(fields) => fields.into_iter(),
        _ => return Err(Problem::new("is neither a name nor an object")),
    };
    match (fields.next(), fields.next()) {
        (Some((name, value)), None) => Ok((name, Some(value))),
        _ => Err(Problem::new("must have exactly one name")),
    }
}

/// Structs with public fields: an object with the fields' names.
macro_rules! records {
    ($($(const $n:ident:)? $type:ty { $($field:ident),* $(,)? })*) => {$(
        impl $(<const $n: usize>)? Text for $type {
            fn write(&self, text: &mut String) {
                let Self { $($field),* } = self;
                write_object(text, &[$((stringify!($field), $field.text())),*]);
            }

            fn read(value: Value) -> Result<Self, Problem> {
                let mut object = Object::of(value)?;
                let record = Self { $($field: object.take(stringify!($field))?),* };
                object.end()?;
                Ok(record)
            }
        }
    )*};
}

/// Enums, by what their variants carry: nothing (the name), one value or fields (an object of that name).
macro_rules! choices {
    ($($(const $n:ident:)? $type:ty {
        nothing [$($bare:ident),*] value [$($one:ident),*] fields [$($many:ident { $($field:ident),* }),*]
    })*) => {$(
        impl $(<const $n: usize>)? Text for $type {
            fn write(&self, text: &mut String) {
                match self {
                    $(Self::$bare => text.push_str(concat!("\"", stringify!($bare), "\"")),)*
                    $(Self::$one(value) => write_object(text, &[(stringify!($one), value.text())]),)*
                    $(Self::$many { $($field),* } => {
                        let mut fields = String::new();
                        write_object(&mut fields, &[$((stringify!($field), $field.text())),*]);
                        write_object(text, &[(stringify!($many), fields)]);
                    })*
                }
            }

            fn read(value: Value) -> Result<Self, Problem> {
                let (name, carried) = read_variant(value)?;
                match (name.as_str(), carried) {
                    $((stringify!($bare), None) => Ok(Self::$bare),)*
                    $((stringify!($one), Some(value)) => {
                        Text::read(value).map(Self::$one).map_err(|problem| problem.within(&name))
                    })*
                    $((stringify!($many), Some(value)) => {
                        let mut fields = Object::of(value)?;
                        let variant = Self::$many { $($field: fields.take(stringify!($field))?),* };
                        fields.end()?;
                        Ok(variant)
                    })*
                    _ => Err(Problem::new(format!("{name:?} is not known here"))),
                }
            }
        }
    )*};
}

/// Structs around one value: that value.
macro_rules! newtypes {
    ($($type:ident),*) => {$(
        impl Text for $type {
            fn write(&self, text: &mut String) {
                self.0.write(text);
            }

            fn read(value: Value) -> Result<Self, Problem> {
                Text::read(value).map(Self)
            }
        }
    )*};
}

pub(super) use {choices, newtypes, records};

macro_rules! integers {
    ($($type:ty),*) => {$(
        impl Text for $type {
            fn write(&self, text: &mut String) {
                text.push_str(&self.to_string());
            }

            fn read(value: Value) -> Result<Self, Problem> {
                let number = value.as_i64().map(i128::from).or(value.as_u64().map(i128::from));
                let number = number.ok_or_else(|| Problem::new(format!("is {value}, it must be a whole number")))?;
                Self::try_from(number).map_err(|_| {
                    Problem::new(format!("is {number}, it must be from {} to {}", Self::MIN, Self::MAX))
                })
            }
        }
    )*};
}

integers!(u8, u16, u32, u64, usize, i16, i32, i64);

/// 128 bits: a string of hexadecimal digits, for JSON readers have no such numbers.
impl Text for u128 {
    fn write(&self, text: &mut String) {
        text.push_str(&format!("\"{self:#034x}\""));
    }

    fn read(value: Value) -> Result<Self, Problem> {
        let digits = value.as_str().and_then(|text| text.strip_prefix("0x"));
        digits
            .and_then(|digits| Self::from_str_radix(digits, 16).ok())
            .ok_or_else(|| Problem::new("must be \"0x\" and up to 32 hexadecimal digits"))
    }
}

impl Text for bool {
    fn write(&self, text: &mut String) {
        text.push_str(&self.to_string());
    }

    fn read(value: Value) -> Result<Self, Problem> {
        let wrong = || Problem::new("must be true or false");
        value.as_bool().ok_or_else(wrong)
    }
}

/// Absent: null.
impl<T: Text> Text for Option<T> {
    fn write(&self, text: &mut String) {
        match self {
            Some(value) => value.write(text),
            None => text.push_str("null"),
        }
    }

    fn read(value: Value) -> Result<Self, Problem> {
        match value {
            Value::Null => Ok(None),
            value => T::read(value).map(Some),
        }
    }
}

/// A pair: an array of two.
impl<A: Text, B: Text> Text for (A, B) {
    fn write(&self, text: &mut String) {
        text.push_str(&format!("[{},{}]", self.0.text(), self.1.text()));
    }

    fn read(value: Value) -> Result<Self, Problem> {
        let [a, b] = <[Value; 2]>::read(value)?;
        let first = A::read(a).map_err(|problem| problem.within("[0]"))?;
        let second = B::read(b).map_err(|problem| problem.within("[1]"))?;
        Ok((first, second))
    }
}

impl<T: Text, const N: usize> Text for [T; N] {
    fn write(&self, text: &mut String) {
        write_array(text, self);
    }

    fn read(value: Value) -> Result<Self, Problem> {
        let items = read_array(value)?;
        let count = items.len();
        let wrong = |_| Problem::new(format!("has {count} entries, it must have {N}"));
        items.try_into().map_err(wrong)
    }
}

/// JSON as it is, for what is looked at before it is understood.
impl Text for Value {
    fn write(&self, text: &mut String) {
        text.push_str(&self.to_string());
    }

    fn read(value: Value) -> Result<Self, Problem> {
        Ok(value)
    }
}

/// The first place at which two pieces of JSON differ, and what stands there in each.
pub(super) fn first_difference(left: &Value, right: &Value) -> Option<(String, Value, Value)> {
    let within = |name: &str, left: &Value, right: &Value| {
        let (place, left, right) = first_difference(left, right)?;
        Some((joined(name, &place), left, right))
    };
    match (left, right) {
        (Value::Object(a), Value::Object(b)) if a.keys().eq(b.keys()) => a
            .iter()
            .zip(b.values())
            .find_map(|((name, left), right)| within(name, left, right)),
        (Value::Array(a), Value::Array(b)) if a.len() == b.len() => (0..)
            .zip(a.iter().zip(b))
            .find_map(|(index, (left, right))| within(&format!("[{index}]"), left, right)),
        _ => (left != right).then(|| (String::new(), left.clone(), right.clone())),
    }
}
