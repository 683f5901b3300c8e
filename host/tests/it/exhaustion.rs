//! A full disk: lost rows are counted and reported, and the session goes on.

use crate::process::Folder;
use crate::signals::{await_obtain, client, leave, serve};

#[test]
fn a_full_disk_costs_the_recording_and_nothing_else() {
    let folder = Folder::new("full");
    let (mut server, addresses) = serve(&folder, &["--record", "/dev/full"]);
    for times in 1..=2 {
        let owner = client(&folder, &format!("owner{times}"), &addresses);
        await_obtain(&mut server, times);
        leave(owner, &mut server);
    }
    let ended = server.stop();
    assert!(ended.stdout.contains("all offsets are zero; ended"), "{}", ended.stdout);
    assert!(ended.stdout.contains(" rows to /dev/full, at least "), "{}", ended.stdout);
    let line = ended.failure(1);
    assert!(line.contains("/dev/full"), "{line}");
}

#[test]
fn a_client_compensates_although_its_disk_is_full() {
    let folder = Folder::new("full_client");
    let (mut server, [address, sensor]) = serve(&folder, &[]);
    let arguments = ["client", &address, "--sensor", &sensor, "--record", "/dev/full"];
    let owner = folder.start("owner", &arguments);
    await_obtain(&mut server, 1);
    let said = owner.stop().success();
    assert!(said.contains("/dev/full"), "{said}");
    server.stop().success();
}
