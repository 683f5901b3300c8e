//! Warnings of a unit.

/// Warnings since they were taken last.
#[derive(Debug, Default)]
pub(crate) struct Log(Vec<String>);

impl Log {
    pub(crate) fn warn(&mut self, warning: String) {
        self.0.push(warning);
    }

    pub(crate) fn take(&mut self) -> Vec<String> {
        std::mem::take(&mut self.0)
    }
}
