//! A recording as MCAP, read back by the format's own crate.

use gantry_tau_machine::model::{F1_MOTORS, L2_MOTORS, MachineKind};
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_test_support::recordings::{Samples, compare, csv_rows};
use gantry_tau_test_support::sessions;
use serde_json::Value;

use super::to;
use crate::process::Folder;

/// Samples by their topics; every message has the type that the schema of its channel says.
pub(crate) fn samples(bytes: &[u8]) -> Samples {
    let mut samples = Samples::default();
    let mut last_time = 0;
    for message in mcap::MessageStream::new(bytes).unwrap() {
        let message = message.unwrap();
        let channel = &message.channel;
        let schema = channel.schema.as_ref().unwrap();
        assert_eq!(
            (channel.message_encoding.as_str(), schema.encoding.as_str()),
            ("json", "jsonschema")
        );
        let value: Value = serde_json::from_slice(&message.data).unwrap();
        assert_is(&value, &serde_json::from_slice(&schema.data).unwrap());
        assert!(message.log_time >= last_time);
        last_time = message.log_time;
        if let Some(tick) = value["tick"].as_u64() {
            assert_eq!(message.log_time, tick * 1_000_000);
        }
        samples.add(channel.topic.trim_start_matches('/'), value);
    }
    samples
}

/// Metadata about the origin of a recording.
pub(crate) fn origin(bytes: &[u8]) -> serde_json::Map<String, Value> {
    let records = mcap::read::LinearReader::new(bytes).unwrap();
    let metadata = records.filter_map(|record| match record.unwrap() {
        mcap::records::Record::Metadata(metadata) if metadata.name == "gantry-tau" => {
            Some(metadata.metadata)
        }
        _ => None,
    });
    metadata
        .flatten()
        .map(|(key, value)| (key, value.into()))
        .collect()
}

/// Fields say what they are, and in which unit.
#[test]
fn schemas_describe_their_fields() {
    let folder = Folder::new("mcap-schemas");
    let robot = RobotFile::builtin_l2().unwrap();
    sessions::run::<_, 3, L2_MOTORS>(
        &robot,
        &[to(&folder, "server.mcap")],
        to(&folder, "client.mcap"),
    );
    let bytes = std::fs::read(folder.path("server.mcap")).unwrap();
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    let [state, axes, tool] = ["state", "axes", "tool"].map(|sample| {
        let name = format!("gantry_tau.{sample}");
        let mut schemas = summary.schemas.values();
        let schema = schemas.find(|schema| schema.name == name).unwrap();
        let schema: Value = serde_json::from_slice(&schema.data).unwrap();
        schema["properties"].clone()
    });
    assert_eq!(
        state["tick"]["description"],
        "Number of the server's tick, 1 ms each"
    );
    assert_eq!(
        (&state["tick"]["unit"], &state["epoch"]["unit"]),
        (&"ms".into(), &Value::Null)
    );
    assert_eq!(state["epoch"]["description"], "Epoch of the session");
    assert_eq!(
        state["phase"]["oneOf"][3],
        serde_json::json!({ "const": 3, "title": "Obtain" })
    );
    let axis = &axes["axis"]["items"]["properties"];
    for (field, unit) in [
        ("nominal_nm", "nm"),
        ("actual_velocity_um_s", "µm/s"),
        ("torque_offset_permille", "per mille of the rated torque"),
    ] {
        assert_eq!(axis[field]["unit"], unit, "{field}");
        assert!(
            axis[field]["description"].as_str().unwrap().len() > 8,
            "{field}"
        );
    }
    assert_eq!(
        (&tool["displacement_m"]["unit"], &tool["turn_rad"]["unit"]),
        (&"m".into(), &"rad".into())
    );
    assert_eq!(tool["load"]["unit"][3], "N m");
}

/// Checks a value against its schema.
fn assert_is(value: &Value, schema: &Value) {
    if let Some(types) = schema["type"].as_array() {
        // What is not known is `null`.
        assert!(
            types == &["number", "null"] && (value.is_number() || value.is_null()),
            "{value}"
        );
        return;
    }
    if let Some(codes) = schema["oneOf"].as_array() {
        assert_eq!(
            codes.iter().filter(|code| code["const"] == *value).count(),
            1,
            "{value} is not one of {schema}"
        );
    }
    match schema["type"].as_str().unwrap() {
        "object" => {
            let properties = schema["properties"].as_object().unwrap();
            for (name, field) in value.as_object().unwrap() {
                assert_is(field, &properties[name]);
            }
            for name in schema["required"].as_array().into_iter().flatten() {
                assert!(value.get(name.as_str().unwrap()).is_some(), "{name}");
            }
        }
        "array" => {
            let all = value.as_array().unwrap();
            for key in ["minItems", "maxItems"] {
                assert!(schema.get(key).is_none_or(|count| *count == all.len()));
            }
            all.iter()
                .for_each(|item| assert_is(item, &schema["items"]));
        }
        "number" => assert!(value.is_number(), "{value}"),
        "integer" => assert!(value.is_i64() || value.is_u64(), "{value}"),
        "string" => assert!(value.is_string(), "{value}"),
        "boolean" => assert!(value.is_boolean(), "{value}"),
        other => panic!("{other}"),
    }
}

fn point(value: &Value) -> [f64; 3] {
    ["x", "y", "z"].map(|axis| value[axis].as_f64().unwrap())
}

/// Way from one point to another.
fn way(from: &Value, to: &Value) -> [f64; 3] {
    let (from, to) = (point(from), point(to));
    [0, 1, 2].map(|axis| to[axis] - from[axis])
}

fn distance(a: &Value, b: &Value) -> f64 {
    let (a, b) = (point(a), point(b));
    (0..3)
        .map(|axis| (a[axis] - b[axis]).powi(2))
        .sum::<f64>()
        .sqrt()
}

/// The lines of a picture from cart to platform are as long as the links of the robot file, and the
/// boxes of the displaced carts are away by the offsets in force, magnified.
fn check_scene<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    update: &Value,
    axes: &Value,
    tool: &Value,
) {
    let (machine, displaced) = (&update["entities"][0], &update["entities"][1]);
    assert_eq!(
        (&machine["id"], &displaced["id"]),
        (&Value::from("machine"), &Value::from("displaced"))
    );
    assert_eq!(displaced["metadata"][0]["value"], "1000");
    let lines = machine["lines"].as_array().unwrap();
    let per_arm = if N > 3 { 2 } else { 1 };
    // Guideways first, then each arm, then the platform.
    assert_eq!(lines.len(), 2 + 3 * per_arm);
    let drawn: Vec<f64> = lines[1..=3 * per_arm]
        .iter()
        .step_by(per_arm)
        .flat_map(|arm| {
            arm["points"]
                .as_array()
                .unwrap()
                .chunks(2)
                .map(|ends| distance(&ends[0], &ends[1]))
        })
        .collect();
    let lengths = robot.model.geometry().lengths_m;
    assert_eq!(drawn.len(), lengths.len());
    for (drawn, length) in drawn.iter().zip(lengths) {
        assert!((drawn - length).abs() < 5e-6, "{drawn} {length}");
    }
    // Ends of the guideways, arm by arm.
    let rails = lines[0]["points"].as_array().unwrap();
    for (arm, rail) in rails.chunks(2).take(3).enumerate() {
        let [from, to] =
            [machine, displaced].map(|entity| &entity["cubes"][arm]["pose"]["position"]);
        let moved = way(from, to);
        let (rail, length) = (way(&rail[0], &rail[1]), distance(&rail[0], &rail[1]));
        let offset = axes["axis"][arm]["position_offset_nm"].as_f64().unwrap();
        for (moved, along) in moved.iter().zip(rail) {
            assert!(
                (moved - offset * 1e-6 * along / length).abs() < 5e-6,
                "{moved} {offset} {along}"
            );
        }
    }
    // Joints are drawn smaller than the tool; carts as long as they are.
    let [of_machine, of_displaced] = [machine, displaced].map(|entity| {
        let spheres = entity["spheres"].as_array().unwrap().iter();
        let diameters = spheres.map(|sphere| sphere["size"]["x"].as_f64().unwrap());
        diameters.collect::<Vec<f64>>()
    });
    let (of_tool, of_joints) = of_machine.split_last().unwrap();
    assert_eq!(of_joints, vec![0.03; 2 * lengths.len()]);
    assert_eq!(
        (*of_tool, of_displaced.as_slice()),
        (0.04, [0.04].as_slice())
    );
    for cube in machine["cubes"].as_array().unwrap() {
        let edges = ["x", "y", "z"].map(|axis| cube["size"][axis].as_f64().unwrap());
        assert!(
            edges.iter().all(|edge| (0.01..1.0).contains(edge)),
            "{edges:?}"
        );
    }
    // The tool by its displacement.
    let [from, to] = [machine, displaced]
        .map(|entity| &entity["spheres"].as_array().unwrap().last().unwrap()["pose"]["position"]);
    for (moved, metres) in way(from, to)
        .iter()
        .zip(tool["displacement_m"].as_array().unwrap())
    {
        assert!(
            (moved - 1_000.0 * metres.as_f64().unwrap()).abs() < 5e-6,
            "{moved} {metres}"
        );
    }
}

fn check<K: MachineKind<N>, const N: usize, const M: usize>(name: &str, robot: &RobotFile<K, N>) {
    let folder = Folder::new(&format!("mcap-{name}"));
    let files = ["server.csv", "server.mcap"].map(|name| to(&folder, name));
    let (rows, events, recorded) =
        sessions::run::<K, N, M>(robot, &files, to(&folder, "client.mcap"));
    assert!(
        recorded
            .iter()
            .all(|file| file.lost == 0 && file.failure.is_none()),
        "{recorded:?}"
    );
    let bytes = std::fs::read(folder.path("server.mcap")).unwrap();
    let server = samples(&bytes);
    compare(&server, &csv_rows(&folder.path("server.csv")), N);
    let recorded = server.of("session_event").iter().map(|event| {
        let codes =
            ["kind", "cause"].map(|name| u8::try_from(event[name].as_u64().unwrap()).unwrap());
        (codes, event["text"].as_str().unwrap())
    });
    let happened = events
        .iter()
        .map(|event| ([event.kind.code(), event.code], event.text.as_str()));
    assert_eq!(recorded.collect::<Vec<_>>(), happened.collect::<Vec<_>>());
    assert!(events.iter().any(|event| event.code > 1), "{events:?}");

    let scenes = server.of("scene");
    assert_eq!(scenes.len(), rows.len().div_ceil(33));
    let of_scene = server.of("axes").iter().zip(server.of("tool")).step_by(33);
    for (update, (axes, tool)) in scenes.iter().zip(of_scene) {
        let time = &update["entities"][0]["timestamp"];
        let tick =
            time["sec"].as_u64().unwrap() * 1_000 + time["nsec"].as_u64().unwrap() / 1_000_000;
        assert_eq!(axes["tick"], tick);
        check_scene(robot, update, axes, tool);
    }

    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    let stats = summary.stats.unwrap();
    assert_eq!(
        usize::try_from(stats.message_count).unwrap(),
        4 * rows.len() + events.len() + scenes.len()
    );
    assert_eq!(
        (
            usize::try_from(stats.chunk_count).unwrap(),
            stats.channel_count
        ),
        (summary.chunk_indexes.len(), 6)
    );
    assert!(
        bytes.len() < 1_000_000 || stats.chunk_count > 1,
        "one chunk of {} bytes",
        bytes.len()
    );
    for record in mcap::read::LinearReader::new(&bytes).unwrap() {
        if let mcap::records::Record::Chunk { header, data } = record.unwrap() {
            let size = u64::try_from(data.len()).unwrap();
            assert_eq!(
                (header.uncompressed_size, header.compressed_size),
                (size, size)
            );
            let length = header.message_end_time - header.message_start_time;
            assert!(length > 0 && length <= 1_000_000_000, "{header:?}");
        }
    }
    // One a second, or 1 MiB.
    let most = 2 + rows.len() / 1_000 + bytes.len() / (1 << 20);
    assert!(
        usize::try_from(stats.chunk_count).unwrap() <= most,
        "{} chunks, {most}",
        stats.chunk_count
    );
    assert_eq!(
        (stats.metadata_count, summary.metadata_indexes.len()),
        (1, 1)
    );
    let metadata = mcap::read::metadata(&bytes, &summary.metadata_indexes[0]).unwrap();
    assert_eq!(
        (
            metadata.name.as_str(),
            metadata.metadata["tick_ms"].as_str()
        ),
        ("gantry-tau", "1")
    );

    // A client knows of its tool the load alone.
    let client = samples(&std::fs::read(folder.path("client.mcap")).unwrap());
    assert!(client.of("axes").len() > 400);
    assert!(
        client
            .of("tool")
            .iter()
            .all(|tool| tool["load"][0].is_f64() && tool["turn_rad"][0].is_null())
    );
    assert!(client.of("scene").iter().all(|update| {
        update["entities"][1]["lines"]
            .as_array()
            .unwrap()
            .is_empty()
    }));
}

#[test]
fn messages_equal_the_table_of_the_same_run() {
    check::<_, 3, L2_MOTORS>("l2", &RobotFile::builtin_l2().unwrap());
    check::<_, 6, F1_MOTORS>("f1", &RobotFile::builtin_f1().unwrap());
}
