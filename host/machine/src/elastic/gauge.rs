//! Reading of a gauge, and its derivatives by every spring.
//!
//! By the unit-load theorem (Maxwell, Mohr) a reading `y` changes with a compliance by the product
//! of two forces in its spring: that of the load, and that of a *virtual* load, which does the work
//! of the reading,
//!
//! ```text
//! dy/dc_ij = f_ij g_ij,    dy/dc_k = tau_k h_k,    dy/dkappa_j = mu_j nu_j
//! dy/dw = -sum c_ij g_ij (W^-1)_ij + sum c_k h_k (D^T W^-1)_k + sum kappa_j nu_j l_j
//! ```
//!
//! with the tensions `f`, loads of axes `tau` and moments about the wrist's joints `mu = l . w`
//! under the load, and `g`, `h`, `nu` under the virtual one, both in the pose under load. A gauge
//! on the platform has `nu = 0`. No differences are taken. What the change of that pose with the
//! spring would add is left out: up to a percent of a derivative, which costs a fit one more round;
//! the reading itself is exact.

use gantry_tau_core::model::robot::LINKS;
use nalgebra::{DVector, SVector, UnitQuaternion, Vector3, Vector6};

use super::loaded::Loaded;
use crate::elastic::Transmission;

/// Body that has faces for gauges.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Body {
    /// The platform.
    Platform,
    /// The tool, behind the wrist.
    Tool,
}

/// A length gauge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Gauge {
    /// A plunger on a flat face.
    Face {
        /// Body that the face belongs to.
        body: Body,
        /// Contact point, from the tool centre point when a series begins, world axes, m.
        point_m: Vector3<f64>,
        /// Direction of the plunger, and normal of the face, world axes; the reading grows when the
        /// face comes along it. Unit vector.
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
pub struct GaugeReading<const N: usize> {
    /// The reading, m; zero in the pose that the series began in.
    pub length_m: f64,
    /// Body that the virtual load acts on.
    body: Body,
    /// Virtual load, about the tool centre point of the platform, world axes.
    load: Vector6<f64>,
    /// Virtual push at the axes.
    push: SVector<f64, N>,
}

/// Derivatives of a reading.
#[derive(Clone, Debug, PartialEq)]
pub struct Derivatives<const N: usize> {
    /// By the compliances of links, axes and joints of the wrist: N, N times metres per unit of
    /// `q`, N m.
    pub springs: DVector<f64>,
    /// By the load: m/N, 1/N.
    pub load: Vector6<f64>,
    /// By the push at each axis, m per generalised newton.
    pub pushes: SVector<f64, N>,
    /// By the lengths of the links.
    pub lengths: Vector6<f64>,
}

impl Gauge {
    /// Returns the reading under a load.
    #[must_use]
    pub fn read<const N: usize>(&self, at: &Loaded<N>) -> GaugeReading<N> {
        match *self {
            Self::Face {
                body,
                point_m,
                axis,
            } => {
                let (began, now) = (&at.began, at.pose(body));
                let turn: UnitQuaternion<f64> = now.rotation * began.rotation.inverse();
                let normal = turn * axis;
                let moved = now.translation_m + turn * point_m - began.translation_m - point_m;
                let along = normal.dot(&axis);
                let length_m = normal.dot(&moved) / along;
                let arm =
                    began.translation_m + point_m + axis * length_m - at.now.pose.translation_m;
                let (force, moment) = (normal / along, arm.cross(&normal) / along);
                let load = Vector6::new(force.x, force.y, force.z, moment.x, moment.y, moment.z);
                GaugeReading {
                    length_m,
                    body,
                    load,
                    push: SVector::zeros(),
                }
            }
            Self::Axis { axis, metres_per_q } => {
                let mut push = SVector::zeros();
                push[axis] = metres_per_q;
                let length_m =
                    metres_per_q * at.machine.compliances().axes[axis] * at.now.axis_loads[axis];
                GaugeReading {
                    length_m,
                    body: Body::Platform,
                    load: Vector6::zeros(),
                    push,
                }
            }
        }
    }
}

impl<const N: usize> GaugeReading<N> {
    /// Returns the derivatives of the reading; `through` is how loads go through the machine in the
    /// equilibrium `at`.
    #[must_use]
    pub fn derivatives(&self, at: &Loaded<N>, through: &Transmission<N>) -> Derivatives<N> {
        let tensions = through.tensions_n(&self.load);
        let loads = through.axis_loads(&tensions, &self.push);
        let links = Vector6::from(at.machine.compliances().links_m_per_n);
        let axes = SVector::from(at.machine.compliances().axes);
        let (stretch, shift) = (links.component_mul(&tensions), axes.component_mul(&loads));
        let joints = at.wrist_lines();
        // Moments about the joints under the virtual load: none if it acts before them.
        let moments = joints.iter().map(|line| {
            if self.body == Body::Tool {
                line.dot(&self.load)
            } else {
                0.0
            }
        });
        let given: Vector6<f64> = joints
            .iter()
            .zip(moments.clone())
            .zip(at.wrist.compliances())
            .map(|((line, nu), kappa)| line * (nu * kappa))
            .sum();
        // The load's own forces per unit, component by component.
        let load = Vector6::from_fn(|component, _| {
            let unit = through.tensions_n(&Vector6::ith(component, 1.0));
            stretch.dot(&unit)
                + shift.dot(&through.axis_loads(&unit, &SVector::zeros()))
                + given[component]
        });
        let springs = self.by_springs(
            at,
            through,
            [&at.now.tensions_n, &at.load],
            &at.now.axis_loads,
        );
        Derivatives {
            springs,
            load,
            pushes: shift,
            lengths: tensions,
        }
    }

    /// Returns the derivatives of the reading by the compliances where a load makes these tensions
    /// and loads of the axes.
    #[must_use]
    pub fn by_springs(
        &self,
        at: &Loaded<N>,
        through: &Transmission<N>,
        [tensions_n, load]: [&Vector6<f64>; 2],
        axis_loads: &SVector<f64, N>,
    ) -> DVector<f64> {
        let tensions = through.tensions_n(&self.load);
        let links = tensions.component_mul(tensions_n);
        let axes = through
            .axis_loads(&tensions, &self.push)
            .component_mul(axis_loads);
        let lines = at.wrist_lines();
        let wrist = lines.iter().map(|line| match self.body {
            Body::Tool => line.dot(&self.load) * line.dot(load),
            Body::Platform => 0.0,
        });
        DVector::from_iterator(
            LINKS + N + lines.len(),
            links.iter().chain(axes.iter()).copied().chain(wrist),
        )
    }
}

const _: () = assert!(LINKS == 6, "one tension per link");

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elastic::backlash::Backlash;
    use crate::elastic::fixture;
    use crate::elastic::springs::Springs;
    use crate::elastic::{ElasticMachine, Equilibrium};
    use crate::model::Wrist;
    use crate::robot_file::WristJoint;
    use gantry_tau_test_support::vectors::Vectors;

    fn gauges<const N: usize>() -> Vec<Gauge> {
        let points = [[0.12, -0.06, 0.10], [-0.1, 0.05, 0.1], [0.0, 0.1, -0.08]];
        let faces = [Body::Platform, Body::Tool]
            .into_iter()
            .flat_map(move |body| {
                points.into_iter().flat_map(move |point: [f64; 3]| {
                    [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| Gauge::Face {
                        body,
                        point_m: point.into(),
                        axis,
                    })
                })
            });
        faces
            .chain((0..N).map(|axis| Gauge::Axis {
                axis,
                metres_per_q: 1.0,
            }))
            .collect()
    }

    /// The machine of the vectors with two joints between platform and tool.
    fn with_wrist<const N: usize>(vectors: &Vectors<N>) -> Springs<N> {
        let joints = [([0.0, 0.6, 0.8], 1e-5), ([1.0, 0.0, 0.0], 2e-5)];
        let joints = joints.map(|(axis, c_rad_per_nm)| WristJoint {
            axis,
            point_m: [0.02, -0.01, 0.15],
            c_rad_per_nm,
        });
        Springs {
            wrist: Wrist::new(&joints),
            ..fixture::springs(vectors)
        }
    }

    fn load() -> Vector6<f64> {
        Vector6::new(180.0, -120.0, 150.0, 12.0, -9.0, 15.0)
    }

    /// The first case of the vectors under a load, and how loads go through it.
    fn loaded<const N: usize>(
        vectors: &Vectors<N>,
        springs: &Springs<N>,
        load: &Vector6<f64>,
    ) -> (Loaded<N>, Transmission<N>) {
        let machine = ElasticMachine::new(vectors.geometry, springs.machine, Backlash::NONE);
        let case = &vectors.cases[0];
        let start = Equilibrium::unloaded(fixture::pose(case));
        let began = machine
            .equilibrium(&case.q, &Vector6::zeros(), &start)
            .unwrap();
        let now = machine.equilibrium(&case.q, load, &began).unwrap();
        let through = machine.transmission(&case.q, &now).unwrap();
        (
            Loaded {
                machine,
                wrist: springs.wrist.clone(),
                began: began.pose,
                now,
                load: *load,
            },
            through,
        )
    }

    /// Readings of all gauges with these compliances under a load.
    fn readings<const N: usize>(
        vectors: &Vectors<N>,
        springs: &Springs<N>,
        load: &Vector6<f64>,
    ) -> Vec<f64> {
        let (loaded, _) = loaded(vectors, springs, load);
        gauges::<N>()
            .iter()
            .map(|gauge| gauge.read(&loaded).length_m)
            .collect()
    }

    /// Each column against central differences of the equilibrium, within 2 % of its largest entry:
    /// what the unit-load theorem leaves out.
    /// Derivatives are the differences of the readings by a step either way.
    fn assert_column(name: &str, analytic: Vec<f64>, [behind, ahead]: [Vec<f64>; 2], step: f64) {
        let largest = analytic
            .iter()
            .fold(0.0, |largest: f64, value| largest.max(value.abs()));
        for ((analytic, ahead), behind) in analytic.into_iter().zip(ahead).zip(behind) {
            let difference = (ahead - behind) / (2.0 * step);
            assert!(
                (analytic - difference).abs() < 0.02 * largest,
                "{name}: {analytic} {difference}"
            );
        }
    }

    fn unit_loads_are_derivatives<const N: usize>(vectors: &Vectors<N>) {
        let springs = with_wrist(vectors);
        let (at, through) = loaded(vectors, &springs, &load());
        let found: Vec<Derivatives<N>> = gauges::<N>()
            .iter()
            .map(|gauge| gauge.read(&at).derivatives(&at, &through))
            .collect();
        let values = springs.vector();
        for spring in 0..springs.count() {
            let changed = [-0.01, 0.01].map(|by| {
                let mut values = values.clone();
                values[spring] *= 1.0 + by;
                readings(vectors, &springs.with(&values), &load())
            });
            let analytic = found
                .iter()
                .map(|derivatives| derivatives.springs[spring])
                .collect();
            assert_column("spring", analytic, changed, 0.01 * values[spring]);
        }
        for component in 0..6 {
            let step = if component < 3 { 1.0 } else { 0.1 };
            let changed = [-step, step]
                .map(|by| readings(vectors, &springs, &(load() + Vector6::ith(component, by))));
            let analytic = found
                .iter()
                .map(|derivatives| derivatives.load[component])
                .collect();
            assert_column("load", analytic, changed, step);
        }
    }

    #[test]
    fn unit_loads_are_derivatives_of_both_machines() {
        unit_loads_are_derivatives(&Vectors::l2());
        unit_loads_are_derivatives(&Vectors::f1());
    }

    /// A gauge on the tool, and a strap that pulls there.
    fn gauge_and_pull(point: [f64; 3], axis: Vector3<f64>) -> (Gauge, Vector6<f64>) {
        let point_m = Vector3::from(point);
        let moment = point_m.cross(&axis);
        let gauge = Gauge::Face {
            body: Body::Tool,
            point_m,
            axis,
        };
        let pull = Vector6::new(axis.x, axis.y, axis.z, moment.x, moment.y, moment.z);
        (gauge, pull)
    }

    /// Betti: a strap pulling where a gauge stands, and a gauge where the strap pulled, show the
    /// same.
    #[test]
    fn strap_and_gauge_change_places() {
        let vectors = Vectors::l2();
        let springs = with_wrist(&vectors);
        let (one, pull_one) = gauge_and_pull([0.12, -0.06, 0.1], Vector3::x());
        let (other, pull_other) = gauge_and_pull([-0.1, 0.08, -0.05], Vector3::new(0.0, 0.6, 0.8));
        // A thousandth of a newton: the displaced points change nothing.
        let [here, there] = [(one, pull_other), (other, pull_one)].map(|(gauge, pull)| {
            let (at, _) = loaded(&vectors, &springs, &(pull * 1e-3));
            gauge.read(&at).length_m
        });
        assert!(
            (here - there).abs() < 1e-4 * here.abs(),
            "{here:e} {there:e}"
        );
    }
}
