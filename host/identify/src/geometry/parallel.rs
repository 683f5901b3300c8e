//! An L2 whose guideways are parallel: one `v` for all arms, 15 parameters.

use gantry_tau_core::model::robot::ARMS;
use nalgebra::{DMatrix, DVector, Vector3};

use super::l2::{Nominal, PARAMETERS, PER_ARM, Places, PredictionError};
use super::robust_fit::Model;
use crate::fit::least_squares::Rows;

/// Parameters of an arm of its own: `A_s` (3), `L`.
const OWN: usize = 4;
/// All of them: those of the arms, then `v` (3).
pub const PARALLEL_PARAMETERS: usize = ARMS * OWN + 3;

/// Measured places of a machine with parallel guideways.
#[derive(Clone, Copy, Debug)]
pub struct Parallel<'a>(pub Places<'a>);

/// Derivatives of the 21 parameters by the 15.
#[must_use]
pub fn expansion() -> DMatrix<f64> {
    let mut expansion = DMatrix::zeros(PARAMETERS, PARALLEL_PARAMETERS);
    for arm in 0..ARMS {
        for component in 0..3 {
            expansion[(PER_ARM * arm + component, OWN * arm + component)] = 1.0;
            expansion[(PER_ARM * arm + 3 + component, OWN * ARMS + component)] = 1.0;
        }
        expansion[(PER_ARM * arm + 6, OWN * arm + 3)] = 1.0;
    }
    expansion
}

/// The machine with the mean of its guideways for each of them.
#[must_use]
pub fn with_parallel_guideways(nominal: &Nominal) -> Nominal {
    let mean: Vector3<f64> = nominal.guideways.iter().sum::<Vector3<f64>>() / 3.0;
    Nominal {
        guideways: [mean; ARMS],
        ..*nominal
    }
}

impl Model for Parallel<'_> {
    type State = Nominal;
    type Error = PredictionError;
    const COMPONENTS: usize = 3;

    fn count(&self) -> usize {
        self.0.count()
    }

    fn rows(&self, nominal: &Nominal, used: &[usize]) -> Result<Rows, PredictionError> {
        let Rows {
            residuals,
            derivatives,
        } = self.0.rows(nominal, used)?;
        Ok(Rows::new(residuals, derivatives * expansion()))
    }

    fn length_sd(&self, nominal: &Nominal, index: usize) -> f64 {
        self.0.length_sd(nominal, index)
    }

    fn away_m(&self, nominal: &Nominal, index: usize) -> Option<f64> {
        self.0.away_m(nominal, index)
    }

    fn scales(&self, nominal: &Nominal) -> DVector<f64> {
        let free = nominal.scales();
        DVector::from_iterator(
            PARALLEL_PARAMETERS,
            expansion().column_iter().map(|column| free[column.imax()]),
        )
    }

    fn stepped(nominal: &Nominal, step: &DVector<f64>) -> Nominal {
        Places::stepped(nominal, &(expansion() * step))
    }
}
