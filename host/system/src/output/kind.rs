//! Contents of whole files, and how they are recognised.

use std::fmt;
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Bytes that show the kind of a file. The keys of a robot file stand behind its comments.
const HEAD: u64 = 64 << 10;
/// Bytes that have the mark of a page, picture, model, answer or header.
const MARKED: usize = 256;
/// Marks of JSON that belongs to measured data, black boxes and companions of recordings; it looks
/// like an answer otherwise.
const MEASURED: [&str; 3] = [
    "\"gantry-tau black box\"",
    "\"gantry-tau position loops\"",
    "\"started_ns\"",
];

/// Extensions that say what a file is.
const EXTENSIONS: [&str; 10] = [
    "csv", "fmu", "h", "html", "json", "jsonl", "svg", "toml", "urdf", "xml",
];

/// Contents of a whole file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A page with results, HTML.
    Page,
    /// The sheet of a plan, HTML.
    Sheet,
    /// A picture, SVG.
    Picture,
    /// Results for programs, JSON.
    Answer,
    /// A machine as a C header.
    Header,
    /// A machine for other programs, XML.
    Model,
    /// A functional mock-up unit, a zip archive.
    Fmu,
    /// The table of `workspace`, CSV.
    Map,
    /// A plan of measurements, TOML.
    Plan,
    /// The table of a plan, CSV: replaced as long as it has no rows.
    Table,
    /// A robot file, TOML.
    Robot,
    /// A manual page, roff.
    Manual,
    /// A black box, JSON lines: it replaces nothing and gets a name that is free.
    BlackBox,
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Page => "a page of results",
            Self::Sheet => "the sheet of a plan",
            Self::Picture => "a picture",
            Self::Answer => "an answer in JSON",
            Self::Header => "a C header",
            Self::Model => "a model of a machine",
            Self::Fmu => "a functional mock-up unit",
            Self::Map => "a table of `workspace`",
            Self::Plan => "a plan",
            Self::Table => "a table without rows",
            Self::Robot => "a robot file",
            Self::Manual => "a manual page",
            Self::BlackBox => "a black box",
        })
    }
}

/// Number of rows below the header of a table. A row ends where readers of CSV see its end: at a
/// line feed or a carriage return.
#[must_use]
pub fn rows(table: &str) -> usize {
    table
        .split(['\n', '\r'])
        .filter(|line| !line.trim().is_empty())
        .count()
        .saturating_sub(1)
}

/// Key of a line of TOML, and the rest of the line behind the quotation mark of its text.
fn quoted(line: &str) -> Option<(&str, &str)> {
    let (key, text) = line.split_once('=')?;
    Some((key.trim(), text.trim_start().strip_prefix(['"', '\''])?))
}

/// True if a key of TOML stands in a text, with a value in quotation marks that begins so.
fn has_text(toml: &str, key: &str, begin: &str) -> bool {
    toml.lines()
        .filter_map(quoted)
        .any(|(named, text)| named == key && text.starts_with(begin))
}

impl Kind {
    /// True if a file of this kind is replaced with `--overwrite` only: work has gone into it.
    pub(super) const fn needs_overwrite(self) -> bool {
        matches!(self, Self::Plan | Self::Robot)
    }

    /// Extensions of its files; none where any will do.
    const fn extensions(self) -> &'static [&'static str] {
        match self {
            Self::Page | Self::Sheet => &["html"],
            Self::Picture => &["svg"],
            Self::Answer => &["json"],
            Self::Header => &["h"],
            Self::Model => &["xml", "urdf"],
            Self::Fmu => &["fmu"],
            Self::Map | Self::Table => &["csv"],
            Self::Plan | Self::Robot => &["toml"],
            Self::BlackBox => &["jsonl", "json"],
            Self::Manual => &[],
        }
    }

    /// Returns the extension of a path, in lower case, if it is one of another kind. (An extension
    /// that no kind has may stand at any output.)
    pub(super) fn foreign_extension(self, path: &Path) -> Option<String> {
        let extension = path.extension()?.to_str()?.to_ascii_lowercase();
        let own = self.extensions();
        let is_known = EXTENSIONS.contains(&extension.as_str());
        (is_known && !own.is_empty() && !own.contains(&extension.as_str())).then_some(extension)
    }

    /// True if the output may take the place of this file: it is empty, or of this kind.
    pub(super) fn replaces(self, old: &Path) -> bool {
        let mut head = Vec::new();
        let read = File::open(old).and_then(|file| file.take(HEAD).read_to_end(&mut head));
        read.is_ok() && (head.is_empty() || self.is_shown_by(&String::from_utf8_lossy(&head)))
    }

    /// Mark in the first bytes of a page, picture or model.
    const fn mark(self) -> &'static str {
        match self {
            Self::Page => "<!-- gantry-tau page -->",
            Self::Sheet => "<!-- gantry-tau sheet -->",
            Self::Model => "<!-- gantry-tau model -->",
            _ => "<!-- gantry-tau picture -->",
        }
    }

    /// True if a text begins as one of this kind.
    fn is_shown_by(self, head: &str) -> bool {
        let start: String = head.chars().take(MARKED).collect();
        match self {
            Self::Page | Self::Sheet | Self::Picture | Self::Model => start.contains(self.mark()),
            Self::Answer => {
                start.starts_with('{')
                    && start.contains("\"gantry-tau ")
                    && !MEASURED.iter().any(|mark| head.contains(mark))
            }
            Self::Header => start.contains("Written by `gantry-tau header`"),
            // Names of the archive's files: the description, then the library.
            Self::Fmu => start.starts_with("PK\u{3}\u{4}") && head.contains("/gantry_tau_"),
            Self::Map => start.starts_with("x_m,y_m,z_m,code,condition,"),
            Self::Plan => has_text(head, "format", "gantry-tau "),
            Self::Table => {
                let begins = ["series,", "pose,"]
                    .iter()
                    .any(|column| start.starts_with(column));
                begins && rows(head) == 0
            }
            Self::Robot => has_text(head, "model", "") && !has_text(head, "format", "gantry-tau "),
            Self::Manual => start.contains(".TH gantry-tau"),
            Self::BlackBox => false,
        }
    }

    /// Returns the text with the mark of its kind, if it does not show its kind by itself.
    pub(super) fn stamped(self, text: &str) -> String {
        if text.is_empty() || self.is_shown_by(text) {
            return text.to_owned();
        }
        match self {
            // After the document type: before it browsers do not know the standard.
            Self::Page | Self::Sheet => text.replacen("<html", &format!("{}<html", self.mark()), 1),
            Self::Picture | Self::Model => format!("{}\n{text}", self.mark()),
            Self::Answer => {
                let version = env!("CARGO_PKG_VERSION");
                let written_by = format!("{{\n  \"written_by\": \"gantry-tau {version}\",");
                text.strip_prefix('{')
                    .map_or_else(|| text.to_owned(), |rest| written_by + rest)
            }
            _ => text.to_owned(),
        }
    }
}
