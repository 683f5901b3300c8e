//! Workpiece that the tool presses on, for force control: a spring without friction below the tool.

use gantry_tau_server::plant::interpolator::check;
use nalgebra::Vector3;

use super::parameters::SimulationError;

/// Largest stiffness below a machine without masses, N/m. The force follows the depth of the cycle
/// before: at twice this value and 1e-6 m/N of the machine it would oscillate.
const MAX_STIFFNESS_N_PER_M: f64 = 1e6;
/// Largest stiffness below a machine with masses, N/m.
const MAX_STIFFNESS_WITH_MASSES_N_PER_M: f64 = 1e9;
/// Largest distance between the tool at home and the surface, m.
const MAX_GAP_M: f64 = 0.01;
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
    /// Returns the force on the tool at this height, N: of the spring, at once.
    #[must_use]
    pub fn spring_n(&self, height_m: f64) -> f64 {
        self.stiffness_n_per_m * (self.surface_m - height_m).max(0.0)
    }

    /// Creates a workpiece whose surface lies `gap_m` below the tool at `home_m`, for a machine with
    /// masses or without.
    ///
    /// # Errors
    /// [`SimulationError::OutOfRange`]: stiffness or gap.
    pub fn below(
        home_m: &[f64; 3],
        stiffness_n_per_m: f64,
        gap_m: f64,
        has_masses: bool,
    ) -> Result<Self, SimulationError> {
        let most_n_per_m = if has_masses {
            MAX_STIFFNESS_WITH_MASSES_N_PER_M
        } else {
            MAX_STIFFNESS_N_PER_M
        };
        check(
            "stiffness of the workpiece (N/m)",
            stiffness_n_per_m,
            1.0,
            most_n_per_m,
        )?;
        check("gap above the workpiece (m)", gap_m, 0.0, MAX_GAP_M)?;
        Ok(Self {
            stiffness_n_per_m,
            surface_m: home_m[2] - gap_m,
            force_n: 0.0,
        })
    }

    /// Returns the force on the tool after one more cycle at this place, N, world axes.
    pub fn force_n(&mut self, tool_m: &Vector3<f64>) -> [f64; 3] {
        self.force_n += SHARE * (self.spring_n(tool_m.z) - self.force_n);
        [0.0, 0.0, self.force_n]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Force at a height, N, once it is settled.
    fn settled(workpiece: &mut Workpiece, z: f64) -> [f64; 3] {
        (0..60)
            .map(|_| workpiece.force_n(&Vector3::new(3.0, -2.0, z)))
            .last()
            .unwrap()
    }

    #[test]
    fn it_pushes_where_it_is_touched_and_holds_nothing() {
        let mut workpiece = Workpiece::below(&[0.0, 0.5, 0.65], 2e5, 1e-4, false).unwrap();
        assert_eq!(settled(&mut workpiece, 0.65), [0.0; 3]);
        let [x, y, z] = settled(&mut workpiece, 0.65 - 2e-4);
        assert!(x == 0.0 && y == 0.0 && (z - 20.0).abs() < 1e-9, "{z}");
        let [_, _, z] = settled(&mut workpiece, 0.7);
        assert!((0.0..1e-12).contains(&z), "{z}");
    }

    #[test]
    fn what_would_oscillate_or_is_no_number_is_refused() {
        for (stiffness, gap, words) in [
            (
                f64::NAN,
                0.0,
                "stiffness of the workpiece (N/m) must be from 1e0 to 1e6",
            ),
            (1e7, 0.0, "stiffness"),
            (
                1e5,
                f64::NAN,
                "gap above the workpiece (m) must be from 0e0 to 1e-2",
            ),
            (1e5, -1e-6, "gap"),
        ] {
            let refused = Workpiece::below(&[0.0; 3], stiffness, gap, false)
                .unwrap_err()
                .to_string();
            assert!(refused.contains(words), "{refused}");
        }
    }
}
