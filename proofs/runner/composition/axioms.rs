//! Axioms of `Rows.v`, as far as they can be compared with the manifest: names, numbers of axes, and
//! the texts of the assertions that they transcribe.

use std::collections::BTreeMap;

use crate::check::axes_said;
use crate::manifest::Manifest;
use crate::results::{Standing, Standings};

/// An axiom.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Axiom {
    pub(super) name: String,
    /// Number of axes that it is a statement about, if of one number only.
    pub(super) axes: Option<u32>,
    /// Texts of assertions.
    pub(super) says: Vec<String>,
}

impl Axiom {
    /// True for an invariant of a type.
    pub(super) fn is_of_type(&self) -> bool {
        self.name.starts_with("type_")
    }

    /// True for a statement read from the source.
    pub(super) fn is_read(&self) -> bool {
        self.name.starts_with("read_")
    }

    /// Everything in which it is not its row.
    pub(super) fn disagreements(&self, manifest: &Manifest, properties: &str) -> Vec<String> {
        let name = &self.name;
        if self.is_of_type() || self.is_read() {
            return Vec::new();
        }
        let Some(row) = manifest.row(name) else {
            return vec![format!(
                "proofs/composition/Rows.v: {name} is not a row of the manifest"
            )];
        };
        let mut wrong = Vec::new();
        if axes_said(&row.domain) != self.axes {
            wrong.push(format!(
                "proofs/composition/Rows.v: {name} is of {}, its row of {}",
                self.axes
                    .map_or("any number of axes".to_owned(), |number| format!(
                        "N = {number}"
                    )),
                row.domain
            ));
        }
        if self.says.is_empty() {
            wrong.push(format!(
                "proofs/composition/Rows.v: {name} quotes no assertion"
            ));
        }
        for text in &self.says {
            let docs = docs_of(properties, text);
            if docs.is_empty() {
                wrong.push(format!(
                    "proofs/composition/Rows.v: {name} quotes \"{text}\", which no property says"
                ));
            } else if !docs.iter().any(|doc| is_composed_as(doc, name)) {
                wrong.push(format!(
                    "proofs/composition/Rows.v: {name} quotes \"{text}\", whose property has no line \"Composed as: `{name}`.\""
                ));
            }
        }
        wrong
    }
}

/// Doc comments of the functions that say a text.
fn docs_of(properties: &str, text: &str) -> Vec<String> {
    let quoted = format!("\"{text}\"");
    let (mut above, mut doc) = (String::new(), String::new());
    let mut found = Vec::new();
    for line in properties.lines() {
        if let Some(comment) = line.strip_prefix("///") {
            above.push_str(comment);
        } else if line.starts_with("pub fn ") || line.starts_with("fn ") {
            doc = std::mem::take(&mut above);
        } else if !line.starts_with("#[") {
            above.clear();
        }
        if line.contains(&quoted) {
            found.push(doc.clone());
        }
    }
    found
}

/// True if a doc comment says that the property is an axiom.
fn is_composed_as(doc: &str, axiom: &str) -> bool {
    doc.split_once("Composed as:")
        .is_some_and(|(_, names)| names.contains(&format!("`{axiom}`")))
}

impl Axiom {
    /// Quotations that the result of its row does not have, if it has one on this source.
    pub(super) fn unstated(&self, standings: &Standings<'_>) -> Vec<String> {
        let states = standings.iter().find_map(|(job, standing)| match standing {
            Standing::Current(entry) if job.name() == self.name => Some(entry.states.as_slice()),
            _ => None,
        });
        let said = self.says.iter();
        said.filter(|text| states.is_some_and(|states| !states.contains(text)))
            .map(|text| {
                format!(
                    "STALE: {} (its axiom quotes \"{text}\", which the result does not have)",
                    self.name
                )
            })
            .collect()
    }
}

/// Text without comments, which can be nested.
pub(super) fn without_comments(text: &str) -> String {
    let mut left = String::new();
    let mut depth = 0_usize;
    for part in text.split_inclusive("(*") {
        let (part, opens) = match part.strip_suffix("(*") {
            Some(part) => (part, true),
            None => (part, false),
        };
        let mut rest = part;
        while let (true, Some((_, behind))) = (depth > 0, rest.split_once("*)")) {
            depth = depth.saturating_sub(1);
            rest = behind;
        }
        if depth == 0 {
            left.push_str(rest);
        }
        depth = depth.saturating_add(usize::from(opens));
    }
    left
}

/// Axioms of a text. A definition's quotations are those of the axioms that say it.
pub(super) fn axioms(text: &str) -> Vec<Axiom> {
    let mut quoted: Vec<String> = Vec::new();
    let mut of_definitions = BTreeMap::<&str, Vec<String>>::new();
    let mut found = Vec::new();
    let mut lines = text.lines().map(str::trim).peekable();
    while let Some(line) = lines.next() {
        if let Some(said) = line
            .strip_prefix("(* says: \"")
            .and_then(|rest| rest.strip_suffix("\" *)"))
        {
            quoted.push(said.to_owned());
        } else if let Some(rest) = line.strip_prefix("Definition ") {
            let name = rest.split([' ', ':']).next().unwrap_or_default();
            of_definitions.insert(name, std::mem::take(&mut quoted));
        } else if let Some((name, begins)) = line
            .strip_prefix("Axiom ")
            .and_then(|rest| rest.split_once(" :"))
        {
            let mut statement = begins.to_owned();
            while !statement.ends_with('.') {
                let Some(next) = lines.next() else { break };
                statement.push(' ');
                statement.push_str(next);
            }
            let mut says = std::mem::take(&mut quoted);
            for word in statement.split(|letter: char| !(letter.is_alphanumeric() || letter == '_'))
            {
                says.extend(of_definitions.get(word).into_iter().flatten().cloned());
            }
            let axes = [3, 6]
                .into_iter()
                .find(|number| statement.contains(&format!("N = {number}%nat ->")));
            found.push(Axiom {
                name: name.to_owned(),
                axes,
                says,
            });
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axioms_have_the_quotations_of_what_they_say() {
        let text = "
  (* says: \"T1: it moves\" *)
  Definition moves := forall x,
    f x = x.
  Axiom row_of_three : N = 3%nat -> moves.
  (* says: \"T2: it bends\" *)
  Axiom row_of_any : forall x,
    g x = x.
  Axiom type_limits : forall x, 0 < x.
";
        let found = axioms(text);
        let one = |name: &str, axes, says: &[&str]| Axiom {
            name: name.to_owned(),
            axes,
            says: says.iter().map(|&said| said.to_owned()).collect(),
        };
        assert_eq!(
            found,
            [
                one("row_of_three", Some(3), &["T1: it moves"]),
                one("row_of_any", None, &["T2: it bends"]),
                one("type_limits", None, &[]),
            ]
        );
    }

    #[test]
    fn a_property_names_its_axioms() {
        let properties = "
/// A step.
///
/// Composed as: `step_is_small`, `step_of_6_axes_is_small`.
#[inline]
pub fn step(x: i32) {
    assert!(x < 5, \"T1: it is small\");
}

/// Another one.
fn other() {
    assert!(true, \"T1: it is small\");
    assert!(true, \"T2: it ends\");
}
";
        let names = |text: &str, axiom: &str| {
            let docs = docs_of(properties, text);
            docs.iter().any(|doc| is_composed_as(doc, axiom))
        };
        assert!(names("T1: it is small", "step_is_small"));
        assert!(names("T1: it is small", "step_of_6_axes_is_small"));
        assert!(!names("T1: it is small", "step"));
        assert!(!names("T2: it ends", "step_is_small"));
        assert_eq!(docs_of(properties, "T3: nowhere").len(), 0);
    }

    #[test]
    fn comments_are_nested() {
        assert_eq!(without_comments("a (* b (* c *) d *) e"), "a  e");
        assert_eq!(without_comments("a (* b *) c (* d *)"), "a  c ");
    }
}
