//! Workpiece that the tool presses on, for force control: a spring without friction below the tool.

use nalgebra::Vector3;

/// Largest stiffness, N/m. The force follows the depth of the cycle before: at twice this value and 1e-6 m/N of the machine it would oscillate.
pub const MAX_STIFFNESS_N_PER_M: f64 = 1e6;
/// Largest distance between the tool at home and the surface, m.
pub const MAX_GAP_M: f64 = 0.01;
/// Share of its way that the force goes in a cycle: a time constant of 1.4 ms.
const SHARE: f64 = 0.5;

/// Elastic workpiece with a horizontal surface; it pushes the tool in +z and holds nothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Workpiece {
    stiffness_n_per_m: f64,
    surface_m: f64,
    force_n: f64,
}

impl Workpiece {
    /// Creates a workpiece whose surface lies `gap_m` below the tool at `home_m`, both within their largest values.
    #[must_use]
    pub fn below(home_m: &[f64; 3], stiffness_n_per_m: f64, gap_m: f64) -> Self {
        Self {
            // NaN becomes zero.
            stiffness_n_per_m: stiffness_n_per_m.max(0.0).min(MAX_STIFFNESS_N_PER_M),
            surface_m: home_m[2] - gap_m.max(0.0).min(MAX_GAP_M),
            force_n: 0.0,
        }
    }

    /// Returns the force on the tool after one more cycle at this place, N, world axes.
    pub fn force_n(&mut self, tool_m: &Vector3<f64>) -> [f64; 3] {
        let depth_m = (self.surface_m - tool_m.z).max(0.0);
        self.force_n += SHARE * (self.stiffness_n_per_m * depth_m - self.force_n);
        [0.0, 0.0, self.force_n]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_pushes_where_it_is_touched_and_holds_nothing() {
        let mut workpiece = Workpiece::below(&[0.0, 0.5, 0.65], 2e5, 1e-4);
        let mut settled = |z: f64| (0..60).map(|_| workpiece.force_n(&Vector3::new(3.0, -2.0, z))).last().unwrap();
        assert_eq!(settled(0.65), [0.0; 3]);
        let [x, y, z] = settled(0.65 - 2e-4);
        assert!(x == 0.0 && y == 0.0 && (z - 20.0).abs() < 1e-9, "{z}");
        let [_, _, z] = settled(0.7);
        assert!((0.0..1e-12).contains(&z), "{z}");
    }
}
