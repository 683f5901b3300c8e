//! Lines that fit into a width.

/// Adds parts to a line as long as there is room, and to the next line then.
pub(super) fn pack(parts: &[String], gap: &str, columns: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for part in parts {
        match lines.last_mut() {
            Some(line) if length(line) + length(gap) + length(part) <= columns => {
                line.push_str(gap);
                line.push_str(part);
            }
            _ => lines.push(part.clone()),
        }
    }
    lines
}

/// Breaks a sentence between words.
pub(super) fn wrap(sentence: &str, columns: usize) -> Vec<String> {
    let words: Vec<String> = sentence.split(' ').map(str::to_owned).collect();
    pack(&words, " ", columns)
}

/// Cuts a line that is too long, and marks it.
pub(super) fn cut(line: String, columns: usize) -> String {
    if length(&line) <= columns {
        return line;
    }
    let mut front: String = line.chars().take(columns.saturating_sub(1)).collect();
    front.push('…');
    front
}

/// Number of characters.
pub(super) fn length(text: &str) -> usize {
    text.chars().count()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_line_is_wider_than_asked_and_no_part_is_lost() {
        let parts = ["one", "two", "µµµµµ", "four"].map(str::to_owned);
        assert_eq!(pack(&parts, "  ", 8), ["one  two", "µµµµµ", "four"]);
        assert_eq!(pack(&parts, "  ", 80), ["one  two  µµµµµ  four"]);
        assert_eq!(wrap("a sentence of words", 10), ["a sentence", "of words"]);
        assert_eq!(cut("µµµµµ".to_owned(), 5), "µµµµµ");
        assert_eq!(cut("µµµµµµ".to_owned(), 5), "µµµµ…");
    }
}
