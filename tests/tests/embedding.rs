//! README shows the code that is compiled, and the other way round.

/// The line in README before the block that shows the example.
const MARKER: &str = "<!-- tests/examples/embed.rs -->";

#[test]
fn readme_shows_the_example_that_is_compiled() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/");
    let example = std::fs::read_to_string(format!("{folder}examples/embed.rs")).unwrap();
    let readme = std::fs::read_to_string(format!("{folder}../README.md")).unwrap();
    let after = readme.split_once(MARKER).map(|(_, after)| after);
    let after = after.expect("README.md lacks the marker");
    let block = after
        .trim_start()
        .strip_prefix("```rust\n")
        .expect("no ```rust block follows the marker");
    let (block, _) = block.split_once("```").unwrap();
    assert_eq!(block, example, "README.md shows other code");
}
