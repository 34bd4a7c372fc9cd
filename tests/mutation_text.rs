//! Compares the mutants of small pieces of WGSL, one by one, with the expected ones.

use crate::mutation::mutants;

fn inside(body: &str) -> Vec<String> {
    let wrap = |body: &str| format!("fn f() {{ {body} }}");
    let (head, tail) = wrap("|").split_once('|').map(|(head, tail)| (head.len(), tail.len())).expect("wrapped");
    let text = wrap(body);
    mutants(&text)
        .iter()
        .map(|mutant| {
            let whole = mutant.apply(&text);
            format!("{}: {}", mutant.operator, &whole[head..whole.len() - tail])
        })
        .collect()
}

#[test]
fn each_operator_makes_the_faults_that_its_name_says() {
    assert_eq!(
        inside("return a * 2.0;"),
        [
            "operator: return a / 2.0;",
            "constant: sign: return a * (-2.0);",
            "constant: step: return a * 2.5;",
            "constant: half: return a * 1.0;",
        ]
    );
    assert_eq!(inside("return -a.xy;"), ["sign: return a.xy;", "components: return -a.yx;"]);
    assert_eq!(
        inside("return a + b * c - d;"),
        [
            "operator: return a - b * c - d;",
            "term dropped: return a  - d;",
            "operator: return a + b / c - d;",
            "operator: return a + b * c + d;",
            "term dropped: return a + b * c ;",
        ]
    );
    assert_eq!(
        inside("if a < 3u { b(); }"),
        [
            "branch: if true { b(); }",
            "branch: if false { b(); }",
            "comparison: if a <= 3u { b(); }",
            "comparison: if a > 3u { b(); }",
            "constant: step: if a < 4u { b(); }",
            "constant: half: if a < 1u { b(); }",
            "statement dropped: if a < 3u {  }",
        ]
    );
    assert_eq!(
        inside("return min(a[i], 0.0);"),
        ["function: return max(a[i], 0.0);", "index: return min(a[(i) + 1], 0.0);", "constant: step: return min(a[i], 0.25);",]
    );
    assert_eq!(inside("return select(f(a, b), c, d);"), ["branch: return select(c, f(a, b), d);"]);
    assert_eq!(inside("x += y;"), ["statement dropped: ", "operator: x -= y;"]);
}

#[test]
fn declarations_types_and_comments_are_left_alone() {
    let text = "// 1 + 2\nconst A: f32 = 1.0;\n@compute @workgroup_size(8, 8)\nfn f(a: vec3<f32>) -> array<u32, 5> {\n    /* 3 < 4 */\n    let b = vec2<f32>(a.x, c);\n    return d;\n}\n";
    assert_eq!(mutants(text).iter().map(|mutant| (mutant.line, mutant.change(text))).collect::<Vec<_>>(), [(6, "`x` -> `y`".to_owned())]);
    assert!(mutants("struct S { a: f32 }").is_empty());
}

#[test]
fn equal_changes_of_a_line_are_numbered() {
    let text = "fn f() {\n    return v(0.0, 0.0, x);\n    return 0.0;\n}\n";
    let changes: Vec<_> = mutants(text).iter().map(|mutant| (mutant.line, mutant.change(text))).collect();
    let expected = [(2, "`0.0` -> `0.25`, occurrence 1"), (2, "`0.0` -> `0.25`, occurrence 2"), (3, "`0.0` -> `0.25`")]
        .map(|(line, change)| (line, change.to_owned()));
    assert_eq!(changes.iter().filter(|(_, change)| change.contains("0.0")).cloned().collect::<Vec<_>>(), expected);
}

#[test]
fn guards_are_not_scaled_and_hexadecimal_is_a_whole_number() {
    assert_eq!(inside("a(1e-30);"), ["statement dropped: ", "constant: sign: a((-1e-30));"]);
    assert_eq!(inside("return 0xffu;"), ["constant: step: return 256u;", "constant: half: return 127u;"]);
    assert_eq!(inside("return 1u;"), ["constant: step: return 2u;"]);
    assert_eq!(inside("return a.w;"), ["components: return a.z;"]);
    assert_eq!(inside("return a.rgb;"), ["components: return a.grb;"]);
    assert_eq!(inside("return a.index;"), Vec::<String>::new());
    assert_eq!(inside("return a.xx;"), Vec::<String>::new());
}
