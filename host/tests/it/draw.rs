//! `draw`.

use crate::process::Folder;

/// The pictures of `docs/`, written by `gantry-tau draw robots/l2.toml --svg docs/l2.svg`, and the same for the F1.
#[test]
fn the_committed_pictures_are_what_the_command_writes() {
    let folder = Folder::new("draw");
    for robot in ["l2", "f1"] {
        folder.run(&["draw", robot, "--svg", "picture.svg"]).success();
        let root = concat!(env!("CARGO_MANIFEST_DIR"), "/..");
        let committed = std::fs::read_to_string(format!("{root}/docs/{robot}.svg")).unwrap();
        assert!(
            folder.read("picture.svg") == committed,
            "docs/{robot}.svg is out of date: cargo run -p gantry-tau -- draw robots/{robot}.toml --svg docs/{robot}.svg"
        );
        let file = format!("{root}/robots/{robot}.toml");
        folder.run(&["draw", &file, "--svg", "file.svg"]).success();
        assert_eq!(folder.read("file.svg"), committed);
        assert_eq!(committed.matches("<polygon").count(), 4, "three carts and the platform");
        for name in ["guideway 3", "cart 1", "platform", "tool", ">11<", ">33<"] {
            assert!(committed.contains(name), "{name}");
        }
    }
}

#[test]
fn a_bad_machine_place_or_angle_is_named() {
    let folder = Folder::new("draw_bad");
    let said = folder.run(&["draw", "no.toml"]).failure(1);
    assert!(said.contains("no.toml"), "{said}");
    folder.write("bad.toml", "model = \"l3\"\n");
    let said = folder.run(&["draw", "bad.toml"]).failure(1);
    assert!(said.contains("bad.toml: model"), "{said}");
    for (option, value) in [("--svg", "no/such/picture.svg"), ("--azimuth", "1000"), ("--elevation", "NaN")] {
        let said = folder.run(&["draw", "l2", option, value]).failure(1);
        assert!(said.contains(value), "{said}");
    }
}
