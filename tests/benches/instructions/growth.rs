//! Growth of the cost: of a tick with axes, connections and frames; of the F1's kinematics with the
//! distance of the seed.

use std::hint::black_box;
use std::path::Path;

use gantry_tau_core::control::endpoint::Transport;
use gantry_tau_core::control::message::{ClientMessage, Mode};
use gantry_tau_core::control::wire::encode_client;
use gantry_tau_core::model::kinematics::COLD_ITERATIONS;
use gantry_tau_report::plots::{Curve, Plot};

use crate::calls::measured;
use crate::count;
use crate::setup::{Server, on_time, six_from};

const DOCS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs");

/// A call that is made with several numbers.
struct Series {
    name: &'static str,
    /// Name in the plot.
    curve: &'static str,
    parameters: &'static [u32],
    run: fn(u32),
}

/// Of a tick: counts of something.
const TICK: [Series; 3] = [
    Series {
        name: "axes",
        curve: "axes",
        parameters: &[1, 2, 3, 4, 5, 6],
        run: tick_of_axes,
    },
    Series {
        name: "connections",
        curve: "connections, the others with a frame each",
        parameters: &[1, 2, 3, 4, 5, 6],
        run: tick_of_connections,
    },
    Series {
        name: "frames",
        curve: "frames of a hostile connection",
        parameters: &[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 12],
        run: tick_of_frames,
    },
];

/// Of the kinematics: distances of the seed, in half decades below 1 (m and rad).
const KINEMATICS: [Series; 2] = [
    Series {
        name: "inverse",
        curve: "inverse",
        parameters: &HALF_DECADES,
        run: inverse_from,
    },
    Series {
        name: "forward",
        curve: "forward",
        parameters: &HALF_DECADES,
        run: forward_from,
    },
];

const HALF_DECADES: [u32; 12] = [1, 2, 3, 4, 5, 6, 8, 10, 12, 14, 16, 18];

fn decades(halves: u32) -> f64 {
    -0.5 * f64::from(halves)
}

fn distance(halves: u32) -> f64 {
    10.0_f64.powf(decades(halves))
}

/// Makes a call by `name:parameter`.
pub(crate) fn run(name: &str, parameter: &str) {
    let series = TICK
        .iter()
        .chain(&KINEMATICS)
        .find(|series| series.name == name);
    let series = series.unwrap_or_else(|| panic!("no series is named {name}"));
    (series.run)(parameter.parse().unwrap());
}

/// Counts all series, prints them, and draws them into docs.
pub(crate) fn draw() {
    draw_into(
        "cost-ticks.svg",
        "Cost of a tick",
        "axes, connections, or frames",
        &TICK,
        f64::from,
    );
    draw_into(
        "cost-kinematics.svg",
        "Cost of the F1's kinematics",
        "distance of the seed, decades of m and rad",
        &KINEMATICS,
        decades,
    );
}

fn draw_into(file: &str, title: &str, x_axis: &str, series: &[Series], x: fn(u32) -> f64) {
    let curves = series.iter().map(|series| {
        let points = series.parameters.iter().map(|parameter| {
            let counted = count(&format!("{}:{parameter}", series.name));
            println!("{} {parameter} {counted}", series.name);
            (x(*parameter), f64::from(u32::try_from(counted).unwrap()))
        });
        Curve::line(series.curve, points.collect()).with_dots()
    });
    let plot = Plot::new(title, x_axis, "instructions (x86-64)", curves.collect());
    std::fs::write(Path::new(DOCS).join(file), plot.svg().as_str()).unwrap();
}

fn tick_of_axes(axes: u32) {
    match axes {
        1 => tick(Server::in_obtain([0]), 1, 0),
        2 => tick(Server::in_obtain([0, 1]), 1, 0),
        3 => tick(Server::in_obtain([0, 1, 2]), 1, 0),
        4 => tick(Server::in_obtain([0, 1, 2, 3]), 1, 0),
        5 => tick(Server::in_obtain([0, 1, 2, 3, 4]), 1, 0),
        _ => tick(six(), 1, 0),
    }
}

fn tick_of_connections(connections: u32) {
    tick(six(), connections, 1);
}

fn tick_of_frames(frames: u32) {
    tick(six(), 2, frames);
}

fn six() -> Server<6, 6> {
    Server::in_obtain([0, 1, 2, 3, 4, 5])
}

/// One command of the owner in, one State out, with the black box. Every other connection sends so
/// many frames, which are not its to send.
fn tick<const N: usize>(mut server: Server<N, N>, connections: u32, frames: u32) {
    let command = server.command(Mode::Obtain);
    let bytes = black_box(encode_client(&ClientMessage::Command(command)));
    let mut others = Vec::new();
    for _ in 1..connections {
        others.push(server.endpoint.open(Transport::Stream).unwrap());
    }
    let stop = encode_client::<N>(&ClientMessage::Stop(command.epoch));
    let stops = black_box(stop.repeat(usize::try_from(frames).unwrap()));
    let input = black_box(on_time());
    measured(|| {
        server.endpoint.feed(server.connection, &bytes);
        for other in &others {
            server.endpoint.feed(*other, &stops);
        }
        black_box(server.tick(&input));
        while let Some((_, bytes)) = server.endpoint.poll_transmit() {
            black_box(bytes);
        }
    });
}

fn inverse_from(halves: u32) {
    let (kinematics, pose, _, seed) = six_from(distance(halves));
    let [.., q4, q5, q6] = kinematics.inverse(&seed, None).unwrap().value;
    let (kinematics, pose, seed) = black_box((kinematics, pose, [q4, q5, q6]));
    black_box(measured(|| kinematics.inverse(&pose, Some(seed)))).unwrap();
}

fn forward_from(halves: u32) {
    let (kinematics, _, q, seed) = black_box(six_from(distance(halves)));
    black_box(measured(|| {
        kinematics.forward_from(&q, &seed, COLD_ITERATIONS)
    }))
    .unwrap();
}
