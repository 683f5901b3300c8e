//! `header`. Its compilation, and that the C interface accepts it: `tests/tests/tools/linuxcnc`.

use crate::process::Folder;

#[test]
fn a_machine_is_written_from_its_file() {
    let folder = Folder::new("header");
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");
    for (robot, model, axes, motors) in [("l2", "L2", 3, 3), ("f1", "F1", 6, 9)] {
        folder.run(&["header", "--robot", robot]).success();
        let built_in = folder.read("machine.h");
        for define in [
            format!("MODEL_{model}"),
            format!("AXES {axes}"),
            format!("MOTORS {motors}"),
            format!("ROBOT \"robots/{robot}.toml (built in)\""),
        ] {
            assert!(
                built_in.contains(&format!("#define GANTRY_TAU_{define}\n")),
                "{define}: {built_in}"
            );
        }
        let file = format!("{root}/robots/{robot}.toml");
        folder
            .run(&["header", "--robot", &file, "-o", "file.h"])
            .success();
        let name = format!("robots/{robot}.toml (built in)");
        let [of_file, built_in] = [folder.read("file.h"), built_in]
            .map(|text| text.replace(&file, "").replace(&name, ""));
        assert_eq!(of_file, built_in);
    }
}

#[test]
fn a_bad_machine_or_place_is_named() {
    let folder = Folder::new("header_bad");
    let said = folder.run(&["header", "--robot", "no.toml"]).failure(1);
    assert!(said.contains("no.toml"), "{said}");
    let said = folder
        .run(&["header", "--robot", "l2", "-o", "no/such/machine.h"])
        .failure(1);
    assert!(said.contains("no/such/machine.h"), "{said}");
    assert!(!folder.path("machine.h").exists());
}

/// The examples in C include headers that are committed. `GT_WRITE_HEADER=1` writes them again.
#[test]
fn the_headers_of_the_examples_are_those_of_the_robot_files() {
    let folder = Folder::new("header_examples");
    for robot in ["l2", "f1"] {
        folder
            .run(&["header", "--robot", robot, "--prefix", robot])
            .success();
        let header = folder.read("machine.h");
        let committed = format!("{}/../capi/examples/{robot}.h", env!("CARGO_MANIFEST_DIR"));
        if std::env::var_os("GT_WRITE_HEADER").is_some() {
            std::fs::write(&committed, &header).unwrap();
        }
        let committed = std::fs::read_to_string(committed).unwrap();
        assert_eq!(
            committed, header,
            "gantry-tau header --robot {robot} --prefix {robot} -o host/capi/examples/{robot}.h"
        );
    }
}

/// A file without compliances, before `identify`, has no compensator; the header says so.
#[test]
fn a_machine_without_springs_has_no_compensator() {
    let folder = Folder::new("header_springs");
    let text =
        std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../../robots/l2.toml"))
            .unwrap();
    let without: String = text
        .lines()
        .filter(|line| !line.starts_with("c_"))
        .map(|line| format!("{line}\n"))
        .collect();
    std::fs::write(folder.path("bare.toml"), without).unwrap();
    folder.run(&["header", "--robot", "bare.toml"]).success();
    let header = folder.read("machine.h");
    assert!(
        header.contains("#define GANTRY_TAU_HAS_COMPENSATOR 0\n"),
        "{header}"
    );
    assert!(
        !header.contains("gantry_tau_compensator") && header.contains("gantry_tau_sensor"),
        "{header}"
    );
    let said = folder
        .run(&["header", "--robot", "l2", "--prefix", "2"])
        .failure(2);
    assert!(said.contains("beginning with a letter"), "{said}");
}

/// A program over the C interface has no accelerometer: the header says that its filter wants one.
#[test]
fn a_machine_with_an_accelerometer_says_so() {
    let folder = Folder::new("header_accelerometer");
    crate::masses::with_accelerometer(&folder);
    folder.run(&["header", "--robot", "felt.toml"]).success();
    let defined = "#define GANTRY_TAU_NEEDS_ACCELEROMETER 1\n";
    assert!(folder.read("machine.h").contains(defined));
    folder
        .run(&["header", "--robot", "l2", "-o", "l2.h"])
        .success();
    assert!(!folder.read("l2.h").contains("ACCELEROMETER"));
}
