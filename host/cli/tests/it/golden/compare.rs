//! Comparison of texts whose numbers may differ in their last place: another machine's sine does.

use std::iter::Peekable;
use std::str::Chars;

/// Largest relative difference of numbers that are written to the last bit.
const RELATIVE: f64 = 1e-6;

/// In place of a line of a text that has ended.
const END: &str = "(end)";

/// Part of a line.
#[derive(Debug, PartialEq)]
enum Token {
    Word(String),
    /// Value, and one unit in its last written place; 0 of an integer.
    Number(f64, f64),
}

/// Returns the first line in which two texts differ, as both have it; numbers may be one off in
/// their last written place.
pub(super) fn difference(expected: &str, found: &str) -> Option<String> {
    let count = expected.lines().count().max(found.lines().count());
    let end = std::iter::repeat_n(END, count);
    let lines = expected
        .lines()
        .chain(end.clone())
        .zip(found.lines().chain(end))
        .take(count);
    let (line, (expected, found)) = lines
        .enumerate()
        .find(|(_, (expected, found))| !agree(&tokens(expected), &tokens(found)))?;
    Some(format!(
        "line {}\n  expected: {expected}\n  found:    {found}",
        line + 1
    ))
}

fn agree(expected: &[Token], found: &[Token]) -> bool {
    let mut pairs = expected.iter().zip(found);
    expected.len() == found.len()
        && pairs.all(|(expected, found)| match (expected, found) {
            (Token::Number(expected, place), Token::Number(found, _)) => {
                (expected - found).abs() <= (1.01 * place).max(RELATIVE * expected.abs())
            }
            _ => expected == found,
        })
}

fn tokens(line: &str) -> Vec<Token> {
    let mut tokens = Vec::new();
    let mut word = String::new();
    let mut rest = line.chars().peekable();
    while let Some(&next) = rest.peek() {
        // `c_link2`, `1e4c` of a checksum, `#3e3678` of a colour and the like are words.
        let is_begun = word
            .chars()
            .last()
            .is_some_and(|last| last.is_alphanumeric() || "_#".contains(last));
        if next.is_ascii_digit() && !is_begun {
            let sign = if word.ends_with('-') { -1.0 } else { 1.0 };
            if sign < 0.0 {
                word.pop();
            }
            tokens.push(Token::Word(std::mem::take(&mut word)));
            tokens.push(number(sign, &mut rest));
        } else {
            word.push(next);
            rest.next();
        }
    }
    tokens.push(Token::Word(word));
    tokens
}

/// Reads the number that begins here.
fn number(sign: f64, rest: &mut Peekable<Chars<'_>>) -> Token {
    let mut written = digits(rest);
    let mut decimals = None;
    if rest.next_if_eq(&'.').is_some() {
        let fraction = digits(rest);
        decimals = i32::try_from(fraction.len()).ok();
        written += &format!(".{fraction}");
    }
    let mut exponent = 0;
    let mut ahead = rest.clone();
    if ahead.next_if_eq(&'e').is_some() {
        let sign = if ahead.next_if_eq(&'-').is_some() {
            "-"
        } else {
            ""
        };
        let power = digits(&mut ahead);
        if let Ok(power) = format!("{sign}{power}").parse::<i32>() {
            (exponent, decimals, *rest) = (power, decimals.or(Some(0)), ahead);
        }
    }
    let value = sign * format!("{written}e{exponent}").parse::<f64>().unwrap();
    Token::Number(
        value,
        decimals.map_or(0.0, |decimals| 10_f64.powi(exponent - decimals)),
    )
}

fn digits(rest: &mut Peekable<Chars<'_>>) -> String {
    std::iter::from_fn(|| rest.next_if(char::is_ascii_digit)).collect()
}

#[test]
fn numbers_differ_in_their_last_place_alone() {
    for (expected, found, is_same) in [
        ("c 4.92e-7 m/N", "c 4.93e-7 m/N", true),
        ("c 4.92e-7 m/N", "c 4.94e-7 m/N", false),
        ("[-0.12, 3]", "[-0.13, 3]", true),
        ("[-0.12, 3]", "[0.12, 3]", false),
        ("[-0.12, 3]", "[-0.12, 4]", false),
        ("1.23456789012345", "1.23456789012399", true),
        ("1.23456789012345", "1.23459", false),
        ("axis1 5.0", "axis2 5.0", false),
        ("#3e3678", "#3e3678", true),
        ("#3e3678", "#3e3679", false),
        ("one\ntwo", "one", false),
        ("one", "one\ntwo", false),
    ] {
        let is_none = difference(expected, found).is_none();
        assert_eq!(is_none, is_same, "{expected:?} {found:?}");
    }
}
