//! Both ways to compute a correction, compared at home without noise, filter or drives.

use gantry_tau_core::model::kinematics::Pose as CorePose;
use gantry_tau_core::model::statics::Wrench;
use gantry_tau_core::units::OffsetNm;
use gantry_tau_machine::elastic::backlash::Backlash;
use gantry_tau_machine::elastic::loaded::Loaded;
use gantry_tau_machine::elastic::springs::Springs;
use gantry_tau_machine::elastic::{ElasticMachine, Equilibrium};
use gantry_tau_machine::model::{CorrectedPose, MachineKind};
use gantry_tau_machine::robot_file::{CorrectionKind, RobotFile};
use gantry_tau_sim::springs::deviated;
use nalgebra::Vector6;
use serde::Serialize;

/// Remaining displacement of the tool at home under a force in x, µm: with first order, and with
/// exact correction.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Corrections {
    /// Force in x, N.
    pub force_n: f64,
    /// With springs that the file knows only nearly: those of the simulation, without its play.
    pub file_springs_um: [f64; 2],
    /// With springs that the file knows exactly.
    pub true_springs_um: [f64; 2],
}

impl Corrections {
    /// Computes both ways; `None` where the machine does not stand under this force.
    pub(super) fn of<K: MachineKind<N>, const N: usize>(
        file: &RobotFile<K, N>,
        force_n: f64,
    ) -> Option<Self> {
        let springs = Springs::of(file)?;
        let truth = deviated(&springs, &file.simulation).ok()?;
        Some(Self {
            force_n,
            file_springs_um: remainders_um(file, &truth, force_n)?,
            true_springs_um: remainders_um(file, &springs, force_n)?,
        })
    }
}

/// With first order, and with exact correction.
fn remainders_um<K: MachineKind<N>, const N: usize>(
    file: &RobotFile<K, N>,
    springs: &Springs<N>,
    force_n: f64,
) -> Option<[f64; 2]> {
    Some([
        remainder_um(file, springs, CorrectionKind::FirstOrder, force_n)?,
        remainder_um(file, springs, CorrectionKind::Exact, force_n)?,
    ])
}

fn remainder_um<K: MachineKind<N>, const N: usize>(
    file: &RobotFile<K, N>,
    springs: &Springs<N>,
    kind: CorrectionKind,
    force_n: f64,
) -> Option<f64> {
    let mut client = file.clone();
    client.client.correction = Some(kind);
    let compensator = client
        .compensator(file.limits.map(|axis| OffsetNm(axis.limits.position.max())))
        .ok()?;
    let load = Vector6::new(force_n, 0.0, 0.0, 0.0, 0.0, 0.0);
    let home = CorePose::at(file.home_m());
    let q = file.home_q().ok()?;
    let held = CorrectedPose::new(
        &*compensator,
        &file.metres_per_q,
        &home,
        &q,
        &Wrench::from_array(load.into()),
    )
    .ok()?;
    let start = Equilibrium::at_home(file.simulation.home_m);
    let machine = ElasticMachine::new(file.model.geometry(), springs.machine, Backlash::NONE);
    let began = machine
        .equilibrium(&held.nominal, &Vector6::zeros(), &start)
        .ok()?;
    let now = machine.equilibrium(&held.corrected, &load, &began).ok()?;
    let loaded = Loaded {
        machine,
        wrist: springs.wrist.clone(),
        began: began.pose,
        now,
        load,
    };
    Some(loaded.displacement().translation_m.norm() * 1e6)
}
