//! Splits a WGSL text into tokens (WGSL specification, section 3.2). Comments and attributes are left out. The tokens of template lists have a
//! separate kind, `Template`.

use std::ops::Range;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// An identifier or keyword.
    Word,
    Number,
    Sign,
    /// A token of a template list, including its brackets: `<`, `f32` and `>` in `vec3<f32>`.
    Template,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Token {
    pub(super) kind: Kind,
    pub(super) range: Range<usize>,
}

impl Token {
    pub(super) fn text<'t>(&self, text: &'t str) -> &'t str {
        &text[self.range.clone()]
    }
}

/// Operators of two and three characters, the longer ones first.
const LONG: [&str; 22] =
    ["<<=", ">>=", "->", "&&", "||", "==", "!=", "<=", ">=", "+=", "-=", "*=", "/=", "%=", "&=", "|=", "^=", "<<", ">>", "++", "--", "::"];

/// Whether `<` after this word opens a template list.
fn has_template(word: &str) -> bool {
    ["vec2", "vec3", "vec4", "array", "ptr", "atomic", "bitcast", "var"].contains(&word)
        || word.starts_with("mat")
        || word.starts_with("texture_")
}

pub(super) fn tokens(text: &str) -> Vec<Token> {
    let bytes = text.as_bytes();
    let mut tokens: Vec<Token> = Vec::new();
    let mut at = 0;
    // Number of template lists that are open.
    let mut template = 0usize;
    while at < bytes.len() {
        let rest = &text[at..];
        let first = rest.chars().next().expect("not at the end");
        if first.is_whitespace() {
            at += first.len_utf8();
            continue;
        }
        if rest.starts_with("//") {
            at += rest.find('\n').unwrap_or(rest.len());
            continue;
        }
        if rest.starts_with("/*") {
            at += rest.find("*/").map_or(rest.len(), |end| end + 2);
            continue;
        }
        if first == '@' {
            at += attribute(rest);
            continue;
        }
        let opens = rest.starts_with('<') && tokens.last().is_some_and(|last| last.kind == Kind::Word && has_template(last.text(text)));
        let (kind, length) = if first.is_ascii_digit() || (first == '.' && rest[1..].starts_with(|c: char| c.is_ascii_digit())) {
            (Kind::Number, number(rest))
        } else if first.is_alphanumeric() || first == '_' {
            (Kind::Word, rest.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(rest.len()))
        } else if template > 0 || opens {
            (Kind::Sign, first.len_utf8())
        } else {
            (Kind::Sign, LONG.iter().find(|sign| rest.starts_with(**sign)).map_or(first.len_utf8(), |sign| sign.len()))
        };
        if opens {
            template += 1;
        }
        let kind = if template > 0 { Kind::Template } else { kind };
        if template > 0 && first == '>' {
            template -= 1;
        }
        // The name of a nested type, such as `vec2` in array<vec2<f32>>, must be a word, so that the `<` after it opens a template list.
        let kind = if kind == Kind::Template && has_template(&rest[..length]) { Kind::Word } else { kind };
        tokens.push(Token { kind, range: at..at + length });
        at += length;
    }
    tokens
}

/// Returns the length of an attribute in bytes: `@`, its name, and its arguments in brackets.
fn attribute(rest: &str) -> usize {
    let name = 1 + rest[1..].find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(rest.len() - 1);
    if rest[name..].starts_with('(') { name + rest[name..].find(')').map_or(0, |end| end + 1) } else { name }
}

/// Returns the length of a number in bytes: digits, a point, an exponent with its sign, and a suffix.
fn number(rest: &str) -> usize {
    let hex = rest.starts_with("0x");
    let mut length = 0;
    let mut before = ' ';
    for c in rest.chars() {
        let exponent = !hex && matches!(before, 'e' | 'E') && matches!(c, '+' | '-');
        if !(c.is_ascii_alphanumeric() || c == '.' || exponent) {
            break;
        }
        before = c;
        length += c.len_utf8();
    }
    length
}
