//! Values as JSON text, into a buffer of fixed length.
//!
//! Three macros list the types of core: [`records`], [`choices`] and [`newtypes`]. They take types apart field by field, so a field that
//! core gains does not compile until it is listed; that the text is the host's to the letter is tested against the host.
//! What every value calls is not inlined: this is not the cyclic path, and an image should be small.

/// A line that is being written: as much as fits is kept, all of it is counted.
pub(crate) struct Line<'a> {
    room: &'a mut [u8],
    length: usize,
}

impl<'a> Line<'a> {
    pub(crate) fn new(room: &'a mut [u8]) -> Self {
        Self { room, length: 0 }
    }

    /// Length of what was written, whether it fitted or not.
    pub(crate) const fn length(&self) -> usize {
        self.length
    }

    pub(super) fn byte(&mut self, byte: u8) {
        if let Some(place) = self.room.get_mut(self.length) {
            *place = byte;
        }
        self.length = self.length.saturating_add(1);
    }

    #[inline(never)]
    pub(super) fn put(&mut self, text: &str) {
        for byte in text.bytes() {
            self.byte(byte);
        }
    }

    /// An object with these fields.
    #[inline(never)]
    pub(super) fn object(&mut self, fields: &[(&str, &dyn Text)]) {
        let mut open = "{";
        for (name, value) in fields {
            self.put(open);
            self.put("\"");
            self.put(name);
            self.put("\":");
            value.write(self);
            open = ",";
        }
        self.put("}");
    }

    /// An array.
    pub(super) fn array<T: Text>(&mut self, items: &[T]) {
        self.put("[");
        for (index, item) in items.iter().enumerate() {
            if index > 0 {
                self.put(",");
            }
            item.write(self);
        }
        self.put("]");
    }

    /// A whole number. Ten to the nineteenth is the largest power of ten in 64 bits.
    #[inline(never)]
    fn decimal(&mut self, number: u64) {
        let mut rest = number;
        let mut begun = false;
        let mut power: u64 = 10_000_000_000_000_000_000;
        while power > 0 {
            let digit = rest.checked_div(power).unwrap_or(0);
            rest = rest.checked_rem(power).unwrap_or(0);
            begun |= digit > 0 || power == 1;
            if begun {
                self.byte(b'0'.saturating_add(u8::try_from(digit).unwrap_or(0)));
            }
            power /= 10;
        }
    }
}

/// Something that stands in a black-box file.
pub(crate) trait Text {
    /// Appends the value as JSON.
    fn write(&self, line: &mut Line<'_>);
}

/// Structs with public fields: an object with the fields' names.
macro_rules! records {
    ($($(const $n:ident:)? $type:ty { $($field:ident),* $(,)? })*) => {$(
        impl $(<const $n: usize>)? Text for $type {
            fn write(&self, line: &mut Line<'_>) {
                let Self { $($field),* } = self;
                line.object(&[$((stringify!($field), $field)),*]);
            }
        }
    )*};
}

/// Enums, by what their variants carry: nothing (the name), one value or fields (an object of that name).
macro_rules! choices {
    ($($(const $n:ident:)? $type:ty {
        nothing [$($bare:ident),* $(,)?] value [$($one:ident),*] fields [$($many:ident { $($field:ident),* }),* $(,)?]
    })*) => {$(
        impl $(<const $n: usize>)? Text for $type {
            fn write(&self, line: &mut Line<'_>) {
                match self {
                    $(Self::$bare => line.put(concat!("\"", stringify!($bare), "\"")),)*
                    $(Self::$one(value) => line.object(&[(stringify!($one), value)]),)*
                    $(Self::$many { $($field),* } => {
                        line.put(concat!("{\"", stringify!($many), "\":"));
                        line.object(&[$((stringify!($field), $field)),*]);
                        line.put("}");
                    })*
                }
            }
        }
    )*};
}

/// Structs around one value: that value.
macro_rules! newtypes {
    ($($type:ident),* $(,)?) => {$(
        impl Text for $type {
            fn write(&self, line: &mut Line<'_>) {
                self.0.write(line);
            }
        }
    )*};
}

pub(super) use {choices, newtypes, records};

macro_rules! unsigned {
    ($($type:ty),*) => {$(
        impl Text for $type {
            fn write(&self, line: &mut Line<'_>) {
                line.decimal(u64::from(*self));
            }
        }
    )*};
}

macro_rules! signed {
    ($($type:ty),*) => {$(
        impl Text for $type {
            fn write(&self, line: &mut Line<'_>) {
                if *self < 0 {
                    line.put("-");
                }
                line.decimal(i64::from(*self).unsigned_abs());
            }
        }
    )*};
}

unsigned!(u8, u16, u32, u64);
signed!(i16, i32, i64);

impl Text for usize {
    fn write(&self, line: &mut Line<'_>) {
        line.decimal(u64::try_from(*self).unwrap_or(u64::MAX));
    }
}

/// 128 bits: a string of hexadecimal digits.
impl Text for u128 {
    fn write(&self, line: &mut Line<'_>) {
        line.put("\"0x");
        for byte in self.to_be_bytes() {
            for digit in [byte >> 4, byte & 15] {
                let letter = if digit < 10 {
                    b'0'
                } else {
                    b'a'.wrapping_sub(10)
                };
                line.byte(letter.wrapping_add(digit));
            }
        }
        line.put("\"");
    }
}

impl Text for bool {
    fn write(&self, line: &mut Line<'_>) {
        line.put(if *self { "true" } else { "false" });
    }
}

/// Absent: null.
impl<T: Text> Text for Option<T> {
    fn write(&self, line: &mut Line<'_>) {
        match self {
            Some(value) => value.write(line),
            None => line.put("null"),
        }
    }
}

/// A pair: an array of two.
impl<A: Text, B: Text> Text for (A, B) {
    fn write(&self, line: &mut Line<'_>) {
        line.put("[");
        self.0.write(line);
        line.put(",");
        self.1.write(line);
        line.put("]");
    }
}

impl<T: Text, const N: usize> Text for [T; N] {
    fn write(&self, line: &mut Line<'_>) {
        line.array(self);
    }
}
