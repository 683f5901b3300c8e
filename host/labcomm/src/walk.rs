//! Walk over a value and its type in lockstep, with an explicit stack.

use crate::cursor::{Reader, to_usize};
use crate::error::{ErrorKind, Limit, Malformed};
use crate::ty::Type;
use crate::ty::scan::{ARRAY, MAX_DEPTH, MAX_TYPE, MAX_VALUE, Primitive, STRUCTURE, product, scan};

/// Step of a walk.
#[derive(Clone, Copy, Debug)]
pub enum Step<'t, 'v> {
    /// An array begins; its elements follow, last index fastest.
    Array(Sizes<'t, 'v>),
    /// A structure of this many fields begins.
    Structure(u32),
    /// A field of a structure begins: its name. Its value follows.
    Field(&'t [u8]),
    /// A value without parts.
    Leaf(Leaf<'v>),
    /// Elements of fixed size that were passed in one step; within [`value_len`] only.
    Skipped,
    /// The innermost array or structure ends.
    Leave,
}

/// Value without parts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Leaf<'v> {
    /// Byte of a boolean; 0 is false.
    Boolean(u8),
    /// Byte.
    Byte(u8),
    /// 16 bits.
    Short(i16),
    /// 32 bits.
    Int(i32),
    /// 64 bits.
    Long(i64),
    /// Bits of a 32-bit float.
    Float(u32),
    /// Bits of a 64-bit float.
    Double(u64),
    /// Bytes of a text.
    String(&'v [u8]),
    /// Index of a sample type, or 0.
    Reference(u32),
}

/// Sizes of an array's indices: the type's, and the value's where the type leaves them open.
#[derive(Clone, Copy, Debug)]
pub struct Sizes<'t, 'v> {
    indices: u32,
    of_type: Reader<'t>,
    of_value: Reader<'v>,
}

impl Iterator for Sizes<'_, '_> {
    type Item = u32;

    fn next(&mut self) -> Option<u32> {
        self.indices = self.indices.checked_sub(1)?;
        size(&mut self.of_type, &mut self.of_value).ok()
    }
}

/// Takes the size of an index: the type's, or the value's where the type leaves it open.
fn size(ty: &mut Reader<'_>, value: &mut Reader<'_>) -> Result<u32, ErrorKind> {
    match ty.number()? {
        0 => value.number(),
        fixed => Ok(fixed),
    }
}

/// Takes the sizes of so many indices; returns their product, or `None` beyond [`MAX_VALUE`], where
/// none of them is 0.
///
/// # Errors
/// `Incomplete`, or a malformed number.
pub fn elements(
    indices: u32,
    ty: &mut Reader<'_>,
    value: &mut Reader<'_>,
) -> Result<Option<u32>, ErrorKind> {
    let mut elements = Some(1);
    let mut has_zero = false;
    for _ in 0..indices {
        let size = size(ty, value)?;
        has_zero |= size == 0;
        elements = elements.and_then(|elements| product(elements, size));
    }
    Ok(if has_zero { Some(0) } else { elements })
}

/// Array or structure around the place of a walk.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(kani, derive(kani::Arbitrary))]
struct Level {
    /// Elements or fields still to come.
    left: u32,
    /// Array: offsets of the element's type and of its end.
    element: Option<(usize, usize)>,
}

impl Level {
    /// True if the offsets are within a type of `length` bytes.
    fn is_within(&self, length: usize) -> bool {
        self.element
            .is_none_or(|(start, end)| start <= end && end <= length)
    }
}

/// Next thing that a walk finds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(kani, derive(kani::Arbitrary))]
enum Next {
    /// A value.
    Value,
    /// An element or field, or the end of the innermost array or structure.
    Part,
    /// Nothing: the value has ended.
    Nothing,
}

/// Place of a walk in its type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Place {
    /// Offset in the type.
    at: usize,
    levels: [Level; MAX_DEPTH],
    depth: usize,
    next: Next,
}

impl Place {
    /// Before a value.
    pub const START: Self = Self {
        at: 0,
        levels: [Level {
            left: 0,
            element: None,
        }; MAX_DEPTH],
        depth: 0,
        next: Next::Value,
    };

    /// The invariant: the stack is not overfull, and is empty at the end; no offset is beyond a
    /// type of `length` bytes.
    #[must_use]
    pub fn is_valid(&self, length: usize) -> bool {
        let stack_matches = match self.next {
            Next::Value => true,
            Next::Part => self.depth > 0,
            Next::Nothing => self.depth == 0,
        };
        let mut levels = self.levels.iter().enumerate();
        self.at <= length
            && stack_matches
            && self.depth <= MAX_DEPTH
            && levels.all(|(depth, level)| depth >= self.depth || level.is_within(length))
    }

    /// Number of arrays and structures around the place.
    #[must_use]
    pub const fn depth(&self) -> usize {
        self.depth
    }

    /// Number of elements or fields that are still to come in the innermost of them.
    #[must_use]
    pub fn left(&self) -> u32 {
        let innermost = self
            .depth
            .checked_sub(1)
            .and_then(|top| self.levels.get(top));
        innermost.map_or(0, |level| level.left)
    }
}

/// Walk over one value.
#[derive(Clone, Debug)]
pub struct Walk<'t, 'v> {
    ty: &'t [u8],
    value: Reader<'v>,
    place: Place,
    /// Passes arrays of fixed elements in one step.
    skips: bool,
}

impl<'t, 'v> Walk<'t, 'v> {
    /// Walk over the value of a type at the front of bytes.
    #[must_use]
    pub const fn new(ty: &Type<'t>, value: &'v [u8]) -> Self {
        Self {
            ty: ty.bytes(),
            value: Reader::new(ty.version(), value),
            place: Place::START,
            skips: false,
        }
    }

    /// Walk at a place, if it is a valid one.
    #[must_use]
    pub fn from_parts(ty: &Type<'t>, value: &'v [u8], place: Place) -> Option<Self> {
        let walk = Self {
            place,
            ..Self::new(ty, value)
        };
        walk.is_valid().then_some(walk)
    }

    /// The invariant: [`Place::is_valid`].
    #[must_use]
    pub fn is_valid(&self) -> bool {
        self.place.is_valid(self.ty.len())
    }

    /// Place in the type.
    #[must_use]
    pub const fn place(&self) -> &Place {
        &self.place
    }

    /// Bytes that are left of those given; behind the value when it has ended.
    #[must_use]
    pub const fn rest(&self) -> &'v [u8] {
        self.value.rest()
    }

    /// Next step; `None` when the value has ended.
    ///
    /// # Errors
    /// `Incomplete` if the bytes end within the value; `Limit` if an array or a text exceeds
    /// [`MAX_VALUE`](crate::MAX_VALUE) bytes.
    pub fn step(&mut self) -> Result<Option<Step<'t, 'v>>, ErrorKind> {
        if self.place.next == Next::Part {
            if let Some(step) = self.part()? {
                return Ok(Some(step));
            }
        }
        if self.place.next == Next::Value {
            self.value().map(Some)
        } else {
            Ok(None)
        }
    }

    /// Field, or end of the innermost array or structure; `None` if an element begins, which is a
    /// value.
    fn part(&mut self) -> Result<Option<Step<'t, 'v>>, ErrorKind> {
        let top = self.place.depth.saturating_sub(1);
        let Some(level) = self.place.levels.get_mut(top) else {
            return Ok(Some(self.leave(None)));
        };
        let Level { left, element } = *level;
        if left == 0 {
            return Ok(Some(self.leave(element)));
        }
        level.left = left.saturating_sub(1);
        self.place.next = Next::Value;
        if let Some((start, _)) = element {
            self.place.at = start;
            return Ok(None);
        }
        let mut ty = self.ty();
        let name = ty.text(MAX_TYPE, Limit::TypeBytes)?;
        self.place.at = self.offset(&ty);
        Ok(Some(Step::Field(name)))
    }

    /// Pops a level; `element` is of the array that ends.
    fn leave(&mut self, element: Option<(usize, usize)>) -> Step<'t, 'v> {
        if let Some((_, end)) = element {
            self.place.at = end;
        }
        self.place.depth = self.place.depth.saturating_sub(1);
        self.end_of_value();
        Step::Leave
    }

    fn value(&mut self) -> Result<Step<'t, 'v>, ErrorKind> {
        let mut ty = self.ty();
        match ty.number()? {
            ARRAY => self.array(ty),
            STRUCTURE => {
                let fields = ty.number()?;
                self.enter(Level {
                    left: fields,
                    element: None,
                })?;
                self.place.at = self.offset(&ty);
                Ok(Step::Structure(fields))
            }
            code => {
                let primitive = Primitive::from_code(ty.version(), code)?;
                let leaf = leaf(primitive, &mut self.value)?;
                self.place.at = self.offset(&ty);
                self.end_of_value();
                Ok(Step::Leaf(leaf))
            }
        }
    }

    /// Beginning of an array, behind its code.
    fn array(&mut self, mut ty: Reader<'t>) -> Result<Step<'t, 'v>, ErrorKind> {
        let indices = ty.number()?;
        let mut value = self.value;
        let sizes = Sizes {
            indices,
            of_type: ty,
            of_value: value,
        };
        let count = elements(indices, &mut ty, &mut value)?.ok_or(Limit::Value)?;
        let start = self.offset(&ty);
        let (extent, length) = scan(ty.version(), ty.rest())?;
        let end = start.saturating_add(length);
        if extent.smallest == 0 {
            return Err(Malformed::EmptyElement.into());
        }
        // Before any loop over the elements: the smallest of them must fit.
        let bytes = to_usize(product(count, extent.smallest).ok_or(Limit::Value)?);
        if bytes > value.rest().len() {
            return Err(ErrorKind::Incomplete);
        }
        if self.skips && extent.fixed {
            value.read_exact(bytes)?;
            self.value = value;
            self.place.at = end;
            self.end_of_value();
            return Ok(Step::Skipped);
        }
        self.enter(Level {
            left: count,
            element: Some((start, end)),
        })?;
        self.value = value;
        Ok(Step::Array(sizes))
    }

    fn enter(&mut self, level: Level) -> Result<(), ErrorKind> {
        *self
            .place
            .levels
            .get_mut(self.place.depth)
            .ok_or(Limit::Depth)? = level;
        self.place.depth = self.place.depth.saturating_add(1);
        self.place.next = Next::Part;
        Ok(())
    }

    const fn end_of_value(&mut self) {
        self.place.next = if self.place.depth == 0 {
            Next::Nothing
        } else {
            Next::Part
        };
    }

    /// Type from the place on.
    fn ty(&self) -> Reader<'t> {
        Reader::new(
            self.value.version(),
            self.ty.get(self.place.at..).unwrap_or_default(),
        )
    }

    /// Offset of a cursor in the type.
    fn offset(&self, ty: &Reader<'t>) -> usize {
        self.ty.len().saturating_sub(ty.rest().len())
    }
}

/// Takes a value without parts.
fn leaf<'v>(primitive: Primitive, value: &mut Reader<'v>) -> Result<Leaf<'v>, ErrorKind> {
    Ok(match primitive {
        Primitive::Boolean => Leaf::Boolean(u8::from_be_bytes(value.array()?)),
        Primitive::Byte => Leaf::Byte(u8::from_be_bytes(value.array()?)),
        Primitive::Short => Leaf::Short(i16::from_be_bytes(value.array()?)),
        Primitive::Int => Leaf::Int(i32::from_be_bytes(value.array()?)),
        Primitive::Long => Leaf::Long(i64::from_be_bytes(value.array()?)),
        Primitive::Float => Leaf::Float(u32::from_be_bytes(value.array()?)),
        Primitive::Double => Leaf::Double(u64::from_be_bytes(value.array()?)),
        Primitive::String => Leaf::String(value.text(to_usize(MAX_VALUE), Limit::Value)?),
        Primitive::Reference => Leaf::Reference(u32::from_be_bytes(value.array()?)),
    })
}

/// Number of bytes of the value of a type at the front of bytes, without a look at what needs none.
///
/// # Errors
/// Those of [`Walk::step`].
#[inline]
pub fn value_len(ty: &Type<'_>, bytes: &[u8]) -> Result<usize, ErrorKind> {
    match ty.fixed_size() {
        Some(size) if size <= bytes.len() => Ok(size),
        Some(_) => Err(ErrorKind::Incomplete),
        None => walked_len(ty, bytes),
    }
}

/// Number of bytes of a value, by a walk over it.
fn walked_len(ty: &Type<'_>, bytes: &[u8]) -> Result<usize, ErrorKind> {
    let mut walk = Walk {
        skips: true,
        ..Walk::new(ty, bytes)
    };
    while walk.step()?.is_some() {}
    Ok(bytes.len().saturating_sub(walk.rest().len()))
}
