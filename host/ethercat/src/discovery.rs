//! SubDevices that answer on a bus, and those among them that a program uses.

use ethercrab::error::{CoeAbortCode, Error, MailboxError};
use ethercrab::subdevice_group::PreOp;
use ethercrab::{
    AlStatusCode, Command, DefaultLock, EtherCrabWireReadSized, MainDevice, RegisterAddress,
    SubDevice, SubDeviceGroup, SubDeviceRef, SubDeviceState,
};

/// Largest number of SubDevices, a power of two.
pub(crate) const MAX_SUBDEVICES: usize = 16;
/// Longest process image, bytes: 32 of each drive.
pub(crate) const MAX_IMAGE: usize = 512;
/// Station address that ethercrab gives to the first SubDevice.
pub(crate) const FIRST_STATION: u16 = 0x1000;
/// Bit of AL status for an error of the state machine.
pub(crate) const ERROR: u16 = 0x10;

/// SubDevices of a program; nothing else on the bus is touched.
pub(crate) type Group<S> = SubDeviceGroup<MAX_SUBDEVICES, MAX_IMAGE, DefaultLock, S>;

/// Place of a device on the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DevicePlace {
    /// Alias in its EEPROM.
    Alias(u16),
    /// Number of SubDevices before it.
    Position(u16),
}

impl std::fmt::Display for DevicePlace {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Alias(alias) => write!(f, "alias {alias}"),
            Self::Position(position) => write!(f, "position {position}"),
        }
    }
}

/// A SubDevice that answered.
#[derive(Clone, Copy)]
pub(crate) struct Found {
    pub(crate) station: u16,
    pub(crate) alias: u16,
    pub(crate) vendor: u32,
    pub(crate) product: u32,
    pub(crate) serial: u32,
}

impl Found {
    fn of(subdevice: &SubDevice) -> Self {
        let identity = subdevice.identity();
        let (station, alias) = (subdevice.configured_address(), subdevice.alias_address());
        let (vendor, product, serial) = (identity.vendor_id, identity.product_id, identity.serial);
        Self {
            station,
            alias,
            vendor,
            product,
            serial,
        }
    }

    pub(crate) const fn is_at(&self, place: DevicePlace) -> bool {
        match place {
            DevicePlace::Alias(alias) => self.alias == alias && alias != 0,
            DevicePlace::Position(position) => self.station.wrapping_sub(FIRST_STATION) == position,
        }
    }
}

/// Use that a program has for a SubDevice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Role {
    /// It moves a motor.
    Drive,
    /// It measures.
    Instrument,
    /// None.
    Other,
}

/// SubDevices by their roles. The others stay in PRE-OP.
#[derive(Default)]
pub(crate) struct Groups {
    pub(crate) drives: Group<PreOp>,
    pub(crate) instruments: Group<PreOp>,
    others: Group<PreOp>,
}

/// Error of a bus as a whole, on its way to SAFE-OP.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum BusError {
    /// No device answers.
    #[error("no SubDevice answers; is it the right interface, and is the bus powered?")]
    Silent,
    /// There are more SubDevices than this program handles.
    #[error("there are more than {MAX_SUBDEVICES} SubDevices on the bus")]
    TooMany,
    /// A step failed.
    #[error("{step}: {error}")]
    Step {
        /// The step.
        step: &'static str,
        /// The error.
        error: Error,
    },
    /// It took too long.
    #[error("the bus answers, but the bring-up did not end within {seconds} s")]
    Overdue {
        /// Time given, s.
        seconds: u32,
    },
    /// A message came that ethercrab does not take, as an emergency between a request and its
    /// answer.
    #[error(
        "a device sent what cannot be handled during the bring-up, an emergency message perhaps; reset the devices and start again"
    )]
    Unhandled,
}

impl BusError {
    /// Error of a step, for `map_err`.
    pub(crate) const fn of(step: &'static str) -> impl Fn(Error) -> Self {
        move |error| Self::Step { step, error }
    }
}

/// Takes all SubDevices to PRE-OP, each into the group of its role. Returns all in the order of the
/// bus.
pub(crate) async fn discover(
    main: &'static MainDevice<'static>,
    clock_ns: impl Fn() -> u64 + Copy,
    role: impl Fn(&Found) -> Role,
) -> Result<(Groups, Vec<Found>), BusError> {
    let mut found = Vec::new();
    let groups = main.init::<MAX_SUBDEVICES, _>(
        clock_ns,
        Groups::default(),
        |groups: &Groups, subdevice| {
            let here = Found::of(subdevice);
            found.push(here);
            Ok(match role(&here) {
                Role::Drive => &groups.drives,
                Role::Instrument => &groups.instruments,
                Role::Other => &groups.others,
            })
        },
    );
    let groups = groups.await;
    let groups = groups.map_err(|error| match error {
        Error::Timeout(_) if found.is_empty() => BusError::Silent,
        Error::Capacity(_) => BusError::TooMany,
        error => BusError::of("looking for SubDevices")(error),
    })?;
    if found.is_empty() {
        return Err(BusError::Silent);
    }
    Ok((groups, found))
}

/// Reason for which a place is not that of one device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Unplaced {
    /// No device is there.
    Missing,
    /// Two devices are there, or the device has two of the places.
    Ambiguous,
}

/// Finds the device at one of `places`. Returns it and its index in the group of all of them, which
/// is in the order of the bus.
pub(crate) fn locate(
    found: &[Found],
    place: DevicePlace,
    places: impl Iterator<Item = DevicePlace> + Clone,
) -> Result<(Found, usize), Unplaced> {
    let mut here = found.iter().filter(|device| device.is_at(place));
    let device = here.next().ok_or(Unplaced::Missing)?;
    let of_device = places.clone().filter(|place| device.is_at(*place));
    if here.next().is_some() || of_device.count() != 1 {
        return Err(Unplaced::Ambiguous);
    }
    let before = (found.iter()).take_while(|other| other.station != device.station);
    let chosen = before.filter(|other| places.clone().any(|place| other.is_at(place)));
    Ok((*device, chosen.count()))
}

/// Reads an object; `None` where the device lacks it.
pub(crate) async fn object<T: EtherCrabWireReadSized>(
    subdevice: &SubDeviceRef<'_, &SubDevice>,
    index: u16,
    sub: u8,
) -> Result<Option<T>, Error> {
    match subdevice.sdo_read::<T>(index, sub).await {
        Ok(value) => Ok(Some(value)),
        Err(Error::Mailbox(MailboxError::Aborted {
            code: CoeAbortCode::NotFound | CoeAbortCode::SubIndexNotFound,
            ..
        })) => Ok(None),
        Err(error) => Err(error),
    }
}

/// Returns the first of some stations that reports an error of its state machine: its index, its
/// state, and the code.
pub(crate) async fn first_refusal(
    main: &MainDevice<'static>,
    stations: impl Iterator<Item = u16>,
) -> Option<(usize, u8, AlStatusCode)> {
    for (index, station) in stations.enumerate() {
        let (status, code) = al_status(main, station).await?;
        if status & ERROR != 0 {
            return Some((index, (status & 0x0F) as u8, AlStatusCode::from(code)));
        }
    }
    None
}

/// Reads AL status and its code.
pub(crate) async fn al_status(main: &MainDevice<'static>, station: u16) -> Option<(u16, u16)> {
    let status = Command::fprd(station, RegisterAddress::AlStatus.into())
        .receive::<u16>(main)
        .await
        .ok()?;
    let code = Command::fprd(station, RegisterAddress::AlStatusCode.into())
        .receive::<u16>(main)
        .await
        .ok()?;
    Some((status, code))
}

/// Code of a state in AL status; 0 for none.
pub(crate) const fn code_of(state: SubDeviceState) -> u8 {
    match state {
        SubDeviceState::None => 0,
        SubDeviceState::Init => 1,
        SubDeviceState::PreOp => 2,
        SubDeviceState::Bootstrap => 3,
        SubDeviceState::SafeOp => 4,
        SubDeviceState::Op => 8,
        SubDeviceState::Other(other) => other,
    }
}
