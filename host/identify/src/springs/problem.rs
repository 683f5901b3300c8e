//! A campaign, and what is known of its machine before it.

use gantry_tau_core::model::f1;
use gantry_tau_machine::elastic::springs::Springs;
use gantry_tau_machine::robot_file::Identified;
use nalgebra::{DMatrix, DVector, Vector6};

use super::setup::SetupConstants;
use crate::measurements::springs::Campaign;

/// A campaign, and the machine that it was made on.
#[derive(Clone)]
pub(crate) struct SpringsProblem<'a, const N: usize> {
    pub(crate) geometry: &'a f1::Geometry,
    /// Springs that the search starts from, and that stay where nothing is seen.
    pub(crate) file: &'a Springs<N>,
    pub(crate) campaign: &'a Campaign<N>,
    pub(crate) setup: SetupConstants,
    /// Compliances that changes are relative to.
    pub(crate) relative_to: DVector<f64>,
    /// Covariance of the file's compliances, in those: of what the campaign does not show.
    pub(crate) prior: DMatrix<f64>,
}

impl<'a, const N: usize> SpringsProblem<'a, N> {
    /// A campaign, and the springs that the search starts from, which changes are relative to.
    pub(crate) fn new(
        geometry: &'a f1::Geometry,
        file: &'a Springs<N>,
        campaign: &'a Campaign<N>,
    ) -> Self {
        let count = file.count();
        Self {
            geometry,
            file,
            campaign,
            setup: SetupConstants::of(campaign),
            relative_to: file.vector(),
            prior: DMatrix::identity(count, count),
        }
    }

    /// The same of another campaign with the same gauges.
    pub(crate) fn with_campaign<'b>(&self, campaign: &'b Campaign<N>) -> SpringsProblem<'b, N>
    where
        'a: 'b,
    {
        SpringsProblem {
            relative_to: self.relative_to.clone(),
            prior: self.prior.clone(),
            ..SpringsProblem::new(self.geometry, self.file, campaign)
        }
    }

    /// The same with what the file says of its compliances, where it was identified.
    pub(crate) fn with_prior(self, identified: &Identified) -> Self {
        let count = self.file.count();
        let relative_to = match identified.relative_to.as_slice() {
            [] => self.relative_to,
            stated => DVector::from_column_slice(stated),
        };
        let prior = DMatrix::from_fn(count, count, |row, column| {
            let entry = identified
                .covariance
                .get(row)
                .and_then(|row| row.get(column))
                .copied()
                .unwrap_or(0.0);
            let relative = entry / (relative_to[row] * relative_to[column]);
            // Files of earlier versions say nothing of what they kept.
            if row == column && relative <= 0.0 {
                1.0
            } else {
                relative
            }
        });
        Self {
            relative_to,
            prior,
            ..self
        }
    }

    /// The same with the constants of the set-up as they were found.
    pub(crate) fn with_exact_setup(&self) -> Self {
        Self {
            setup: self.setup.exact(),
            ..self.clone()
        }
    }

    /// Variances of a load's components: N^2, (N m)^2.
    pub(crate) fn load_variances(&self) -> Vector6<f64> {
        self.campaign.noise.load_variances()
    }
}
