//! `bus scan`, run as a user runs it. What is printed stands in `golden/bus`.

use crate::process::Folder;

/// The program was built with EtherCAT.
const HAS_ETHERCAT: bool = cfg!(all(feature = "ethercat", target_os = "linux"));

#[test]
fn a_program_without_ethercat_says_so_and_one_with_it_names_the_interface() {
    let folder = Folder::new("bus-missing");
    let ended = folder.run(&["bus", "scan", "nosuch"]);
    if !HAS_ETHERCAT {
        let said = ended.failure(1);
        assert!(said.contains("built without EtherCAT"), "{said}");
        return;
    }
    let said = ended.failure(8);
    let reasons = [
        "gantry-tau: there is no network interface nosuch; `ip link` lists them",
        "gantry-tau: raw sockets are not permitted",
    ];
    assert!(
        reasons.iter().any(|reason| said.starts_with(reason)),
        "{said}"
    );
}

#[test]
fn text_and_json_say_the_same() {
    if !HAS_ETHERCAT {
        return;
    }
    let folder = Folder::new("bus-json");
    let text = folder.run(&["bus", "scan", "emulated"]).success();
    let json = folder.run(&["bus", "scan", "emulated", "--json"]).success();
    assert_eq!(json.lines().count(), 1);
    let answer: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(answer["format"], "gantry-tau bus scan 1");
    let devices = answer["devices"].as_array().unwrap();
    assert_eq!(text.lines().next(), Some("9 devices"));
    assert_eq!(devices.len(), 9);
    let blocks: Vec<&str> = text.split("\n\n").skip(1).collect();
    for (device, block) in devices.iter().zip(blocks) {
        let verdict = device["verdict"].as_str().unwrap();
        assert!(block.contains(&format!("\n  {verdict}")), "{block}");
        let is_entry = block.contains("[[ethercat.drives]]");
        assert_eq!(is_entry, device["is_drivable"] == true, "{block}");
    }
}

#[test]
fn a_wrong_use_is_refused() {
    let folder = Folder::new("bus-usage");
    for arguments in [&["bus"][..], &["bus", "scan"], &["bus", "list", "emulated"]] {
        assert_eq!(folder.run(arguments).code, Some(2), "{arguments:?}");
    }
}
