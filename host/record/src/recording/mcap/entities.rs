//! A machine as entities of `foxglove.SceneUpdate`: guideways, carts, links and platform, and
//! magnified what differs from them.

use gantry_tau_machine::figure::Figure;
use gantry_tau_machine::scene::{Scene, SceneArm};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use serde::Serialize;

/// Magnification of offsets and displacement: 0.1 mm is drawn as 100 mm. (The monitor's page has
/// its own, chosen there.)
pub(super) const FACTOR: f64 = 1_000.0;
/// Frame of all entities: the world of the robot file.
const FRAME: &str = "world";
/// `LinePrimitive.LINE_LIST`: two points per line.
const LINE_LIST: u8 = 2;

const INK: Colour = Colour {
    r: 0.25,
    g: 0.28,
    b: 0.32,
    a: 1.0,
};
const RAIL: Colour = Colour {
    r: 0.6,
    g: 0.6,
    b: 0.57,
    a: 1.0,
};
const TOOL: Colour = Colour {
    r: 0.8,
    g: 0.0,
    b: 0.0,
    a: 1.0,
};
const ACCENT: Colour = Colour {
    r: 0.69,
    g: 0.08,
    b: 0.48,
    a: 0.6,
};
/// Colours of the arms' clusters.
const ARMS: [Colour; 3] = [
    Colour {
        r: 0.7,
        g: 0.28,
        b: 0.11,
        a: 0.8,
    },
    Colour {
        r: 0.12,
        g: 0.44,
        b: 0.23,
        a: 0.8,
    },
    Colour {
        r: 0.12,
        g: 0.37,
        b: 0.66,
        a: 0.8,
    },
];

/// Message on the channel.
#[derive(Debug, Serialize)]
pub(super) struct Update {
    entities: [Entity; 2],
}

/// One entity; the next of the same name takes its place.
#[derive(Debug, Serialize)]
struct Entity {
    timestamp: Time,
    frame_id: &'static str,
    id: &'static str,
    /// Zero: until the next.
    lifetime: Time,
    frame_locked: bool,
    metadata: Vec<KeyValue>,
    cubes: Vec<Cube>,
    spheres: Vec<Sphere>,
    lines: Vec<LineList>,
}

#[derive(Debug, Default, Serialize)]
struct Time {
    sec: u64,
    nsec: u64,
}

#[derive(Debug, Serialize)]
struct KeyValue {
    key: &'static str,
    value: String,
}

#[derive(Clone, Copy, Debug, Serialize)]
struct Colour {
    r: f64,
    g: f64,
    b: f64,
    a: f64,
}

#[derive(Clone, Copy, Debug, Serialize)]
struct Point {
    x: f64,
    y: f64,
    z: f64,
}

#[derive(Debug, Serialize)]
struct Quaternion {
    x: f64,
    y: f64,
    z: f64,
    w: f64,
}

#[derive(Debug, Serialize)]
struct EntityPose {
    position: Point,
    orientation: Quaternion,
}

#[derive(Debug, Serialize)]
struct Cube {
    pose: EntityPose,
    size: Point,
    color: Colour,
}

#[derive(Debug, Serialize)]
struct Sphere {
    pose: EntityPose,
    size: Point,
    color: Colour,
}

#[derive(Debug, Serialize)]
struct LineList {
    #[serde(rename = "type")]
    kind: u8,
    pose: EntityPose,
    /// Metres.
    thickness: f64,
    scale_invariant: bool,
    points: Vec<Point>,
    color: Colour,
}

/// Returns the machine of a figure.
pub(super) fn update(name: &str, scene: &Scene, figure: &Figure, time_ns: u64) -> Update {
    let machine = Entity {
        metadata: vec![KeyValue {
            key: "robot",
            value: name.to_owned(),
        }],
        cubes: carts(scene, &figure.carts, of_arm),
        spheres: joints(scene, figure),
        lines: machine_lines(scene, figure),
        ..Entity::empty("machine", time_ns)
    };
    let displaced = Entity {
        metadata: vec![KeyValue {
            key: "magnification",
            value: FACTOR.to_string(),
        }],
        cubes: carts(scene, &displaced_carts(figure), |_| Colour {
            a: 0.25,
            ..ACCENT
        }),
        spheres: displaced_tool(figure)
            .map(|tool| sphere(&tool, 0.04, ACCENT))
            .into_iter()
            .collect(),
        lines: displaced_lines(figure),
        ..Entity::empty("displaced", time_ns)
    };
    Update {
        entities: [machine, displaced],
    }
}

impl Entity {
    fn empty(id: &'static str, time_ns: u64) -> Self {
        let timestamp = Time {
            sec: time_ns / 1_000_000_000,
            nsec: time_ns % 1_000_000_000,
        };
        Self {
            timestamp,
            frame_id: FRAME,
            id,
            lifetime: Time::default(),
            frame_locked: false,
            metadata: Vec::new(),
            cubes: Vec::new(),
            spheres: Vec::new(),
            lines: Vec::new(),
        }
    }
}

/// Carts as boxes, moved from home.
fn carts(scene: &Scene, ways: &[Vector3<f64>], colour: impl Fn(usize) -> Colour) -> Vec<Cube> {
    let arms = scene.arms.iter().zip(ways).enumerate();
    arms.map(|(index, (arm, way))| cart(arm, way, colour(index)))
        .collect()
}

fn cart(arm: &SceneArm, way: &Vector3<f64>, color: Colour) -> Cube {
    let edges = arm.half_edges_m.map(|edge| edge.normalize());
    // The edges are orthogonal, and in the order of a right hand.
    let turn = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&edges));
    let orientation = UnitQuaternion::from_rotation_matrix(&turn);
    let [x, y, z] = arm.half_edges_m.map(|edge| rounded(2.0 * edge.norm()));
    Cube {
        pose: pose(&(arm.centre_m + way), &orientation),
        size: Point { x, y, z },
        color,
    }
}

/// Ends of the links, and the tool.
fn joints(scene: &Scene, figure: &Figure) -> Vec<Sphere> {
    let links = scene
        .links
        .iter()
        .zip(figure.joints.iter().zip(&figure.platform));
    let ends = links.flat_map(|(link, (cart, platform))| [(link.arm, cart), (link.arm, platform)]);
    let mut spheres: Vec<Sphere> = ends
        .map(|(arm, end)| sphere(end, 0.03, of_arm(arm)))
        .collect();
    spheres.push(sphere(&figure.tool, 0.04, TOOL));
    spheres
}

fn machine_lines(scene: &Scene, figure: &Figure) -> Vec<LineList> {
    let arms = scene.arms.iter().zip(&figure.carts);
    let rails = arms.clone().flat_map(|(arm, way)| arm.rail_to(way));
    let mut all = vec![lines(rails, 0.02, RAIL)];
    for (index, (arm, way)) in arms.enumerate() {
        let own = scene
            .links
            .iter()
            .zip(figure.joints.iter().zip(&figure.platform));
        let own = own
            .filter(|(link, _)| link.arm == index)
            .map(|(_, ends)| ends);
        let links = own.clone().flat_map(|(cart, platform)| [*cart, *platform]);
        all.push(lines(links, 0.012, of_arm(index)));
        if scene.axes > scene.arms.len() {
            // Joints on a plate that turns, away from the guideway.
            let hub = arm.centre_m + way;
            all.push(lines(
                own.flat_map(|(cart, _)| [*cart, hub]),
                0.012,
                of_arm(index),
            ));
        }
    }
    all.push(lines(platform(&figure.platform, &figure.tool), 0.008, INK));
    all
}

/// Places with what displaces them, magnified.
fn magnified(places: &[Vector3<f64>], ways: &[Vector3<f64>]) -> impl Iterator<Item = Vector3<f64>> {
    places
        .iter()
        .zip(ways)
        .map(|(place, way)| place + way * FACTOR)
}

fn displaced_carts(figure: &Figure) -> Vec<Vector3<f64>> {
    magnified(&figure.carts, &figure.cart_offsets).collect()
}

fn displaced_tool(figure: &Figure) -> Option<Vector3<f64>> {
    figure
        .tool_displacement
        .map(|way| figure.tool + way * FACTOR)
}

/// Links and platform, displaced; nothing if the displacement is not measured.
fn displaced_lines(figure: &Figure) -> Vec<LineList> {
    let (Some(ways), Some(tool)) = (figure.platform_displacements, displaced_tool(figure)) else {
        return Vec::new();
    };
    let on_platform: Vec<_> = magnified(&figure.platform, &ways).collect();
    let links = magnified(&figure.joints, &figure.joint_offsets)
        .zip(&on_platform)
        .flat_map(|(cart, platform)| [cart, *platform]);
    vec![
        lines(links, 0.004, ACCENT),
        lines(platform(&on_platform, &tool), 0.006, ACCENT),
    ]
}

/// The platform as lines: around its joints, and from each to the tool.
fn platform(joints: &[Vector3<f64>], tool: &Vector3<f64>) -> Vec<Vector3<f64>> {
    let next = joints.iter().cycle().skip(1);
    joints
        .iter()
        .zip(next)
        .flat_map(|(joint, next)| [*joint, *next, *joint, *tool])
        .collect()
}

fn lines(
    points: impl IntoIterator<Item = Vector3<f64>>,
    thickness: f64,
    color: Colour,
) -> LineList {
    let points = points.into_iter().map(|place| point(&place)).collect();
    let pose = pose(&Vector3::zeros(), &UnitQuaternion::identity());
    LineList {
        kind: LINE_LIST,
        pose,
        thickness,
        scale_invariant: false,
        points,
        color,
    }
}

fn sphere(centre: &Vector3<f64>, diameter: f64, color: Colour) -> Sphere {
    let size = Point {
        x: diameter,
        y: diameter,
        z: diameter,
    };
    Sphere {
        pose: pose(centre, &UnitQuaternion::identity()),
        size,
        color,
    }
}

fn pose(place: &Vector3<f64>, turn: &UnitQuaternion<f64>) -> EntityPose {
    let turn = turn.quaternion();
    let orientation = Quaternion {
        x: rounded(turn.i),
        y: rounded(turn.j),
        z: rounded(turn.k),
        w: rounded(turn.w),
    };
    EntityPose {
        position: point(place),
        orientation,
    }
}

fn point(place: &Vector3<f64>) -> Point {
    Point {
        x: rounded(place.x),
        y: rounded(place.y),
        z: rounded(place.z),
    }
}

/// To a micrometre, in few digits.
fn rounded(value: f64) -> f64 {
    (value * 1e6).round() / 1e6
}

fn of_arm(arm: usize) -> Colour {
    ARMS.get(arm).copied().unwrap_or(INK)
}
