//! Terminals in process that count what other gauges show.

use gantry_tau_ethercat::emulation::{
    Chain, EmulatedWire, EncoderModel, EncoderTerminal, Instrument, Node, Plain, Process, SubDevice,
};
use gantry_tau_machine::robot_file::EthercatGauge;
use gantry_tau_server::links::gauges::GaugeReader;
use gantry_tau_system::dial::{Addresses, NEVER};

use super::GaugesFile;
use crate::ethercat::places::place;

/// Product code of an EL5151; any other counts as an EL5101.
const EL5151: u32 = 0x141F_3052;

/// Gauges that are shown by a link.
#[derive(Debug)]
pub struct ShownGauges {
    gauges: Vec<EthercatGauge>,
    link: Option<GaugeReader>,
}

impl Process for ShownGauges {
    fn step(&mut self, _drives: &mut [SubDevice]) {}

    fn measure(&mut self, instruments: &mut [SubDevice<Instrument>]) {
        let Some(link) = &mut self.link else {
            return;
        };
        let lengths = match link.latest() {
            Ok(Some(lengths)) => lengths,
            Ok(None) => return,
            Err(error) => {
                tracing::warn!("the gauges that are shown are gone: {error}");
                self.link = None;
                terminals(instruments).for_each(|terminal| terminal.break_wire(true));
                return;
            }
        };
        let lengths_m = lengths.lengths_m().iter().copied();
        // Those that the link does not have are not mounted.
        let lengths_m = lengths_m.chain(std::iter::repeat(f64::NAN));
        for ((terminal, gauge), length_m) in terminals(instruments).zip(&self.gauges).zip(lengths_m)
        {
            terminal.break_wire(!length_m.is_finite());
            if length_m.is_finite() {
                terminal.set_counts((length_m / gauge.length_m(1)).round() as i64);
            }
        }
    }
}

fn terminals(
    instruments: &mut [SubDevice<Instrument>],
) -> impl Iterator<Item = &mut EncoderTerminal> {
    let devices = instruments.iter_mut().map(SubDevice::device_mut);
    devices.filter_map(|device| match device {
        Instrument::Encoder(terminal) => Some(terminal),
        Instrument::Plain(_) | Instrument::Force(_) => None,
    })
}

/// Returns an emulated terminal for a gauge.
pub(in crate::ethercat) fn terminal(gauge: &EthercatGauge) -> Node {
    let model = if gauge.product == EL5151 {
        EncoderModel::El5151
    } else {
        EncoderModel::El5101
    };
    let terminal = Instrument::Encoder(EncoderTerminal::new(model));
    Node::Instrument(SubDevice::of(terminal))
}

/// Builds a bus of a coupler and the terminals of a file, in its order. They count what the gauges
/// at `show` show, or stand.
///
/// # Errors
/// Gauges at other positions than 1, 2 and so on; nothing listens at `show`.
pub fn shown_bus(
    file: &GaugesFile,
    show: Option<&Addresses>,
) -> Result<EmulatedWire<ShownGauges>, String> {
    let mut nodes = vec![Node::Instrument(SubDevice::of(Instrument::Plain(
        Plain::coupler(),
    )))];
    for (position, gauge) in (1..).zip(&file.gauges) {
        if gauge.position != Some(position) {
            return Err(format!(
                "{}: {}: the emulated bus has the gauges at positions 1, 2 and so on, in the order of the file; this one is at {}",
                file.path,
                gauge.name,
                place(gauge.alias, gauge.position)
            ));
        }
        nodes.push(terminal(gauge));
    }
    let link = show.map(|at| {
        GaugeReader::connect(at.clone(), &NEVER)
            .map_err(|error| format!("no gauges at {at}: {error}"))
    });
    let process = ShownGauges {
        gauges: file.gauges.clone(),
        link: link.transpose()?,
    };
    Ok(EmulatedWire::new(Chain::of(nodes, process)))
}
