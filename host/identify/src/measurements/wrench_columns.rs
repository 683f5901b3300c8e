//! Columns of a table that a wrench is written in.

use nalgebra::{Matrix6, Vector6};

use super::springs::LOAD;

/// The six columns of a table that a wrench is written in, and how the load on the platform follows
/// from them.
#[derive(Clone, Debug, PartialEq)]
pub struct WrenchColumns {
    /// Names: three forces, three moments.
    pub(crate) names: [&'static str; 6],
    /// One per pose.
    pub(crate) maps: Vec<WrenchMap>,
}

/// Linear map of changes of the six columns to changes of the load (force N, moment N m about the
/// tool centre point, world axes), and back.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct WrenchMap {
    pub(crate) load_of_columns: Matrix6<f64>,
    pub(crate) columns_of_load: Matrix6<f64>,
}

impl WrenchColumns {
    /// Columns of the load itself.
    pub(crate) fn of_load(poses: usize) -> Self {
        let same = WrenchMap {
            load_of_columns: Matrix6::identity(),
            columns_of_load: Matrix6::identity(),
        };
        Self {
            names: LOAD,
            maps: vec![same; poses],
        }
    }
}

impl WrenchMap {
    /// Returns the load whose columns are `mended` times those of this one.
    pub(crate) fn mended(&self, mended: &Matrix6<f64>, load: &Vector6<f64>) -> Vector6<f64> {
        self.load_of_columns * mended * self.columns_of_load * load
    }
}
