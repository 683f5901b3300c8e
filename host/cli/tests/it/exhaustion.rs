//! A full disk: lost rows are counted and reported, and the session goes on.

use std::os::unix::fs::symlink;

use crate::process::Folder;
use crate::signals::{await_obtain, client, leave, serve};

/// Files without any room, one of each format.
const FULL: [&str; 3] = ["full.csv", "full.labcomm", "full.mcap"];

#[test]
fn a_full_disk_costs_the_recording_and_nothing_else() {
    for full in FULL {
        let folder = Folder::new(full);
        symlink("/dev/full", folder.path(full)).unwrap();
        let (mut server, addresses) = serve(&folder, &["--record", full]);
        for times in 1..=2 {
            let owner = client(&folder, &format!("owner{times}"), &addresses);
            await_obtain(&mut server, times);
            leave(owner, &mut server);
        }
        let ended = server.stop();
        assert!(
            ended.stdout.contains("all offsets are zero; ended"),
            "{}",
            ended.stdout
        );
        assert!(
            ended
                .stdout
                .contains(&format!(" rows to {full}, at least ")),
            "{}",
            ended.stdout
        );
        let line = ended.failure(1);
        assert!(line.contains(full), "{line}");
    }
}

#[test]
fn a_client_compensates_although_its_disk_is_full() {
    for full in FULL {
        let folder = Folder::new(&format!("client_{full}"));
        symlink("/dev/full", folder.path(full)).unwrap();
        let (mut server, address) = serve(&folder, &[]);
        let arguments = ["client", &address, "--record", full];
        let owner = folder.start("owner", &arguments);
        await_obtain(&mut server, 1);
        let said = owner.stop().success();
        assert!(
            said.contains(&format!(" rows to {full}, at least ")),
            "{said}"
        );
        server.stop().success();
    }
}
