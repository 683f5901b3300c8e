//! Changes of a robot file that keep its comments and its order.

use serde::Serialize;
use toml_edit::{Array, Decor, DocumentMut, Item, Table, TableLike, Value};

/// Beginnings of a provenance, and what its checksum follows:
/// `IDENTIFIED with springs.csv (CRC-32 89abcdef)`.
const LEARNED: [&str; 2] = ["IDENTIFIED", "CALIBRATED"];
const CRC: &str = "(CRC-32 ";

/// Reason why a section cannot be written into a robot file.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EditError {
    /// A value cannot be written as TOML.
    #[error(transparent)]
    Serialize(#[from] toml::ser::Error),
    /// The text that was written is not TOML.
    #[error(transparent)]
    Parse(#[from] toml_edit::TomlError),
}

/// A robot file that is being changed.
pub struct RobotText {
    document: DocumentMut,
    /// Word that takes the place of "ASSUMED" above a changed key.
    provenance: String,
}

impl RobotText {
    /// Begins with the text of a file. `provenance` says where changed values come from: it
    /// replaces "ASSUMED" in the comments above them.
    ///
    /// # Errors
    /// The text is not TOML.
    pub fn new(text: &str, provenance: &str) -> Result<Self, toml_edit::TomlError> {
        Ok(Self {
            document: text.parse()?,
            provenance: provenance.to_owned(),
        })
    }

    /// Replaces a list of numbers.
    pub fn set_numbers(&mut self, key: &str, values: &[f64]) {
        self.set(
            key,
            Value::Array(values.iter().copied().map(number).collect()),
        );
    }

    /// Replaces a list of rows, one per line.
    pub fn set_rows(&mut self, key: &str, rows: &[[f64; 3]]) {
        self.set(key, Value::Array(lines(rows)));
    }

    fn set(&mut self, key: &str, value: Value) {
        set_in(self.document.as_table_mut(), key, value, &self.provenance);
    }

    /// Adds a section, in place of the one with its name.
    ///
    /// # Errors
    /// [`EditError`].
    pub fn set_serialized(
        &mut self,
        name: &str,
        section: &impl Serialize,
    ) -> Result<(), EditError> {
        let text = toml::to_string(section)?;
        let document: DocumentMut = text.parse()?;
        let mut table = document.as_table().clone();
        table
            .iter_mut()
            .for_each(|(_, item)| item.as_value_mut().into_iter().for_each(readable));
        table.decor_mut().set_prefix("\n");
        self.document
            .as_table_mut()
            .insert(name, Item::Table(table));
        Ok(())
    }

    /// Replaces lists of numbers in a table of a section that exists. A table that is missing is
    /// added, with the provenance above it.
    pub fn set_table_in(&mut self, section: &str, name: &str, entries: &[(&str, &[f64])]) {
        let parent = self
            .document
            .get_mut(section)
            .and_then(Item::as_table_like_mut);
        let Some(parent) = parent else { return };
        match parent.get_mut(name) {
            Some(table) => {
                if let Some(decor) = table.as_table_mut().map(Table::decor_mut) {
                    replace_assumed(decor, &self.provenance);
                }
                for (key, values) in entries {
                    self.set_numbers_at(&[section, name, key], values);
                }
            }
            None => {
                let mut table = Table::new();
                table
                    .decor_mut()
                    .set_prefix(format!("\n# {}\n", self.provenance));
                for (key, values) in entries {
                    table.insert(
                        key,
                        Item::Value(Value::Array(values.iter().copied().map(number).collect())),
                    );
                }
                parent.insert(name, Item::Table(table));
            }
        }
    }

    /// Replaces a number in a section that exists.
    pub fn set_number_in(&mut self, section: &str, key: &str, value: f64) {
        self.replace(&[section, key], number(value));
    }

    /// Replaces a number in an entry of a list of tables that exists, `[[name]]`.
    pub fn set_number_of(&mut self, name: &str, index: usize, key: &str, value: f64) {
        let Some(list) = self.document.get_mut(name) else {
            return;
        };
        match list
            .as_array_of_tables_mut()
            .and_then(|entries| entries.get_mut(index))
        {
            Some(entry) => {
                replace_assumed(entry.decor_mut(), &self.provenance);
                set_in(entry, key, number(value), &self.provenance);
            }
            None => replace(
                entry_of(list, index).and_then(|entry| entry.get_mut(key)),
                number(value),
            ),
        }
    }

    /// Replaces a list of numbers in a section that exists, by its path.
    pub fn set_numbers_at(&mut self, path: &[&str], values: &[f64]) {
        self.replace(
            path,
            Value::Array(values.iter().copied().map(number).collect()),
        );
    }

    /// Replaces a list of numbers in an entry of a list of sections, `[[name]]`, that exists.
    pub fn set_numbers_of(&mut self, name: &str, index: usize, key: &str, values: &[f64]) {
        let entry = self
            .document
            .get_mut(name)
            .and_then(|list| entry_of(list, index));
        replace(
            entry.and_then(|entry| entry.get_mut(key)),
            Value::Array(values.iter().copied().map(number).collect()),
        );
    }

    /// Replaces a list of rows in a section that exists, by its path.
    pub fn set_rows_at(&mut self, path: &[&str], rows: &[[f64; 3]]) {
        self.replace(path, Value::Array(lines(rows)));
    }

    /// Replaces a value that exists; the comment behind it stays.
    fn replace(&mut self, path: &[&str], value: Value) {
        let mut item = Some(self.document.as_item_mut());
        for key in path {
            item = item.and_then(|item| item.get_mut(key));
        }
        replace(item, value);
    }

    /// Returns the text.
    #[must_use]
    pub fn text(&self) -> String {
        self.document.to_string()
    }
}

/// An entry of a list of sections: `[[name]]`, or `name = [{ .. }]`.
fn entry_of(list: &mut Item, index: usize) -> Option<&mut dyn TableLike> {
    if list.is_array_of_tables() {
        return list
            .as_array_of_tables_mut()?
            .get_mut(index)
            .map(|table| table as &mut dyn TableLike);
    }
    let entry = list.as_array_mut()?.get_mut(index)?.as_inline_table_mut()?;
    Some(entry as &mut dyn TableLike)
}

/// Replaces a value; the comment behind the old one stays.
fn replace(item: Option<&mut Item>, mut value: Value) {
    let Some(item) = item else { return };
    if let Some(old) = item.as_value() {
        *value.decor_mut() = old.decor().clone();
    }
    *item = Item::Value(value);
}

/// Sets a value of a table. The comment behind the old value stays.
fn set_in(table: &mut Table, key: &str, mut value: Value, provenance: &str) {
    if let Some(old) = table.get(key).and_then(Item::as_value) {
        *value.decor_mut() = old.decor().clone();
    }
    match table.get_mut(key) {
        Some(item) => *item = Item::Value(value),
        None => _ = table.insert(key, Item::Value(value)),
    }
    if let Some(mut key) = table.key_mut(key) {
        replace_assumed(key.leaf_decor_mut(), provenance);
    }
}

/// Replaces "ASSUMED", or the measurement before this one, in the comment above a key or a table.
fn replace_assumed(decor: &mut Decor, provenance: &str) {
    let above = decor
        .prefix()
        .and_then(toml_edit::RawString::as_str)
        .unwrap_or_default();
    let earlier = LEARNED.into_iter().find_map(|word| {
        let (_, from_word) = above.split_once(word)?;
        let (name, crc) = from_word.split_once(CRC)?;
        let (crc, _) = crc.split_once(')')?;
        // One measurement, of one line.
        (!name.contains('\n')).then(|| format!("{word}{name}{CRC}{crc})"))
    });
    let replaced = above.replace(earlier.as_deref().unwrap_or("ASSUMED"), provenance);
    decor.set_prefix(replaced);
}

/// Rows, one per line.
fn lines(rows: &[[f64; 3]]) -> Array {
    let mut array = Array::new();
    for row in rows {
        let mut row = Value::Array(row.iter().copied().map(number).collect());
        row.decor_mut().set_prefix("\n    ");
        array.push_formatted(row);
    }
    array.set_trailing_comma(true);
    array.set_trailing("\n");
    array
}

/// Writes the numbers of a value as [`number`] does.
fn readable(value: &mut Value) {
    match value {
        Value::Float(float) => *value = number(*float.value()),
        Value::Array(array) => array.iter_mut().for_each(readable),
        _ => {}
    }
}

/// A number that reads back to the bit; with an exponent where zeros would hide its digits.
#[must_use]
pub fn number(value: f64) -> Value {
    let plain = value == 0.0 || (1e-3..1e6).contains(&value.abs());
    let text = if plain {
        format!("{value:?}")
    } else {
        format!("{value:e}")
    };
    text.parse().unwrap_or_else(|_| Value::from(value))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot_file::{AnyRobotFile, L2_TEXT};

    /// A key that is learned twice carries the second measurement.
    #[test]
    fn the_last_provenance_stands_above_a_key() {
        let mut text = L2_TEXT.to_owned();
        for name in ["first.csv", "second.csv"] {
            let mut robot =
                RobotText::new(&text, &format!("IDENTIFIED with {name} (CRC-32 01234567)"))
                    .unwrap();
            robot.set_numbers("c_link", &[1e-7; 6]);
            text = robot.text();
        }
        assert!(text.contains(
            "# Compliances of the links, m/N; IDENTIFIED with second.csv (CRC-32 01234567)."
        ));
        assert!(!text.contains("first.csv"));
    }

    /// A list of sections may stand in a line.
    #[test]
    fn joints_in_a_line_are_changed_too() {
        let joint = "{ axis = [0.0, 1.0, 0.0], point_m = [0.0, 0.0, 0.15], c_rad_per_nm = 1.0e-5 }";
        let (top, rest) = L2_TEXT.split_once("[axes]").unwrap();
        let text = format!("{top}wrist = [{joint}, {joint}]\n[axes]{rest}");
        let mut robot = RobotText::new(&text, "IDENTIFIED").unwrap();
        robot.set_number_of("wrist", 1, "c_rad_per_nm", 2e-5);
        robot.set_numbers_of("wrist", 0, "axis", &[1.0, 0.0, 0.0]);
        let AnyRobotFile::L2(robot) = AnyRobotFile::parse("changed", &robot.text()).unwrap() else {
            panic!()
        };
        let [first, second] = robot.wrist[..] else {
            panic!("{:?}", robot.wrist)
        };
        assert_eq!((first.axis, first.c_rad_per_nm), ([1.0, 0.0, 0.0], 1e-5));
        assert_eq!((second.axis, second.c_rad_per_nm), ([0.0, 1.0, 0.0], 2e-5));
    }

    #[test]
    fn a_changed_file_differs_in_what_was_changed() {
        let mut robot = RobotText::new(L2_TEXT, "CALIBRATED with poses.csv").unwrap();
        robot.set_numbers("L", &[1.001, 1.1, 0.999_5]);
        robot.set_rows("V", &[[1.0, 0.0, 1e-4], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]);
        robot.set_numbers("c_link", &[1e-7; 6]);
        let text = robot.text();
        let added: Vec<&str> = text
            .lines()
            .filter(|line| !L2_TEXT.lines().any(|other| other == *line))
            .collect();
        assert_eq!(added.len(), 4, "{added:#?}");
        assert_eq!(added[0], "    [1.0, 0.0, 1e-4],");
        assert_eq!(added[1], "L = [1.001, 1.1, 0.9995]");
        assert_eq!(
            added[2],
            "# Compliances of the links, m/N; CALIBRATED with poses.csv."
        );
        assert_eq!(added[3], "c_link = [1e-7, 1e-7, 1e-7, 1e-7, 1e-7, 1e-7]");
        assert_eq!(text.lines().count(), L2_TEXT.lines().count());
        let AnyRobotFile::L2(robot) = AnyRobotFile::parse("changed", &text).unwrap() else {
            panic!()
        };
        let links = robot.compliances.unwrap().link_m_per_n().map(f64::to_bits);
        assert_eq!(links, [1e-7_f64.to_bits(); 6]);
    }
}
