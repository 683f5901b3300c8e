//! Compliances of a machine and its wrist, as one vector of parameters.

use gantry_tau_core::model::l2::AXES;
use gantry_tau_core::model::robot::{Compliances, LINKS};
use nalgebra::DVector;

use crate::elastic::RawCompliances;
use crate::model::{MachineKind, Wrist};
use crate::robot_file::RobotFile;

/// Springs of a machine: links and axes, and the joints of a wrist behind its platform.
#[derive(Clone, Debug, PartialEq)]
pub struct Springs<const N: usize> {
    /// Links and axes.
    pub machine: RawCompliances<N>,
    /// Joints between platform and tool.
    pub wrist: Wrist,
}

impl<const N: usize> Springs<N> {
    /// Springs of a robot file; `None` without compliances.
    #[must_use]
    pub fn of<K: MachineKind<N>>(robot: &RobotFile<K, N>) -> Option<Self> {
        Some(Self {
            machine: robot.compliances?.into(),
            wrist: Wrist::new(&robot.wrist),
        })
    }

    /// Springs of a machine whose tool is fixed to the platform.
    #[must_use]
    pub fn rigid_wrist(machine: Compliances<N>) -> Self {
        Self {
            machine: machine.into(),
            wrist: Wrist::default(),
        }
    }

    /// Number of springs.
    #[must_use]
    pub fn count(&self) -> usize {
        LINKS + N + self.wrist.joints()
    }

    /// Names of the compliances, as keys with an index, and their units.
    #[must_use]
    pub fn names(&self) -> Vec<(String, &'static str)> {
        let links = (0..LINKS).map(|link| (format!("c_link[{link}]"), "m/N"));
        let axes = (0..N).map(|axis| (format!("{}[{axis}]", axes_key::<N>()), "m/N"));
        let wrist =
            (0..self.wrist.joints()).map(|joint| (format!("c_wrist[{joint}]"), "rad/(N m)"));
        links.chain(axes).chain(wrist).collect()
    }

    /// Compliances of links, axes, joints of the wrist, in the units of their keys.
    #[must_use]
    pub fn vector(&self) -> DVector<f64> {
        let machine = self
            .machine
            .links_m_per_n
            .iter()
            .chain(&self.machine.axes)
            .copied();
        DVector::from_iterator(self.count(), machine.chain(self.wrist.compliances()))
    }

    /// The same machine with the compliances of a vector, in the order of [`vector`](Self::vector).
    #[must_use]
    pub fn with(&self, vector: &DVector<f64>) -> Self {
        let links_m_per_n = std::array::from_fn(|link| vector[link]);
        let machine = RawCompliances {
            links_m_per_n,
            axes: std::array::from_fn(|axis| vector[LINKS + axis]),
        };
        Self {
            machine,
            wrist: self
                .wrist
                .with_compliances(vector.iter().skip(LINKS + N).copied()),
        }
    }
}

/// Key of the compliances of the axes.
#[must_use]
pub const fn axes_key<const N: usize>() -> &'static str {
    if N == AXES { "c_cart" } else { "c_act" }
}
