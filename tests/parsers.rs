//! Tests the functions that read files. Their input is damaged: mutants of small valid files. The mutants are the same in every run. A mutant must be
//! accepted, or refused with an error of one line, and the data of an accepted mutant must be consistent. The module [`readers`], which the fuzz
//! targets also use, checks this. Files that once caused a crash are in the same folders as the valid files. They are read unchanged, too.

use std::fs;
use std::panic::catch_unwind;
use std::path::Path;
use std::time::{Duration, Instant};

use experiments::stability::statistics::Random;

#[allow(unreachable_pub, reason = "the library of the fuzz targets, included")]
#[path = "../fuzz/readers.rs"]
mod readers;

/// Number of mutants of each kind of file. The environment variable `SCREE_MUTANTS` replaces it.
const MUTANTS: u32 = 2000;
/// Limit of the time for one mutant. A mutant usually takes less than a millisecond. The limit is high, because the machine may be busy.
const PATIENCE: Duration = Duration::from_secs(20);
/// Limit of the size of a mutant, bytes. A larger mutant is not changed further, because each change can double its size.
const LARGE: usize = 1 << 16;
/// Integers at the ends of the ranges of counts and sizes in files.
const INTEGERS: [u64; 14] = [0, 1, 2, 127, 128, 255, 256, 16_385, 65_535, 1 << 16, (1 << 31) - 1, 1 << 31, (1 << 32) - 1, (1 << 63) | 1];
/// Numbers as text, inside and outside valid ranges.
const NUMBERS: [&str; 16] = [
    "0",
    "-0.0",
    "-1",
    "1",
    "nan",
    "-nan",
    "inf",
    "-inf",
    "1e-320",
    "1e308",
    "1e999",
    "4294967296",
    "9223372036854775807",
    "99999999999999999999",
    "0x7f",
    "1_000",
];
/// Text that strings and names in a damaged file may contain: line breaks, NUL, an escape sequence of a terminal, a mark of text direction, quotes.
const PIECES: [&str; 12] = ["\\n", "\\r\\n", "\\u0000", "\\u001b[2J", "\\u0085", "\\u2028", "\u{2028}", "\u{202e}", "\t", "é", "\\", "\""];

/// A file of the corpus (`fuzz/corpus`), from which mutants are made.
struct Seed {
    name: String,
    bytes: Vec<u8>,
}

/// The files of a kind in the corpus, sorted by name.
fn corpus(kind: &str) -> Vec<Seed> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/corpus").join(kind);
    let entries = fs::read_dir(&folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    let mut seeds: Vec<Seed> = entries
        .map(|entry| {
            let path = entry.expect("an entry").path();
            Seed { name: path.file_name().unwrap_or_default().to_string_lossy().into_owned(), bytes: fs::read(&path).expect("readable") }
        })
        .collect();
    seeds.sort_by(|a, b| a.name.cmp(&b.name));
    seeds
}

/// Makes mutants of a corpus.
struct Mutator<'a> {
    random: Random,
    seeds: &'a [Seed],
}

impl Mutator<'_> {
    /// Returns a random range within `length` bytes. In most cases, the range is short.
    fn part(&mut self, length: usize) -> std::ops::Range<usize> {
        let start = self.random.below(length + 1);
        let longest = if self.random.below(4) == 0 { length } else { 8 };
        start..(start + self.random.below(longest + 1)).min(length)
    }

    fn one<T: Copy>(&mut self, of: &[T]) -> T {
        of[self.random.below(of.len())]
    }

    fn mutant(&mut self) -> Vec<u8> {
        let mut bytes = self.seeds[self.random.below(self.seeds.len())].bytes.clone();
        for _ in 0..=self.random.below(4) {
            let is_text = std::str::from_utf8(&bytes).is_ok();
            if is_text && self.random.below(4) > 0 {
                self.change_text(&mut bytes);
            } else {
                self.change_bytes(&mut bytes);
            }
            if bytes.len() > LARGE {
                break;
            }
        }
        // Most mutants get valid PNG checksums, because a reader refuses a wrong checksum before it reads the data.
        if self.random.below(8) > 0 { with_png_checksums(bytes) } else { bytes }
    }

    fn change_bytes(&mut self, bytes: &mut Vec<u8>) {
        let at = self.random.below(bytes.len() + 1);
        match self.random.below(8) {
            0 => {
                if let Some(byte) = bytes.get_mut(at) {
                    *byte ^= 1 << self.random.below(8);
                }
            }
            1 => bytes.truncate(at),
            2 => {
                let part = self.part(bytes.len());
                bytes.drain(part);
            }
            3 => {
                let part = self.part(bytes.len());
                let copy = bytes[part].to_vec();
                bytes.splice(at..at, copy);
            }
            4 => {
                let other = self.random.below(self.seeds.len());
                let part = self.part(self.seeds[other].bytes.len());
                bytes.splice(at.., self.seeds[other].bytes[part.start..].iter().copied());
            }
            5 | 6 => {
                let number = self.one(&INTEGERS);
                let width = self.one(&[1, 2, 4, 8]);
                let (little, big) = (number.to_le_bytes(), number.to_be_bytes());
                let written = if self.random.below(2) == 0 { &little[..width] } else { &big[8 - width..] };
                let end = (at + width).min(bytes.len());
                bytes.splice(at..end, written.iter().copied());
            }
            _ => {
                let noise = self.random.word().to_le_bytes();
                bytes.splice(at..at, noise[..1 + self.random.below(8)].iter().copied());
            }
        }
    }

    fn change_text(&mut self, bytes: &mut Vec<u8>) {
        let text = String::from_utf8_lossy(bytes).into_owned();
        let mut lines: Vec<&str> = text.split_inclusive('\n').collect();
        let line = self.random.below(lines.len().max(1));
        match self.random.below(8) {
            0 if !lines.is_empty() => lines.insert(line, lines[line]),
            1 if !lines.is_empty() => {
                lines.remove(line);
            }
            2 if !lines.is_empty() => {
                let other = self.random.below(lines.len());
                lines.swap(line, other);
            }
            3 => return self.replace(bytes, &text, |c| c.is_ascii_alphanumeric() || "+-._".contains(c), &NUMBERS),
            4 => return self.replace(bytes, &text, |c| c != '"' && c != '\n' && c != '=' && c != ',', &PIECES),
            5 => {
                // Replaces a value or a name by another word of the file.
                let words: Vec<&str> = text.split(|c: char| c.is_whitespace() || "[]{}=,".contains(c)).filter(|w| !w.is_empty()).collect();
                if !words.is_empty() {
                    return self.replace(bytes, &text, |c| !c.is_whitespace() && !"[]{}=,".contains(c), &words);
                }
            }
            6 => {
                let depth = self.one(&[2, 100, 20_000]);
                let (open, close) = self.one(&[("[", "]"), ("{a=", "}"), ("{\"a\":", "}"), ("a.", ""), ("[[", ""), ("\"", "")]);
                let nest = format!("{}1{}", open.repeat(depth), close.repeat(depth));
                return self.replace(bytes, &text, |c| c.is_ascii_alphanumeric() || "+-._".contains(c), &[&nest]);
            }
            _ => {
                let at = self.random.below(bytes.len() + 1);
                let piece = self.one(&PIECES);
                bytes.splice(at..at, piece.bytes());
                return;
            }
        }
        *bytes = lines.concat().into_bytes();
    }

    /// Selects a random run of characters for which `of_kind` is true. Replaces the run by a random text from `by`, or inserts the text before the
    /// run.
    fn replace(&mut self, bytes: &mut Vec<u8>, text: &str, of_kind: impl Fn(char) -> bool, by: &[&str]) {
        let runs: Vec<(usize, &str)> = text
            .split(|c| !of_kind(c))
            .filter(|run| !run.is_empty())
            .map(|run| (run.as_ptr() as usize - text.as_ptr() as usize, run))
            .collect();
        if runs.is_empty() {
            return;
        }
        let (start, run) = self.one(&runs);
        let end = if self.random.below(2) == 0 { start + run.len() } else { start };
        bytes.splice(start..end, self.one(by).bytes());
    }
}

/// Corrects the checksum of every chunk if the bytes are a PNG; returns other bytes unchanged.
fn with_png_checksums(mut bytes: Vec<u8>) -> Vec<u8> {
    let mut at = 8;
    while bytes.starts_with(b"\x89PNG\r\n\x1a\n") && bytes.len() >= at + 12 {
        let length = u32::from_be_bytes(std::array::from_fn(|i| bytes[at + i])) as usize;
        let end = at + 8 + length;
        let Some(covered) = bytes.get(at + 4..end).filter(|_| bytes.len() >= end + 4) else { break };
        let crc = !covered.iter().fold(u32::MAX, |crc, &byte| {
            (0..8).fold(crc ^ u32::from(byte), |crc, _| if crc & 1 == 1 { crc >> 1 ^ 0xedb8_8320 } else { crc >> 1 })
        });
        bytes[end..end + 4].copy_from_slice(&crc.to_be_bytes());
        at = end + 4;
    }
    bytes
}

/// Runs a reader on the corpus files of a kind, and on mutants of these files. The reader must accept the files, except those whose names begin with
/// `refused`.
fn try_all(kind: &str, reader: fn(&[u8]) -> bool) {
    let seeds = corpus(kind);
    for seed in &seeds {
        assert_eq!(reader(&seed.bytes), !seed.name.starts_with("refused"), "{kind}/{}", seed.name);
    }
    let count = std::env::var("SCREE_MUTANTS").map_or(MUTANTS, |count| count.parse().expect("SCREE_MUTANTS is a number"));
    let mut accepted = 0;
    let mut mutator = Mutator { random: Random(kind.len() as u64), seeds: &seeds };
    for number in 0..count {
        let mutant = mutator.mutant();
        let began = Instant::now();
        let outcome = catch_unwind(|| reader(&mutant));
        if outcome.is_err() || began.elapsed() > PATIENCE {
            let file = std::env::temp_dir().join(format!("scree-mutant-{kind}-{number}"));
            fs::write(&file, &mutant).expect("a temporary file");
            panic!("{kind}: mutant {number}, kept as {}, panicked or took too long: {:?}", file.display(), began.elapsed());
        }
        accepted += u32::from(outcome.is_ok_and(|accepted| accepted));
    }
    // If the first check of a reader refused all mutants, the code after that check would not be tested. If all mutants were accepted, no check would
    // be tested.
    assert!(accepted > count / 100 && accepted < count, "{accepted} of {count} mutants of {kind} were accepted");
}

#[test]
fn scenes_are_read_or_refused() {
    try_all("scene", readers::scene);
}

#[test]
fn definitions_are_read_or_refused() {
    try_all("definition", readers::definition);
}

#[test]
fn heightmaps_are_read_or_refused() {
    try_all("heightmap", readers::heightmap);
}

#[test]
fn maps_of_materials_are_read_or_refused() {
    try_all("material", readers::material);
}

#[test]
fn parts_of_openexr_are_read_or_refused() {
    try_all("openexr", readers::openexr);
}

#[test]
fn textures_are_read_or_refused() {
    try_all("texture", readers::texture);
}

#[test]
fn what_is_kept_is_read_or_refused() {
    try_all("cache", readers::cache);
}

/// Returns a file of the corpus that states something false: the first occurrence of the bytes `what` is replaced by `instead`.
fn claiming(kind: &str, name: &str, what: &[u8], instead: &[u8]) -> Vec<u8> {
    let seed = corpus(kind).into_iter().find(|seed| seed.name == name);
    let mut bytes = seed.unwrap_or_else(|| panic!("{kind}/{name} is in the corpus")).bytes;
    let at = bytes.windows(what.len()).position(|part| part == what).unwrap_or_else(|| panic!("{name} says {what:?} somewhere"));
    bytes[at..at + what.len()].copy_from_slice(instead);
    with_png_checksums(bytes)
}

#[test]
fn sizes_that_are_only_claimed_are_refused_at_once() {
    let png = |kind: &str, name: &str, old: [u8; 2], new: u32| {
        let header = |w: u32, h: u32| [b"IHDR".as_slice(), &w.to_be_bytes(), &h.to_be_bytes()].concat();
        claiming(kind, name, &header(old[0].into(), old[1].into()), &header(new, new))
    };
    let box2i = |name: &str, w: i32, h: i32| {
        let corners = [0, 0, w - 1, h - 1].map(i32::to_le_bytes).concat();
        [name.as_bytes(), b"\0box2i\0\x10\0\0\0", &corners].concat()
    };
    let exr = |new: i32| claiming("heightmap", "float.exr", &box2i("dataWindow", 5, 4), &box2i("dataWindow", new, new));
    let tiff = |new: u32| {
        let size = |w: u32, h: u32| {
            let entry = |tag: u16, value: u32| [&tag.to_le_bytes()[..], &[4, 0, 1, 0, 0, 0], &value.to_le_bytes()].concat();
            [entry(256, w), entry(257, h)].concat()
        };
        claiming("heightmap", "grey16.tif", &size(5, 4), &size(new, new))
    };
    let jpeg = |new: u16| {
        let frame = |w: u16, h: u16| [b"\xff\xc0\0\x11\x08".as_slice(), &h.to_be_bytes(), &w.to_be_bytes()].concat();
        claiming("texture", "rgb8.jpg", &frame(8, 8), &frame(new, new))
    };
    // The stated widths and heights are the largest that is allowed, the largest plus 1, and the largest that a PNG or OpenEXR file can state. All
    // are refused, because the files do not contain so many samples.
    for edge in [16_385, 16_386, (1 << 31) - 1] {
        for (what, bytes) in [("png", png("heightmap", "grey16.png", [5, 4], edge)), ("exr", exr(edge.cast_signed())), ("tif", tiff(edge))]
        {
            let began = Instant::now();
            assert!(!readers::heightmap(&bytes) && began.elapsed() < PATIENCE, "{what} of {edge}: {:?}", began.elapsed());
        }
    }
    // If a JPEG holds fewer texels than it states, the decoder fills the rest with grey. So a JPEG that states a false but allowed size is accepted,
    // and only larger sizes are tested.
    let too_large = [8193, 65_535].map(|edge| ("jpg", jpeg(edge)));
    for (what, bytes) in [8192, 8193, 65_535].map(|edge| ("png", png("texture", "rgb8.png", [4, 4], edge))).into_iter().chain(too_large) {
        let began = Instant::now();
        assert!(!readers::texture(&bytes) && !readers::material(&bytes) && began.elapsed() < PATIENCE, "{what}: {:?}", began.elapsed());
    }
    // Tests very long words, and tables that are deeply nested.
    let long = [
        format!("{} = 1\n", "a".repeat(4 << 20)),
        format!("name = \"{}\"\n", "b".repeat(4 << 20)),
        format!("{}d = 1\n", "c.".repeat(2 << 20)),
    ];
    let small = corpus("definition").into_iter().find(|seed| seed.name == "small.toml").expect("in the corpus").bytes;
    let small = String::from_utf8(small).expect("text");
    let deep = small.replacen("[set]\n", &format!("[set]\n\"{}x\" = 1\n", "a.".repeat(20_000)), 1);
    assert!(deep.len() > small.len());
    for text in long.iter().chain([&deep]) {
        let began = Instant::now();
        assert!(
            !readers::scene(text.as_bytes()) && !readers::definition(text.as_bytes()) && began.elapsed() < PATIENCE,
            "{:?}",
            began.elapsed()
        );
    }
}
