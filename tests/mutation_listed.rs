//! Tests how `make mutants-rust` reads the list of cargo-mutants and applies its mutants. The list is written as version 27.1.0 writes it. Also tests
//! that `strength.toml` names lines that exist.

use std::fs;
use std::path::Path;

use crate::mutation::listed::listed;

/// A text with characters of two bytes, both before the changed line and in it.
const TEXT: &str = "//! α\nfn f(a: u32) -> u32 {\n    let b = 3; /* α² */ let c = a + b + 1;\n    c\n}\n";

/// A mutant in JSON, including the fields that `listed` does not use.
fn entry(what: &str, genre: &str, [start, end]: [[usize; 2]; 2], replacement: &str) -> String {
    let at = |[line, column]: [usize; 2]| format!("{{ \"line\": {line}, \"column\": {column} }}");
    let [line, column] = start;
    format!(
        "{{ \"name\": \"src/f.rs:{line}:{column}: {what}\", \"package\": \"p\", \"file\": \"src/f.rs\", \"function\": null, \
         \"span\": {{ \"start\": {}, \"end\": {} }}, \"replacement\": \"{replacement}\", \"genre\": \"{genre}\", \"diff\": \"\" }}",
        at(start),
        at(end)
    )
}

#[test]
fn mutants_are_applied_where_the_list_says() {
    let entries = [
        entry("replace f -> u32 with 0", "FnValue", [[3, 5], [4, 6]], "0"),
        entry("replace + with - in f", "BinaryOperator", [[3, 35], [3, 36]], "-"),
        entry("replace + with - in f", "BinaryOperator", [[3, 39], [3, 40]], "-"),
        entry("replace + with * in f", "BinaryOperator", [[3, 39], [3, 40]], "*"),
    ];
    let all = listed(&format!("[{}]", entries.join(","))).expect("a list");
    let found: Vec<(usize, String, String)> = all.iter().map(|m| (m.line(), m.change(), m.apply(TEXT).expect("applies"))).collect();
    let with = |from: &str, to: &str| TEXT.replacen(from, to, 1);
    let expected = [
        (3, "replace f -> u32 with 0".to_owned(), "//! α\nfn f(a: u32) -> u32 {\n    0\n}\n".to_owned()),
        (3, "replace + with - in f, occurrence 1".to_owned(), with("a + b", "a - b")),
        (3, "replace + with - in f, occurrence 2".to_owned(), with("b + 1", "b - 1")),
        (3, "replace + with * in f".to_owned(), with("b + 1", "b * 1")),
    ];
    assert_eq!(found, expected);
    assert_eq!(all[1].any_occurrence(), "replace + with - in f");
    assert_eq!([&all[0].file, &all[0].genre], ["src/f.rs", "FnValue"]);
}

#[test]
fn a_list_that_belongs_to_another_text_is_an_error() {
    let one = |what: &str, span: [[usize; 2]; 2], replacement: &str| {
        listed(&format!("[{}]", entry(what, "BinaryOperator", span, replacement))).expect("a list").remove(0)
    };
    for span in [[[9, 1], [9, 2]], [[3, 4], [3, 400]], [[3, 9], [3, 5]], [[0, 1], [1, 1]], [[1, 0], [1, 1]]] {
        let error = one("replace + with - in f", span, "-").apply(TEXT).expect_err("outside the text").to_string();
        assert!(error.contains("is not a part of the text"), "{error}");
    }
    let error = one("replace + with + in f", [[3, 35], [3, 36]], "+").apply(TEXT).expect_err("no change").to_string();
    assert!(error.contains("changes nothing"), "{error}");
    assert!(listed("[").is_err() && listed("{}").is_err());
    assert!(listed("[]").expect("an empty list").is_empty());
}

#[test]
fn equivalent_mutants_and_controls_name_lines_that_exist() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let strength: toml::Table = toml::from_str(include_str!("strength.toml")).expect("a table");
    let text_of = |entry: &toml::Value, key: &str| entry[key].as_str().expect("a text").to_owned();
    let mut seen = Vec::new();
    for entry in ["equivalent", "control"].iter().flat_map(|kind| strength[*kind].as_array().expect("a list")) {
        let (file, line) = (text_of(entry, "file"), text_of(entry, "line"));
        // Shaders are named by their path in kernels/src, Rust files by their path from the root.
        let place = if file.ends_with(".wgsl") { root.join("kernels/src").join(&file) } else { root.join(&file) };
        let text = fs::read_to_string(&place).unwrap_or_else(|error| panic!("{file}: {error}"));
        assert!(text.lines().any(|other| other.trim() == line), "{file} has no line `{line}`: was it changed?");
        seen.push((file, line));
    }
    assert!(seen.len() > 20 && seen.iter().any(|(file, _)| file.ends_with(".rs")), "{seen:?}");
    for file in strength["references"]["files"].as_array().expect("a list") {
        let place = root.join("kernels/src").join(file.as_str().expect("a text"));
        assert!(place.exists(), "[references] names {}, which does not exist", place.display());
    }
}
