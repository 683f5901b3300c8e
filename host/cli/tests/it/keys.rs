//! Keys on the command line: made, shown, demanded, and refused.

use crate::process::Folder;
use crate::signals::{await_obtain, serve};

/// A folder with a key of each role.
fn folder(name: &str) -> Folder {
    let folder = Folder::new(name);
    folder.run(&["key", "new", "machine.key"]).success();
    folder
        .run(&["key", "new", "reader.key", "--role", "read"])
        .success();
    folder
}

#[test]
fn a_key_is_made_once_and_shown_without_its_secret() {
    let folder = folder("key-new");
    let text = folder.read("machine.key");
    let secret = text
        .lines()
        .nth(2)
        .unwrap()
        .strip_prefix("secret ")
        .unwrap();
    let shown = folder.run(&["key", "show-id", "machine.key"]).success();
    let (id, role) = shown.trim().split_once(' ').unwrap();
    assert!(id.len() == 16 && role == "control", "{shown}");
    assert!(!shown.contains(secret));
    let shown = folder.run(&["key", "show-id", "reader.key"]).success();
    assert!(shown.trim().ends_with(" read"), "{shown}");

    let line = folder.run(&["key", "new", "machine.key"]).failure(1);
    assert!(
        line.contains("machine.key") && line.contains("exists"),
        "{line}"
    );
    assert_eq!(folder.read("machine.key"), text);

    let first = format!("0x{}", &secret[..2]);
    for (language, begins) in [
        ("--c", "static const uint8_t"),
        ("--rust", "const KEY: [u8; 32]"),
    ] {
        let code = folder
            .run(&["key", "export", "machine.key", language])
            .success();
        assert!(code.contains(begins) && code.contains(id), "{code}");
        assert!(
            code.contains(&first) && code.matches("0x").count() == 32,
            "{code}"
        );
    }
    folder.run(&["key", "export", "machine.key"]).failure(2);
}

/// Over both transports: the holder of the key obtains, and no other client.
#[test]
fn a_server_with_a_key_answers_its_holders_only() {
    for transport in [None, Some("--udp")] {
        let folder = folder("key-serve");
        folder.run(&["key", "new", "other.key"]).success();
        let options = [
            &["--key", "machine.key", "--key", "reader.key"],
            transport.as_slice(),
        ];
        let (mut server, address) = serve(&folder, &options.concat());
        let client = |key: &[&'static str]| {
            let mut arguments = vec!["client".to_owned(), address.clone()];
            arguments.extend(key.iter().chain(transport.iter()).map(ToString::to_string));
            arguments
        };
        let run = |key: &[&'static str]| {
            let arguments = client(key);
            folder.run(&arguments.iter().map(String::as_str).collect::<Vec<_>>())
        };
        let said = run(&["--key", "other.key"]).failure(7);
        let id = folder.run(&["key", "show-id", "other.key"]).success();
        let id = id.split_whitespace().next().unwrap();
        assert!(said.contains("wrong key?") && said.contains(id), "{said}");
        if transport.is_none() {
            let said = run(&[]).failure(4);
            assert!(said.contains("the server needs a key (--key)"), "{said}");
        }
        let said = run(&["--key", "reader.key"]).failure(4);
        assert!(said.contains("this key may only read"), "{said}");

        let arguments = client(&["--key", "machine.key"]);
        let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        let owner = folder.start("owner", &arguments);
        await_obtain(&mut server, 1);
        let id = folder.run(&["key", "show-id", "machine.key"]).success();
        let id = id.split_whitespace().next().unwrap();
        server.await_words(&format!("to key {id}"));
        let said = run(&["--key", "machine.key"]).failure(4);
        assert!(said.contains("another client owns the session"), "{said}");
        owner.stop().success();
        server.stop().success();
    }
}

#[test]
fn a_client_with_a_key_leaves_a_server_without_one() {
    let folder = folder("key-alone");
    let (server, address) = serve(&folder, &[]);
    let said = folder
        .run(&["client", &address, "--key", "machine.key"])
        .failure(4);
    assert!(
        said.contains("the server has no key; without --key"),
        "{said}"
    );
    server.stop().success();
}

/// An address that others reach is an open door without a key; that its peers are named is none.
#[test]
fn an_open_port_needs_a_key() {
    let folder = folder("key-open");
    let open = ["serve", "--listen", "0.0.0.0:0", "--name", "open"];
    for further in [&[][..], &["--allow", "127.0.0.0/8"], &["--udp"]] {
        let said = folder.run(&[&open[..], further].concat()).failure(2);
        assert!(
            said.contains("could move the machine")
                && said.contains("--key")
                && said.contains("--insecure"),
            "{said}"
        );
    }
    for further in [&["--key", "machine.key"][..], &["--insecure"]] {
        let mut server = folder.start("serve", &[&open[..], further].concat());
        server.await_words("listening on");
        server.stop().success();
    }
    let both = ["--key", "machine.key", "--insecure"];
    folder.run(&[&open[..], &both].concat()).failure(2);
}

#[test]
fn a_key_file_that_is_none_is_refused_by_both_sides() {
    let folder = folder("key-bad");
    folder.write("empty.key", "");
    #[cfg(unix)]
    std::fs::set_permissions(
        folder.path("empty.key"),
        std::os::unix::fs::PermissionsExt::from_mode(0o600),
    )
    .unwrap();
    let mut cases = vec![
        ("empty.key", "line 1"),
        ("missing.key", "missing.key"),
        (".", "folder"),
    ];
    if cfg!(unix) {
        folder.write("open.key", &folder.read("machine.key"));
        cases.push(("open.key", "chmod 600 open.key"));
    }
    for (file, reason) in cases {
        let said = folder.run(&["serve", "--key", file]).failure(1);
        assert!(said.contains("key file") && said.contains(reason), "{said}");
        let said = folder
            .run(&["client", "127.0.0.1:1", "--key", file])
            .failure(1);
        assert!(said.contains("key file") && said.contains(reason), "{said}");
    }
    let twice = ["serve", "--key", "machine.key", "--key", "machine.key"];
    let said = folder.run(&twice).failure(1);
    assert!(said.contains("is given twice"), "{said}");
}
