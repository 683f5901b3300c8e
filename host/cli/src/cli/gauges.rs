//! `gantry-tau gauges`.

use std::net::SocketAddr;

use clap::Args;
use gantry_tau_record::recording::RecordTo;
use gantry_tau_system::dial::Addresses;

use super::outputs::InputFile;
use super::{OptionError, Outcome, address, peer};

/// Publish the lengths of gauges on EtherCAT terminals, for `experiment`
///
/// Reads terminals that count the edges of a gauge (EL5101, EL5151) 1000 times per second, on a bus
/// of their own, and publishes the lengths, from the first count on. A gauge without a count, for a
/// wire that is open, a terminal that is gone or a frame that is lost, is a NaN, and the reason is
/// logged. One whose terminal was restarted stays NaN: its count is another one. End the program,
/// and begin again.
///
/// FILE.toml has a table [[gauge]] for each one, in the order in which they are published: name,
/// position on the bus or alias, product, um_per_count, sign. See docs/ethercat.md.
///
/// Exit codes: 0 ended by Ctrl-C; 1 the file or an address cannot be used, or this program has no EtherCAT; 2 usage;
/// 8 the bus cannot be read.
#[derive(Debug, Args)]
pub(crate) struct GaugesCommand {
    /// The network interface of the bus; emulated for a bus without hardware
    #[arg(value_name = "IFACE|emulated")]
    pub(super) interface: String,
    /// The gauges
    #[arg(value_name = "FILE.toml")]
    pub(super) file: InputFile,
    /// Address for readers
    #[arg(long, value_name = "HOST:PORT", default_value = "127.0.0.1:7002", value_parser = address)]
    pub(super) publish: SocketAddr,
    /// Publish the counts of the first three gauges over LabComm, as the sample data of the thesis
    #[arg(long, value_name = "HOST:PORT", value_parser = address)]
    pub(super) labcomm: Option<SocketAddr>,
    /// Answer only this peer or network; others are closed silently (repeatable). Needed for
    /// addresses that are not of this machine alone
    #[arg(long, value_name = "IP|IP/BITS")]
    pub(super) allow: Vec<String>,
    /// Record the lengths of every cycle
    #[arg(long, value_name = "FILE.csv", value_parser = record_csv)]
    pub(super) record: Option<RecordTo>,
    /// With emulated: the terminals count what the gauges at this address show, those of
    /// `serve --plan`, say; without it they stand
    #[arg(long, value_name = "HOST:PORT", value_parser = peer)]
    pub(super) show: Option<Addresses>,
}

/// A recording as CSV.
fn record_csv(text: &str) -> Result<RecordTo, OptionError> {
    let to: RecordTo = text.parse()?;
    if to.path().extension().is_some_and(|ending| ending == "csv") {
        Ok(to)
    } else {
        Err("expected FILE.csv".into())
    }
}

#[cfg(not(all(feature = "ethercat", target_os = "linux")))]
impl GaugesCommand {
    pub(super) fn run(self) -> Outcome {
        Err(super::plant::WITHOUT_ETHERCAT.into())
    }
}

#[cfg(all(feature = "ethercat", target_os = "linux"))]
impl GaugesCommand {
    pub(super) fn run(self) -> Outcome {
        use gantry_tau_ethercat::RawSocket;

        use crate::ethercat::gauges::{GaugesFile, shown_bus};

        let file = GaugesFile::read(&self.file)?;
        let outputs = self.outputs(&file)?;
        if self.interface == "emulated" {
            let wire = shown_bus(&file, self.show.as_ref())?;
            return self.publish(wire, &file, outputs);
        }
        if self.show.is_some() {
            return Err("--show is for the emulated bus: real terminals count their gauges".into());
        }
        match RawSocket::open(&self.interface) {
            Ok(wire) => self.publish(wire, &file, outputs),
            Err(error) => Ok(super::fail(8, error)),
        }
    }

    /// Listens, and makes the recording, before the bus is touched.
    fn outputs(
        &self,
        file: &crate::ethercat::gauges::GaugesFile,
    ) -> Result<crate::ethercat::gauges::GaugeOutputs, super::Failure> {
        use gantry_tau_server::links::Allowed;

        use crate::ethercat::gauges::GaugeOutputs;

        let allowed = Allowed::only(&self.allow)?;
        super::check_reach(self.publish, &allowed)?;
        self.labcomm
            .map_or(Ok(()), |address| super::check_reach(address, &allowed))?;
        let record = self.record.as_ref().map(RecordTo::path);
        GaugeOutputs::open(file, self.publish, self.labcomm, &allowed, record)
    }

    fn publish<W: gantry_tau_ethercat::Wire>(
        &self,
        wire: W,
        file: &crate::ethercat::gauges::GaugesFile,
        outputs: crate::ethercat::gauges::GaugeOutputs,
    ) -> Outcome {
        use std::process::ExitCode;
        use std::sync::Arc;
        use std::sync::atomic::{AtomicBool, Ordering};

        use crate::ethercat::gauges::{self, GaugesCommandError};

        let quit = Arc::new(AtomicBool::new(false));
        let asked = Arc::clone(&quit);
        crate::signals::on_quit(move || asked.store(true, Ordering::Relaxed));
        match gauges::run(wire, file, outputs, &quit) {
            Ok(()) => Ok(ExitCode::SUCCESS),
            Err(error @ GaugesCommandError::Bus { .. }) => Ok(super::fail(8, error)),
            Err(error) => Err(error.into()),
        }
    }
}
