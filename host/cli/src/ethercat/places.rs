//! Places of devices and expectations of terminals, from the keys of a file.

use gantry_tau_ethercat::{DevicePlace, GaugeConfig, NoReading};
use gantry_tau_machine::robot_file::EthercatGauge;

/// Returns the place that one of the two keys names.
pub(super) fn place(alias: Option<u16>, position: Option<u16>) -> DevicePlace {
    match (alias, position) {
        (Some(alias), _) => DevicePlace::Alias(alias),
        (None, position) => DevicePlace::Position(position.unwrap_or(0)),
    }
}

/// Returns the expectations of the terminals of gauges.
pub(super) fn gauge_configs(gauges: &[EthercatGauge]) -> Vec<GaugeConfig> {
    let configs = gauges.iter().map(|gauge| GaugeConfig {
        place: place(gauge.alias, gauge.position),
        vendor: GaugeConfig::BECKHOFF,
        product: gauge.product,
    });
    configs.collect()
}

/// Returns the lengths of these counts, m, in the order of the gauges; not a number for none.
pub(super) fn lengths_m(
    gauges: &[EthercatGauge],
    counts: impl Iterator<Item = Result<i64, NoReading>>,
) -> impl Iterator<Item = f64> {
    let of_gauges = counts.zip(gauges);
    of_gauges.map(|(count, gauge)| count.map_or(f64::NAN, |count| gauge.length_m(count)))
}
