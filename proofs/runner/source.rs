//! What the source says: harnesses and their attributes, assumptions and covers, mutants, the README's table.
//!
//! Read line by line, in the layout rustfmt gives (CI checks it): a function ends at the first `}` as far in as its first line, and
//! its statements stand four columns further in. A harness written by a macro is not seen, and then the names disagree.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// One file of `proofs/src/harness/`.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Family {
    /// The file's name, which is the module's.
    pub(crate) name: String,
    pub(crate) harnesses: Vec<Harness>,
}

/// A function with `#[kani::proof]`.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Harness {
    pub(crate) name: String,
    pub(crate) solver: Option<String>,
    pub(crate) unwind: Option<u32>,
    /// Something is substituted.
    pub(crate) stubbed: bool,
    /// Its last statement is a cover, or calls a function of the file that ends in one: the end of the proof can be reached.
    pub(crate) ends_in_cover: bool,
}

/// A row of the README's table of theorems.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Row {
    pub(crate) theorem: String,
    pub(crate) harnesses: BTreeSet<String>,
}

/// Every family.
pub(crate) fn families(root: &Path) -> Result<Vec<Family>, String> {
    let mut families = Vec::new();
    for path in rust_files(&root.join("proofs/src/harness"))? {
        let name = path.file_stem().unwrap_or_default().to_string_lossy();
        if name != "mod" {
            families.push(family(&name, &read(&path)?));
        }
    }
    Ok(families)
}

/// Whether `proofs/src/harness/mod.rs` compiles a family, and leaves it out where the runner wants another one only.
pub(crate) fn is_declared(root: &Path, family: &str) -> Result<bool, String> {
    let text = read(&root.join("proofs/src/harness/mod.rs"))?;
    let lines: Vec<&str> = text.lines().collect();
    let wanted = declaration(family);
    Ok(lines.windows(2).any(|pair| pair == wanted))
}

/// How a family is declared.
pub(crate) fn declaration(family: &str) -> [String; 2] {
    let cfg = format!("#[cfg(any(not(only), only = \"{family}\"))]");
    [cfg, format!("mod {family};")]
}

/// Where core or proofs assume something that no cover follows in the same function.
pub(crate) fn uncovered(root: &Path) -> Result<Vec<String>, String> {
    let mut places = Vec::new();
    for folder in ["core/src", "proofs/src"] {
        for path in rust_files(&root.join(folder))? {
            let text = read(&path)?;
            let lines = functions(&text)
                .into_iter()
                .flat_map(|function| function.uncovered());
            places.extend(lines.map(|line| format!("{}:{line}", path.display())));
        }
    }
    Ok(places)
}

/// Every name in a `cfg(mutant = "...")` of core.
pub(crate) fn mutants(root: &Path) -> Result<BTreeSet<String>, String> {
    let mut names = BTreeSet::new();
    for path in rust_files(&root.join("core/src"))? {
        let text = read(&path)?;
        for line in text.lines().filter(|line| !is_comment(line)) {
            let after = line.split("mutant = \"").skip(1);
            names.extend(after.filter_map(|rest| rest.split('"').next().map(str::to_owned)));
        }
    }
    Ok(names)
}

/// The rows of the README's table.
pub(crate) fn readme(root: &Path) -> Result<Vec<Row>, String> {
    Ok(rows(&read(&root.join("README.md"))?))
}

/// The version of Kani in `proofs/kani-version`, the one place that names it.
pub(crate) fn pinned_kani(root: &Path) -> Result<String, String> {
    Ok(read(&root.join("proofs/kani-version"))?.trim().to_owned())
}

/// Rows begin with a theorem's number; their last cell holds the harnesses' names, in backticks.
fn rows(text: &str) -> Vec<Row> {
    let row = |line: &str| {
        let (theorem, _) = line.strip_prefix("| T")?.split_once(' ')?;
        theorem.parse::<u32>().ok()?;
        let last = line.trim_end().strip_suffix('|')?.rsplit('|').next()?;
        Some(Row {
            theorem: format!("T{theorem}"),
            harnesses: last
                .split('`')
                .skip(1)
                .step_by(2)
                .map(str::to_owned)
                .collect(),
        })
    };
    text.lines().filter_map(row).collect()
}

/// One family, from its text.
fn family(name: &str, text: &str) -> Family {
    let functions = functions(text);
    let covering = functions
        .iter()
        .filter(|function| function.ends_in("kani::cover!"));
    let endings: Vec<&str> = covering
        .map(|function| function.name)
        .chain(["kani::cover!"])
        .collect();
    let harness = |function: &Function<'_>| function.harness(&endings);
    Family {
        name: name.to_owned(),
        harnesses: functions.iter().filter_map(harness).collect(),
    }
}

/// A function, as lines.
struct Function<'a> {
    name: &'a str,
    /// What stands before it: attributes and comments, the last line first.
    attributes: Vec<&'a str>,
    /// Columns before its first line.
    indent: usize,
    /// From its first line to the one before its last, with their numbers.
    lines: Vec<(usize, &'a str)>,
}

fn functions(text: &str) -> Vec<Function<'_>> {
    let lines: Vec<(usize, &str)> = (1..).zip(text.lines()).collect();
    let mut functions = Vec::new();
    for (index, (_, first)) in lines.iter().enumerate() {
        let Some(name) = function_name(first) else {
            continue;
        };
        let (before, from) = lines.split_at(index);
        let indent = indent_of(first);
        let ends = |line: &str| line.ends_with('}') && indent_of(line) == indent;
        let attributes = before.iter().rev().map(|(_, line)| line.trim());
        functions.push(Function {
            name,
            attributes: attributes.take_while(|line| !ends_item(line)).collect(),
            indent,
            lines: from
                .iter()
                .take_while(|(_, line)| !ends(line))
                .copied()
                .collect(),
        });
    }
    functions
}

impl Function<'_> {
    /// A harness, if it is one. To end in one of these calls is to end in a cover.
    fn harness(&self, endings: &[&str]) -> Option<Harness> {
        self.attribute("#[kani::proof").map(|_| Harness {
            name: self.name.to_owned(),
            solver: self.argument("#[kani::solver("),
            unwind: self
                .argument("#[kani::unwind(")
                .and_then(|bound| bound.parse().ok()),
            stubbed: self.attribute("#[kani::stub").is_some(),
            ends_in_cover: endings.iter().any(|call| self.ends_in(call)),
        })
    }

    /// What follows the beginning of an attribute.
    fn attribute(&self, beginning: &str) -> Option<&str> {
        self.attributes
            .iter()
            .find_map(|line| line.strip_prefix(beginning))
    }

    /// The argument of an attribute.
    fn argument(&self, beginning: &str) -> Option<String> {
        let (argument, _) = self.attribute(beginning)?.split_once(')')?;
        Some(argument.to_owned())
    }

    /// Whether the last statement is this call.
    fn ends_in(&self, call: &str) -> bool {
        let statement = self.indent.saturating_add(4);
        // A statement over many lines ends in a line as far in as its first: `)` and the like.
        let starts = |line: &str| {
            indent_of(line) == statement && line.trim().starts_with(char::is_alphabetic)
        };
        let last = self.lines.iter().rev().find(|(_, line)| starts(line));
        let after = last.and_then(|(_, line)| line.trim().strip_prefix(call));
        after.is_some_and(|rest| rest.starts_with(['(', ':']))
    }

    /// Line numbers of the assumptions after the last cover.
    fn uncovered(&self) -> Vec<usize> {
        let code = self
            .lines
            .iter()
            .rev()
            .filter(|(_, line)| !is_comment(line));
        code.take_while(|(_, line)| !line.contains("kani::cover!("))
            .filter(|(_, line)| line.contains("kani::assume("))
            .map(|(number, _)| *number)
            .collect()
    }
}

/// The name, where a function begins in this line.
fn function_name(line: &str) -> Option<&str> {
    let (before, after) = line.split_once("fn ")?;
    let is_header = before
        .chars()
        .all(|c| c.is_alphanumeric() || " ()_:".contains(c));
    let name = after.split(['(', '<']).next()?;
    (is_header && before.is_empty() | before.ends_with(' ')).then_some(name)
}

/// Nothing above this line belongs to the item below it.
fn ends_item(line: &str) -> bool {
    line.is_empty() || line.ends_with(['}', ';', '{'])
}

fn is_comment(line: &str) -> bool {
    line.trim_start().starts_with("//")
}

fn indent_of(line: &str) -> usize {
    line.len().saturating_sub(line.trim_start().len())
}

/// All Rust files below a folder, in the order of their names.
fn rust_files(folder: &Path) -> Result<Vec<PathBuf>, String> {
    let complain = |error: std::io::Error| format!("{}: {error}", folder.display());
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(complain)? {
        let path = entry.map_err(complain)?.path();
        if path.is_dir() {
            files.extend(rust_files(&path)?);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}

fn read(path: &Path) -> Result<String, String> {
    std::fs::read_to_string(path).map_err(|error| format!("{}: {error}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = r#"//! Words about kani::assume( and fn nothing() in a comment.

fn any_limits() -> Limits {
    let limits = Limits::new(kani::any());
    kani::assume(limits.is_ok());
    kani::cover!(true, "some are valid");
    limits.unwrap()
}

impl Any for Thing {
    fn any() -> Self {
        kani::assume(true);
        Self
    }
}

/// Words.
#[kani::proof]
#[kani::solver(kissat)]
#[kani::unwind(9)]
#[kani::stub(
    core::sqrt,
    crate::sqrt
)]
fn covered() {
    let limits = any_limits();
    if limits.is_empty() {
        kani::assume(limits.any());
    }
    kani::cover!(
        limits.any(),
        "the end"
    );
}
#[kani::proof]
fn not_covered() {
    kani::cover!(true, "a cover, but not the last statement");
    property(|x| {
        kani::assume(x);
    });
}
#[kani::proof]
fn covered_by_another() {
    covered();
}
"#;

    #[test]
    fn a_family_is_read() {
        let family = family("toy", TEXT);
        let uncovered: Vec<usize> = functions(TEXT)
            .iter()
            .flat_map(Function::uncovered)
            .collect();
        assert_eq!(uncovered, [12, 39]);
        let expected = Harness {
            name: "covered".to_owned(),
            solver: Some("kissat".to_owned()),
            unwind: Some(9),
            stubbed: true,
            ends_in_cover: true,
        };
        assert_eq!(family.harnesses[0], expected);
        let second = &family.harnesses[1];
        assert_eq!(second.name, "not_covered");
        assert!(second.solver.is_none() && !second.stubbed && !second.ends_in_cover);
        assert!(family.harnesses[2].ends_in_cover);
        assert_eq!(family.harnesses.len(), 3);
    }

    #[test]
    fn a_table_is_read() {
        let rows = rows(concat!(
            "| T1 | \\|x\\| small, `code` | proved | `a`, `b` |\n",
            "| Tx | no |\n| T12 | x | — |\n"
        ));
        let names: Vec<&str> = rows[0].harnesses.iter().map(String::as_str).collect();
        assert_eq!((rows[0].theorem.as_str(), names), ("T1", vec!["a", "b"]));
        assert_eq!(rows[1].theorem, "T12");
        assert!(rows[1].harnesses.is_empty() && rows.len() == 2);
    }
}
