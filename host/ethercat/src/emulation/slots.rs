//! SubDevices in the order of the bus: drives, and other devices between them.

use super::device::Device;
use super::instrument::Instrument;
use super::subdevice::SubDevice;

/// A SubDevice of a chain.
#[derive(Clone, Debug)]
pub enum Node {
    /// A drive.
    Drive(SubDevice),
    /// Another device.
    Instrument(SubDevice<Instrument>),
}

/// Operations of a chain on any of its SubDevices.
pub(super) trait Controller {
    fn answers_to(&self, address: u16) -> bool;
    fn read(&mut self, address: u16, data: &mut [u8]) -> bool;
    fn write(&mut self, address: u16, data: &[u8]) -> bool;
    fn logical(&mut self, address: u32, data: &mut [u8], reads: bool, write_counts: u16) -> u16;
    fn advance_to(&mut self, now_ns: u64);
    fn set_passing(&mut self, here_ns: u64, back_ns: u64);
    fn set_ports(&mut self, has_next: bool);
    fn highest_state(&self) -> u8;
}

impl<D: Device> Controller for SubDevice<D> {
    fn answers_to(&self, address: u16) -> bool {
        self.answers_to(address)
    }

    fn read(&mut self, address: u16, data: &mut [u8]) -> bool {
        self.read(address, data)
    }

    fn write(&mut self, address: u16, data: &[u8]) -> bool {
        self.write(address, data)
    }

    fn logical(&mut self, address: u32, data: &mut [u8], reads: bool, write_counts: u16) -> u16 {
        self.logical(address, data, reads, write_counts)
    }

    fn advance_to(&mut self, now_ns: u64) {
        self.advance_to(now_ns);
    }

    fn set_passing(&mut self, here_ns: u64, back_ns: u64) {
        self.set_passing(here_ns, back_ns);
    }

    fn set_ports(&mut self, has_next: bool) {
        self.set_ports(has_next);
    }

    fn highest_state(&self) -> u8 {
        self.highest_state()
    }
}

/// Index of a SubDevice among those of its kind.
#[derive(Clone, Copy, Debug)]
enum Slot {
    Drive(usize),
    Instrument(usize),
}

/// SubDevices by kind, each kind in the order of the bus.
#[derive(Clone, Debug, Default)]
pub(super) struct Slots {
    order: Vec<Slot>,
    pub(super) drives: Vec<SubDevice>,
    pub(super) instruments: Vec<SubDevice<Instrument>>,
}

impl Slots {
    pub(super) fn new(nodes: Vec<Node>) -> Self {
        let mut slots = Self::default();
        for node in nodes {
            slots.order.push(match node {
                Node::Drive(drive) => {
                    slots.drives.push(drive);
                    Slot::Drive(slots.drives.len() - 1)
                }
                Node::Instrument(instrument) => {
                    slots.instruments.push(instrument);
                    Slot::Instrument(slots.instruments.len() - 1)
                }
            });
        }
        slots
    }

    pub(super) fn len(&self) -> usize {
        self.order.len()
    }

    /// Returns the drive at a place of the bus; `None` where another device stands.
    pub(super) fn drive(&self, position: usize) -> Option<&SubDevice> {
        match self.order.get(position)? {
            Slot::Drive(index) => self.drives.get(*index),
            Slot::Instrument(_) => None,
        }
    }

    pub(super) fn drive_mut(&mut self, position: usize) -> Option<&mut SubDevice> {
        match self.order.get(position)? {
            Slot::Drive(index) => self.drives.get_mut(*index),
            Slot::Instrument(_) => None,
        }
    }

    /// Returns the other device at a place of the bus; `None` where a drive stands.
    pub(super) fn instrument_mut(&mut self, position: usize) -> Option<&mut SubDevice<Instrument>> {
        match self.order.get(position)? {
            Slot::Instrument(index) => self.instruments.get_mut(*index),
            Slot::Drive(_) => None,
        }
    }

    pub(super) fn controller(&mut self, position: usize) -> Option<&mut dyn Controller> {
        Some(match self.order.get(position)? {
            Slot::Drive(index) => self.drives.get_mut(*index)?,
            Slot::Instrument(index) => self.instruments.get_mut(*index)?,
        })
    }

    /// Does something to every SubDevice, in the order of the bus.
    pub(super) fn for_each(&mut self, mut action: impl FnMut(usize, &mut dyn Controller)) {
        for position in 0..self.order.len() {
            if let Some(controller) = self.controller(position) {
                action(position, controller);
            }
        }
    }

    /// Swaps the places of two SubDevices.
    pub(super) fn swap(&mut self, first: usize, second: usize) {
        if first.max(second) >= self.order.len() {
            return;
        }
        self.order.swap(first, second);
        let (mut drives, mut instruments) = (Vec::new(), Vec::new());
        for slot in &mut self.order {
            let (moved, new): (&mut Vec<usize>, fn(usize) -> Slot) = match slot {
                Slot::Drive(_) => (&mut drives, Slot::Drive),
                Slot::Instrument(_) => (&mut instruments, Slot::Instrument),
            };
            let (Slot::Drive(old) | Slot::Instrument(old)) = *slot;
            *slot = new(moved.len());
            moved.push(old);
        }
        sort(&mut self.drives, &drives);
        sort(&mut self.instruments, &instruments);
    }
}

/// Puts items into an order of their indices.
fn sort<T>(items: &mut Vec<T>, order: &[usize]) {
    let mut taken: Vec<Option<T>> = items.drain(..).map(Some).collect();
    items.extend(
        order
            .iter()
            .filter_map(|index| taken.get_mut(*index)?.take()),
    );
}
