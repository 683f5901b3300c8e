//! Reasons why a JSON line is not encoded.

use gantry_tau_labcomm::ErrorKind;
use serde_json::Value;

/// Reason why a line is not encoded. Fields named `json` are the front of what stands in the line.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum LineError {
    /// The encoder refuses it.
    #[error(transparent)]
    Encoder(#[from] ErrorKind),
    /// It is too long.
    #[error("is longer than {longest} bytes")]
    TooLong {
        /// Largest length, bytes.
        longest: usize,
    },
    /// It is not a text.
    #[error("is not UTF-8")]
    NotUtf8,
    /// It is not JSON.
    #[error("not JSON: {reason}")]
    NotJson {
        /// The reader's reason.
        reason: String,
    },
    /// `index` is not one.
    #[error("{json} is not an index")]
    NotAnIndex {
        /// The value.
        json: String,
    },
    /// The line says that the recording has failed here.
    #[error("the recording ends with an error: {json}")]
    EndsWithError {
        /// That error.
        json: String,
    },
    /// `type` is missing.
    #[error("a definition without \"type\"")]
    NoType,
    /// `value` is missing.
    #[error("a sample without \"value\"")]
    NoValue,
    /// The line is neither a definition nor a sample.
    #[error("expected \"define\" or \"sample\"")]
    UnknownKind,
    /// A sample that no line before defines.
    #[error("no definition of {sample}")]
    Undefined {
        /// Its name, JSON.
        sample: String,
    },
    /// A name is not a text.
    #[error("expected a text or {{\"bytes\":\"hex\"}}, got {json}")]
    NotAText {
        /// The value.
        json: String,
    },
    /// `type` is not one.
    #[error("{json} is not a type")]
    NotAType {
        /// The value.
        json: String,
    },
    /// Two fields of a structure have one name.
    #[error("a structure has two fields named {field}; values could not tell them apart")]
    DuplicateField {
        /// The name.
        field: String,
    },
    /// A type has too many sizes or fields.
    #[error("a type has more than 2^32 parts")]
    TooManyParts,
    /// The value of a structure is not an object.
    #[error("expected an object, got {json}")]
    NotAnObject {
        /// The value.
        json: String,
    },
    /// A field of a structure has no value.
    #[error("field {field} is missing")]
    MissingField {
        /// Its name.
        field: String,
    },
    /// An object has more fields than the structure.
    #[error("the object has a field that the type has not")]
    UnknownField,
    /// The value of a field is wrong.
    #[error("{field}: {reason}")]
    Field {
        /// Its name.
        field: String,
        /// The reason.
        #[source]
        reason: Box<Self>,
    },
    /// A value is not of its primitive type.
    #[error("expected a value of type {expected}, got {json}")]
    NotOfType {
        /// Name of the type.
        expected: &'static str,
        /// The value.
        json: String,
    },
    /// The lists of an array are not as deep as it has indices.
    #[error("expected lists within each other, one level for each of {indices} indices")]
    Depth {
        /// Number of indices.
        indices: usize,
    },
    /// A list is too long.
    #[error("a list has 2^32 elements or more")]
    ListTooLong,
    /// An array is not rectangular.
    #[error("lists of one index have different lengths")]
    Ragged,
    /// A list has another length than the type.
    #[error("expected a list of {expected}, got one of {length}")]
    ListLength {
        /// Length by the type.
        expected: u32,
        /// Length of the list.
        length: u32,
    },
    /// An array with elements is an empty list.
    #[error("expected an array of {sizes:?}, got an empty list")]
    EmptyList {
        /// Sizes by the type.
        sizes: Vec<u32>,
    },
}

/// The front of a JSON text.
pub(super) fn short(json: &Value) -> String {
    let text = json.to_string();
    if text.chars().count() > 40 {
        text.chars().take(37).chain("...".chars()).collect()
    } else {
        text
    }
}
