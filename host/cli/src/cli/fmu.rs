//! `gantry-tau fmu`.

use std::path::PathBuf;
use std::process::ExitCode;

use crate::fmu::fmu;
use crate::fmu::library::Library;
use crate::terminal::say;
use clap::Args;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use gantry_tau_fmi::kind::Kind as UnitKind;
use gantry_tau_machine::robot_file::text_of;
use gantry_tau_system::output::{Kind, Output};

use super::Outcome;
use super::machine::MachineOption;
use super::outputs::{InputFile, file};

/// Write a functional mock-up unit (FMI 2.0, co-simulation): server, machine or compensator for
/// Simulink, OpenModelica, Dymola, FMPy
///
/// The unit has the robot file, a description of its variables, and the library of all units,
/// libgantry_tau_fmu.so, which is found beside this program or named with --library. A unit computes
/// cycles of 1 ms. docs/fmi.md has its variables and a program that runs it.
#[derive(Debug, Args)]
pub(crate) struct Fmu {
    #[command(flatten)]
    machine: MachineOption,
    /// Kind of the unit
    #[arg(long, value_parser = unit_kind())]
    kind: UnitKind,
    /// Library of the units, one per platform (repeatable) [default: that of this computer, beside
    /// the program or in ../lib/gantry-tau from there]
    #[arg(long, value_name = "FILE")]
    library: Vec<InputFile>,
    /// The unit to be written
    #[arg(short, long, value_name = "FILE.fmu", value_parser = file(Kind::Fmu))]
    output: Output,
}

/// Reads a kind by its name.
fn unit_kind() -> impl TypedValueParser<Value = UnitKind> {
    let named = UnitKind::ALL.map(|kind| PossibleValue::new(kind.name()).help(kind.description()));
    PossibleValuesParser::new(named).try_map(|name| name.parse())
}

impl Fmu {
    pub(super) fn run(self) -> Outcome {
        let named: Vec<PathBuf> = self.library.iter().map(|file| file.to_path_buf()).collect();
        let libraries = Library::find(&named)?;
        let (kind, name) = (self.kind, self.machine.name());
        let text = text_of(name)?;
        let bytes = fmu(kind, name, &text, &libraries)?;
        self.output.write_bytes(&bytes)?;
        let platforms = libraries.iter().map(|library| library.platform.folder());
        let platforms = platforms.collect::<Vec<_>>().join(", ");
        let path = self.output.path().display();
        say(format_args!(
            "{kind} of {name} for {platforms}: written to {path}"
        ));
        Ok(ExitCode::SUCCESS)
    }
}
