use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

use proc_macro2::{Ident, Literal};

use super::*;

fn normal(source: &str) -> String {
    program(source).unwrap().text
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap()
}

/// Folders of the hashed crates.
const CRATES: [&str; 4] = [
    "core/src",
    "proofs/src",
    "host/capi/src",
    "host/labcomm/src",
];

/// Settings of rustfmt: the defaults, the repository's before them, a narrow format and a wide one.
const FORMATS: [&str; 5] = [
    "max_width=100,use_small_heuristics=Default",
    "max_width=120,use_small_heuristics=Max",
    "max_width=50,use_small_heuristics=Default",
    "max_width=200,use_small_heuristics=Max",
    "max_width=80,use_small_heuristics=Off",
];

/// Texts of the hashed crates, by their paths in a folder.
fn sources(folder: &Path) -> BTreeMap<PathBuf, String> {
    let files = CRATES
        .iter()
        .flat_map(|name| crate::files(&folder.join(name)).unwrap());
    files
        .map(|path| {
            (
                path.strip_prefix(folder).unwrap().to_owned(),
                crate::read(&path).unwrap(),
            )
        })
        .collect()
}

/// Beginning of the first difference of two texts.
fn difference(one: &str, other: &str) -> [String; 2] {
    let same = one
        .split(' ')
        .zip(other.split(' '))
        .take_while(|(one, other)| one == other)
        .count();
    [one, other].map(|text| {
        text.split(' ')
            .skip(same.saturating_sub(20))
            .take(40)
            .collect::<Vec<_>>()
            .join(" ")
    })
}

/// Each setting of rustfmt, one after the other, leaves the tokens of every hashed file as they
/// are.
#[test]
fn a_format_does_not_count() {
    let rustfmt = std::env::var_os("RUSTFMT").unwrap_or_else(|| "rustfmt".into());
    if !Command::new(&rustfmt)
        .arg("--version")
        .output()
        .is_ok_and(|output| output.status.success())
    {
        // Not `eprint!`, which a test that passes does not show.
        std::io::stderr()
            .write_all(b"SKIPPED: a_format_does_not_count: rustfmt is not installed\n")
            .unwrap();
        return;
    }
    let folder = std::env::temp_dir().join(format!("gantry-tau-formats-{}", std::process::id()));
    let written = sources(root());
    for (path, text) in &written {
        std::fs::create_dir_all(folder.join(path).parent().unwrap()).unwrap();
        std::fs::write(folder.join(path), text).unwrap();
    }
    let mut before = written.clone();
    for format in FORMATS {
        let crates = CRATES.map(|name| folder.join(name).join("lib.rs"));
        let status = Command::new(&rustfmt)
            .args(["--edition", "2024", "--config", format])
            .args(crates)
            .status();
        assert!(status.unwrap().success(), "{format}");
        let after = sources(&folder);
        for (path, text) in &after {
            let (one, other) = (normal(&written[path]), normal(text));
            assert!(
                one == other,
                "{format}: {}: {:#?}",
                path.display(),
                difference(&one, &other)
            );
        }
        // The first setting may be the one in force.
        let changed = after
            .iter()
            .filter(|(path, text)| before[*path] != **text)
            .count();
        assert!(
            format == FORMATS[0] || changed > after.len() / 2,
            "{format} changes {changed} files"
        );
        before = after;
    }
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
fn formatting_does_not_count() {
    for (one, other) in [
        (
            "fn f() { g() }",
            "// A comment.\nfn f() {\n\n    g() /* another */\n}\n",
        ),
        (
            "fn f() {}",
            "//! Docs.\n/// More.\nfn f() {\n    //! Inner docs.\n}",
        ),
        (
            "enum E { A { x: u8 } }",
            "enum E {\n    /// Docs.\n    A {\n        /// Docs.\n        x: u8,\n    },\n}",
        ),
        ("m! { a [x] }", "m! {\n    /// Docs.\n    a [x]\n}"),
        ("use a::{b, c};", "use a::{\n    b,\n    c,\n};"),
        (
            "fn f<T, U>(a: T, b: U) where T: A {}",
            "fn f<\n T,\n U,\n>(\n a: T,\n b: U,\n) where\n T: A,\n{}",
        ),
        (
            "const X: S<1> = S { a, ..B };",
            "const X: S<1,> = S {\n a,\n ..B\n};",
        ),
        (
            "const X: [u8; 2] = [f(1), 2];",
            "const X: [u8; 2] = [f(1,), 2,];",
        ),
        (
            "const X: (u8, u8) = (1, 2);",
            "const X: (u8, u8,) = (1, 2,);",
        ),
        (
            "#[derive(A, B)] #[cfg(all(a, b))] struct S(u8);",
            "#[derive(A, B,)]\n#[cfg(all(a, b,),)]\nstruct S(u8,);",
        ),
        (
            "fn f() { match x { A => g(), B(x) => {} } }",
            "fn f() { match x { A => { g() } B(x,) => {}, } }",
        ),
        (
            "fn f() { match x { A => panic!(), } }",
            "fn f() { match x { A => { panic!() } } }",
        ),
        (
            "fn f() { match x { A => return 1, B => break, } }",
            "fn f() { match x { A => { return 1; } B => { break; } } }",
        ),
        (
            "fn f() { g(|x| x + 1) }",
            "fn f() { g(|x,| { { x + 1 } },) }",
        ),
        (
            "fn f() { let A = x else { return 1 }; }",
            "fn f() { let A = x else {\n    return 1;\n}; }",
        ),
        (
            "fn f() { assert!(g(|x| h(x, 1)), \"text\") }",
            "fn f() { assert!(g(|x| { h(x, 1,) },), \"text\",) }",
        ),
        ("fn f() { vec![g(1); 2] }", "fn f() { vec![g(1,); 2] }"),
        (
            "macro_rules! m { ($x:expr) => { f($x, [1]) }; }",
            "macro_rules! m { ($x:expr) => { f($x, [1,],) }; }",
        ),
        (
            "mod a; fn f() {} #[cfg(test)] mod tests { fn g() {} }",
            "mod a; mod b; fn f() {} #[cfg(test)] mod tests;",
        ),
        (
            "const H: &[&[H]] = &[a::HARNESSES];",
            "const H: &[&[H]] = &[a::HARNESSES, b::HARNESSES,];",
        ),
    ] {
        assert_eq!(normal(one), normal(other));
    }
}

#[test]
fn everything_else_counts() {
    for (one, other) in [
        ("fn f() { a + b }", "fn f() { a - b }"),
        ("fn f() { a && b }", "fn f() { a & &b }"),
        ("fn f() { a + b * c }", "fn f() { (a + b) * c }"),
        ("const X: u8 = 1;", "const X: u8 = 2;"),
        ("const X: u8 = 1;", "const X: u8 = 1_u8;"),
        ("const X: &str = \"a b\";", "const X: &str = \"a  b\";"),
        ("fn f() {}", "fn g() {}"),
        ("fn f() {}", "pub fn f() {}"),
        ("fn f() {}", "#[cfg(kani)] fn f() {}"),
        ("#[cfg(kani)] fn f() {}", "#[cfg(not(kani))] fn f() {}"),
        ("#[doc(hidden)] fn f() {}", "fn f() {}"),
        ("fn f() {} fn g() {}", "fn g() {} fn f() {}"),
        (
            "fn f() { if a { b(); } c(); }",
            "fn f() { if a { b(); c(); } }",
        ),
        ("fn f() { g() }", "fn f() { g(); }"),
        ("fn f() { g(|x| { h(x) }) }", "fn f() { g(|x| { h(x); }) }"),
        ("fn f() { g(|x| x) }", "fn f() { g(|x| unsafe { x }) }"),
        ("fn f() { g(|x| x) }", "fn f() { g(move |x| x) }"),
        (
            "fn f() { match x { A => { g() } } }",
            "fn f() { match x { A => { #[cfg(kani)] g() } } }",
        ),
        (
            "fn f() { match x { A => a, B => b } }",
            "fn f() { match x { B => b, A => a } }",
        ),
        (
            "fn f() { match x { A => 'a: { g() } } }",
            "fn f() { match x { A => g() } }",
        ),
        (
            "fn f() { loop { return; } }",
            "fn f() { loop { return 1; } }",
        ),
        ("fn f() { let x = { g() }; }", "fn f() { let x = g(); }"),
        ("const X: T = (1,);", "const X: T = (1);"),
        ("type X = (u8,);", "type X = (u8);"),
        ("fn f((x,): T) {}", "fn f((x): T) {}"),
        (
            "fn f() { assert!(a, \"text\") }",
            "fn f() { assert!(b, \"text\") }",
        ),
        ("fn f() { assert!(g((1,))) }", "fn f() { assert!(g((1))) }"),
        ("fn f() { m!(g(1,)) }", "fn f() { m!(g(1)) }"),
        ("fn f() { m!({ x }) }", "fn f() { m!(x) }"),
        ("m! { a b }", "m! { a c }"),
        ("m! { a . . b }", "m! { a .. b }"),
        (
            "macro_rules! m { ($x:expr,) => {}; }",
            "macro_rules! m { ($x:expr) => {}; }",
        ),
        (
            "macro_rules! m { ($($x:expr),*) => { [$($x,)*] }; }",
            "macro_rules! m { ($($x:expr),*) => { [$($x)*] }; }",
        ),
        (
            "macro_rules! m { () => { f(&(1,)) }; }",
            "macro_rules! m { () => { f(&(1)) }; }",
        ),
        (
            "macro_rules! m { () => { return (1,) }; }",
            "macro_rules! m { () => { return (1) }; }",
        ),
        (
            "macro_rules! m { ($x:ident) => { $x (1,) }; }",
            "macro_rules! m { ($x:ident) => { $x (1) }; }",
        ),
        (
            "macro_rules! m { () => { n!(1,) }; }",
            "macro_rules! m { () => { n!(1) }; }",
        ),
        ("mod tests { fn f() {} }", "mod tests { fn g() {} }"),
        (
            "const H: &[&[H]] = &[HARNESSES];",
            "const H: &[&[H]] = &[];",
        ),
    ] {
        assert_ne!(normal(one), normal(other));
    }
}

/// Copies of the tokens, each with one change: another name, another literal, a sign less, or
/// parentheses more. Commas and doc comments are left alone.
fn with_one_change(tokens: TokenStream) -> Vec<TokenStream> {
    let trees = Vec::from_iter(tokens);
    let mut copies = Vec::new();
    let mut rest = trees.as_slice();
    while let Some((tree, after)) = rest.split_first() {
        let before = &trees[..trees.len().saturating_sub(rest.len())];
        if let Some(after) = after_doc_comment(rest) {
            rest = after;
            continue;
        }
        let changes: Vec<TokenStream> = match tree {
            TokenTree::Ident(name) => {
                vec![TokenTree::from(Ident::new(&format!("{name}x"), name.span())).into()]
            }
            TokenTree::Literal(literal) => {
                vec![TokenTree::from(Literal::string(&literal.to_string())).into()]
            }
            TokenTree::Punct(punct) if punct.as_char() == ',' => Vec::new(),
            TokenTree::Punct(_) => vec![TokenStream::new()],
            TokenTree::Group(group) => {
                let inner = with_one_change(group.stream()).into_iter();
                let inner =
                    inner.map(|inner| TokenTree::from(Group::new(group.delimiter(), inner)).into());
                inner
                    .chain([TokenTree::from(Group::new(
                        Delimiter::Parenthesis,
                        tree.clone().into(),
                    ))
                    .into()])
                    .collect()
            }
        };
        for change in changes {
            copies.push(
                before
                    .iter()
                    .cloned()
                    .chain(change)
                    .chain(after.iter().cloned())
                    .collect(),
            );
        }
        rest = after;
    }
    copies
}

/// In files with every kind of token, every source that still parses after one change is another
/// program.
#[test]
fn every_token_counts() {
    for file in [
        "core/src/control/axis.rs",
        "core/src/control/wire/cursor.rs",
        "core/src/control/client/saturation.rs",
    ] {
        let source = crate::read(&root().join(file)).unwrap();
        let (original, mut parsed) = (normal(&source), 0);
        for copy in with_one_change(source.parse().unwrap()) {
            let copy = copy.to_string();
            if let Ok(program) = parse(&copy) {
                assert_ne!(program.text, original, "{file}: {copy}");
                parsed += 1;
            }
        }
        assert!(parsed > 150, "{file}: {parsed}");
    }
}
