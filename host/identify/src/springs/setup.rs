//! Constants of a set-up that are known only about: where gauges touch and point, where the force
//! sensor stands, how it is turned, its gains.
//!
//! Each is an unknown of the fit with a prior of mean zero. They are counted in standard deviations
//! of the prior: first those of the gauges on platform and tool, mounting by mounting, then those
//! of the sensor.

use gantry_tau_machine::elastic::gauge::Gauge;
use nalgebra::{DMatrix, DVector, Vector3, Vector6};

use crate::fit::frames::across;
use crate::measurements::springs::{Campaign, SetupNoise};

/// Change of a constant that derivatives of a reading are taken with: m, rad. Readings are linear
/// in the point, and nearly so in the turn.
const DIFFERENCE: f64 = 1e-5;

/// Constants of one campaign, and where each stands.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct SetupConstants {
    noise: SetupNoise,
    /// Gauges on platform and tool, by their index among all gauges.
    faces: Vec<usize>,
    mountings: usize,
}

/// A constant of a set-up.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Constant {
    /// Its name: `pz1.point.x (mounting a)`.
    pub(crate) name: String,
    /// Standard deviation of its prior; m, rad, or relative.
    pub(crate) prior_sd: f64,
}

impl SetupConstants {
    pub(crate) fn of<const N: usize>(campaign: &Campaign<N>) -> Self {
        Self {
            noise: campaign.setup,
            faces: (0..campaign.gauges.len())
                .filter(|gauge| matches!(campaign.gauges[*gauge].gauge, Gauge::Face { .. }))
                .collect(),
            mountings: campaign.mountings.len(),
        }
    }

    /// The same constants, all exact.
    pub(crate) fn exact(&self) -> Self {
        Self {
            noise: SetupNoise::default(),
            ..self.clone()
        }
    }

    /// Number of constants of one gauge in one mounting.
    fn per_gauge(&self) -> usize {
        self.gauge_sds().len()
    }

    /// Standard deviations of the constants of a gauge: point along x, y, z, then turn about the
    /// two directions across.
    fn gauge_sds(&self) -> Vec<f64> {
        let point = self.noise.gauge_point_mm.map(|sd| vec![sd * 1e-3; 3]);
        let axis = self.noise.gauge_axis_mrad.map(|sd| vec![sd * 1e-3; 2]);
        point.into_iter().chain(axis).flatten().collect()
    }

    /// Number of constants of one mounting.
    pub(crate) fn per_mounting(&self) -> usize {
        self.faces.len() * self.per_gauge()
    }

    /// Number of constants of the sensor.
    pub(crate) fn of_sensor(&self) -> usize {
        self.effect(&Vector6::zeros()).ncols()
    }

    /// Number of all constants.
    pub(crate) fn count(&self) -> usize {
        self.mountings * self.per_mounting() + self.of_sensor()
    }

    /// Index of the first constant of a mounting; of the sensor, with their number.
    pub(crate) fn first(&self, mounting: usize) -> usize {
        mounting * self.per_mounting()
    }

    /// Index of the sensor's first constant.
    pub(crate) fn first_of_sensor(&self) -> usize {
        self.first(self.mountings)
    }

    /// Index of the first constant of a gauge, within its mounting; `None` if it has none.
    fn place(&self, gauge: usize) -> Option<usize> {
        let place = self.faces.iter().position(|other| *other == gauge)?;
        (self.per_gauge() > 0).then(|| place * self.per_gauge())
    }

    /// Returns how far a gauge stands from where it is assumed to, in the order of
    /// [`gauge_sds`](Self::gauge_sds); empty if it stands there exactly.
    fn offsets(&self, constants: &DVector<f64>, mounting: usize, gauge: usize) -> Vec<f64> {
        let Some(place) = self.place(gauge) else {
            return Vec::new();
        };
        let sds = self.gauge_sds();
        let first = self.first(mounting) + place;
        sds.iter()
            .zip(constants.rows(first, sds.len()).iter())
            .map(|(sd, z)| sd * z)
            .collect()
    }

    /// Returns a gauge where the constants put it.
    pub(crate) fn placed<const N: usize>(
        &self,
        campaign: &Campaign<N>,
        constants: &DVector<f64>,
        mounting: usize,
        gauge: usize,
    ) -> Gauge {
        self.moved(
            &campaign.gauges[gauge].gauge,
            &self.offsets(constants, mounting, gauge),
        )
    }

    /// A gauge moved by offsets, in the order of [`gauge_sds`](Self::gauge_sds).
    fn moved(&self, gauge: &Gauge, offsets: &[f64]) -> Gauge {
        let Gauge::Face {
            body,
            point_m,
            axis,
        } = *gauge
        else {
            return *gauge;
        };
        let (point, turn) = offsets.split_at(if self.noise.gauge_point_mm.is_some() {
            offsets.len().min(3)
        } else {
            0
        });
        let point_m = point_m + Vector3::from_iterator(point.iter().copied().chain([0.0; 3]));
        let across = across(&axis);
        let axis = across
            .iter()
            .zip(turn)
            .fold(axis, |axis, (direction, angle)| axis + direction * *angle);
        Gauge::Face {
            body,
            point_m,
            axis: axis.normalize(),
        }
    }

    /// Returns the derivatives of a reading by the constants of its gauge, and the place of the
    /// first in its mounting. `read` says what a gauge reads: the machine does not move when it
    /// stands elsewhere.
    pub(crate) fn derivatives<const N: usize>(
        &self,
        campaign: &Campaign<N>,
        constants: &DVector<f64>,
        mounting: usize,
        gauge: usize,
        read: impl Fn(&Gauge) -> f64,
    ) -> Option<(usize, Vec<f64>)> {
        let place = self.place(gauge)?;
        let offsets = self.offsets(constants, mounting, gauge);
        let mut derivatives = Vec::with_capacity(offsets.len());
        for (constant, sd) in self.gauge_sds().iter().enumerate() {
            let [above, below] = [DIFFERENCE, -DIFFERENCE].map(|by| {
                let mut beside = offsets.clone();
                beside[constant] += by;
                read(&self.moved(&campaign.gauges[gauge].gauge, &beside))
            });
            derivatives.push(sd * ((above - below) / (2.0 * DIFFERENCE)));
        }
        Some((place, derivatives))
    }

    /// Effect of the sensor's constants on what it indicates under a load: 6 rows (N, N m), one
    /// column per constant. World axes, about the tool centre point: a lever of the sensor that is
    /// longer by `d` adds `d x F` to the moment, turned axes turn force and moment, gains are
    /// relative.
    pub(crate) fn effect(&self, load: &Vector6<f64>) -> DMatrix<f64> {
        let force: Vector3<f64> = load.fixed_rows::<3>(0).into();
        let moment: Vector3<f64> = load.fixed_rows::<3>(3).into();
        let units = [Vector3::x(), Vector3::y(), Vector3::z()];
        let mut columns: Vec<Vector6<f64>> = Vec::new();
        if let Some(sd) = self.noise.sensor_lever_mm {
            columns.extend(
                units.map(|unit| stacked(Vector3::zeros(), unit.cross(&force)) * (sd * 1e-3)),
            );
        }
        if let Some(sd) = self.noise.sensor_axes_mrad {
            columns.extend(
                units.map(|unit| stacked(unit.cross(&force), unit.cross(&moment)) * (sd * 1e-3)),
            );
        }
        if let Some(sd) = self.noise.sensor_gain {
            columns.extend((0..6).map(|component| Vector6::ith(component, load[component] * sd)));
        }
        DMatrix::from_fn(6, columns.len(), |row, column| columns[column][row])
    }

    /// All constants, in order.
    pub(crate) fn list<const N: usize>(&self, campaign: &Campaign<N>) -> Vec<Constant> {
        let point = self
            .noise
            .gauge_point_mm
            .map(|_| ["point.x", "point.y", "point.z"].as_slice());
        let turn = self
            .noise
            .gauge_axis_mrad
            .map(|_| ["axis.1", "axis.2"].as_slice());
        let kinds: Vec<&str> = point.into_iter().chain(turn).flatten().copied().collect();
        let sds = self.gauge_sds();
        let mut list = Vec::with_capacity(self.count());
        for mounting in &campaign.mountings {
            for gauge in &self.faces {
                let gauge = &campaign.gauges[*gauge].name;
                list.extend(kinds.iter().zip(&sds).map(|(kind, sd)| Constant {
                    name: format!("{gauge}.{kind} (mounting {mounting})"),
                    prior_sd: *sd,
                }));
            }
        }
        list.extend(self.list_of_sensor());
        list
    }

    /// Constants of the sensor, in order.
    fn list_of_sensor(&self) -> Vec<Constant> {
        let SetupNoise {
            sensor_lever_mm,
            sensor_axes_mrad,
            sensor_gain,
            ..
        } = self.noise;
        let of_sensor: [(&str, &[&str], Option<f64>); 3] = [
            (
                "lever",
                &["x", "y", "z"],
                sensor_lever_mm.map(|sd| sd * 1e-3),
            ),
            (
                "axes",
                &["x", "y", "z"],
                sensor_axes_mrad.map(|sd| sd * 1e-3),
            ),
            (
                "gain",
                &[
                    "force_x", "force_y", "force_z", "moment_x", "moment_y", "moment_z",
                ],
                sensor_gain,
            ),
        ];
        let mut list = Vec::new();
        for (kind, components, sd) in of_sensor {
            let Some(prior_sd) = sd else { continue };
            list.extend(components.iter().map(|name| Constant {
                name: format!("sensor.{kind}.{name}"),
                prior_sd,
            }));
        }
        list
    }
}

/// Six numbers of a force and a moment.
fn stacked(force: Vector3<f64>, moment: Vector3<f64>) -> Vector6<f64> {
    Vector6::new(force.x, force.y, force.z, moment.x, moment.y, moment.z)
}
