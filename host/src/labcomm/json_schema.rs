//! Types as JSON schemas of their values.

use gantry_tau_labcomm::{Kind, Primitive, Type};
use serde_json::{Map, Value, json};

/// Returns the schema of the JSON that [`to_json`](super::to_json) writes for a type.
pub(crate) fn json_schema(of: &Type<'_>) -> Value {
    match of.kind() {
        Kind::Primitive(primitive) => json!({ "type": name(primitive) }),
        Kind::Array(array) => {
            let sizes: Vec<u32> = array.indices().collect();
            let element = json_schema(&array.element());
            sizes.iter().rev().fold(element, |items, size| match size {
                0 => json!({ "type": "array", "items": items }),
                size => json!({ "type": "array", "items": items, "minItems": size, "maxItems": size }),
            })
        }
        Kind::Structure(structure) => {
            let fields =
                structure.fields().map(|(name, of)| (String::from_utf8_lossy(name).into_owned(), json_schema(&of)));
            let properties: Map<String, Value> = fields.collect();
            let required: Vec<&String> = properties.keys().collect();
            json!({ "type": "object", "required": required, "properties": properties })
        }
    }
}

const fn name(of: Primitive) -> &'static str {
    match of {
        Primitive::Boolean => "boolean",
        Primitive::String => "string",
        Primitive::Float | Primitive::Double => "number",
        Primitive::Byte | Primitive::Short | Primitive::Int | Primitive::Long | Primitive::Reference => "integer",
    }
}
