//! `export`. That MuJoCo moves the models as they should is judged in tests/tests/tools/engines.

use crate::process::Folder;

const L2: &str = include_str!("../../../../robots/l2.toml");

/// A robot file without the lines from one key or section up to the next.
fn without(text: &str, from: &str, to: &str) -> String {
    let (before, rest) = text.split_once(&format!("\n{from}")).unwrap();
    let (_, after) = rest.split_once(&format!("\n{to}")).unwrap();
    format!("{before}\n{to}{after}")
}

#[test]
fn a_model_has_every_axis_and_link() {
    let folder = Folder::new("export");
    for (robot, axes) in [("l2", 3), ("f1", 6)] {
        let files = ["--mjcf", "machine.xml", "--urdf", "machine.urdf"];
        let said = folder
            .run(&[&["export", "--robot", robot], &files[..]].concat())
            .success();
        assert!(said.ends_with("written to machine.urdf\n"), "{said}");
        let model = folder.read("machine.xml");
        assert_eq!(model.matches("<position name=\"axis").count(), axes);
        assert_eq!(model.matches("<connect ").count(), 6);
        assert_eq!(model.matches("name=\"link").count(), 12, "body and joint");
        let description = folder.read("machine.urdf");
        assert_eq!(description.matches("<joint name=\"axis").count(), axes);
        for text in [model, description] {
            assert!(!text.contains("NaN") && !text.contains("inf"), "{text}");
        }
    }
}

#[test]
fn what_cannot_be_a_model_is_named() {
    let folder = Folder::new("export-bad");
    let wrist = format!(
        "{L2}\n[[wrist]]\naxis = [0.0, 1.0, 0.0]\npoint_m = [0.0, 0.0, 0.1]\nc_rad_per_nm = 1e-5\n"
    );
    let cases = [
        (
            without(L2, "[masses]", "[simulation]"),
            "no [masses]: a model needs them",
        ),
        (
            without(L2, "c_link", "# One entry"),
            "no c_link, or none of the axes: a model needs springs",
        ),
        (
            wrist,
            "[[wrist]] cannot be exported; take it out of a copy of the file",
        ),
    ];
    for (text, reason) in cases {
        folder.write("robot.toml", &text);
        let said = folder
            .run(&["export", "--robot", "robot.toml", "--mjcf", "machine.xml"])
            .failure(1);
        assert!(
            said.contains(&format!("robot.toml: {reason}")),
            "{reason}: {said}"
        );
    }
    folder.run(&["export", "--robot", "l2"]).failure(2);
}
