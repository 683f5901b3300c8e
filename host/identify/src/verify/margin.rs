//! Largest gain that is not statically unstable against a workpiece, with what the file knows of its springs.

use gantry_tau_core::model::stiffness::{Compliance, contact_loop_gain};
use gantry_tau_machine::elastic::Equilibrium;
use nalgebra::{DMatrix, Matrix6, SVector, Vector3, Vector6};

use super::model::FileModel;
use crate::fit::statistics::NORMAL_95;

impl<const N: usize> FileModel<N> {
    /// Returns the largest gain that is not statically unstable in contact along `normal`, with 97.5 %
    /// confidence:
    /// `(C + 1 / k_e) / C_file` with the lower end of the 95 % interval of `C`. `at` is the machine
    /// in its pose, with the axes at `q`. `None` where the links cannot take the contact.
    pub(super) fn largest_gain(
        &self,
        q: &[f64; N],
        at: &Equilibrium<N>,
        normal: &Vector3<f64>,
        workpiece_n_per_m: f64,
    ) -> Option<f64> {
        let through = self.machine.transmission(q, at)?;
        let unit = Vector6::new(normal.x, normal.y, normal.z, 0.0, 0.0, 0.0);
        let tensions_n = through.tensions_n(&unit);
        let axis_loads = through.axis_loads(&tensions_n, &SVector::zeros());
        let under_unit = Equilibrium {
            tensions_n,
            axis_loads,
            ..*at
        };
        // The unit load is its own virtual load: C = sum c f^2, whose derivatives are the squares.
        let by_springs = normal.transpose()
            * self
                .loaded(at, &under_unit, &unit)
                .displacement_by_springs(&through);
        let by_springs = DMatrix::from_row_slice(1, by_springs.ncols(), by_springs.as_slice());
        let known = (&by_springs * self.springs.vector()).sum();
        let sd = self.covariance(&by_springs).sum().sqrt();
        let lower = (known - NORMAL_95 * sd).max(0.0);
        let [known, lower] =
            [known, lower].map(|m_per_n| Compliance(Matrix6::identity() * m_per_n));
        let loop_gain = contact_loop_gain(1.0, &known, &lower, normal, workpiece_n_per_m).ok()?;
        Some(1.0 / loop_gain)
    }
}
