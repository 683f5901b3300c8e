//! `header`. Its compilation, and that the C interface accepts it: `tests/tests/tools/linuxcnc`.

use crate::process::Folder;

#[test]
fn a_machine_is_written_from_its_file() {
    let folder = Folder::new("header");
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/..");
    for (robot, model, axes, motors) in [("l2", "L2", 3, 3), ("f1", "F1", 6, 9)] {
        folder.run(&["header", robot]).success();
        let built_in = folder.read("machine.h");
        for define in [
            format!("MODEL_{model}"),
            format!("AXES {axes}"),
            format!("MOTORS {motors}"),
            format!("ROBOT \"robots/{robot}.toml (built in)\""),
        ] {
            assert!(built_in.contains(&format!("#define GANTRY_TAU_{define}\n")), "{define}: {built_in}");
        }
        let file = format!("{root}/robots/{robot}.toml");
        folder.run(&["header", &file, "-o", "file.h"]).success();
        let without_name =
            |text: String| text.replace(&file, "").replace(&format!("robots/{robot}.toml (built in)"), "");
        assert_eq!(without_name(folder.read("file.h")), without_name(built_in));
    }
}

#[test]
fn a_bad_machine_or_place_is_named() {
    let folder = Folder::new("header_bad");
    let said = folder.run(&["header", "no.toml"]).failure(1);
    assert!(said.contains("no.toml"), "{said}");
    let said = folder.run(&["header", "l2", "-o", "no/such/machine.h"]).failure(1);
    assert!(said.contains("no/such/machine.h"), "{said}");
    assert!(!folder.path("machine.h").exists());
}
