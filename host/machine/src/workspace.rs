//! Reach, condition number and compliance of a machine with its platform unturned.

pub mod map;

use std::collections::BTreeMap;
use std::fmt;

use gantry_tau_core::model::kinematics::KinematicsError;

use crate::model::MachineKind;
use crate::robot_file::RobotFile;
pub use map::{Grid, GridPlace, Reached, Surveyor, condition};

/// Range of the steps along the longest side of a grid.
pub const CELLS: std::ops::RangeInclusive<u32> = 4..=200;

/// Results at every place of a grid.
#[derive(Clone, Debug, PartialEq)]
pub struct Survey<const N: usize> {
    /// Robot file.
    pub name: String,
    /// The grid.
    pub grid: Grid,
    /// Results, in the order of [`Grid`].
    pub places: Vec<GridPlace<N>>,
    /// Length that a radian of the platform counts as in a condition number, m.
    pub radian_m: f64,
}

/// Summary of a survey.
#[derive(Clone, Debug, PartialEq)]
pub struct Summary {
    /// Number of places.
    pub places: usize,
    /// Number of places that are reached.
    pub reached: usize,
    /// Volume of their cubes, m^3.
    pub volume_m3: f64,
    /// Number of the others by error code ([`KinematicsError::kind`]).
    pub refused: BTreeMap<&'static str, usize>,
    /// Condition number: smallest, median, largest.
    pub condition: [f64; 3],
    /// Compliance at the tool, µm/N: smallest, median, largest; absent without compliances.
    pub compliance_um_per_n: Option<[f64; 3]>,
    /// Condition number and compliance (µm/N) at home.
    pub home: (f64, Option<f64>),
}

/// Evaluates the machine at every place of `grid`, and passes each result to `each`.
pub fn survey<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    grid: Grid,
    mut each: impl FnMut(&GridPlace<N>),
) -> Survey<N> {
    let surveyor = Surveyor::new(robot);
    let places = grid.places().map(|steps| {
        let place = surveyor.survey(grid.at(steps));
        each(&place);
        place
    });
    Survey {
        name: robot.name.clone(),
        grid,
        places: places.collect(),
        radian_m: surveyor.radian_m(),
    }
}

impl<const N: usize> Survey<N> {
    /// Returns the table: a row per place. Numbers and codes, nothing that CSV would quote.
    #[must_use]
    pub fn table(&self) -> String {
        let rows = self.places.iter().map(GridPlace::fields);
        [GridPlace::<N>::header()]
            .into_iter()
            .chain(rows)
            .map(|row| row.join(",") + "\n")
            .collect()
    }

    /// Returns the summary.
    #[must_use]
    pub fn summary(&self) -> Summary {
        let reached = self.places.iter().filter_map(|place| place.reached.ok());
        let mut refused = BTreeMap::new();
        for error in (self.places.iter()).filter_map(|place| place.reached.err()) {
            *refused.entry(KinematicsError::kind(&error)).or_insert(0) += 1;
        }
        let home = (self.places.iter())
            .find(|place| place.tool_m == self.grid.home_m)
            .and_then(|place| place.reached.ok());
        let count = reached.clone().count();
        let cubes = f64::from(u32::try_from(count).unwrap_or(u32::MAX));
        Summary {
            places: self.places.len(),
            reached: count,
            volume_m3: cubes * self.grid.pitch_m.powi(3),
            refused,
            condition: quantiles(reached.clone().map(|reached| reached.condition))
                .unwrap_or_default(),
            compliance_um_per_n: quantiles(
                reached.filter_map(|reached| reached.compliance_um_per_n()),
            ),
            home: home.map_or((f64::NAN, None), |home| {
                (home.condition, home.compliance_um_per_n())
            }),
        }
    }
}

impl<const N: usize> Reached<N> {
    fn compliance_um_per_n(&self) -> Option<f64> {
        Some(self.compliance_m_per_n? * 1e6)
    }
}

/// Returns smallest, median and largest.
fn quantiles(values: impl Iterator<Item = f64>) -> Option<[f64; 3]> {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    let median = values.get(values.len() / 2)?;
    Some([*values.first()?, *median, *values.last()?])
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (reached, places, volume) = (self.reached, self.places, self.volume_m3);
        writeln!(
            f,
            "reached             {reached} of {places} places, {volume:.2} m^3"
        )?;
        for (kind, count) in &self.refused {
            writeln!(f, "{kind:<19} {count} places")?;
        }
        let (home, home_compliance) = self.home;
        let [low, median, high] = self.condition;
        write!(
            f,
            "condition number    {home:.2} at home; smallest {low:.2}, median {median:.2}, largest {high:.3e}"
        )?;
        if let (Some([low, median, high]), Some(home)) = (self.compliance_um_per_n, home_compliance)
        {
            write!(
                f,
                "\ncompliance, um/N    {home:.3} at home; smallest {low:.3}, median {median:.3}, largest {high:.3e}"
            )?;
        }
        Ok(())
    }
}

impl<const N: usize> GridPlace<N> {
    /// Names of the columns, with units.
    fn header() -> Vec<String> {
        let names = [
            "x_m",
            "y_m",
            "z_m",
            "code",
            "condition",
            "compliance_um_per_n",
        ];
        let mut header: Vec<String> = names.map(str::to_owned).into();
        header.extend((1..=N).map(|axis| format!("q{axis}")));
        header
    }

    fn fields(&self) -> Vec<String> {
        let mut fields: Vec<String> = self.tool_m.iter().map(|x| format!("{x:.6}")).collect();
        match &self.reached {
            Ok(reached) => {
                let compliance = reached.compliance_m_per_n;
                fields.extend(["ok".to_owned(), reached.condition.to_string()]);
                fields.push(compliance.map_or_else(String::new, |c| (c * 1e6).to_string()));
                fields.extend(reached.q.iter().map(f64::to_string));
            }
            Err(error) => {
                fields.push(error.kind().to_owned());
                fields.extend((0..N + 2).map(|_| String::new()));
            }
        }
        fields
    }
}

#[cfg(test)]
#[allow(
    clippy::indexing_slicing,
    reason = "the tests walk vectors by one axis number"
)]
mod tests;
