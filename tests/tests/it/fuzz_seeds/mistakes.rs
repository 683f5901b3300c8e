//! Texts with one mistake.

/// Numbers and words that hurt where a number stands.
const WRONG: [&str; 12] = [
    "nan",
    "inf",
    "-inf",
    "1e999",
    "-1e308",
    "5e-324",
    "-0.0",
    "0.0",
    "-1",
    "9223372036854775807",
    "\"1\"",
    "",
];
/// Bytes from one cut to the next: a prime, so that it cuts everywhere in a line.
const BETWEEN_CUTS: usize = 23;

/// Calls `with` for each: a number replaced, a line lost or twice, the end lost.
pub(crate) fn each(text: &str, mut with: impl FnMut(&str)) {
    for number in numbers(text) {
        for wrong in WRONG {
            with(&[&text[..number.start], wrong, &text[number.end..]].concat());
        }
    }
    let lines: Vec<&str> = text.split_inclusive('\n').collect();
    for (index, line) in lines.iter().enumerate() {
        let (before, after) = (lines[..index].concat(), lines[index + 1..].concat());
        with(&[&before[..], &after].concat());
        with(&[&before[..], line, line, &after].concat());
    }
    for (cut, _) in text.char_indices().step_by(BETWEEN_CUTS) {
        with(&text[..cut]);
    }
}

/// Positions of numbers; a digit of a name counts too.
fn numbers(text: &str) -> Vec<std::ops::Range<usize>> {
    let mut numbers: Vec<std::ops::Range<usize>> = Vec::new();
    let of_numbers = text
        .char_indices()
        .filter(|(_, c)| c.is_ascii_digit() || matches!(c, '.' | '-'));
    for (at, c) in of_numbers {
        match numbers.last_mut() {
            Some(last) if last.end == at => last.end = at + c.len_utf8(),
            _ => numbers.push(at..at + c.len_utf8()),
        }
    }
    numbers
}
