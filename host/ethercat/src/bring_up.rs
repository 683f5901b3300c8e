//! From power-on to SAFE-OP: who is on the bus, what the drives have in force, what they map, and
//! their watchdogs.

mod clocks;
mod error;

use ethercrab::error::{CoeAbortCode, Error, MailboxError};
use ethercrab::subdevice_group::{PreOp, SafeOp};
use ethercrab::{
    Command, EtherCrabWireReadSized, EtherCrabWireReadWrite, MainDevice, RegisterAddress,
    SubDevice, SubDeviceRef,
};

use crate::cia402::{CSP, Input, Mapping, Offset, Target};
use crate::clock;
use crate::discovery::{
    self, BusError, DevicePlace, Found, Group, Role, Unplaced, discover, first_refusal, locate,
};
use crate::instruments::beside_drives::BesideDrives;
use crate::instruments::encoder::{Counter, GaugeConfig};
use crate::instruments::force::{ForceSensor, ForceSensorConfig};
use crate::instruments::{
    self, GroupError, Identity, InstrumentRefusal, Instruments, MailboxSetup,
};
pub use clocks::ClockSettings;
use clocks::Clocks;
pub use error::BringUpError;

/// Divider of the watchdogs: ticks of 100 µs.
const DIVIDER: u16 = 2_498;
/// Tick of the watchdogs, µs.
const WATCHDOG_TICK_US: u32 = 100;
/// Place of the control byte among the registers of a sync manager, and its bit that triggers the
/// watchdog.
const SYNC_MANAGER_CONTROL: u16 = 4;
const TRIGGERS_WATCHDOG: u8 = 0x40;

/// Expectations of one drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DriveConfig {
    /// Place.
    pub place: DevicePlace,
    /// Vendor.
    pub vendor: u32,
    /// Product code.
    pub product: u32,
    /// Serial number; `None` compares nothing.
    pub serial: Option<u32>,
    /// Counts per turn of the encoder, compared with object 608Fh; `None` compares nothing.
    pub counts_per_turn: Option<u32>,
    /// Travel of the machine, counts, lower end first: the drive's software limits must not be
    /// narrower.
    pub travel: (i32, i32),
    /// The drive must take velocity offsets.
    pub needs_velocity_offset: bool,
    /// The drive must take torque offsets.
    pub needs_torque_offset: bool,
}

/// Settings of the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    /// Length of a cycle, µs.
    pub cycle_us: u32,
    /// Time of the drives' watchdogs, in cycles; at most [`Settings::MAX_WATCHDOG_CYCLES`].
    pub watchdog_cycles: u32,
    /// Longest wait for the answer of a cycle, µs; below a cycle.
    pub answer_us: u32,
}

impl Settings {
    /// Largest number of cycles without outputs before a drive stops by itself. EtherCAT's default
    /// would be 100 of 1 ms.
    pub const MAX_WATCHDOG_CYCLES: u32 = 10;

    pub(crate) const fn cycle_ns(&self) -> u32 {
        self.cycle_us.saturating_mul(1_000)
    }

    pub(crate) const fn watchdog_us(&self) -> u32 {
        self.cycle_us.saturating_mul(self.watchdog_cycles)
    }
}

/// Parts of a bus beside drives that run freely.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Extras<'a> {
    /// Distributed clocks of the drives.
    pub clocks: Option<ClockSettings>,
    /// A force sensor.
    pub force_sensor: Option<ForceSensorConfig>,
    /// Gauges.
    pub gauges: &'a [GaugeConfig],
}

impl Extras<'_> {
    /// Returns what is expected of the instruments, in the order in which they are numbered: the
    /// gauges, then the force sensor.
    fn identities(&self) -> impl Iterator<Item = Identity> + Clone {
        let sensor = self.force_sensor.iter().map(ForceSensorConfig::identity);
        self.gauges.iter().map(GaugeConfig::identity).chain(sensor)
    }

    /// Error of the instruments.
    pub(crate) fn refused(&self, error: GroupError) -> BringUpError {
        match error {
            GroupError::Bus(error) => BringUpError::Bus(error),
            GroupError::Member(index, reason) if index < self.gauges.len() => BringUpError::Gauge {
                gauge: number(index),
                reason,
            },
            GroupError::Member(_, reason) => BringUpError::ForceSensor { reason },
        }
    }
}

/// Values that a drive had before it was brought up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Initial {
    /// Position, 6064h, counts.
    pub position: i32,
    /// Offsets in force: 60B0h, 60B1h, 60B2h; zero of objects that the drive lacks.
    pub offset: Offset,
    /// The drive has 60B0h: it knows its position offset.
    pub has_position_offset: bool,
}

/// A drive of the bus, brought up.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Member {
    /// Index in the group.
    pub(crate) index: usize,
    /// Configured station address.
    pub(crate) station: u16,
    pub(crate) mapping: Mapping,
    pub(crate) initial: Initial,
}

/// The bus in SAFE-OP.
pub(crate) struct Ready<const M: usize> {
    pub(crate) group: Group<SafeOp>,
    pub(crate) members: [Member; M],
    /// First pulse of SYNC0, ns of the reference; `None` for drives that run freely.
    pub(crate) sync0_start_ns: Option<u64>,
    pub(crate) instruments: Option<Instruments<BesideDrives>>,
}

/// Number of a motor, for errors.
pub(crate) fn number(motor: usize) -> u8 {
    u8::try_from(motor).unwrap_or(u8::MAX)
}

/// Brings the bus to SAFE-OP.
pub(crate) async fn bring_up<const M: usize>(
    main: &'static MainDevice<'static>,
    drives: &[DriveConfig; M],
    settings: &Settings,
    extras: &Extras<'_>,
) -> Result<Ready<M>, BringUpError> {
    let clocks = extras.clocks.as_ref();
    let has_clocks = clocks.is_some();
    let clock_ns = move || if has_clocks { clock::now_ns() } else { 0 };
    let role = |here: &Found| {
        if drives.iter().any(|drive| here.is_at(drive.place)) {
            Role::Drive
        } else if extras.identities().any(|wanted| here.is_at(wanted.place)) {
            Role::Instrument
        } else {
            Role::Other
        }
    };
    let (groups, found) = discover(main, clock_ns, role).await?;
    let mut members = places(&found, drives)?;
    for ((motor, drive), member) in drives.iter().enumerate().zip(&mut members) {
        let subdevice = groups
            .drives
            .subdevice(main, member.index)
            .map_err(|error| BringUpError::Exchange {
                motor: number(motor),
                step: "looking for the drive",
                error,
            })?;
        let setup = Setup {
            motor: number(motor),
            subdevice: &subdevice,
        };
        (member.mapping, member.initial) = setup.ask(drive).await?;
        setup.map(member.mapping).await?;
        setup.set_watchdog(settings).await?;
        if has_clocks {
            setup.choose_sync0(settings.cycle_ns()).await?;
        }
    }
    let instruments = if extras.identities().next().is_some() {
        let instruments = start_instruments(main, groups.instruments, &found, extras).await;
        Some(instruments.map_err(|error| extras.refused(error))?)
    } else {
        None
    };
    let sync0_start_ns = match clocks {
        None => None,
        Some(clocks) => Some(start_clocks(main, &found, &members, settings, clocks).await?),
    };
    let group = groups.drives.into_pre_op_pdi(main).await;
    let group = group.map_err(BusError::of("mapping process data"))?;
    for member in &members {
        let target = standing(&member.initial);
        if let Ok(subdevice) = group.subdevice(main, member.index) {
            member
                .mapping
                .pack(0, &target, &mut subdevice.outputs_raw_mut());
        }
    }
    let group = match group.into_safe_op(main).await {
        Ok(group) => group,
        Err(error) => {
            let stations = members.iter().map(|member| member.station);
            let refused = first_refusal(main, stations).await;
            return Err(refused.map_or(
                BusError::of("SAFE-OP")(error).into(),
                |(motor, state, code)| BringUpError::Refused {
                    motor: number(motor),
                    state,
                    code,
                },
            ));
        }
    };
    for (motor, member) in members.iter().enumerate() {
        let control = Command::fprd(
            member.station,
            u16::from(RegisterAddress::Sm2) + SYNC_MANAGER_CONTROL,
        )
        .receive::<u8>(main)
        .await;
        let control = control.map_err(|error| BringUpError::Exchange {
            motor: number(motor),
            step: "reading sync manager 2",
            error,
        })?;
        if control & TRIGGERS_WATCHDOG == 0 {
            return Err(BringUpError::WatchdogOff {
                motor: number(motor),
            });
        }
    }
    Ok(Ready {
        group,
        members,
        sync0_start_ns,
        instruments,
    })
}

/// Sets the instruments up, takes them to SAFE-OP, and asks for OP.
async fn start_instruments(
    main: &'static MainDevice<'static>,
    group: Group<PreOp>,
    found: &[Found],
    extras: &Extras<'_>,
) -> Result<Instruments<BesideDrives>, GroupError> {
    let places = extras.identities().map(|wanted| wanted.place);
    let mut members = Vec::new();
    for (index, wanted) in extras.identities().enumerate() {
        let refused = |reason| GroupError::Member(index, reason);
        let at = instruments::find(found, &wanted, places.clone()).map_err(refused)?;
        let subdevice = group.subdevice(main, at.1).map_err(|error| {
            let step = "looking for the instrument";
            refused(InstrumentRefusal::Exchange { step, error })
        })?;
        let setup = MailboxSetup(&subdevice);
        let instrument = match &extras.force_sensor {
            Some(sensor) if index == extras.gauges.len() => ForceSensor::prepare(sensor, &setup)
                .await
                .map(BesideDrives::Force),
            _ => Counter::prepare(&setup).await.map(BesideDrives::Gauge),
        };
        members.push(instruments::Member::new(at, instrument.map_err(refused)?));
    }
    Instruments::start(main, group, members).await
}

/// Lets all clocks follow the reference, and starts SYNC0; returns the time of its first pulse.
async fn start_clocks<const M: usize>(
    main: &'static MainDevice<'static>,
    found: &[Found],
    members: &[Member; M],
    settings: &Settings,
    clocks: &ClockSettings,
) -> Result<u64, BringUpError> {
    let all: Vec<u16> = found.iter().map(|device| device.station).collect();
    let bus = Clocks {
        main,
        all: &all,
        drives: &members.map(|member| member.station),
    };
    let reference = bus.reference().await?;
    bus.follow(reference).await?;
    bus.start_sync0(reference, clocks, settings.cycle_ns())
        .await
}

/// References that keep a drive where it stands, with the offsets that it has in force.
pub(crate) const fn standing(initial: &Initial) -> Target {
    let position = initial.position.saturating_sub(initial.offset.position);
    Target {
        position,
        offset: initial.offset,
    }
}

/// Finds every drive at its place, and compares its identity.
fn places<const M: usize>(
    found: &[Found],
    drives: &[DriveConfig; M],
) -> Result<[Member; M], BringUpError> {
    let mut members = [Member::default(); M];
    for ((motor, drive), member) in drives.iter().enumerate().zip(&mut members) {
        let (motor, place) = (number(motor), drive.place);
        let places = drives.iter().map(|drive| drive.place);
        let (device, index) = locate(found, place, places).map_err(|reason| match reason {
            Unplaced::Missing => BringUpError::Missing {
                motor,
                place,
                found: number(found.len()),
            },
            Unplaced::Ambiguous => BringUpError::Ambiguous { motor, place },
        })?;
        if (device.vendor, device.product) != (drive.vendor, drive.product) {
            return Err(BringUpError::Identity {
                motor,
                place,
                vendor: drive.vendor,
                product: drive.product,
                found_vendor: device.vendor,
                found_product: device.product,
            });
        }
        if let Some(expected) = drive.serial.filter(|expected| *expected != device.serial) {
            return Err(BringUpError::Serial {
                motor,
                place,
                expected,
                found: device.serial,
            });
        }
        member.index = index;
        member.station = device.station;
    }
    Ok(members)
}

/// Set-up of one drive in PRE-OP.
struct Setup<'a> {
    motor: u8,
    subdevice: &'a SubDeviceRef<'a, &'a SubDevice>,
}

impl Setup<'_> {
    fn failed(&self, step: &'static str) -> impl FnOnce(Error) -> BringUpError + use<> {
        let motor = self.motor;
        move |error| BringUpError::Exchange { motor, step, error }
    }

    /// Reads an object; `None` where the drive lacks it.
    async fn object<T: EtherCrabWireReadSized>(
        &self,
        index: u16,
        sub: u8,
    ) -> Result<Option<T>, BringUpError> {
        let value = discovery::object(self.subdevice, index, sub).await;
        value.map_err(self.failed("reading an object"))
    }

    /// Reads an object that every drive of CiA 402 has in this mode.
    async fn needed<T: EtherCrabWireReadSized>(&self, object: u16) -> Result<T, BringUpError> {
        let purpose = "which cyclic synchronous position mode needs";
        (self.object(object, 0).await?).ok_or(BringUpError::MissingObject {
            motor: self.motor,
            object,
            purpose,
        })
    }

    /// Asks a drive for its objects and for the values in force, and compares its set-up with what
    /// is expected.
    async fn ask(&self, drive: &DriveConfig) -> Result<(Mapping, Initial), BringUpError> {
        let motor = self.motor;
        let position = self.needed::<i32>(0x6064).await?;
        let _target = self.needed::<i32>(0x607A).await?;
        let _mode = self.needed::<i8>(0x6061).await?;
        let position_offset = self.object::<i32>(0x60B0, 0).await?;
        let velocity_offset = self.object::<i32>(0x60B1, 0).await?;
        let torque_offset = self.object::<i16>(0x60B2, 0).await?;
        if drive.needs_velocity_offset && velocity_offset.is_none() {
            let purpose =
                "but its axis has velocity offsets; set axes.velocity.max_um_s of the axis to 0";
            return Err(BringUpError::MissingObject {
                motor,
                object: 0x60B1,
                purpose,
            });
        }
        if drive.needs_torque_offset && torque_offset.is_none() {
            let purpose =
                "but its axis has torque offsets; set axes.torque.max_permille of the axis to 0";
            return Err(BringUpError::MissingObject {
                motor,
                object: 0x60B2,
                purpose,
            });
        }
        if let Some(expected) = drive.counts_per_turn {
            let counts = self.object::<u32>(0x608F, 1).await?;
            let turns = self.object::<u32>(0x608F, 2).await?;
            let (Some(counts), Some(turns)) = (counts, turns) else {
                let purpose = "with which counts_per_turn is compared; leave counts_per_turn out";
                return Err(BringUpError::MissingObject {
                    motor,
                    object: 0x608F,
                    purpose,
                });
            };
            let found = counts.checked_div(turns).unwrap_or(0);
            if found != expected {
                return Err(BringUpError::Encoder {
                    motor,
                    expected,
                    found,
                });
            }
        }
        let limits = (
            self.object::<i32>(0x607D, 1).await?,
            self.object::<i32>(0x607D, 2).await?,
        );
        if let (Some(lower), Some(upper)) = limits {
            let (travel, limits) = (drive.travel, (lower, upper));
            // Equal ends: the drive has none.
            if lower != upper && (travel.0 < lower || travel.1 > upper) {
                return Err(BringUpError::SoftwareLimits {
                    motor,
                    travel,
                    limits,
                });
            }
        }
        let mapping = Mapping {
            position_offset: position_offset.is_some(),
            velocity_offset: velocity_offset.is_some(),
            torque_offset: torque_offset.is_some(),
            error_code: self.object::<u16>(0x603F, 0).await?.is_some(),
        };
        let offset = Offset {
            position: position_offset.unwrap_or(0),
            velocity: velocity_offset.unwrap_or(0),
            torque: torque_offset.unwrap_or(0),
        };
        Ok((
            mapping,
            Initial {
                position,
                offset,
                has_position_offset: mapping.position_offset,
            },
        ))
    }

    /// Writes the mapping: assignment and contents to zero, contents, their number, assignment.
    async fn map(&self, mapping: Mapping) -> Result<(), BringUpError> {
        self.subdevice
            .sdo_write(0x6060, 0, CSP)
            .await
            .map_err(self.failed("setting the mode of operation (6060h)"))?;
        self.map_pdo(0x1C12, 0x1600, &mapping.outputs())
            .await
            .map_err(self.failed("mapping outputs (1600h)"))?;
        self.map_pdo(0x1C13, 0x1A00, &mapping.inputs())
            .await
            .map_err(self.failed("mapping inputs (1A00h)"))
    }

    async fn map_pdo(&self, assignment: u16, pdo: u16, entries: &[u32]) -> Result<(), Error> {
        self.subdevice.sdo_write(assignment, 0, 0_u8).await?;
        self.subdevice.sdo_write(pdo, 0, 0_u8).await?;
        let mut count = 0_u8;
        for entry in entries.iter().filter(|entry| **entry != 0) {
            count = count.saturating_add(1);
            self.subdevice.sdo_write(pdo, count, *entry).await?;
        }
        self.subdevice.sdo_write(pdo, 0, count).await?;
        self.subdevice.sdo_write(assignment, 1, pdo).await?;
        self.subdevice.sdo_write(assignment, 0, 1_u8).await
    }

    /// Chooses SYNC0 for outputs and inputs (1C32h, 1C33h), with the length of the cycle. Objects
    /// that the drive lacks, or that are read only, are left.
    async fn choose_sync0(&self, cycle_ns: u32) -> Result<(), BringUpError> {
        const TYPES_SYNC0: u16 = 0x04;
        const BY_SYNC0: u16 = 2;
        let types = self.object::<u16>(0x1C32, 4).await?;
        if let Some(types) = types.filter(|types| types & TYPES_SYNC0 == 0) {
            return Err(BringUpError::NoSync0 {
                motor: self.motor,
                types,
            });
        }
        self.write_synchronisation(0x1C32, 1, BY_SYNC0).await?;
        self.write_synchronisation(0x1C33, 1, BY_SYNC0).await?;
        self.write_synchronisation(0x1C32, 2, cycle_ns).await
    }

    async fn write_synchronisation<T>(
        &self,
        object: u16,
        sub: u8,
        value: T,
    ) -> Result<(), BringUpError>
    where
        T: EtherCrabWireReadSized + EtherCrabWireReadWrite + PartialEq + Copy + Into<u32>,
    {
        use CoeAbortCode as C;
        match self.subdevice.sdo_write(object, sub, value).await {
            Ok(()) => {}
            Err(Error::Mailbox(MailboxError::Aborted {
                code: C::NotFound | C::SubIndexNotFound | C::ReadOnlyWrite,
                ..
            })) => return Ok(()),
            Err(error) => return Err(self.failed("choosing SYNC0")(error)),
        }
        match self.object::<T>(object, sub).await? {
            Some(found) if found != value => Err(BringUpError::Synchronisation {
                motor: self.motor,
                object,
                sub,
                wanted: value.into(),
                found: found.into(),
            }),
            _ => Ok(()),
        }
    }

    /// Writes the watchdog of the outputs, and reads it back.
    async fn set_watchdog(&self, settings: &Settings) -> Result<(), BringUpError> {
        const ACTION: &str = "setting the watchdog";
        let wanted_us = settings.watchdog_us();
        let ticks = u16::try_from(wanted_us / WATCHDOG_TICK_US).unwrap_or(u16::MAX);
        let (divider, time) = (
            RegisterAddress::WatchdogDivider,
            RegisterAddress::SyncManagerWatchdog,
        );
        self.subdevice
            .register_write(divider, DIVIDER)
            .await
            .map_err(self.failed(ACTION))?;
        self.subdevice
            .register_write(time, ticks)
            .await
            .map_err(self.failed(ACTION))?;
        let divider: u16 = self
            .subdevice
            .register_read(divider)
            .await
            .map_err(self.failed(ACTION))?;
        let time: u16 = self
            .subdevice
            .register_read(time)
            .await
            .map_err(self.failed(ACTION))?;
        let found_us = (u32::from(divider) + 2) * u32::from(time) / 25;
        if found_us == wanted_us && time > 0 {
            Ok(())
        } else {
            Err(BringUpError::WatchdogTime {
                motor: self.motor,
                wanted_us,
                found_us,
            })
        }
    }
}

impl Initial {
    /// Returns the measurements that a drive begins with: its position, at rest.
    pub(crate) fn input(&self) -> Input {
        Input {
            position: self.position,
            ..Input::default()
        }
    }
}
