//! The header that is in the repository is the one that the sources give.

#[test]
fn the_header_is_up_to_date() {
    let folder = env!("CARGO_MANIFEST_DIR");
    let path = format!("{folder}/include/gantry_tau.h");
    let config = cbindgen::Config::from_root_or_default(folder);
    let mut header = Vec::new();
    cbindgen::generate_with_config(folder, config)
        .unwrap()
        .write(&mut header);
    let header = String::from_utf8(header).unwrap();
    if std::env::var_os("GT_WRITE_HEADER").is_some() {
        std::fs::write(&path, &header).unwrap();
    }
    // Line by line, so that a difference is seen and not two headers.
    let there = std::fs::read_to_string(&path).unwrap();
    for (number, (there, given)) in there.lines().zip(header.lines()).enumerate() {
        let line = number + 1;
        assert_eq!(
            there, given,
            "line {line}: GT_WRITE_HEADER=1 cargo test --test header"
        );
    }
    assert_eq!(there.lines().count(), header.lines().count());
}

/// The README has the sizes of the header.
#[test]
fn the_sizes_of_the_readme_are_those_of_the_header() {
    let header = include_str!("../include/gantry_tau.h");
    let readme = include_str!("../README.md").replace('\u{202f}', " ");
    let sizes = header.lines().filter_map(|line| {
        let (name, size) = line.strip_prefix("#define GT_")?.split_once(' ')?;
        name.contains("SIZE")
            .then_some((name, size.parse::<u32>().ok()?))
    });
    let sizes: Vec<_> = sizes.collect();
    assert_eq!(sizes.len(), 10, "{sizes:?}");
    for (name, size) in sizes {
        let text = format!("{} {:03}", size / 1000, size % 1000);
        assert!(readme.contains(&text), "GT_{name}: {text}");
    }
}
