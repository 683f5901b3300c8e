use std::fs;

use super::*;

const SECRET: &str = "000102030405060708090a0b0c0d0e0f101112131415161718191a1b1c1d1e1f";

/// A file that only its owner may read.
fn file_of(folder: &Path, text: &[u8]) -> PathBuf {
    let path = folder.join("key");
    drop(fs::remove_file(&path));
    let mut file = create_for_its_owner(&path).unwrap();
    file.write_all(text).unwrap();
    path
}

fn refused(path: &Path) -> String {
    read(path).unwrap_err().to_string()
}

#[test]
fn a_new_key_is_read_again() {
    let folder = tempfile::tempdir().unwrap();
    for (name, role) in [("control", Role::Control), ("read", Role::Read)] {
        let path = folder.path().join(name);
        let key = create(&path, role).unwrap();
        assert_eq!(read(&path).unwrap(), key);
        assert_eq!((key.role, key.key().role()), (role, role));
        let error = create(&path, role).unwrap_err().to_string();
        assert!(error.contains("exists"), "{error}");
        assert_eq!(read(&path).unwrap(), key);
    }
    let [one, other] = ["control", "read"].map(|name| read(&folder.path().join(name)));
    assert_ne!(one.unwrap().bytes, other.unwrap().bytes);
}

/// The file of the specification, and its name.
#[test]
fn the_lines_may_end_as_on_windows() {
    let folder = tempfile::tempdir().unwrap();
    for end in ["\n", "\r\n"] {
        let text = [
            "gantry-tau-key 1",
            "role control",
            &format!("secret {SECRET}"),
            "",
        ]
        .join(end);
        for text in [text.as_str(), text.trim_end()] {
            let key = read(&file_of(folder.path(), text.as_bytes())).unwrap();
            assert_eq!(key.key().id().to_string(), "91ab2dba9840f109");
            assert_eq!(key.role, Role::Control);
        }
    }
}

#[test]
fn another_text_is_refused_with_the_line_and_without_the_secret() {
    let folder = tempfile::tempdir().unwrap();
    let upper = SECRET.to_uppercase();
    let cases = [
        ("", 1),
        ("g", 1),
        ("gantry-tau-key 2\nrole control\n", 1),
        ("gantry-tau-key 1", 2),
        (&format!("gantry-tau-key 1\nsecret {SECRET}\n"), 2),
        ("gantry-tau-key 1\nrole owner\n", 2),
        ("gantry-tau-key 1\nrole control \n", 2),
        ("gantry-tau-key 1\nrole control\nsecret \n", 3),
        (
            &format!("gantry-tau-key 1\nrole control\nsecret {}\n", &SECRET[1..]),
            3,
        ),
        (
            &format!("gantry-tau-key 1\nrole control\nsecret {SECRET}0\n"),
            3,
        ),
        (
            &format!("gantry-tau-key 1\nrole control\nsecret {upper}\n"),
            3,
        ),
        (
            &format!("gantry-tau-key 1\nrole control\nsecret  {SECRET}\n"),
            3,
        ),
        (
            &format!("gantry-tau-key 1\nrole control\nkey {SECRET}\n"),
            3,
        ),
        (
            &format!("gantry-tau-key 1\nrole control\nsecret {SECRET}\nsecret {SECRET}\n"),
            4,
        ),
        (
            &format!("gantry-tau-key 1\nrole control\nsecret {SECRET}\n\n"),
            4,
        ),
    ];
    for (text, line) in cases {
        let error = refused(&file_of(folder.path(), text.as_bytes()));
        assert!(
            error.contains(&format!(", line {line}: expected ")),
            "{text:?}: {error}"
        );
        assert!(!error.contains(&SECRET[8..16]), "{error}");
    }
    let error = refused(&file_of(folder.path(), &[0xff; 100]));
    assert!(error.contains("line 1"), "{error}");
    // A part of a long file is read.
    let long = format!(
        "gantry-tau-key 1\nrole control\nsecret {SECRET}\n{}",
        " ".repeat(1 << 20)
    );
    assert!(refused(&file_of(folder.path(), long.as_bytes())).contains("line 4"));
}

#[test]
fn what_is_no_file_is_refused_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let missing = folder.path().join("missing");
    for (path, reason) in [
        (folder.path(), "is a folder"),
        (missing.as_path(), "No such file"),
    ] {
        assert!(refused(path).contains(reason), "{}", refused(path));
    }
    #[cfg(unix)]
    {
        let key = file_of(folder.path(), b"gantry-tau-key 1\n");
        let link = folder.path().join("link");
        std::os::unix::fs::symlink(&key, &link).unwrap();
        assert!(refused(&link).contains("is a symbolic link"));
        assert!(refused(Path::new("/dev/zero")).contains("is a device"));
    }
}

#[cfg(unix)]
#[test]
fn a_file_that_others_may_read_is_refused_with_the_remedy() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("key");
    create(&path, Role::Control).unwrap();
    for mode in [0o640, 0o604, 0o620, 0o644, 0o610] {
        fs::set_permissions(&path, fs::Permissions::from_mode(mode)).unwrap();
        let error = refused(&path);
        assert!(error.contains("run: chmod 600 "), "{error}");
    }
    fs::set_permissions(&path, fs::Permissions::from_mode(0o400)).unwrap();
    assert!(read(&path).is_ok());
}

/// `LoadCredential=` of systemd: mode 0440 and an access list.
#[cfg(unix)]
#[test]
fn a_credential_of_a_service_may_be_read_by_its_group() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("key");
    create(&path, Role::Control).unwrap();
    let elsewhere = folder.path().join("elsewhere");
    for (mode, is_taken) in [(0o440, true), (0o400, true), (0o444, false), (0o460, false)] {
        fs::set_permissions(&path, fs::Permissions::from_mode(mode)).unwrap();
        let metadata = fs::metadata(&path).unwrap();
        let taken = |credentials| check_access(&path, &metadata, credentials).is_ok();
        assert_eq!(taken(Some(folder.path())), is_taken, "{mode:o}");
        assert_eq!(taken(Some(&elsewhere)), mode == 0o400, "{mode:o}");
        assert_eq!(taken(None), mode == 0o400, "{mode:o}");
    }
}

#[test]
fn a_server_has_four_keys_and_none_twice() {
    let folder = tempfile::tempdir().unwrap();
    let files: Vec<PathBuf> = (0..5)
        .map(|number| {
            let path = folder.path().join(number.to_string());
            create(&path, Role::Control).unwrap();
            path
        })
        .collect();
    assert!(keyring(&[]).unwrap().is_none());
    assert!(keyring(&files[..4]).unwrap().is_some());
    let error = keyring(&files).unwrap_err().to_string();
    assert!(error.contains("at most 4 keys"), "{error}");
    let twice = [files[0].clone(), files[0].clone()];
    let error = keyring(&twice).unwrap_err().to_string();
    assert!(error.contains("is given twice"), "{error}");
}
