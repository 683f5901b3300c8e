//! `gantry-tau verify`.

use crate::terminal::say;
use clap::Args;
use gantry_tau_identify::measurements::springs;
use gantry_tau_identify::verify::{
    PredictOptions, VerifyError, predict, prediction_page, verification_page, verify,
};
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::{CorrectionKind, RobotFile};
use gantry_tau_system::output::{Kind, Output};

use super::outputs::{InputFile, NamedInput, file};
use super::workspace::check_cells;
use super::{Failure, MachineCommand, Outcome, doubted};

/// Compare what remains of the tool's displacement with compensation against what the robot file
/// predicts
///
/// Reads pairs of windows, compensation off and on, in the formats of `identify`: a set-up (TOML,
/// format = "gantry-tau springs 1") and its table (CSV). In each series of the table, rows without
/// a load (every component within 5 standard deviations of zero) give the zeros of the gauges; two
/// rows with a load and the same `window` are a pair. The one whose q is that of the rows without a
/// load is off; the q of the other contains the offsets of the compensation. The two may also stand
/// in series of their own, `NAME off` and `NAME on`, as `plan verify` writes them: same pose, same
/// mounting, and the second with `compensated = true` or a name in ` on`.
///
/// With --predict nothing is measured: the remainder is predicted over the workspace from the
/// covariance that the robot file carries.
///
/// Exit codes: 0 done; 1 cannot run; 3 done, and not to be trusted as it is: the readings reject
/// the file (p < 0.001), or more than the tolerance remains.
#[derive(Debug, Args)]
pub(crate) struct Verify {
    /// Set-up of the measurements
    #[arg(
        value_name = "MEASURED.toml",
        required_unless_present = "predict",
        conflicts_with = "predict"
    )]
    measured: Option<InputFile>,
    /// The machine: l2 or f1 (built in), or a robot file
    #[arg(long, value_name = "l2|f1|FILE")]
    pub(super) robot: NamedInput,
    /// Predict the remainder over the workspace instead of reading measurements
    #[arg(long)]
    predict: bool,
    /// Path of the page with the maps
    #[arg(long, value_name = "PAGE.html", value_parser = file(Kind::Page))]
    report: Option<Output>,
    /// The answer for programs
    #[arg(long, value_name = "FILE", value_parser = file(Kind::Answer))]
    json: Option<Output>,
    /// Largest remainder, um: of every measured pair, or what 95 % of the predicted ones stay below
    #[arg(long, value_name = "UM", default_value_t = 20.0)]
    tolerance: f64,
    /// Stiffness of the workpiece for the largest stable gain, N/m; the default is nearly rigid
    #[arg(long, value_name = "N/m", default_value_t = 1e9)]
    stiffness: f64,
    /// Force of the predicted loads, N
    #[arg(long, value_name = "N", default_value_t = 300.0)]
    force_n: f64,
    /// Steps along the longest side of the grid of the prediction
    #[arg(long, value_name = "N", default_value_t = 16)]
    cells: u32,
}

impl MachineCommand for Verify {
    fn run_on<K: MachineKind<N>, const N: usize, const M: usize>(
        self,
        robot: RobotFile<K, N>,
    ) -> Outcome {
        self.check()?;
        let doubts = match &self.measured {
            Some(path) => self.measured(path, &robot)?,
            None => self.predicted(&robot)?,
        };
        Ok(doubted(&doubts))
    }
}

impl Verify {
    fn check(&self) -> Result<(), Failure> {
        let positive = [
            ("--tolerance", self.tolerance),
            ("--stiffness", self.stiffness),
            ("--force-n", self.force_n),
        ];
        if let Some((option, value)) = positive
            .into_iter()
            .find(|(_, value)| !(*value > 0.0 && value.is_finite()))
        {
            return Err(format!("{option} is {value}; expected a number above 0").into());
        }
        check_cells(self.cells)
    }

    fn options(&self) -> PredictOptions {
        PredictOptions {
            cells: self.cells,
            force_n: self.force_n,
            workpiece_n_per_m: self.stiffness,
        }
    }

    /// Compares measurements; returns the doubts.
    fn measured<K: MachineKind<N>, const N: usize>(
        &self,
        path: &std::path::Path,
        robot: &RobotFile<K, N>,
    ) -> Result<Vec<String>, Box<dyn std::error::Error>> {
        let campaign = springs::read(path, K::MODEL, &robot.metres_per_q)?;
        campaign.check_wrist(path, robot.wrist.len())?;
        let verification = verify(robot, &campaign, self.stiffness)?;
        let doubts = verification.doubts(self.tolerance * 1e-6);
        if let Some(output) = &self.report {
            let prediction = match predict(robot, &self.options()) {
                Err(VerifyError::NotIdentified { .. }) => None,
                prediction => Some(prediction?),
            };
            let home_m = robot.home_m();
            let page = verification_page(
                &robot.name,
                &home_m,
                &verification,
                prediction.as_ref(),
                &doubts,
            );
            output.write(&page)?;
        }
        if let Some(output) = &self.json {
            output.write(&serde_json::to_string_pretty(&verification)?)?;
        }
        say(format_args!("{}\n\n{verification}", robot.name));
        Ok(doubts)
    }

    /// Predicts; returns the doubts.
    fn predicted<K: MachineKind<N>, const N: usize>(
        &self,
        robot: &RobotFile<K, N>,
    ) -> Result<Vec<String>, Box<dyn std::error::Error>> {
        let prediction = predict(robot, &self.options())?;
        let summary = prediction.summary();
        let doubts = summary.doubts(self.tolerance * 1e-6);
        let method = match robot.correction() {
            CorrectionKind::FirstOrder => "to first order",
            CorrectionKind::Exact => "exact",
        };
        if let Some(output) = &self.report {
            output.write(&prediction_page(&robot.name, method, &prediction, &doubts))?;
        }
        if let Some(output) = &self.json {
            output.write(&prediction.json(K::MODEL)?)?;
        }
        say(format_args!(
            "{}, corrections {method}\n\n{summary}",
            robot.name
        ));
        Ok(doubts)
    }
}
