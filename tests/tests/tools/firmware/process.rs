//! A running program, and how long it may take.

use std::process::{Child, ChildStdout, Command, ExitStatus};
use std::time::{Duration, Instant};

/// Pause between two looks at a process.
const LOOK: Duration = Duration::from_millis(5);

/// A running program, killed when the test ends before it.
pub(crate) struct Process(Child);

impl Process {
    /// Starts it.
    pub(crate) fn start(command: &mut Command) -> Self {
        Self(command.spawn().unwrap())
    }

    /// Takes the end of the pipe that was made for its output.
    pub(crate) fn stdout(&mut self) -> ChildStdout {
        self.0.stdout.take().unwrap()
    }

    /// True if it still runs.
    pub(crate) fn is_running(&mut self) -> bool {
        self.0.try_wait().unwrap().is_none()
    }

    /// Interrupts it, as Ctrl-C does.
    pub(crate) fn interrupt(&self) {
        let kill = Command::new("kill")
            .args(["-INT", &self.0.id().to_string()])
            .status();
        assert!(kill.unwrap().success());
    }

    /// Waits for its end. Fails with what it has said if that takes longer than `patience`.
    pub(crate) fn end(&mut self, patience: Duration, said: impl Fn() -> String) -> ExitStatus {
        let since = Instant::now();
        while self.is_running() {
            assert!(
                since.elapsed() < patience,
                "it runs longer than {patience:?}: {}",
                said()
            );
            std::thread::sleep(LOOK);
        }
        self.0.wait().unwrap()
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}
