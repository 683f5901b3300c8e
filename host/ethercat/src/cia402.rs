//! CiA 402 as it lies in process data: states, control words, and the mapping of one drive.

/// Modes of operation: cyclic synchronous position.
pub(crate) const CSP: i8 = 8;

/// State of a drive by its status word.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PowerState {
    /// Starting up.
    NotReady,
    /// No voltage.
    SwitchOnDisabled,
    /// Ready for the power stage.
    ReadyToSwitchOn,
    /// Power stage on.
    SwitchedOn,
    /// Follows its references.
    OperationEnabled,
    /// Brakes on command.
    QuickStopActive,
    /// Brakes after a fault.
    FaultReactionActive,
    /// Stands after a fault.
    Fault,
}

impl PowerState {
    /// Returns the state of a status word (object 6041h).
    #[must_use]
    pub const fn of(status: u16) -> Self {
        match status & 0x4F {
            0x0F => return Self::FaultReactionActive,
            0x08 => return Self::Fault,
            0x40 => return Self::SwitchOnDisabled,
            _ => {}
        }
        match status & 0x6F {
            0x21 => Self::ReadyToSwitchOn,
            0x23 => Self::SwitchedOn,
            0x27 => Self::OperationEnabled,
            0x07 => Self::QuickStopActive,
            _ => Self::NotReady,
        }
    }

    /// Returns the state's name in CiA 402.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::NotReady => "not ready to switch on",
            Self::SwitchOnDisabled => "switch on disabled",
            Self::ReadyToSwitchOn => "ready to switch on",
            Self::SwitchedOn => "switched on",
            Self::OperationEnabled => "operation enabled",
            Self::QuickStopActive => "quick stop active",
            Self::FaultReactionActive => "fault reaction active",
            Self::Fault => "fault",
        }
    }

    /// Returns the control word that goes one state further towards operation enabled. The reset of
    /// a fault is an edge: `reset` alternates.
    pub(crate) const fn towards_operation(self, reset: bool) -> u16 {
        match self {
            Self::Fault if reset => 0x80,
            Self::NotReady | Self::Fault | Self::FaultReactionActive | Self::QuickStopActive => 0,
            Self::SwitchOnDisabled => 0x06,
            Self::ReadyToSwitchOn => 0x07,
            Self::SwitchedOn | Self::OperationEnabled => control::ENABLED,
        }
    }
}

/// Control words.
pub(crate) mod control {
    /// Operation enabled.
    pub(crate) const ENABLED: u16 = 0x0F;
    /// Power stage on, no torque.
    pub(crate) const SWITCHED_ON: u16 = 0x07;
    /// Ready to switch on.
    pub(crate) const SHUTDOWN: u16 = 0x06;
    /// Quick stop, with voltage.
    pub(crate) const QUICK_STOP: u16 = 0x02;
}

/// Following error, bit of the status word in CSP.
pub(crate) const FOLLOWING_ERROR: u16 = 0x2000;

/// Additive objects of a drive.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Offset {
    /// 60B0h, counts.
    pub position: i32,
    /// 60B1h, velocity units of the drive.
    pub velocity: i32,
    /// 60B2h, per mille of rated torque.
    pub torque: i16,
}

/// References of a drive.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Target {
    /// Position without its offset, counts.
    pub position: i32,
    /// Offsets. A drive without 60B0h gets position and offset as a sum.
    pub offset: Offset,
}

/// Measurements of a drive.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Input {
    /// Status word, 6041h.
    pub status: u16,
    /// Position, 6064h, counts.
    pub position: i32,
    /// Velocity, 606Ch, velocity units of the drive.
    pub velocity: i32,
    /// Torque, 6077h, per mille of rated torque.
    pub torque: i16,
    /// Mode of operation that the drive is in, 6061h.
    pub mode: i8,
    /// Error code, 603Fh; 0 when there is none, or the drive does not map it.
    pub error_code: u16,
}

impl Input {
    /// Returns the drive's state.
    #[must_use]
    pub const fn state(&self) -> PowerState {
        PowerState::of(self.status)
    }
}

/// Objects of one drive that are mapped if it has them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Mapping {
    pub(crate) position_offset: bool,
    pub(crate) velocity_offset: bool,
    pub(crate) torque_offset: bool,
    pub(crate) error_code: bool,
}

/// Entry of a PDO: index, sub-index and bits, as 1600h and 1A00h take it.
const fn entry(index: u16, bits: u8) -> u32 {
    (index as u32) << 16 | bits as u32
}

impl Mapping {
    /// Returns the entries of the outputs, in order; zeros for those that are left out.
    pub(crate) const fn outputs(self) -> [u32; 6] {
        [
            entry(0x6040, 16),
            entry(0x607A, 32),
            if self.position_offset {
                entry(0x60B0, 32)
            } else {
                0
            },
            if self.velocity_offset {
                entry(0x60B1, 32)
            } else {
                0
            },
            if self.torque_offset {
                entry(0x60B2, 16)
            } else {
                0
            },
            entry(0x6060, 8),
        ]
    }

    /// Returns the entries of the inputs, in order; zeros for those that are left out.
    pub(crate) const fn inputs(self) -> [u32; 6] {
        let error_code = if self.error_code {
            entry(0x603F, 16)
        } else {
            0
        };
        [
            entry(0x6041, 16),
            entry(0x6064, 32),
            entry(0x606C, 32),
            entry(0x6077, 16),
            entry(0x6061, 8),
            error_code,
        ]
    }

    /// Writes a drive's outputs. False unless they fit: the process image has another length than
    /// was mapped.
    pub(crate) fn pack(self, control: u16, target: &Target, room: &mut [u8]) -> bool {
        let Target { position, offset } = *target;
        let sum = position.saturating_add(offset.position);
        let mut room = Room(Some(room));
        room.put(&control.to_le_bytes());
        room.put(&(if self.position_offset { position } else { sum }).to_le_bytes());
        for (is_mapped, value) in [
            (self.position_offset, offset.position),
            (self.velocity_offset, offset.velocity),
        ] {
            if is_mapped {
                room.put(&value.to_le_bytes());
            }
        }
        if self.torque_offset {
            room.put(&offset.torque.to_le_bytes());
        }
        room.put(&CSP.to_le_bytes());
        room.0.is_some_and(|rest| rest.is_empty())
    }

    /// Reads a drive's inputs; `None` if they have another length than was mapped.
    pub(crate) fn unpack(self, bytes: &[u8]) -> Option<Input> {
        let (status, rest) = bytes.split_first_chunk()?;
        let (position, rest) = rest.split_first_chunk()?;
        let (velocity, rest) = rest.split_first_chunk()?;
        let (torque, rest) = rest.split_first_chunk()?;
        let (mode, rest) = rest.split_first_chunk()?;
        let (error_code, rest) = if self.error_code {
            rest.split_first_chunk()?
        } else {
            (&[0, 0], rest)
        };
        rest.is_empty().then(|| Input {
            status: u16::from_le_bytes(*status),
            position: i32::from_le_bytes(*position),
            velocity: i32::from_le_bytes(*velocity),
            torque: i16::from_le_bytes(*torque),
            mode: i8::from_le_bytes(*mode),
            error_code: u16::from_le_bytes(*error_code),
        })
    }
}

/// Rest of a buffer; `None` after a value that did not fit.
struct Room<'a>(Option<&'a mut [u8]>);

impl Room<'_> {
    fn put(&mut self, bytes: &[u8]) {
        self.0 = self.0.take().and_then(|room| {
            let (place, rest) = room.split_at_mut_checked(bytes.len())?;
            place.copy_from_slice(bytes);
            Some(rest)
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn states_are_those_of_the_standard() {
        use PowerState as S;
        // Bits 4, 9, 10, 12 and 13 do not tell the state; bit 5 does, in some of them.
        for (status, state) in [
            (0x0000, S::NotReady),
            (0x0250, S::SwitchOnDisabled),
            (0x0231, S::ReadyToSwitchOn),
            (0x0233, S::SwitchedOn),
            (0x1237, S::OperationEnabled),
            (0x0217, S::QuickStopActive),
            (0x021F, S::FaultReactionActive),
            (0x023F, S::FaultReactionActive),
            (0x0218, S::Fault),
            (0x2238, S::Fault),
        ] {
            assert_eq!(S::of(status), state, "{status:04x}");
        }
    }

    #[test]
    fn outputs_are_packed_as_they_are_mapped() {
        let target = Target {
            position: 0x0102_0304,
            offset: Offset {
                position: -2,
                velocity: 5,
                torque: -1,
            },
        };
        let all = Mapping {
            position_offset: true,
            velocity_offset: true,
            torque_offset: true,
            error_code: true,
        };
        let mut bytes = [0xAA; 17];
        assert!(all.pack(0x0F, &target, &mut bytes));
        assert_eq!(
            bytes,
            [
                15, 0, 4, 3, 2, 1, 254, 255, 255, 255, 5, 0, 0, 0, 255, 255, 8
            ]
        );
        let mut bytes = [0xAA; 7];
        assert!(Mapping::default().pack(0x0F, &target, &mut bytes));
        assert_eq!(bytes, [15, 0, 2, 3, 2, 1, 8], "the sum");
        for length in [6, 8] {
            assert!(
                !Mapping::default().pack(0x0F, &target, &mut vec![0; length]),
                "{length}"
            );
        }
    }

    #[test]
    fn inputs_have_the_mapped_length() {
        let bytes = [
            0x37, 0x12, 1, 0, 0, 0, 2, 0, 0, 0, 0xFF, 0xFF, 8, 0x11, 0x86,
        ];
        let with_code = Mapping {
            error_code: true,
            ..Mapping::default()
        };
        let input = with_code.unpack(&bytes).unwrap();
        assert_eq!(
            input,
            Input {
                status: 0x1237,
                position: 1,
                velocity: 2,
                torque: -1,
                mode: 8,
                error_code: 0x8611
            }
        );
        assert_eq!(Mapping::default().unpack(&bytes), None);
        assert_eq!(
            Mapping::default().unpack(&bytes[..13]).unwrap().error_code,
            0
        );
    }
}
