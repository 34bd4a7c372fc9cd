//! Reads the text of a table in the forms that spreadsheets and other programs write: UTF-8 or UTF-16, with cells separated by commas,
//! semicolons, tabs or bars.

use std::fs;
use std::path::Path;

use anyhow::{Result, anyhow};

/// The characters that may separate cells. If several of them fit the header equally well, the last one is used.
const DELIMITERS: [u8; 4] = [b'|', b'\t', b';', b','];

/// A table as text.
pub(super) struct Text {
    /// The text from the header on.
    pub(super) body: String,
    /// The character between cells.
    pub(super) delimiter: u8,
    /// Number of lines before `body`.
    pub(super) lines_before: u64,
    /// Whether the file is UTF-16.
    pub(super) is_utf16: bool,
}

impl Text {
    /// Reads a table that should have these columns.
    ///
    /// # Errors
    /// The file cannot be read, is not text, states a delimiter that is not accepted, or has a quote that is not closed.
    pub(super) fn read(path: &Path, columns: &[&str]) -> Result<Text> {
        let name = path.display();
        let bytes = fs::read(path).map_err(|error| anyhow!("cannot open the table {name}: {error}; correct --input"))?;
        let is_utf16 = bytes.starts_with(&[0xff, 0xfe]) || bytes.starts_with(&[0xfe, 0xff]);
        let text = decode(bytes).map_err(|what| anyhow!("{name} {what}"))?;
        let (stated, body) = stated_delimiter(&text).map_err(|what| anyhow!("{name} {what}"))?;
        let delimiter = stated.unwrap_or_else(|| delimiter_of(body, columns));
        let lines_before = u64::from(stated.is_some());
        if let Some(line) = open_quote(body, delimiter) {
            return Err(anyhow!(
                "{name}, line {}: the quote at the beginning of a cell is not closed: close it or remove it",
                lines_before + line
            ));
        }
        Ok(Text { body: body.to_owned(), delimiter, lines_before, is_utf16 })
    }

    /// Returns a description of the delimiter for messages.
    pub(super) fn delimiter_words(&self) -> &'static str {
        match self.delimiter {
            b'\t' => "tabs",
            b';' => "`;`",
            b'|' => "`|`",
            _ => "`,`",
        }
    }
}

/// Decodes UTF-8, and UTF-16 with a byte order mark (Unicode, section 23.8).
fn decode(bytes: Vec<u8>) -> Result<String, String> {
    if bytes.starts_with(&[0xff, 0xfe, 0, 0]) || bytes.starts_with(&[0, 0, 0xfe, 0xff]) {
        return Err("is UTF-32 text: save the table as UTF-8".to_owned());
    }
    let utf16 = |of: fn([u8; 2]) -> u16| {
        let (pairs, rest) = bytes.as_chunks::<2>();
        let units: Vec<u16> = pairs.iter().map(|pair| of(*pair)).skip(1).collect();
        let text = String::from_utf16(&units).ok().filter(|_| rest.is_empty());
        text.ok_or_else(|| "is UTF-16 text with a wrong character: save the table again, as UTF-8".to_owned())
    };
    let text = if bytes.starts_with(&[0xff, 0xfe]) {
        utf16(u16::from_le_bytes)?
    } else if bytes.starts_with(&[0xfe, 0xff]) {
        utf16(u16::from_be_bytes)?
    } else {
        let text = String::from_utf8(bytes).map_err(|error| {
            let before = &error.as_bytes()[..error.utf8_error().valid_up_to()];
            let line = 1 + before.iter().filter(|byte| **byte == b'\n').count();
            format!("is not UTF-8 text in line {line}: save the table as UTF-8")
        })?;
        match text.strip_prefix('\u{feff}') {
            Some(rest) => rest.to_owned(),
            None => text,
        }
    };
    if text.contains('\0') {
        return Err("holds NUL characters, as UTF-16 text without a byte order mark has: save the table as UTF-8".to_owned());
    }
    Ok(text)
}

/// Returns the delimiter that the first line states, and the text after this line. The line has the form `sep=;`, which spreadsheets read.
/// Without such a line, returns `None` and the whole text.
fn stated_delimiter(text: &str) -> Result<(Option<u8>, &str), String> {
    let end = text.find(['\r', '\n']).unwrap_or(text.len());
    let (line, rest) = text.split_at(end);
    let line = line.strip_prefix('"').and_then(|line| line.strip_suffix('"')).unwrap_or(line);
    let Some((start, stated)) = line.split_at_checked(4).filter(|(start, _)| start.eq_ignore_ascii_case("sep=")) else {
        return Ok((None, text));
    };
    let body = rest.strip_prefix("\r\n").or_else(|| rest.strip_prefix(['\r', '\n'])).unwrap_or(rest);
    match DELIMITERS.into_iter().find(|delimiter| stated.as_bytes() == [*delimiter]) {
        Some(delimiter) => Ok((Some(delimiter), body)),
        None => Err(format!("states in its first line (`{start}`) a delimiter that is not one of , ; | and tab: correct that line")),
    }
}

/// Returns the delimiter with which the header contains the largest number of the given columns. If several delimiters are equal in this respect, the
/// one with the most cells is returned.
fn delimiter_of(body: &str, columns: &[&str]) -> u8 {
    let fit = |delimiter: &u8| {
        let mut reader =
            csv::ReaderBuilder::new().has_headers(false).delimiter(*delimiter).trim(csv::Trim::All).from_reader(body.as_bytes());
        let header = reader.records().next().and_then(std::result::Result::ok).unwrap_or_default();
        (header.iter().filter(|title| columns.contains(title)).count(), header.len())
    };
    DELIMITERS.into_iter().max_by_key(fit).unwrap_or(b',')
}

/// Returns the line in which a quoted cell without an end begins, counted from 1; `None` if all quotes are closed. The parser would read such a cell
/// up to the end of the table.
///
/// A quote opens a cell only as its first character. Inside a quoted cell, two quotes stand for one quote character (RFC 4180, section 2).
fn open_quote(body: &str, delimiter: u8) -> Option<u64> {
    let (mut line, mut opened) = (1, None);
    let mut is_first = true;
    let mut rest = body.chars().peekable();
    while let Some(c) = rest.next() {
        let is_break = c == '\n' || (c == '\r' && rest.peek() != Some(&'\n'));
        line += u64::from(is_break);
        if opened.is_some() {
            if c == '"' && rest.next_if_eq(&'"').is_none() {
                opened = None;
                is_first = false;
            }
            continue;
        }
        if c == '"' && is_first {
            opened = Some(line);
        }
        is_first = is_break || c == char::from(delimiter);
    }
    opened
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quotes_that_are_not_closed_are_found() {
        for closed in
            ["", "a,b\n1,2\n", "\"a\",\"b\"\n1,\"2\"", "\"a \"\"b\"\" c\",d", "a\"b,c\n1,2", "\"two\nlines\",b\n", "\"\",\"\"\"\"", "a \"b"]
        {
            assert_eq!(open_quote(closed, b','), None, "{closed:?}");
        }
        for (open, line) in [
            ("\"a,b\n1,2\n", 1),
            ("a,b\n1,\"2\n3,4\n", 2),
            ("a,b\r\n1,2\r\n\"3,4", 3),
            ("a\rb\r\"", 3),
            ("\"a\"\"", 1),
            ("\"x\ny\"\n\"z", 3),
        ] {
            assert_eq!(open_quote(open, b','), Some(line), "{open:?}");
        }
        assert_eq!((open_quote("a;\"b\n", b';'), open_quote("a;\"b\n", b',')), (Some(1), None));
    }

    #[test]
    fn text_is_decoded() {
        let utf16 = |of: fn(u16) -> [u8; 2]| "\u{feff}é,b\n".encode_utf16().flat_map(of).collect::<Vec<u8>>();
        for bytes in [utf16(u16::to_le_bytes), utf16(u16::to_be_bytes), "\u{feff}é,b\n".as_bytes().to_vec(), "é,b\n".as_bytes().to_vec()]
        {
            assert_eq!(decode(bytes).as_deref(), Ok("é,b\n"));
        }
        for (bytes, says) in [
            (&b"\xff\xfea"[..], "wrong character"),
            (&b"\xfe\xff\xd8\x00"[..], "wrong character"),
            (&b"\xff\xfe\0\0a\0\0\0"[..], "UTF-32"),
            (&b"a\0,\0b\0"[..], "NUL"),
            (&b"a,b\n\n1,\xff\n"[..], "line 3"),
        ] {
            let refused = decode(bytes.to_vec()).unwrap_err();
            assert!(refused.contains(says), "{refused}");
        }
    }

    #[test]
    fn delimiters_are_stated_or_found() {
        for (text, delimiter, body) in [
            ("sep=;\na,b;c", Some(b';'), "a,b;c"),
            ("SEP=\t\r\na", Some(b'\t'), "a"),
            ("\"sep=,\"\ra", Some(b','), "a"),
            ("sep=|", Some(b'|'), ""),
            ("separate\na", None, "separate\na"),
            ("é", None, "é"),
        ] {
            assert_eq!(stated_delimiter(text), Ok((delimiter, body)), "{text:?}");
        }
        for text in ["sep=\na", "sep=::\na", "sep=x\na"] {
            assert!(stated_delimiter(text).is_err(), "{text:?}");
        }
        for (body, delimiter) in [
            ("a,b\n1;2;3;4,5", b','),
            ("a;b;c,d\n", b';'),
            (" a \t b\n", b'\t'),
            ("a|b", b'|'),
            // The only column is found with any delimiter, so the last one is used.
            ("a\n1", b','),
            // No delimiter finds any of the columns, so the one with the most cells is used.
            ("x;y;z\n", b';'),
            ("", b','),
        ] {
            assert_eq!(delimiter_of(body, &["a", "b"]), delimiter, "{body:?}");
        }
    }
}
