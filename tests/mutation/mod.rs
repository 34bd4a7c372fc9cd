//! Mutants of WGSL. A mutant is the text of a shader with one small fault. The module [`listed`] contains the mutants of Rust, and [`results`] the
//! tables of results for both languages.
//!
//! Mutants measure the strength of tests: if a mutant passes all tests and is not equivalent to the original, its line could be wrong without any
//! test failing. The mutation operators follow Jia and Harman (2011, *An Analysis and Survey of the Development of Mutation Testing*, table 3),
//! adapted to WGSL. They change constants, operators, signs, comparisons, components, terms, built-in functions, indices, branches and statements.

use std::ops::Range;

pub(crate) mod listed;
pub(crate) mod results;
mod tokens;

use tokens::{Kind, Token, tokens};

/// A mutant of a text: one range of bytes is replaced.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Mutant {
    /// Number of the line in which the range begins, counted from 1.
    pub(crate) line: usize,
    /// Name of the mutation operator, such as `constant: half`.
    pub(crate) operator: &'static str,
    /// The range of bytes that is replaced.
    pub(crate) range: Range<usize>,
    /// The text that replaces the range.
    pub(crate) with: String,
    /// Number of this mutant among the mutants of its line that have the same description, counted from 1; 0 = no other mutant has the description.
    pub(crate) occurrence: usize,
}

impl Mutant {
    /// Returns the text with the fault.
    pub(crate) fn apply(&self, text: &str) -> String {
        format!("{}{}{}", &text[..self.range.start], self.with, &text[self.range.end..])
    }

    /// Describes the change in one line, such as `a * b` -> `a / b`. If several changes in the line have the same description, the number of the
    /// occurrence follows: `1.0` -> `0.5`, occurrence 2.
    pub(crate) fn change(&self, text: &str) -> String {
        let change = self.any_occurrence(text);
        if self.occurrence == 0 { change } else { format!("{change}, occurrence {}", self.occurrence) }
    }

    /// Describes the change without the number of the occurrence.
    pub(crate) fn any_occurrence(&self, text: &str) -> String {
        let short = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ");
        let with = short(&self.with);
        format!("`{}` -> `{}`", short(&text[self.range.clone()]), if with.is_empty() { "(nothing)" } else { &with })
    }
}

/// Operators between two operands, with their replacements and the name of the mutation operator. Other operators stay unchanged.
const SIGNS: [(&str, &[&str], &str); 22] = [
    ("+", &["-"], "operator"),
    ("-", &["+"], "operator"),
    ("*", &["/"], "operator"),
    ("/", &["*"], "operator"),
    ("%", &["*"], "operator"),
    ("&", &["|"], "operator"),
    ("|", &["&"], "operator"),
    ("^", &["|"], "operator"),
    ("<<", &[">>"], "operator"),
    (">>", &["<<"], "operator"),
    ("+=", &["-="], "operator"),
    ("-=", &["+="], "operator"),
    ("*=", &["/="], "operator"),
    ("|=", &["&="], "operator"),
    ("<", &["<=", ">"], "comparison"),
    ("<=", &["<", ">"], "comparison"),
    (">", &[">=", "<"], "comparison"),
    (">=", &[">", "<"], "comparison"),
    ("==", &["!="], "comparison"),
    ("!=", &["=="], "comparison"),
    ("&&", &["||"], "comparison"),
    ("||", &["&&"], "comparison"),
];

/// Replacements of built-in functions. If the replacement is empty, the call becomes its argument in brackets.
const CALLS: [(&str, &str); 14] = [
    ("min", "max"),
    ("max", "min"),
    ("floor", "round"),
    ("round", "floor"),
    ("ceil", "floor"),
    ("fract", "floor"),
    ("abs", ""),
    ("saturate", ""),
    ("normalize", ""),
    ("any", "all"),
    ("all", "any"),
    ("exp2", "exp"),
    ("sqrt", ""),
    ("sin", "cos"),
];

/// Range of the floating-point constants that are scaled. Smaller and larger constants usually guard against division by zero and overflow. They are
/// not scaled, because another tiny or huge value would serve the same purpose.
const GUARDS: Range<f64> = 1e-5..1e9;

/// Returns all mutants of a text, in the order of their positions. Only function bodies are changed; tests by reflection (`layouts.rs`) check
/// declarations.
pub(crate) fn mutants(text: &str) -> Vec<Mutant> {
    let tokens = tokens(text);
    let mut all = Vec::new();
    for body in bodies(text, &tokens) {
        for at in body.clone() {
            at_token(text, &tokens, &body, at, &mut all);
        }
    }
    let mut seen: Vec<String> = Vec::new();
    all.retain(|mutant| {
        let fresh = mutant.apply(text) != text && !seen.contains(&format!("{:?} {}", mutant.range, mutant.with));
        seen.push(format!("{:?} {}", mutant.range, mutant.with));
        fresh
    });
    number(text, &mut all);
    all
}

/// Sets [`Mutant::occurrence`]: numbers the mutants of each line that have the same description.
fn number(text: &str, all: &mut [Mutant]) {
    let described: Vec<(usize, String)> = all.iter().map(|mutant| (mutant.line, mutant.any_occurrence(text))).collect();
    for (i, mutant) in all.iter_mut().enumerate() {
        if described.iter().filter(|other| **other == described[i]).count() > 1 {
            mutant.occurrence = 1 + described[..i].iter().filter(|other| **other == described[i]).count();
        }
    }
}

/// Returns the indices of the tokens of each function body, without its braces.
fn bodies(text: &str, tokens: &[Token]) -> Vec<Range<usize>> {
    let mut bodies = Vec::new();
    let mut at = 0;
    while at < tokens.len() {
        if tokens[at].text(text) != "fn" {
            at += 1;
            continue;
        }
        let Some(open) = (at..tokens.len()).find(|&i| tokens[i].text(text) == "{") else { break };
        let Some(close) = closing(text, tokens, open) else { break };
        bodies.push(open + 1..close);
        at = close;
    }
    bodies
}

/// Returns the index of the token that closes the bracket at index `open`.
fn closing(text: &str, tokens: &[Token], open: usize) -> Option<usize> {
    let mut depth = 0usize;
    for (at, token) in tokens.iter().enumerate().skip(open) {
        match token.text(text) {
            "(" | "[" | "{" => depth += 1,
            ")" | "]" | "}" => {
                depth -= 1;
                if depth == 0 {
                    return Some(at);
                }
            }
            _ => {}
        }
    }
    None
}

/// Whether a token can be the end of an operand. An operator after such a token is binary.
fn ends_operand(text: &str, token: &Token) -> bool {
    match token.kind {
        Kind::Number => true,
        Kind::Word => token.text(text) != "return",
        Kind::Template => token.text(text) == ">",
        Kind::Sign => matches!(token.text(text), ")" | "]"),
    }
}

fn at_token(text: &str, tokens: &[Token], body: &Range<usize>, at: usize, all: &mut Vec<Mutant>) {
    let token = &tokens[at];
    let word = token.text(text);
    let line = 1 + text[..token.range.start].matches('\n').count();
    let mut add =
        |operator: &'static str, range: Range<usize>, with: String| all.push(Mutant { line, operator, range, with, occurrence: 0 });
    let before = at.checked_sub(1).filter(|&i| i >= body.start).map(|i| &tokens[i]);
    let after = tokens.get(at + 1).map_or("", |token| token.text(text));
    let binary = before.is_some_and(|token| ends_operand(text, token));
    match token.kind {
        Kind::Number => {
            for (operator, with) in constants(word) {
                add(operator, token.range.clone(), with);
            }
        }
        Kind::Sign => {
            if binary && let Some((_, others, operator)) = SIGNS.iter().find(|(sign, ..)| *sign == word) {
                for other in *others {
                    add(operator, token.range.clone(), (*other).to_owned());
                }
            }
            if !binary && word == "-" {
                add("sign", token.range.clone(), String::new());
            }
            if !binary && word == "!" {
                add("branch", token.range.clone(), String::new());
            }
            if binary && matches!(word, "+" | "-") {
                let end = term_end(text, tokens, at + 1, body.end);
                add("term dropped", token.range.start..tokens[end - 1].range.end, String::new());
            }
            if word == "["
                && before.is_some_and(|token| ends_operand(text, token))
                && let Some(close) = closing(text, tokens, at)
            {
                let inner = tokens[at + 1].range.start..tokens[close - 1].range.end;
                let with = format!("({}) + 1", &text[inner.clone()]);
                add("index", inner, with);
            }
        }
        Kind::Word => {
            let is_member = before.is_some_and(|token| token.text(text) == ".");
            if is_member && let Some(with) = swizzled(word) {
                add("components", token.range.clone(), with);
            }
            if !is_member
                && after == "("
                && let Some((_, with)) = CALLS.iter().find(|(name, _)| *name == word)
            {
                add("function", token.range.clone(), (*with).to_owned());
            }
            if word == "select"
                && after == "("
                && let Some([first, second]) = first_arguments(text, tokens, at + 1)
            {
                let with = format!("{}, {}", &text[second.clone()], &text[first.clone()]);
                add("branch", first.start..second.end, with);
            }
            if word == "if"
                && let Some(open) = (at..body.end).find(|&i| tokens[i].text(text) == "{")
            {
                let condition = tokens[at + 1].range.start..tokens[open - 1].range.end;
                add("branch", condition.clone(), "true".to_owned());
                add("branch", condition, "false".to_owned());
            }
            if starts_statement(text, before)
                && !matches!(
                    word,
                    "let"
                        | "var"
                        | "return"
                        | "if"
                        | "for"
                        | "else"
                        | "switch"
                        | "case"
                        | "default"
                        | "loop"
                        | "while"
                        | "break"
                        | "continue"
                        | "const"
                )
                && let Some(end) = (at..body.end).find(|&i| tokens[i].text(text) == ";")
            {
                add("statement dropped", token.range.start..tokens[end].range.end, String::new());
            }
        }
        Kind::Template => {}
    }
}

fn starts_statement(text: &str, before: Option<&Token>) -> bool {
    before.is_none_or(|token| matches!(token.text(text), ";" | "{" | "}"))
}

/// Returns the index of the first token after the term that begins at `from`. A term is a product or a single operand.
fn term_end(text: &str, tokens: &[Token], from: usize, end: usize) -> usize {
    let mut at = from;
    while at < end {
        match tokens[at].text(text) {
            "(" | "[" => at = closing(text, tokens, at).unwrap_or(end),
            "+" | "-" if at > from => break,
            ")" | "]" | "}" | "{" | ";" | "," | "<" | ">" | "<=" | ">=" | "==" | "!=" | "&&" | "||" | "&" | "|" | "^" | "<<" | ">>"
                if tokens[at].kind == Kind::Sign =>
            {
                break;
            }
            _ => {}
        }
        at += 1;
    }
    at.min(end)
}

/// Returns the byte ranges of the first two arguments of a call, whose opening bracket has the index `open`; `None` if the call has fewer than three
/// arguments.
fn first_arguments(text: &str, tokens: &[Token], open: usize) -> Option<[Range<usize>; 2]> {
    let close = closing(text, tokens, open)?;
    let mut commas = Vec::new();
    let mut at = open + 1;
    while at < close {
        match tokens[at].text(text) {
            "(" | "[" => at = closing(text, tokens, at)?,
            "," => commas.push(at),
            _ => {}
        }
        at += 1;
    }
    let [first, second] = [*commas.first()?, *commas.get(1)?];
    Some([tokens[open + 1].range.start..tokens[first - 1].range.end, tokens[first + 1].range.start..tokens[second - 1].range.end])
}

/// Returns the mutants of a number, each with its operator: a larger number, half of it, or the opposite sign, where these make sense.
fn constants(word: &str) -> Vec<(&'static str, String)> {
    let (digits, suffix) = match word.char_indices().last() {
        Some((last, 'u' | 'i' | 'f')) if !word.starts_with("0x") || word.ends_with('u') => word.split_at(last),
        _ => (word, ""),
    };
    let whole = digits.strip_prefix("0x").map_or_else(|| digits.parse::<u64>().ok(), |hex| u64::from_str_radix(hex, 16).ok());
    if let Some(whole) = whole {
        let mut found = vec![("constant: step", format!("{}{suffix}", whole + 1))];
        if whole >= 2 {
            found.push(("constant: half", format!("{}{suffix}", whole / 2)));
        }
        return found;
    }
    let Ok(number) = digits.parse::<f64>() else { return Vec::new() };
    if number == 0.0 {
        return vec![("constant: step", format!("0.25{suffix}"))];
    }
    let mut found = vec![("constant: sign", format!("(-{word})"))];
    if GUARDS.contains(&number) {
        found.push(("constant: step", format!("{:?}{suffix}", number * 1.25)));
        found.push(("constant: half", format!("{:?}{suffix}", number * 0.5)));
    }
    found
}

/// Returns different components, or the components in a different order: `x` -> `y`, `xyz` -> `yxz`; `None` if the word does not name components, or
/// if it only repeats one component, such as `xx`.
fn swizzled(word: &str) -> Option<String> {
    let set = ["xyzw", "rgba"].into_iter().find(|set| word.chars().all(|c| set.contains(c)))?;
    let mut letters: Vec<char> = word.chars().collect();
    if letters.len() > 4 || letters.is_empty() {
        return None;
    }
    if let [only] = letters[..] {
        let place = set.find(only)?;
        return set.chars().nth(if place == 0 { 1 } else { place - 1 }).map(String::from);
    }
    let other = (1..letters.len()).find(|&i| letters[i] != letters[0])?;
    letters.swap(0, other);
    Some(letters.into_iter().collect())
}
