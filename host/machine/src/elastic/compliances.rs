//! Compliances of any sign.

use gantry_tau_core::model::robot::{Compliances, LINKS, RobotError};

/// Compliances of links and axes. Those of a machine are positive ([`Compliances`]); an estimate of
/// one that the readings hardly see may be negative.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RawCompliances<const N: usize> {
    /// Of the links, m/N, link order.
    pub links_m_per_n: [f64; LINKS],
    /// Of the axes, q-units per newton of generalised load, axis order.
    pub axes: [f64; N],
}

impl<const N: usize> RawCompliances<N> {
    /// Compliances that a machine can have.
    ///
    /// # Errors
    /// The first one that is none.
    pub fn checked(&self) -> Result<Compliances<N>, RobotError> {
        Compliances::new(self.links_m_per_n, self.axes)
    }
}

impl<const N: usize> From<Compliances<N>> for RawCompliances<N> {
    fn from(checked: Compliances<N>) -> Self {
        Self {
            links_m_per_n: *checked.link_m_per_n(),
            axes: *checked.cart_m_per_n(),
        }
    }
}
