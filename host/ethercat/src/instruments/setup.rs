//! Set-up of an instrument in PRE-OP.

use ethercrab::{EtherCrabWireReadSized, EtherCrabWireWrite, SubDevice, SubDeviceRef};

use super::InstrumentRefusal;
use crate::discovery;

/// An instrument in PRE-OP, to be set up through its mailbox.
pub(crate) struct MailboxSetup<'a>(pub(crate) &'a SubDeviceRef<'a, &'a SubDevice>);

impl MailboxSetup<'_> {
    /// Assigns one PDO, unless it is assigned alone.
    pub(super) async fn assign(&self, direction: u16, pdo: u16) -> Result<(), InstrumentRefusal> {
        let count = self.object::<u8>(direction, 0).await?;
        if count == Some(1) && self.object::<u16>(direction, 1).await? == Some(pdo) {
            return Ok(());
        }
        self.write(direction, 0, 0_u8).await?;
        self.write(direction, 1, pdo).await?;
        self.write(direction, 0, 1_u8).await
    }

    /// Returns the first object of the PDOs that are assigned, and the number of their bits.
    pub(super) async fn assigned(&self, direction: u16) -> Result<(u16, u32), InstrumentRefusal> {
        let (mut first, mut bits) = (None, 0_u32);
        let count = self.object::<u8>(direction, 0).await?.unwrap_or(0);
        for place in 1..=count {
            let Some(pdo) = self.object::<u16>(direction, place).await? else {
                continue;
            };
            let entries = self.object::<u8>(pdo, 0).await?.unwrap_or(0);
            for entry in 1..=entries {
                let entry = self.object::<u32>(pdo, entry).await?.unwrap_or(0);
                bits = bits.saturating_add(entry & 0xFF);
                first = first.or(Some((entry >> 16) as u16));
            }
        }
        Ok((first.unwrap_or(0), bits))
    }

    /// Reads an object; `None` where the device lacks it.
    pub(super) async fn object<T: EtherCrabWireReadSized>(
        &self,
        index: u16,
        sub: u8,
    ) -> Result<Option<T>, InstrumentRefusal> {
        let step = "reading an object";
        let value = discovery::object(self.0, index, sub).await;
        value.map_err(|error| InstrumentRefusal::Exchange { step, error })
    }

    pub(super) async fn write<T: EtherCrabWireWrite>(
        &self,
        index: u16,
        sub: u8,
        value: T,
    ) -> Result<(), InstrumentRefusal> {
        let step = "writing an object";
        let written = self.0.sdo_write(index, sub, value).await;
        written.map_err(|error| InstrumentRefusal::Exchange { step, error })
    }
}
