//! WGSL files, their dependencies, and the constants that the host passes to them.
//!
//! There is no preprocessor: a module is the concatenation of its files, each after its dependencies. Constants that host and shader share are
//! declared in Rust and written out as WGSL before the file that uses them.

use std::fmt::Write as _;

/// A value of a constant that host and shader share.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Constant {
    /// An unsigned integer.
    U32(u32),
    /// A signed integer.
    I32(i32),
    /// A real number.
    F32(f32),
}

impl Constant {
    /// A real constant: `value`, rounded to the nearest f32.
    #[allow(clippy::cast_possible_truncation, reason = "shaders compute in f32")]
    pub const fn real(value: f64) -> Constant {
        Constant::F32(value as f32)
    }

    /// The declaration in WGSL. The text of a real number reads back as the same f32.
    fn wgsl(self, name: &str) -> String {
        match self {
            Constant::U32(value) => format!("const {name}: u32 = {value}u;\n"),
            Constant::I32(value) => format!("const {name}: i32 = {value};\n"),
            Constant::F32(value) => format!("const {name}: f32 = {value:?};\n"),
        }
    }
}

/// A WGSL file.
#[derive(Debug)]
pub struct Wgsl {
    /// Path of the file in `kernels/src`, such as `shared/hash.wgsl`.
    pub path: &'static str,
    /// Text of the file, embedded at compile time.
    pub text: &'static str,
    /// Direct dependencies: the files whose declarations this file uses.
    pub needs: &'static [&'static Wgsl],
    /// Constants that the host passes to this file: names and values.
    pub constants: &'static [(&'static str, Constant)],
}

impl Wgsl {
    /// A file to which the host passes no constants.
    pub const fn new(path: &'static str, text: &'static str, needs: &'static [&'static Wgsl]) -> Wgsl {
        Wgsl { path, text, needs, constants: &[] }
    }

    /// Returns this file with its constants replaced by `constants`.
    #[must_use]
    pub const fn with(self, constants: &'static [(&'static str, Constant)]) -> Wgsl {
        Wgsl { constants, ..self }
    }
}

/// Returns the files of a module that uses `roots`. Each file appears once, after its dependencies.
pub fn closure(roots: &[&'static Wgsl]) -> Vec<&'static Wgsl> {
    fn visit(file: &'static Wgsl, begun: &mut Vec<&'static str>, all: &mut Vec<&'static Wgsl>) {
        if begun.contains(&file.path) {
            return;
        }
        begun.push(file.path);
        for need in file.needs {
            visit(need, begun, all);
        }
        all.push(file);
    }
    let (mut begun, mut all) = (Vec::new(), Vec::new());
    for root in roots {
        visit(root, &mut begun, &mut all);
    }
    all
}

/// A piece of a module: a file, or generated text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Piece {
    /// The path of the file; for generated text, a description.
    pub path: String,
    /// The WGSL text.
    pub text: String,
}

impl Piece {
    /// A piece with this path and text.
    pub fn new(path: &str, text: impl Into<String>) -> Piece {
        Piece { path: path.to_owned(), text: text.into() }
    }
}

/// Returns the pieces of a module that uses `roots`. The constants that the host passes to a file are a separate piece, directly before the file.
pub fn pieces(roots: &[&'static Wgsl]) -> Vec<Piece> {
    let mut pieces = Vec::new();
    for file in closure(roots) {
        if !file.constants.is_empty() {
            let mut text = String::new();
            for (name, value) in file.constants {
                let _ = write!(text, "{}", value.wgsl(name));
            }
            pieces.push(Piece { path: format!("{} (constants of the host)", file.path), text });
        }
        pieces.push(Piece::new(file.path, file.text));
    }
    pieces
}

/// Joins pieces into the text of a module.
pub fn joined(pieces: &[Piece]) -> String {
    pieces.iter().flat_map(|piece| [piece.text.as_str(), "\n"]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    static A: Wgsl = Wgsl::new("a", "fn a() {}", &[]).with(&[("SIZE", Constant::U32(4)), ("STEP", Constant::real(1e-6))]);
    static B: Wgsl = Wgsl::new("b", "fn b() { a(); }", &[&A]);
    static C: Wgsl = Wgsl::new("c", "fn c() { a(); b(); }", &[&A, &B]);
    static LOOP: Wgsl = Wgsl::new("loop", "", &[&LOOP, &A]);

    #[test]
    fn what_is_needed_comes_first_and_once() {
        let paths = |roots: &[&'static Wgsl]| closure(roots).iter().map(|f| f.path).collect::<Vec<_>>();
        assert_eq!(paths(&[&C]), ["a", "b", "c"]);
        assert_eq!(paths(&[&B, &C, &A]), ["a", "b", "c"]);
        assert_eq!(paths(&[&LOOP]), ["a", "loop"]);
        assert!(closure(&[]).is_empty());
    }

    #[test]
    fn constants_stand_before_their_file() {
        let pieces = pieces(&[&B]);
        assert_eq!(pieces.iter().map(|p| p.path.as_str()).collect::<Vec<_>>(), ["a (constants of the host)", "a", "b"]);
        assert_eq!(pieces[0].text, "const SIZE: u32 = 4u;\nconst STEP: f32 = 1e-6;\n");
        assert_eq!(joined(&pieces[1..]), "fn a() {}\nfn b() { a(); }\n");
    }

    #[test]
    fn constants_keep_every_bit() {
        for bits in [0x3727_c5ac_u32, 0x0000_0001, 0x7f7f_ffff, 0x3f80_0001] {
            let value = f32::from_bits(bits);
            let text = Constant::F32(value).wgsl("X");
            let number = text.trim_end_matches(";\n").rsplit_once("= ").expect("a value").1;
            assert_eq!(number.parse::<f32>().map(f32::to_bits), Ok(bits), "{text}");
        }
    }
}
