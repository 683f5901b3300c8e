//! What a gauge reads, and how the reading depends on every spring.
//!
//! By the unit-load theorem (Maxwell, Mohr) a reading `y` changes with a compliance by the product of two forces in its spring: that of the
//! load, and that of a *virtual* load, which does the work of the reading,
//!
//!     dy/dc_ij = f_ij g_ij,    dy/dc_k = tau_k h_k,    dy/dw = -sum c_ij g_ij (W^-1)_ij + sum c_k h_k (D^T W^-1)_k
//!
//! with `f`, `tau` under the load and `g`, `h` under the virtual one, both in the pose under load. No differences are taken. What the change of that pose with the spring would add is left out: up to a
//! percent of a derivative, which costs a fit one more round; the reading itself is exact.

use gantry_tau_core::model::robot::LINKS;
use nalgebra::{SVector, UnitQuaternion, Vector3, Vector6};

use crate::elastic::{ElasticMachine, Equilibrium, Pose, Transmission};

/// A length gauge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Gauge {
    /// On the platform: a plunger on a flat face.
    Platform {
        /// Where it touches, from the tool centre point when a series begins, world axes, m.
        point_m: Vector3<f64>,
        /// Direction of the plunger, and normal of the face, world axes; the reading grows when the face comes along it. Unit vector.
        axis: Vector3<f64>,
    },
    /// On the cart or plate of an axis, against its rail: the displacement by the spring.
    Axis {
        /// Index of the axis.
        axis: usize,
        /// Metres that it shows per unit of `q`.
        metres_per_q: f64,
    },
}

/// A reading, and its virtual load.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading<const N: usize> {
    /// The reading, m; zero in the pose that the series began in.
    pub length_m: f64,
    /// Virtual load on the platform, about the tool centre point, world axes.
    load: Vector6<f64>,
    /// Virtual push at the axes.
    push: SVector<f64, N>,
}

/// Derivatives of a reading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Derivatives<const N: usize> {
    /// By the compliances of the links, N.
    pub links: Vector6<f64>,
    /// By the compliances of the axes, N times metres per unit of `q`.
    pub axes: SVector<f64, N>,
    /// By the load on the platform: m/N, 1/N.
    pub load: Vector6<f64>,
    /// By the push at each axis, m per generalised newton.
    pub pushes: SVector<f64, N>,
    /// By the lengths of the links.
    pub lengths: Vector6<f64>,
}

impl Gauge {
    /// Returns the reading with the machine in equilibrium, and `began` its unloaded pose when the series began.
    #[must_use]
    pub fn read<const N: usize>(&self, machine: &ElasticMachine<N>, began: &Pose, now: &Equilibrium<N>) -> Reading<N> {
        match *self {
            Self::Platform { point_m, axis } => {
                let turn: UnitQuaternion<f64> = now.pose.rotation * began.rotation.inverse();
                let normal = turn * axis;
                let moved = now.pose.translation_m + turn * point_m - began.translation_m - point_m;
                let along = normal.dot(&axis);
                let length_m = normal.dot(&moved) / along;
                let arm = began.translation_m + point_m + axis * length_m - now.pose.translation_m;
                let (force, moment) = (normal / along, arm.cross(&normal) / along);
                let load = Vector6::new(force.x, force.y, force.z, moment.x, moment.y, moment.z);
                Reading { length_m, load, push: SVector::zeros() }
            }
            Self::Axis { axis, metres_per_q } => {
                let mut push = SVector::zeros();
                push[axis] = metres_per_q;
                let length_m = metres_per_q * machine.compliances().cart_m_per_n()[axis] * now.axis_loads[axis];
                Reading { length_m, load: Vector6::zeros(), push }
            }
        }
    }
}

impl<const N: usize> Reading<N> {
    /// Returns the derivatives of the reading; `through` is how loads go through the machine in the equilibrium `now`.
    #[must_use]
    pub fn derivatives(
        &self,
        machine: &ElasticMachine<N>,
        through: &Transmission<N>,
        now: &Equilibrium<N>,
    ) -> Derivatives<N> {
        let tensions = through.tensions_n(&self.load);
        let loads = through.axis_loads(&tensions, &self.push);
        let links = Vector6::from(*machine.compliances().link_m_per_n());
        let axes = SVector::from(*machine.compliances().cart_m_per_n());
        let (stretch, shift) = (links.component_mul(&tensions), axes.component_mul(&loads));
        // The load's own forces per unit, component by component.
        let load = Vector6::from_fn(|component, _| {
            let unit = through.tensions_n(&Vector6::ith(component, 1.0));
            stretch.dot(&unit) + shift.dot(&through.axis_loads(&unit, &SVector::zeros()))
        });
        Derivatives {
            links: tensions.component_mul(&now.tensions_n),
            axes: loads.component_mul(&now.axis_loads),
            load,
            pushes: shift,
            lengths: tensions,
        }
    }
}

const _: () = assert!(LINKS == 6, "one tension per link");

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elastic::backlash::Backlash;
    use crate::sim::fixture::Vectors;
    use gantry_tau_core::model::robot::Compliances;

    fn gauges<const N: usize>() -> Vec<Gauge> {
        let points = [[0.12, -0.06, 0.10], [-0.1, 0.05, 0.1], [0.0, 0.1, -0.08]];
        let platform = points.into_iter().flat_map(|point: [f64; 3]| {
            [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| Gauge::Platform { point_m: point.into(), axis })
        });
        platform.chain((0..N).map(|axis| Gauge::Axis { axis, metres_per_q: 1.0 })).collect()
    }

    fn load() -> Vector6<f64> {
        Vector6::new(180.0, -120.0, 150.0, 12.0, -9.0, 15.0)
    }

    /// Readings of all gauges with these compliances under a load.
    fn readings<const N: usize>(vectors: &Vectors<N>, compliances: Compliances<N>, load: &Vector6<f64>) -> Vec<f64> {
        let machine = ElasticMachine::new(vectors.geometry, compliances, Backlash::NONE);
        let case = &vectors.cases[0];
        let start = Equilibrium::unloaded(case.pose);
        let began = machine.equilibrium(&case.q, &Vector6::zeros(), &start).unwrap();
        let now = machine.equilibrium(&case.q, load, &began).unwrap();
        gauges::<N>().iter().map(|gauge| gauge.read(&machine, &began.pose, &now).length_m).collect()
    }

    fn derivatives<const N: usize>(vectors: &Vectors<N>, load: &Vector6<f64>) -> Vec<Derivatives<N>> {
        let machine = vectors.machine();
        let case = &vectors.cases[0];
        let began = machine.equilibrium(&case.q, &Vector6::zeros(), &Equilibrium::unloaded(case.pose)).unwrap();
        let now = machine.equilibrium(&case.q, load, &began).unwrap();
        let through = machine.transmission(&case.q, &now).unwrap();
        let reading = |gauge: &Gauge| gauge.read(&machine, &began.pose, &now).derivatives(&machine, &through, &now);
        gauges::<N>().iter().map(reading).collect()
    }

    /// Each column against central differences of the equilibrium, within 2 % of its largest entry: what the unit-load theorem leaves out.
    fn unit_loads_are_derivatives<const N: usize>(vectors: &Vectors<N>) {
        let (links, axes) = (*vectors.compliances.link_m_per_n(), *vectors.compliances.cart_m_per_n());
        let found = derivatives(vectors, &load());
        let column = |name: &str, analytic: Vec<f64>, ahead: Vec<f64>, behind: Vec<f64>, step: f64| {
            let largest = analytic.iter().fold(0.0, |largest: f64, value| largest.max(value.abs()));
            for ((analytic, ahead), behind) in analytic.into_iter().zip(ahead).zip(behind) {
                let difference = (ahead - behind) / (2.0 * step);
                assert!((analytic - difference).abs() < 0.02 * largest, "{name}: {analytic} {difference}");
            }
        };
        for link in 0..LINKS {
            let changed = |by: f64| {
                let mut links = links;
                links[link] *= 1.0 + by;
                readings(vectors, Compliances::new(links, axes).unwrap(), &load())
            };
            let analytic = found.iter().map(|derivatives| derivatives.links[link]).collect();
            column("link", analytic, changed(0.01), changed(-0.01), 0.01 * links[link]);
        }
        for axis in 0..N {
            let changed = |by: f64| {
                let mut axes = axes;
                axes[axis] *= 1.0 + by;
                readings(vectors, Compliances::new(links, axes).unwrap(), &load())
            };
            let analytic = found.iter().map(|derivatives| derivatives.axes[axis]).collect();
            column("axis", analytic, changed(0.01), changed(-0.01), 0.01 * axes[axis]);
        }
        for component in 0..6 {
            let step = if component < 3 { 1.0 } else { 0.1 };
            let changed = |by: f64| readings(vectors, vectors.compliances, &(load() + Vector6::ith(component, by)));
            let analytic = found.iter().map(|derivatives| derivatives.load[component]).collect();
            column("load", analytic, changed(step), changed(-step), step);
        }
    }

    #[test]
    fn unit_loads_are_derivatives_of_both_machines() {
        unit_loads_are_derivatives(&Vectors::l2());
        unit_loads_are_derivatives(&Vectors::f1());
    }

    /// Betti: a strap pulling where a gauge stands, and a gauge where the strap pulled, show the same.
    #[test]
    fn strap_and_gauge_change_places() {
        let vectors = Vectors::l2();
        let machine = vectors.machine();
        let case = &vectors.cases[0];
        let began = machine.equilibrium(&case.q, &Vector6::zeros(), &Equilibrium::unloaded(case.pose)).unwrap();
        let at = |point: [f64; 3], axis: Vector3<f64>| {
            let point_m = Vector3::from(point);
            let moment = point_m.cross(&axis);
            let pull = Vector6::new(axis.x, axis.y, axis.z, moment.x, moment.y, moment.z);
            (Gauge::Platform { point_m, axis }, pull)
        };
        let (one, pull_one) = at([0.12, -0.06, 0.1], Vector3::x());
        let (other, pull_other) = at([-0.1, 0.08, -0.05], Vector3::new(0.0, 0.6, 0.8));
        // A thousandth of a newton: the displaced points change nothing.
        let read = |gauge: Gauge, pull: Vector6<f64>| {
            let now = machine.equilibrium(&case.q, &(pull * 1e-3), &began).unwrap();
            gauge.read(&machine, &began.pose, &now).length_m
        };
        let (here, there) = (read(one, pull_other), read(other, pull_one));
        assert!((here - there).abs() < 1e-4 * here.abs(), "{here:e} {there:e}");
    }
}
