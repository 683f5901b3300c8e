//! Distributed clocks of the drives: the bus follows its reference, and SYNC0 begins at one time at
//! all of them.

use ethercrab::error::Error;
use ethercrab::{Command, EtherCrabWireReadWrite, MainDevice, RegisterAddress as Register};

use super::{BringUpError, number};
use crate::clock;
use crate::discovery::BusError;

/// Bits of 0008h: a distributed clock, of 64 bits; ETG1000.4.
const HAS_CLOCK: u16 = 0x0C;
/// Bits of 0981h: cyclic operation with SYNC0; SYNC1.
const SYNC0: u8 = 0x03;
const SYNC1: u8 = 0x04;
/// Difference to the reference below which a clock follows it, ns; frames for which it must; time
/// for that, s.
const FOLLOWS_NS: u32 = 500;
const FOLLOWS_FRAMES: u32 = 100;
const FOLLOWS_S: u32 = 10;
/// Time between two frames, µs.
const FRAME_REST_US: u64 = 1_000;
/// Time from the last look at the reference to the first pulse, at least, ns.
const AHEAD_NS: u64 = 200_000_000;
/// Unit of SYNC0's period, ns.
const PERIOD_UNIT_NS: u32 = 62_500;

/// Settings of distributed clocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ClockSettings {
    /// Period of SYNC0, ns; it divides the cycle, and is a multiple of 62 500.
    pub sync0_ns: u32,
    /// Time from the passage of a frame at the reference to the pulse that ends its cycle, ns; from
    /// a fifth to four fifths of the cycle.
    pub frame_to_sync0_ns: u32,
    /// SYNC1 is activated too, once per cycle.
    pub has_sync1: bool,
}

impl ClockSettings {
    /// Returns what is wrong with them.
    ///
    /// # Errors
    /// [`BringUpError::Clocks`].
    pub(crate) fn check(&self, cycle_ns: u32) -> Result<(), BringUpError> {
        let (period, lead) = (self.sync0_ns, self.frame_to_sync0_ns);
        let divides = period > 0 && cycle_ns.checked_rem(period) == Some(0);
        let reason = if !divides {
            "the period of SYNC0 does not divide the cycle"
        } else if period % PERIOD_UNIT_NS != 0 {
            "the period of SYNC0 is not a multiple of 62.5 us"
        } else if !(cycle_ns / 5..=cycle_ns / 5 * 4).contains(&lead) {
            "a frame passes the reference less than a fifth, or more than four fifths, of a cycle before SYNC0"
        } else {
            return Ok(());
        };
        Err(BringUpError::Clocks { reason })
    }
}

/// Drives with their station addresses, and the reference of the bus.
pub(crate) struct Clocks<'a> {
    pub(crate) main: &'static MainDevice<'static>,
    /// Stations of all devices, in the order of the bus.
    pub(crate) all: &'a [u16],
    /// Stations of the drives, by motor.
    pub(crate) drives: &'a [u16],
}

impl Clocks<'_> {
    /// Returns the reference: the first device of the bus with a clock. Refuses a drive without one.
    pub(crate) async fn reference(&self) -> Result<u16, BringUpError> {
        for (motor, &station) in self.drives.iter().enumerate() {
            if !self.has_clock(station).await? {
                return Err(BringUpError::NoClock {
                    motor: number(motor),
                });
            }
        }
        for &station in self.all {
            if self.has_clock(station).await? {
                return Ok(station);
            }
        }
        Err(BringUpError::NoClock { motor: 0 })
    }

    async fn has_clock(&self, station: u16) -> Result<bool, BringUpError> {
        let features: u16 = self.read(station, Register::SupportFlags).await?;
        // A time of 32 bits begins again every 4.3 s.
        Ok(features & HAS_CLOCK == HAS_CLOCK)
    }

    async fn read<T: EtherCrabWireReadWrite + ethercrab::EtherCrabWireReadSized>(
        &self,
        station: u16,
        register: Register,
    ) -> Result<T, BringUpError> {
        Command::fprd(station, register.into())
            .receive(self.main)
            .await
            .map_err(|error| BusError::of("reading a distributed clock")(error).into())
    }

    /// Gives the reference's time to all others.
    async fn distribute(&self, reference: u16) -> Result<(), BringUpError> {
        let time: Result<u64, Error> = Command::frmw(reference, Register::DcSystemTime.into())
            .ignore_wkc()
            .receive(self.main)
            .await;
        time.map(drop)
            .map_err(|error| BusError::of("distributing the reference's time")(error).into())
    }

    /// Sends the reference's time until all drives follow it.
    pub(crate) async fn follow(&self, reference: u16) -> Result<(), BringUpError> {
        let limit_us = clock::now_us().saturating_add(u64::from(FOLLOWS_S) * 1_000_000);
        let mut frames = 0;
        while frames < FOLLOWS_FRAMES {
            self.distribute(reference).await?;
            let mut largest = (0, 0);
            for (motor, &station) in self.drives.iter().enumerate() {
                let difference: u32 = self.read(station, Register::DcSystemTimeDifference).await?;
                // Sign and magnitude.
                largest = largest.max((difference & 0x7FFF_FFFF, number(motor)));
            }
            frames = if largest.0 < FOLLOWS_NS {
                frames + 1
            } else {
                0
            };
            let now_us = clock::now_us();
            if now_us >= limit_us {
                let (difference_ns, motor) = largest;
                return Err(BringUpError::ClockApart {
                    motor,
                    difference_ns,
                });
            }
            clock::wait_until(now_us + FRAME_REST_US).await;
        }
        Ok(())
    }

    /// Sets SYNC0 up at all drives, from one time on; returns it, ns of the reference.
    pub(crate) async fn start_sync0(
        &self,
        reference: u16,
        settings: &ClockSettings,
        cycle_ns: u32,
    ) -> Result<u64, BringUpError> {
        let cycle = u64::from(cycle_ns.max(1));
        let now_ns: u64 = self.read(reference, Register::DcSystemTime).await?;
        let ahead_ns = now_ns.saturating_add(AHEAD_NS);
        let start_ns = ahead_ns.div_ceil(cycle).saturating_mul(cycle);
        let sync1_ns = cycle_ns.saturating_sub(settings.sync0_ns);
        let activation = if settings.has_sync1 {
            SYNC0 | SYNC1
        } else {
            SYNC0
        };
        for (motor, &station) in self.drives.iter().enumerate() {
            let drive = Registers {
                main: self.main,
                motor: number(motor),
                station,
            };
            drive.write(Register::DcSyncActive, 0_u8).await?;
            drive.write(Register::DcCyclicUnitControl, 0_u8).await?;
            drive
                .write_checked(Register::DcSyncStartTime, start_ns)
                .await?;
            drive
                .write_checked(Register::DcSync0CycleTime, settings.sync0_ns)
                .await?;
            drive
                .write_checked(Register::DcSync1CycleTime, sync1_ns)
                .await?;
            drive
                .write_checked(Register::DcSyncActive, activation)
                .await?;
        }
        if self.read::<u64>(reference, Register::DcSystemTime).await? >= start_ns {
            return Err(BringUpError::Clocks {
                reason: "SYNC0 was set up too late: the bus or this computer is too slow",
            });
        }
        Ok(start_ns)
    }
}

/// Registers of one drive.
struct Registers {
    main: &'static MainDevice<'static>,
    motor: u8,
    station: u16,
}

impl Registers {
    async fn write<T: EtherCrabWireReadWrite>(
        &self,
        register: Register,
        value: T,
    ) -> Result<(), BringUpError> {
        let motor = self.motor;
        Command::fpwr(self.station, register.into())
            .send(self.main, value)
            .await
            .map_err(|error| BringUpError::Exchange {
                motor,
                step: "setting SYNC0 up",
                error,
            })
    }

    /// Writes a register and reads it back.
    async fn write_checked<T>(&self, register: Register, value: T) -> Result<(), BringUpError>
    where
        T: EtherCrabWireReadWrite + ethercrab::EtherCrabWireReadSized + PartialEq + Copy,
    {
        self.write(register, value).await?;
        let motor = self.motor;
        let found: T = Command::fprd(self.station, register.into())
            .receive(self.main)
            .await
            .map_err(|error| BringUpError::Exchange {
                motor,
                step: "reading SYNC0 back",
                error,
            })?;
        if found == value {
            Ok(())
        } else {
            Err(BringUpError::ClockRegister {
                motor,
                register: register.into(),
            })
        }
    }
}
