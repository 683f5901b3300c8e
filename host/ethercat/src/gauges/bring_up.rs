//! From power-on to SAFE-OP, with OP asked for.

use ethercrab::subdevice_group::Op;
use ethercrab::{EtherCrabWireReadSized, EtherCrabWireWrite, MainDevice, SubDevice, SubDeviceRef};

use super::terminal::{Counter, CounterMap};
use super::{GaugeConfig, GaugeRefusal, GaugesError, Terminal};
use crate::discovery::{self, Found, Group, Unplaced, discover, first_refusal, locate};

/// PDO assignments of outputs and inputs.
const OUTPUTS: u16 = 0x1C12;
const INPUTS: u16 = 0x1C13;
/// PDOs of outputs and inputs, the best first: a counter of 32 bits of an EL5101, and the only ones
/// of an EL5101-0010 and an EL5151.
const PDOS: [[u16; 2]; 2] = [[0x1603, 0x1A04], [0x1600, 0x1A00]];
/// Objects by which the terminal's program runs: of its inputs, and of its outputs.
const SYNCHRONISATION: [u16; 2] = [0x1C33, 0x1C32];
/// From the object of a status to that of the settings; its sub-indices that switch the checks of
/// the wires on.
const TO_SETTINGS: u16 = 0x2000;
const WIRE_CHECKS: [u8; 2] = [0x0B, 0x0C];

/// The bus in SAFE-OP, with OP asked for.
pub(super) struct Ready {
    pub(super) group: Group<Op>,
    pub(super) terminals: Vec<Terminal>,
}

pub(super) async fn bring_up(
    main: &'static MainDevice<'static>,
    gauges: &[GaugeConfig],
) -> Result<Ready, GaugesError> {
    let is_gauge = |here: &Found| gauges.iter().any(|gauge| here.is_at(gauge.place));
    let (groups, found) = discover(main, || 0, is_gauge).await?;
    let mut terminals = Vec::new();
    for (gauge, config) in gauges.iter().enumerate() {
        let refused = |reason| GaugesError::Gauge { gauge, reason };
        let (station, index) = place(&found, gauges, config).map_err(refused)?;
        let subdevice = groups.chosen.subdevice(main, index).map_err(|error| {
            let step = "looking for the terminal";
            refused(GaugeRefusal::Exchange { step, error })
        })?;
        let counter = Setup(&subdevice).prepare().await.map_err(refused)?;
        terminals.push(Terminal {
            index,
            station,
            counter,
            state: 0,
        });
    }
    let bus = |step| move |error| GaugesError::Bus { step, error };
    let group = groups.chosen.into_pre_op_pdi(main).await;
    let group = group.map_err(bus("mapping process data"))?;
    let group = match group.into_safe_op(main).await {
        Ok(group) => group,
        Err(error) => {
            let stations = terminals.iter().map(|terminal| terminal.station);
            let refused = first_refusal(main, stations).await;
            return Err(refused.map_or(
                GaugesError::Bus {
                    step: "SAFE-OP",
                    error,
                },
                |(gauge, state, code)| GaugesError::Gauge {
                    gauge,
                    reason: GaugeRefusal::NotOperational { state, code },
                },
            ));
        }
    };
    // Outputs that are valid before OP is asked for.
    let first = group.tx_rx(main).await;
    first.map_err(bus("the first exchange"))?;
    let group = group.request_into_op(main).await.map_err(bus("OP"))?;
    Ok(Ready { group, terminals })
}

/// Finds the terminal of a gauge, and compares its identity. Returns its station address and its
/// index among the gauges of the bus.
fn place(
    found: &[Found],
    gauges: &[GaugeConfig],
    config: &GaugeConfig,
) -> Result<(u16, usize), GaugeRefusal> {
    let place = config.place;
    let places = gauges.iter().map(|gauge| gauge.place);
    let (device, index) = locate(found, place, places).map_err(|reason| match reason {
        Unplaced::Missing => GaugeRefusal::Missing {
            place,
            found: found.len(),
        },
        Unplaced::Ambiguous => GaugeRefusal::Ambiguous { place },
    })?;
    if (device.vendor, device.product) != (config.vendor, config.product) {
        return Err(GaugeRefusal::Identity {
            place,
            vendor: config.vendor,
            product: config.product,
            found_vendor: device.vendor,
            found_product: device.product,
        });
    }
    Ok((device.station, index))
}

/// Set-up of one terminal in PRE-OP.
struct Setup<'a>(&'a SubDeviceRef<'a, &'a SubDevice>);

impl Setup<'_> {
    /// Chooses the widest counter that the terminal has, and switches its wire checks on.
    async fn prepare(&self) -> Result<Counter, GaugeRefusal> {
        for [outputs, inputs] in PDOS {
            if self.object::<u8>(inputs, 0).await?.is_some() {
                self.assign(OUTPUTS, outputs).await?;
                self.assign(INPUTS, inputs).await?;
                break;
            }
        }
        let (status, bits) = self.assigned_inputs().await?;
        let map = CounterMap::of_bits(bits).ok_or(GaugeRefusal::Map { bits })?;
        for sub in WIRE_CHECKS {
            let settings = status.wrapping_add(TO_SETTINGS);
            if map != CounterMap::Old && self.object::<u8>(settings, sub).await?.is_some() {
                self.write(settings, sub, 1_u8).await?;
            }
        }
        let mut runs_freely = false;
        for object in SYNCHRONISATION {
            if let Some(kind) = self.object::<u16>(object, 1).await? {
                runs_freely = kind == 0;
                break;
            }
        }
        Ok(Counter::new(map, !runs_freely))
    }

    /// Assigns one PDO, unless it is assigned alone.
    async fn assign(&self, direction: u16, pdo: u16) -> Result<(), GaugeRefusal> {
        let count = self.object::<u8>(direction, 0).await?;
        if count == Some(1) && self.object::<u16>(direction, 1).await? == Some(pdo) {
            return Ok(());
        }
        self.write(direction, 0, 0_u8).await?;
        self.write(direction, 1, pdo).await?;
        self.write(direction, 0, 1_u8).await
    }

    /// Returns the object of the status and the number of bits of the inputs that are assigned.
    async fn assigned_inputs(&self) -> Result<(u16, u32), GaugeRefusal> {
        let (mut first, mut bits) = (None, 0);
        let count = self.object::<u8>(INPUTS, 0).await?.unwrap_or(0);
        for place in 1..=count {
            let Some(pdo) = self.object::<u16>(INPUTS, place).await? else {
                continue;
            };
            let entries = self.object::<u8>(pdo, 0).await?.unwrap_or(0);
            for entry in 1..=entries {
                let entry = self.object::<u32>(pdo, entry).await?.unwrap_or(0);
                bits += entry & 0xFF;
                first = first.or(Some((entry >> 16) as u16));
            }
        }
        Ok((first.unwrap_or(0), bits))
    }

    /// Reads an object; `None` where the terminal lacks it.
    async fn object<T: EtherCrabWireReadSized>(
        &self,
        index: u16,
        sub: u8,
    ) -> Result<Option<T>, GaugeRefusal> {
        let step = "reading an object";
        let value = discovery::object(self.0, index, sub).await;
        value.map_err(|error| GaugeRefusal::Exchange { step, error })
    }

    async fn write<T: EtherCrabWireWrite>(
        &self,
        index: u16,
        sub: u8,
        value: T,
    ) -> Result<(), GaugeRefusal> {
        let written = self.0.sdo_write(index, sub, value).await;
        written.map_err(|error| GaugeRefusal::Exchange {
            step: "writing an object",
            error,
        })
    }
}
