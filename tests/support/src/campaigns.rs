//! Plans of campaigns.

use std::fmt::Write;

/// Gauges of campaign A: six on the platform, 3-2-1, and one on each cart.
pub const GAUGES: [&str; 9] = [
    "pz1", "pz2", "pz3", "py1", "py2", "px1", "axis1", "axis2", "axis3",
];

/// Campaign A of an L2: at home, three hooks, three directions, six gauges on the platform and three
/// on carts. `noise` is the content of the section of that name, with what follows it.
#[must_use]
pub fn campaign_a(noise: &str, levels: &[u32]) -> String {
    let mut text = format!(
        "format = \"gantry-tau springs 1\"\nmodel = \"l2\"\nmeasurements = \"springs.csv\"\n[noise]\n{noise}\
         [[pose]]\nname = \"home\"\nT = [0.0, 0.5, 0.65]\n"
    );
    let platform = [
        ([0.12, -0.06, 0.10], [0.0, 0.0, 1.0]),
        ([-0.12, -0.06, 0.10], [0.0, 0.0, 1.0]),
        ([0.0, 0.10, 0.10], [0.0, 0.0, 1.0]),
        ([0.10, 0.12, 0.05], [0.0, 1.0, 0.0]),
        ([-0.10, 0.12, 0.05], [0.0, 1.0, 0.0]),
        ([0.14, 0.0, 0.05], [1.0, 0.0, 0.0]),
    ];
    for (name, (point, axis)) in GAUGES.iter().zip(platform) {
        write!(
            text,
            "[[gauge]]\nname = {name:?}\non = \"platform\"\npoint_m = {point:?}\naxis = {axis:?}\n"
        )
        .unwrap();
    }
    for axis in 1..=3 {
        write!(
            text,
            "[[gauge]]\nname = \"axis{axis}\"\non = \"axis\"\naxis_number = {axis}\n"
        )
        .unwrap();
    }
    for (hook, place) in [[0.0, 0.0, -0.08], [0.15, 0.0, -0.08], [0.0, 0.15, -0.08]]
        .into_iter()
        .enumerate()
    {
        for (name, direction) in [
            ("x", [1.0, 0.0, 0.0]),
            ("y", [0.0, 1.0, 0.0]),
            ("z", [0.0, 0.0, 1.0]),
        ] {
            let hook = hook + 1;
            let series = format!("{name}{hook}");
            write!(
                text,
                "[[series]]\nname = {series:?}\npose = \"home\"\nmounting = \"hook {hook}, {name}\"\n\
                 hook_m = {place:?}\ndirection = {direction:?}\nlevels_n = {levels:?}\n\
                 gauges = {GAUGES:?}\n"
            )
            .unwrap();
        }
    }
    text
}
