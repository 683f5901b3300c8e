//! Types as JSON schemas of their values.

use gantry_tau_labcomm::{Kind, Primitive, Type};
use serde_json::{Map, Value, json};

/// Returns the schema of the JSON that [`to_json`](super::to_json) writes for a type, with `null`
/// for floats that are not finite. `describe` adds to the schema of a field what its name says
/// beyond its type.
pub(crate) fn json_schema(
    of: &Type<'_>,
    describe: &impl Fn(&str, &mut Map<String, Value>),
) -> Value {
    match of.kind() {
        Kind::Primitive(primitive) => json!({ "type": name(primitive) }),
        Kind::Array(array) => {
            let sizes: Vec<u32> = array.indices().collect();
            let element = json_schema(&array.element(), describe);
            sizes.iter().rev().fold(element, |items, size| match size {
                0 => json!({ "type": "array", "items": items }),
                size => {
                    json!({ "type": "array", "items": items, "minItems": size, "maxItems": size })
                }
            })
        }
        Kind::Structure(structure) => {
            let fields = structure.fields().map(|(name, of)| {
                let name = String::from_utf8_lossy(name).into_owned();
                let mut schema = json_schema(&of, describe);
                if let Value::Object(schema) = &mut schema {
                    describe(&name, schema);
                }
                (name, schema)
            });
            let properties: Map<String, Value> = fields.collect();
            let required: Vec<&String> = properties.keys().collect();
            json!({ "type": "object", "required": required, "properties": properties, "additionalProperties": false })
        }
    }
}

/// Types of a value in JSON.
fn name(of: Primitive) -> Value {
    match of {
        Primitive::Boolean => "boolean".into(),
        Primitive::String => "string".into(),
        Primitive::Float | Primitive::Double => json!(["number", "null"]),
        Primitive::Byte
        | Primitive::Short
        | Primitive::Int
        | Primitive::Long
        | Primitive::Reference => "integer".into(),
    }
}
