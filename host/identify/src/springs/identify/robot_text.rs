//! Robot file of an identified machine: that of the file that the identification began with,
//! edited.

use gantry_tau_core::model::robot::LINKS;
use gantry_tau_machine::elastic::backlash::Backlash;
use gantry_tau_machine::elastic::springs::axes_key;
use gantry_tau_machine::elastic::{ElasticMachine, Equilibrium};
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::edit::RobotText;
use gantry_tau_machine::robot_file::{Identified, Play, RobotFile};
use nalgebra::Vector6;

use super::answer::{PlayAnswer, SpringsAnswer};
use super::{IdentifiedSprings, IdentifyError, IdentifyOptions};

fn edit_error(error: impl std::fmt::Display) -> IdentifyError {
    IdentifyError::Edit(error.to_string())
}

impl<const N: usize> IdentifiedSprings<'_, N> {
    /// Text of the changed robot file.
    pub(super) fn robot_file<K: MachineKind<N>>(
        &self,
        robot: &RobotFile<K, N>,
        options: &IdentifyOptions,
        answer: &SpringsAnswer,
        warnings: &mut Vec<String>,
    ) -> Result<String, IdentifyError> {
        let campaign = self.problem.campaign;
        let text = gantry_tau_machine::robot_file::text_of(&options.robot)?;
        let provenance = format!(
            "IDENTIFIED with {} (CRC-32 {:08x})",
            campaign.table, campaign.crc
        );
        let mut text = RobotText::new(&text, &provenance).map_err(edit_error)?;
        let values: Vec<f64> = answer
            .parameters
            .iter()
            .map(|parameter| parameter.value)
            .collect();
        let (links, axes) = values.split_at(LINKS);
        text.set_numbers("c_link", links);
        text.set_numbers(axes_key::<N>(), &axes[..N]);
        for (joint, value) in axes[N..].iter().take(robot.wrist.len()).enumerate() {
            text.set_number_of("wrist", joint, "c_rad_per_nm", *value);
        }
        let springs = self.problem.file.count();
        let covariance = self
            .uncertainty()
            .whole_covariance()
            .view((0, 0), (springs, springs))
            .into_owned();
        let identified = Identified {
            measurements: campaign.table.clone(),
            crc: campaign.crc,
            windows: campaign.windows.len(),
            chi2: answer.fit.chi2,
            dof: answer.fit.dof,
            sd: covariance
                .diagonal()
                .iter()
                .map(|variance| variance.max(0.0).sqrt())
                .collect(),
            covariance: covariance
                .row_iter()
                .map(|row| row.iter().copied().collect())
                .collect(),
            relative_to: self.problem.relative_to.as_slice().to_vec(),
        };
        text.set_serialized("identified", &identified)
            .map_err(edit_error)?;
        if let Some(PlayAnswer {
            gap_m,
            sd_m,
            preload_rising_n,
            preload_falling_n,
        }) = answer.play
        {
            let play = Play {
                gap_m,
                sd_m,
                preload_rising_n,
                preload_falling_n,
            };
            text.set_serialized("play", &play).map_err(edit_error)?;
            match preload_rising_n.or(preload_falling_n).and_then(|preload_n| self.jump_force_n(robot, preload_n)) {
                Some(jump_force_n) => {
                    text.set_number_in("simulation", "jump_force_n", jump_force_n);
                    text.set_number_in("simulation", "jump_gap_m", gap_m);
                }
                None => warnings.push(
                    "the jump is not one that a force in +x opens at home; [simulation] keeps its own".to_owned(),
                ),
            }
        }
        Ok(text.text())
    }

    /// Force in x at home that takes the preload away, N; `None` if none in +x does.
    fn jump_force_n<K: MachineKind<N>>(
        &self,
        robot: &RobotFile<K, N>,
        preload_n: [f64; 2],
    ) -> Option<f64> {
        let home = robot.home_m();
        let q = robot.model.axes_at(&home).ok()?;
        let compliances = self.robust_fit.solution.state.springs.machine;
        let machine = ElasticMachine::new(*self.problem.geometry, compliances, Backlash::NONE);
        let probe_n = 100.0;
        let load = Vector6::new(probe_n, 0.0, 0.0, 0.0, 0.0, 0.0);
        let loaded = machine
            .equilibrium(&q, &load, &Equilibrium::at_home(home.into()))
            .ok()?;
        let force = -f64::midpoint(preload_n[0], preload_n[1]) * probe_n / loaded.cluster_3_n();
        (1.0..1e5).contains(&force).then_some(force)
    }
}
