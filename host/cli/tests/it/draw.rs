//! `draw`.

use crate::process::Folder;

/// The pictures of `docs/`, written by `gantry-tau draw --robot robots/l2.toml -o docs/l2.svg`, and the
/// same for the F1.
#[test]
fn the_committed_pictures_are_what_the_command_writes() {
    let folder = Folder::new("draw");
    for robot in ["l2", "f1"] {
        folder
            .run(&["draw", "--robot", robot, "-o", "picture.svg"])
            .success();
        let root = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");
        let committed = std::fs::read_to_string(format!("{root}/docs/{robot}.svg")).unwrap();
        assert!(
            folder.read("picture.svg") == committed,
            "docs/{robot}.svg is out of date: cargo run -p gantry-tau -- draw --robot robots/{robot}.toml -o docs/{robot}.svg"
        );
        let file = format!("{root}/robots/{robot}.toml");
        folder
            .run(&["draw", "--robot", &file, "-o", "file.svg"])
            .success();
        assert_eq!(folder.read("file.svg"), committed);
        assert_eq!(
            committed.matches("<polygon").count(),
            4,
            "three carts and the platform"
        );
        for name in ["guideway 3", "cart 1", "platform", "tool", ">11<", ">33<"] {
            assert!(committed.contains(name), "{name}");
        }
    }
}

#[test]
fn a_bad_machine_place_or_angle_is_named() {
    let folder = Folder::new("draw_bad");
    let said = folder.run(&["draw", "--robot", "no.toml"]).failure(1);
    assert!(said.contains("no.toml"), "{said}");
    folder.write("bad.toml", "model = \"l3\"\n");
    let said = folder.run(&["draw", "--robot", "bad.toml"]).failure(1);
    assert!(said.contains("bad.toml: model"), "{said}");
    for (option, value) in [
        ("-o", "no/such/picture.svg"),
        ("--azimuth", "1000"),
        ("--elevation", "NaN"),
    ] {
        let said = folder
            .run(&["draw", "--robot", "l2", option, value])
            .failure(1);
        assert!(said.contains(value), "{said}");
    }
}
