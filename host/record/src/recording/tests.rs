use gantry_tau_machine::robot_file::RobotFile;

use super::*;

fn recorder<T: TickRow<3>>(path: &std::path::Path) -> Recorder<T, 3> {
    let to: RecordTo = path.to_str().unwrap().parse().unwrap();
    Recorder::start(Recording::create::<T, _>(&to, &RobotFile::builtin_l2().unwrap()).unwrap())
        .unwrap()
}

#[test]
fn rows_that_were_dropped_before_are_lost_rows() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("dropped.csv");
    let recorder = recorder::<ClientRow<3>>(&path);
    assert!(!recorder.loses_rows());
    let recorded = recorder.finish(3).unwrap();
    assert_eq!(
        (recorded.written, recorded.lost, recorded.failure),
        (0, 3, None)
    );
    assert!(!path.exists(), "no row, no file");
}

#[cfg(unix)]
mod pipes {
    use std::fs::{File, OpenOptions};
    use std::io::Read;
    use std::os::unix::fs::OpenOptionsExt;
    use std::process::Command;

    use super::*;
    use gantry_tau_server::record::TickRecord;
    use gantry_tau_test_support::logged::logged;

    /// A recording into a pipe whose reader takes nothing by itself.
    struct Piped {
        _folder: tempfile::TempDir,
        reader: File,
        recorder: Recorder<TickRecord<3>, 3>,
    }

    impl Piped {
        fn new() -> Self {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("pipe.csv");
            assert!(
                Command::new("mkfifo")
                    .arg(&path)
                    .status()
                    .unwrap()
                    .success()
            );
            let nonblocking = i32::try_from(rustix::fs::OFlags::NONBLOCK.bits()).unwrap();
            let reader = OpenOptions::new()
                .read(true)
                .custom_flags(nonblocking)
                .open(&path)
                .unwrap();
            Self {
                recorder: recorder(&path),
                _folder: folder,
                reader,
            }
        }

        fn push(&mut self) {
            self.recorder.push(TickRecord::listening(), Vec::new());
        }

        /// Drops rows until so many are lost; returns the log meanwhile.
        fn lose(&mut self, rows: u64) -> String {
            logged(|| {
                while self.recorder.dropped < rows {
                    self.push()
                }
            })
            .1
        }

        /// Ends the recording; with `takes` its reader takes what is there.
        fn end(self, takes: bool) -> Recorded {
            let Self {
                _folder,
                mut reader,
                recorder,
            } = self;
            let finishing = std::thread::spawn(move || recorder.finish(0));
            while takes && !finishing.is_finished() {
                let _read = reader.read(&mut [0; 65_536]);
            }
            finishing.join().unwrap().unwrap()
        }
    }

    #[test]
    fn the_first_row_that_is_dropped_is_logged_once() {
        let mut piped = Piped::new();
        let first = piped.lose(1);
        assert!(
            first.contains(" WARN ")
                && first.contains(&format!("its disk does not take {QUEUE} rows")),
            "{first}"
        );
        assert_eq!((first.lines().count(), piped.lose(100)), (1, String::new()));
        assert!(piped.recorder.loses_rows());
        let recorded = piped.end(true);
        assert!(
            recorded.written >= 8_192 && recorded.lost == 100 && recorded.failure.is_none(),
            "{recorded:?}"
        );
    }

    /// Found from outside: a reader that takes nothing kept the process, and with it the lock of
    /// its machine.
    #[test]
    fn a_reader_that_takes_nothing_does_not_keep_the_end() {
        let mut piped = Piped::new();
        (0..5_000).for_each(|_| piped.push());
        let recorded = piped.end(false);
        let said = recorded.to_string();
        assert!(
            said.contains("takes nothing") && recorded.written < 5_000,
            "{said}"
        );
    }
}
