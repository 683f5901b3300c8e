//! Channel `/scene`: the machine as Foxglove's 3-D panel draws it, 30 times per second of ticks.

use std::io;

use gantry_tau_machine::figure::{Displaced, Figure, Moving, Position};
use gantry_tau_server::publication::Samples;
use serde_json::{Map, Value, json};

use super::entities::update;
use super::writer::{ChannelId, McapWriter};

/// Ticks from one picture to the next.
const EVERY: u64 = 33;

/// The channel, and the machine that it shows.
pub(super) struct SceneChannel {
    channel: ChannelId,
    /// Name of the robot file.
    name: String,
    machine: Box<dyn Moving>,
    /// Tick of the last picture.
    shown: Option<u64>,
}

impl SceneChannel {
    /// Adds the channel. Its schema is that of the machine at home.
    pub(super) fn open(
        writer: &mut McapWriter,
        name: &str,
        machine: Box<dyn Moving>,
    ) -> io::Result<Self> {
        let scene = machine.scene();
        let at_home = Figure::at_home(scene);
        let example = serde_json::to_value(update(name, scene, &at_home, 0))?;
        let channel = writer.channel(
            "/scene",
            "foxglove.SceneUpdate",
            schema_of(&example).to_string().as_bytes(),
        )?;
        Ok(Self {
            channel,
            name: name.to_owned(),
            machine,
            shown: None,
        })
    }

    /// Adds a picture if one is due. Without one: positions that this machine cannot have.
    pub(super) fn show<const N: usize>(
        &mut self,
        writer: &mut McapWriter,
        tick: u64,
        time_ns: u64,
        samples: &Samples<N>,
    ) -> io::Result<()> {
        if self
            .shown
            .is_some_and(|shown| (shown..shown.saturating_add(EVERY)).contains(&tick))
        {
            return Ok(());
        }
        self.shown = Some(tick);
        let positions = samples.axes.axis.map(|axis| Position {
            nominal_nm: axis.nominal_nm,
            offset_nm: axis.position_offset_nm,
        });
        let displaced = samples
            .tool
            .filter(|tool| tool.displacement_m.iter().all(|way| way.is_finite()));
        let displaced = displaced.map(|tool| Displaced {
            way_m: tool.displacement_m.into(),
            turn_rad: tool.turn_rad.into(),
        });
        let Ok(figure) = self.machine.figure(&positions, displaced) else {
            return Ok(());
        };
        let text =
            serde_json::to_string(&update(&self.name, self.machine.scene(), &figure, time_ns))?;
        writer.message(self.channel, time_ns, text.as_bytes())
    }
}

/// JSON schema of values like this one; a list has elements like its first.
fn schema_of(example: &Value) -> Value {
    match example {
        Value::Null => json!({ "type": "null" }),
        Value::Bool(_) => json!({ "type": "boolean" }),
        Value::Number(number) => {
            json!({ "type": if number.is_f64() { "number" } else { "integer" } })
        }
        Value::String(_) => json!({ "type": "string" }),
        Value::Array(all) => {
            json!({ "type": "array", "items": all.first().map_or_else(|| json!({}), schema_of) })
        }
        Value::Object(fields) => {
            let properties: Map<String, Value> = fields
                .iter()
                .map(|(name, field)| (name.clone(), schema_of(field)))
                .collect();
            json!({ "type": "object", "properties": properties })
        }
    }
}
