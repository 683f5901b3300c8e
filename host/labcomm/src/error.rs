//! Errors of decoding and encoding.

/// Error of a stream, with its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Error {
    /// Offset in the stream of the packet (2014), definition or data (2006) that has the error,
    /// bytes.
    pub at: u64,
    /// The reason.
    pub kind: ErrorKind,
}

/// Reason of an error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub enum ErrorKind {
    /// The bytes end within a number, text, type or value.
    Incomplete,
    /// The bytes are not LabComm.
    Malformed(Malformed),
    /// The stream begins as another generation, or names another version.
    Version(Unsupported),
    /// Data of an index without a definition. 2006 only: there is no length to skip by.
    UnknownIndex(u32),
    /// Second definition of an index, with another name or type.
    Conflict(u32),
    /// Beyond a limit of the decoder, or of the buffer to encode into.
    Limit(Limit),
}

/// Part of a stream that breaks the format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub enum Malformed {
    /// First byte of no generation.
    Start,
    /// Packed number with a leading zero group.
    LongNumber,
    /// Packed number above `u32::MAX`.
    LargeNumber,
    /// Packet that is neither version, definition, reference, something to skip, nor data.
    Tag(u32),
    /// Number that is not the code of a type.
    TypeCode(u32),
    /// Array whose elements take no bytes.
    EmptyElement,
    /// Packet whose contents are shorter or longer than it states.
    PacketLength,
    /// Definition with an index below 0x40.
    Index(u32),
    /// Version packet that is not the first, or a first packet that is none.
    VersionPlace,
}

/// Version that is not decoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub enum Unsupported {
    /// LabComm2013, of February 2013 to November 2014.
    LabComm2013,
    /// Version text other than "LabComm2014.v1" and "LabComm2014".
    Text,
}

/// Limit that is exceeded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub enum Limit {
    /// Type of more than [`MAX_TYPE`](crate::MAX_TYPE) bytes.
    TypeBytes,
    /// More than [`MAX_DEPTH`](crate::MAX_DEPTH) arrays and structures within each other.
    Depth,
    /// More than [`MAX_FIELDS`](crate::MAX_FIELDS) fields in all structures of a type.
    Fields,
    /// Name of more than [`MAX_NAME`](crate::MAX_NAME) bytes.
    Name,
    /// Value or packet of more bytes than the decoder takes, or than
    /// [`MAX_VALUE`](crate::MAX_VALUE).
    Value,
    /// More definitions than the registry takes.
    Definitions,
    /// More bytes of names and types than the registry takes.
    DefinitionBytes,
    /// Buffer to encode into is full.
    Room,
}

impl From<Malformed> for ErrorKind {
    fn from(what: Malformed) -> Self {
        Self::Malformed(what)
    }
}

impl From<Limit> for ErrorKind {
    fn from(limit: Limit) -> Self {
        Self::Limit(limit)
    }
}

impl core::fmt::Display for Error {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "at byte {}: {}", self.at, self.kind)
    }
}

impl core::fmt::Display for ErrorKind {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Incomplete => f.write_str("the bytes end within a number, text, type or value"),
            Self::Malformed(what) => write!(f, "{what}"),
            Self::Version(version) => write!(f, "{version}"),
            Self::UnknownIndex(index) => {
                write!(f, "data of index {index:#x}, which has no definition")
            }
            Self::Conflict(index) => write!(
                f,
                "index {index:#x} is defined again, with another name or type"
            ),
            Self::Limit(limit) => write!(f, "{limit}"),
        }
    }
}

impl core::fmt::Display for Malformed {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Start => f.write_str(
                "the first byte starts no LabComm stream: expected 00 (2006) or 01 (2014)",
            ),
            Self::LongNumber => f.write_str("a packed number begins with a zero group"),
            Self::LargeNumber => f.write_str("a packed number exceeds 32 bits"),
            Self::Tag(tag) => write!(f, "{tag:#x} starts neither a definition nor data"),
            Self::TypeCode(code) => write!(f, "{code:#x} is not the code of a type"),
            Self::EmptyElement => f.write_str("an array has elements that take no bytes"),
            Self::PacketLength => {
                f.write_str("the contents of a packet are not as long as it states")
            }
            Self::Index(index) => write!(
                f,
                "a definition has index {index:#x}; indices begin at 0x40"
            ),
            Self::VersionPlace => {
                f.write_str("the version packet must be the first packet, and only that")
            }
        }
    }
}

impl core::fmt::Display for Unsupported {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::LabComm2013 => {
                "the stream is LabComm2013, which is obsolete: send version 2006 or 2014"
            }
            Self::Text => "the version text is neither \"LabComm2014.v1\" nor \"LabComm2014\"",
        })
    }
}

impl core::fmt::Display for Limit {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::TypeBytes => write!(f, "a type has more than {} bytes", crate::MAX_TYPE),
            Self::Depth => write!(f, "a type is nested more than {} deep", crate::MAX_DEPTH),
            Self::Fields => write!(f, "a type has more than {} fields", crate::MAX_FIELDS),
            Self::Name => write!(f, "a name has more than {} bytes", crate::MAX_NAME),
            Self::Value => f.write_str("a value has more bytes than the decoder takes"),
            Self::Definitions => {
                f.write_str("the stream has more definitions than the decoder takes")
            }
            Self::DefinitionBytes => {
                f.write_str("names and types have more bytes than the decoder takes")
            }
            Self::Room => f.write_str("the buffer to encode into is full"),
        }
    }
}

impl core::error::Error for Error {}
impl core::error::Error for ErrorKind {}
