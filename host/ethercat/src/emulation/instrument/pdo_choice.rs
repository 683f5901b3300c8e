//! PDOs with fixed contents, one of which is assigned.

use crate::emulation::mapping::Mapped;
use crate::emulation::objects::abort;

/// PDOs of one direction: contents are read only, the assignment is written in PRE-OP.
#[derive(Clone, Debug)]
pub(super) struct PdoChoice {
    assignment: u16,
    pdos: Vec<(u16, Vec<Mapped>)>,
    assigned: u16,
    is_assigned: bool,
}

impl PdoChoice {
    /// Creates a choice; the first PDO is assigned.
    pub(super) fn new(assignment: u16, pdos: Vec<(u16, Vec<Mapped>)>) -> Self {
        Self {
            assignment,
            assigned: pdos.first().map_or(0, |(object, _)| *object),
            pdos,
            is_assigned: true,
        }
    }

    /// Assigns the first PDO again, as after a loss of power.
    pub(super) fn reset(&mut self) {
        self.assigned = self.pdos.first().map_or(0, |(object, _)| *object);
        self.is_assigned = true;
    }

    /// Returns the assigned PDO's object; 0 without one.
    pub(super) const fn assigned(&self) -> u16 {
        if self.is_assigned { self.assigned } else { 0 }
    }

    /// True if an object belongs to these PDOs.
    pub(super) fn owns(&self, index: u16) -> bool {
        index == self.assignment || self.contents(index).is_some()
    }

    fn contents(&self, object: u16) -> Option<&Vec<Mapped>> {
        self.pdos
            .iter()
            .find(|(here, _)| *here == object)
            .map(|(_, contents)| contents)
    }

    /// Returns the length of the assigned PDO, bytes.
    pub(super) fn length(&self) -> usize {
        let bits: usize = self.contents(self.assigned()).map_or(0, |contents| {
            contents.iter().map(|it| usize::from(it.bits)).sum()
        });
        bits / 8
    }

    pub(super) fn upload(&self, index: u16, sub: u8) -> Result<([u8; 4], usize), u32> {
        if index == self.assignment {
            return match sub {
                0 => Ok(([u8::from(self.is_assigned), 0, 0, 0], 1)),
                1 => Ok((u32::from(self.assigned()).to_le_bytes(), 2)),
                _ => Err(abort::NO_SUBINDEX),
            };
        }
        let contents = self.contents(index).ok_or(abort::NO_OBJECT)?;
        if sub == 0 {
            return Ok(([contents.len() as u8, 0, 0, 0], 1));
        }
        let place = contents.get(usize::from(sub) - 1);
        let it = place.ok_or(abort::NO_SUBINDEX)?;
        let word = u32::from(it.index) << 16 | u32::from(it.sub) << 8 | u32::from(it.bits);
        Ok((word.to_le_bytes(), 4))
    }

    /// Takes a write to the assignment, as ETG1000.6 orders them: count to zero, PDO, count.
    pub(super) fn download(&mut self, index: u16, sub: u8, bytes: &[u8]) -> Result<(), u32> {
        if index != self.assignment {
            return Err(abort::READ_ONLY);
        }
        match (sub, bytes) {
            (0, [count @ (0 | 1)]) => {
                self.is_assigned = *count == 1;
                Ok(())
            }
            (0, [_]) => Err(abort::RANGE),
            (1, [low, high]) => {
                let object = u16::from_le_bytes([*low, *high]);
                if self.is_assigned {
                    return Err(abort::UNSUPPORTED);
                }
                if self.contents(object).is_none() {
                    return Err(abort::NOT_MAPPABLE);
                }
                self.assigned = object;
                Ok(())
            }
            (0 | 1, _) => Err(abort::LENGTH),
            _ => Err(abort::NO_SUBINDEX),
        }
    }
}
