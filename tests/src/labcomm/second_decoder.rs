//! A second decoder of LabComm streams, written from `docs/labcomm.md` alone, for comparison with
//! the crate.
//!
//! It takes a whole stream at once. For every stream memory and work stay within a fixed
//! multiple of its length: values are flat lists in the order of the stream, so that neither
//! structures within each other nor void fields cost anything.

use std::collections::BTreeMap;
use std::rc::Rc;

// Limits of a type, a name, a value or packet, and a stream.
const TYPE_BYTES: u64 = 2_048;
const DEPTH: u32 = 16;
const FIELDS: u32 = 256;
const NAME_BYTES: u32 = 1_024;
const VALUE_BYTES: u64 = 16 << 20;
const ELEMENTS: u64 = 1 << 24;
const DEFINITIONS: usize = 256;
const DEFINITION_BYTES: u64 = 64 << 10;

/// One item of a stream. `at` is the offset where it begins.
#[derive(Clone, Debug, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum Event {
    /// Version packet.
    Version { at: u64, text: Vec<u8> },
    /// Definition of a sample, also one that repeats an earlier one.
    Define {
        at: u64,
        index: u32,
        name: Vec<u8>,
        kind: Type,
    },
    /// Packet 0x03, a type that sample references name.
    Reference {
        at: u64,
        index: u32,
        name: Vec<u8>,
        kind: Type,
    },
    /// Value of a defined sample, flat: what `Value` lists, in the order of the stream.
    Data {
        at: u64,
        index: u32,
        value: Vec<Value>,
    },
    /// Packet 0x04, 0x05 or 0x3f, or data of an index without a definition, which is then the tag.
    Skip { at: u64, tag: u32 },
}

/// How a stream ends.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Ending {
    /// Behind a whole item.
    Clean,
    /// Within an item that was right so far. The contents of a packet of 2014 are judged only when
    /// all of them are there.
    Incomplete,
    /// With an item that breaks a rule.
    Refused(String),
}

/// Type of a sample.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Type {
    /// Code of a type without parts: 0x20, boolean, to 0x28, sample reference.
    Basic(u32),
    /// Sizes of the indices, 0 where each value has its own; and the type of an element.
    Array(Vec<u32>, Box<Type>),
    /// Names and types of the fields; none in void.
    Struct(Vec<(Vec<u8>, Type)>),
}

/// Part of a value. Floats are their bits.
#[derive(Clone, Debug, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum Value {
    Boolean(bool),
    Byte(u8),
    Short(i16),
    Int(i32),
    Long(i64),
    Float(u32),
    Double(u64),
    Text(Vec<u8>),
    Sample(u32),
    /// Size of one variable index. The sizes of an array stand before its elements.
    Size(u32),
}

/// Decodes a stream of either generation: what it contains, and how it ends.
pub fn decode(stream: &[u8]) -> (Vec<Event>, Ending) {
    let mut events = Vec::new();
    let packed = match stream.first() {
        None => return (events, Ending::Clean),
        Some(0x00) => false,
        Some(0x01) => true,
        Some(0x02 | 0x0b) => return (events, refused("LabComm2013")),
        Some(byte) => {
            return (
                events,
                Ending::Refused(format!("no stream begins with {byte:02x}")),
            );
        }
    };
    let known = BTreeMap::new();
    let mut reader = Reader {
        stream,
        at: 0,
        packed,
        limit: u64::MAX,
        over: "",
        known,
        known_bytes: 0,
    };
    while reader.at < length(stream) {
        match reader.item() {
            Ok(event) => events.push(event),
            Err(ending) => return (events, ending),
        }
    }
    (events, Ending::Clean)
}

/// How to read values of a type: what remains of it without names, void and fixed sizes.
struct Plan {
    /// Bytes of the smallest value, 0 only for a type whose values never have any.
    least: u64,
    shape: Shape,
}

enum Shape {
    Basic(u32),
    Array {
        variable: u32,
        fixed: u64,
        element: Box<Plan>,
    },
    Struct(Vec<Plan>),
}

struct Reader<'a> {
    stream: &'a [u8],
    at: u64,
    /// 2014: numbers are packed, and packets state their length.
    packed: bool,
    /// Offset that nothing may pass, beyond the end of the stream too, and what is wrong when
    /// something does.
    limit: u64,
    over: &'static str,
    /// What was defined so far, and the bytes of its names and types.
    known: BTreeMap<u32, (Vec<u8>, Type, Rc<Plan>)>,
    known_bytes: u64,
}

/// Index, name, type and bytes of the type.
type Declaration = (u32, Vec<u8>, (Type, Plan), u64);

impl Reader<'_> {
    fn item(&mut self) -> Result<Event, Ending> {
        let at = self.at;
        (self.limit, self.over) = (u64::MAX, "");
        let tag = self.number()?;
        let listed = if self.packed {
            matches!(tag, 0x01..=0x05 | 0x3f)
        } else {
            tag == 0x02
        };
        if tag < 0x40 && !listed || tag == 0x01 && at > 0 {
            return Err(Ending::Refused(format!("tag {tag:#04x} at {at}")));
        }
        if self.packed {
            let bytes = u64::from(self.number()?);
            refuse_if(bytes > VALUE_BYTES, "packet over the limit")?;
            (self.limit, self.over) = (
                self.at.saturating_add(bytes),
                "contents longer than the packet",
            );
            if self.limit > length(self.stream) {
                return Err(Ending::Incomplete);
            }
        }
        let event = match tag {
            0x01 => {
                let text = self.text(u32::MAX)?;
                refuse_if(
                    text != b"LabComm2014.v1" && text != b"LabComm2014",
                    "version text",
                )?;
                Event::Version { at, text }
            }
            0x02 => self.definition(at)?,
            0x03 => {
                let (index, name, (kind, _), _) = self.declaration()?;
                Event::Reference {
                    at,
                    index,
                    name,
                    kind,
                }
            }
            _ => match self.known.get(&tag).map(|(_, _, plan)| Rc::clone(plan)) {
                Some(plan) => {
                    if !self.packed {
                        (self.limit, self.over) =
                            (self.at.saturating_add(VALUE_BYTES), "value over the limit");
                    }
                    let mut value = Vec::new();
                    self.value(&plan, &mut value)?;
                    Event::Data {
                        at,
                        index: tag,
                        value,
                    }
                }
                None if self.packed => {
                    self.at = self.limit;
                    Event::Skip { at, tag }
                }
                None => return Err(refused("data without a definition")),
            },
        };
        refuse_if(
            self.packed && self.at != self.limit,
            "contents shorter than the packet",
        )?;
        Ok(event)
    }

    fn definition(&mut self, at: u64) -> Result<Event, Ending> {
        let (index, name, (kind, plan), bytes) = self.declaration()?;
        if let Some((known_name, known_kind, _)) = self.known.get(&index) {
            refuse_if(
                *known_name != name || *known_kind != kind,
                "index defined twice, in two ways",
            )?;
        } else {
            self.known_bytes = self
                .known_bytes
                .saturating_add(length(&name))
                .saturating_add(bytes);
            let over = self.known.len() >= DEFINITIONS || self.known_bytes > DEFINITION_BYTES;
            refuse_if(over, "definitions over the limit")?;
            self.known
                .insert(index, (name.clone(), kind.clone(), Rc::new(plan)));
        }
        Ok(Event::Define {
            at,
            index,
            name,
            kind,
        })
    }

    /// Reads what definitions and references have in common.
    fn declaration(&mut self) -> Result<Declaration, Ending> {
        let index = self.number()?;
        refuse_if(index < 0x40, "index below 0x40")?;
        let name = self.text(NAME_BYTES)?;
        let outer = (self.limit, self.over);
        if self.packed {
            let bytes = u64::from(self.number()?);
            refuse_if(bytes > TYPE_BYTES, "type over the limit")?;
            let end = self.at.saturating_add(bytes);
            refuse_if(end > self.limit, self.over)?;
            (self.limit, self.over) = (end, "type longer than stated");
        } else {
            (self.limit, self.over) = (self.at.saturating_add(TYPE_BYTES), "type over the limit");
        }
        let begin = self.at;
        let parts = self.kind(0, &mut 0)?;
        refuse_if(
            self.packed && self.at != self.limit,
            "type shorter than stated",
        )?;
        (self.limit, self.over) = outer;
        Ok((index, name, parts, self.at.saturating_sub(begin)))
    }

    fn kind(&mut self, depth: u32, fields: &mut u32) -> Result<(Type, Plan), Ending> {
        let code = self.number()?;
        let least = match code {
            0x10 | 0x11 if depth >= DEPTH => {
                return Err(refused("too many types within each other"));
            }
            0x10 => return self.array(depth, fields),
            0x11 => return self.structure(depth, fields),
            0x20 | 0x21 => 1,
            0x22 => 2,
            0x23 | 0x25 => 4,
            0x24 | 0x26 => 8,
            0x27 => self.number_bytes(),
            0x28 if self.packed => 4,
            _ => return Err(Ending::Refused(format!("type code {code:#04x}"))),
        };
        Ok((
            Type::Basic(code),
            Plan {
                least,
                shape: Shape::Basic(code),
            },
        ))
    }

    fn array(&mut self, depth: u32, fields: &mut u32) -> Result<(Type, Plan), Ending> {
        let indices = self.number()?;
        self.room(u64::from(indices).saturating_mul(self.number_bytes()))?;
        let (mut sizes, mut variable, mut fixed) = (Vec::new(), 0_u32, 1_u64);
        for _ in 0..indices {
            let size = self.number()?;
            match size {
                0 => variable = variable.saturating_add(1),
                _ => fixed = fixed.saturating_mul(u64::from(size)),
            }
            refuse_if(fixed > ELEMENTS, "fixed sizes over the limit")?;
            sizes.push(size);
        }
        let (kind, plan) = self.kind(depth.saturating_add(1), fields)?;
        // The rule that bounds work by bytes: without it 2^32 elements would cost one size.
        refuse_if(plan.least == 0, "array whose elements take no bytes")?;
        let least = match variable {
            0 => fixed.saturating_mul(plan.least),
            _ => u64::from(variable).saturating_mul(self.number_bytes()),
        };
        refuse_if(least > VALUE_BYTES, "smallest value over the limit")?;
        let shape = Shape::Array {
            variable,
            fixed,
            element: Box::new(plan),
        };
        Ok((Type::Array(sizes, Box::new(kind)), Plan { least, shape }))
    }

    fn structure(&mut self, depth: u32, fields: &mut u32) -> Result<(Type, Plan), Ending> {
        let number = self.number()?;
        *fields = fields.saturating_add(number);
        refuse_if(*fields > FIELDS, "too many fields")?;
        let (mut kinds, mut plans, mut least) = (Vec::new(), Vec::new(), 0_u64);
        for _ in 0..number {
            let name = self.text(u32::MAX)?;
            let (kind, plan) = self.kind(depth.saturating_add(1), fields)?;
            kinds.push((name, kind));
            // Void is left out of the plan, lest an array of structures visits 255 void fields per
            // byte.
            if plan.least > 0 {
                least = least.saturating_add(plan.least);
                refuse_if(least > VALUE_BYTES, "smallest value over the limit")?;
                plans.push(plan);
            }
        }
        Ok((
            Type::Struct(kinds),
            Plan {
                least,
                shape: Shape::Struct(plans),
            },
        ))
    }

    fn value(&mut self, plan: &Plan, out: &mut Vec<Value>) -> Result<(), Ending> {
        match &plan.shape {
            Shape::Basic(basic) => out.push(self.basic(*basic)?),
            Shape::Struct(plans) => plans.iter().try_for_each(|part| self.value(part, out))?,
            Shape::Array {
                variable,
                fixed,
                element,
            } => {
                // Saturated or not, a product with a size of 0 is 0.
                let mut count = *fixed;
                for _ in 0..*variable {
                    let size = self.number()?;
                    out.push(Value::Size(size));
                    count = count.saturating_mul(u64::from(size));
                }
                self.room(count.saturating_mul(element.least))?;
                for _ in 0..count {
                    self.value(element, out)?;
                }
            }
        }
        Ok(())
    }

    fn basic(&mut self, code: u32) -> Result<Value, Ending> {
        Ok(match code {
            0x20 => Value::Boolean(self.fixed::<1>()? != [0]),
            0x21 => Value::Byte(u8::from_be_bytes(self.fixed()?)),
            0x22 => Value::Short(i16::from_be_bytes(self.fixed()?)),
            0x23 => Value::Int(i32::from_be_bytes(self.fixed()?)),
            0x24 => Value::Long(i64::from_be_bytes(self.fixed()?)),
            0x25 => Value::Float(u32::from_be_bytes(self.fixed()?)),
            0x26 => Value::Double(u64::from_be_bytes(self.fixed()?)),
            0x27 => Value::Text(self.text(u32::MAX)?),
            _ => Value::Sample(u32::from_be_bytes(self.fixed()?)),
        })
    }

    fn text(&mut self, most: u32) -> Result<Vec<u8>, Ending> {
        let bytes = self.number()?;
        refuse_if(bytes > most, "name over the limit")?;
        Ok(self.consume(u64::from(bytes))?.to_vec())
    }

    /// Bytes of the shortest number.
    fn number_bytes(&self) -> u64 {
        if self.packed { 1 } else { 4 }
    }

    /// Reads a number of the protocol.
    fn number(&mut self) -> Result<u32, Ending> {
        if !self.packed {
            return Ok(u32::from_be_bytes(self.fixed()?));
        }
        let mut number = 0_u32;
        loop {
            let [byte] = self.fixed()?;
            // Checked before the shift: another group would push bits out of the number.
            refuse_if(
                byte == 0x80 && number == 0 || number > u32::MAX >> 7,
                "packed number",
            )?;
            number = number << 7 | u32::from(byte & 0x7f);
            if byte & 0x80 == 0 {
                return Ok(number);
            }
        }
    }

    fn fixed<const N: usize>(&mut self) -> Result<[u8; N], Ending> {
        let bytes = self.consume(u64::try_from(N).unwrap_or(u64::MAX))?;
        bytes.try_into().map_err(|_| Ending::Incomplete)
    }

    fn consume(&mut self, bytes: u64) -> Result<&[u8], Ending> {
        self.room(bytes)?;
        let end = self.at.saturating_add(bytes);
        let range = usize::try_from(self.at).ok().zip(usize::try_from(end).ok());
        let taken = range
            .and_then(|(begin, end)| self.stream.get(begin..end))
            .ok_or(Ending::Incomplete)?;
        self.at = end;
        Ok(taken)
    }

    /// Refuses what cannot fit, whether or not the stream goes on that far.
    fn room(&self, bytes: u64) -> Result<(), Ending> {
        refuse_if(bytes > self.limit.saturating_sub(self.at), self.over)
    }
}

fn refuse_if(wrong: bool, why: &str) -> Result<(), Ending> {
    if wrong { Err(refused(why)) } else { Ok(()) }
}

fn refused(why: &str) -> Ending {
    Ending::Refused(String::from(why))
}

fn length(bytes: &[u8]) -> u64 {
    u64::try_from(bytes.len()).unwrap_or(u64::MAX)
}
