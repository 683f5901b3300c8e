//! `workspace`.

use crate::process::Folder;

#[test]
fn the_map_has_a_page_and_a_row_per_place() {
    let folder = Folder::new("workspace");
    for (robot, axes) in [("l2", 3), ("f1", 6)] {
        let said = folder
            .run(&["workspace", "--robot", robot, "--cells", "16"])
            .success();
        let mut words = said.lines().find(|line| line.starts_with("reached"));
        let mut words = words.take().unwrap().split_whitespace().skip(1);
        let reached: usize = words.next().unwrap().parse().unwrap();
        let places: usize = words.nth(1).unwrap().parse().unwrap();
        assert!(reached > 20 && reached < places, "{said}");
        let csv = folder.read("workspace.csv");
        let mut lines = csv.lines();
        let header = lines.next().unwrap();
        assert!(header.starts_with("x_m,y_m,z_m,code,condition,compliance_um_per_n,q1"));
        assert_eq!(header.split(',').count(), 6 + axes, "{header}");
        let rows: Vec<Vec<&str>> = lines.map(|line| line.split(',').collect()).collect();
        assert_eq!(rows.len(), places);
        let ok = rows.iter().filter(|row| row[3] == "ok");
        assert_eq!(ok.count(), reached);
        for row in rows {
            assert_eq!(row.len(), 6 + axes);
            assert_eq!(row[3] == "ok", !row[5].is_empty(), "{row:?}");
        }
        let page = folder.read("workspace.html");
        assert_eq!(page.matches("<svg").count(), 6);
    }
}

#[test]
fn a_bad_grid_or_place_is_named() {
    let folder = Folder::new("workspace_bad");
    for (option, value) in [
        ("--cells", "1000"),
        ("-o", "no/such/folder.csv"),
        ("--report", "no/such/page.html"),
    ] {
        let said = folder
            .run(&["workspace", "--robot", "l2", option, value])
            .failure(1);
        assert!(said.contains(value), "{said}");
    }
}
