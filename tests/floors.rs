//! Checks the layers of the crates, which are called floors. A module may import from itself and from modules on lower floors, but not from other
//! modules on its own floor or from modules on higher floors.
//!
//! The sources are parsed, so comments and strings do not count. Code under `#[cfg(test)]` does not count either.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use proc_macro2::{Span, TokenStream, TokenTree};
use syn::visit::{self, Visit};
use syn::{Attribute, Item, ItemMod, ItemUse, Meta, UseTree, Visibility};

use crate::fixtures::Folder;

/// The modules of a folder, floor by floor from the lowest. Modules of the same floor do not import each other.
type Floors = [&'static [&'static str]];

/// The modules of `experiments`: first what several modules use, then the definition of an experiment, then the parts of a run, its files and its
/// report, then the command line.
const EXPERIMENTS: &Floors = &[
    &["process", "metrics", "row", "settings", "rounds", "significance"], // used by higher floors
    &["definition", "judge"],                                             // the experiment, and the metrics of pictures
    &["unit", "expectations", "stability"],
    &["store"],            // the folder of a run
    &["runner", "report"], // the runner writes the folder; the report reads it
    &["cli"],
    &["commands"],
];

/// The modules of `workbench`: the window shows the model and requests pictures from the engine. Panels use neither the window nor the state of other
/// panels.
const WORKBENCH: &Floors = &[&["model"], &["engine"], &["panels"], &["window"], &["script"]];

/// The modules inside the model of `workbench`.
const WORKBENCH_MODEL: &Floors = &[
    &["files", "display", "panes", "flight", "editing", "metrics"],
    &["settings", "places"],
    &["compare", "viewpoint", "kept"],
    &["picture"], // requests to the engine, and its results
    &["brush", "drafts", "times"],
    &["state"],
];

/// The modules of `kernels`: first the modules that do not depend on terrain, then the data of the terrain on the CPU, then the stages, then the
/// frame and the modules that inspect it.
const KERNELS: &Floors = &[
    &["base"],                     // errors, names, files, colour: no terrain
    &["settings"],                 // how a setting is declared, checked and shown
    &["variant"],                  // five flavours and their sets
    &["shared"],                   // functions that stages share, in WGSL and Rust
    &["gpu"],                      // the device
    &["scene"],                    // the content of a scene file
    &["view", "decode", "blocks"], // the camera; decoding of files into arrays; block compression
    &["world", "materials"],       // node payloads and textures, on the CPU
    &["import", "quadtree"],       // import of a heightmap as a scene; choice of the nodes that are drawn
    &["culling", "residency"],
    &["terrain"], // terrain data on the device, which several stages use
    &["stage"],   // what a stage declares
    &["geometry"],
    &["virtual_texture", "classification", "motion", "occlusion"],
    &["shading", "temporal"],
    &["lighting", "metrics", "inspect"],
    &["display"],
    &["composition"],     // composes pictures, and lights and displays them
    &["frame"],           // the stages in their order
    &["oracle", "probe"], // references and probes that check the other modules
];

#[test]
fn kernels_keeps_its_floors() {
    check("kernels/src", KERNELS);
}

#[test]
fn experiments_keeps_its_floors() {
    check("experiments/src", EXPERIMENTS);
}

#[test]
fn workbench_keeps_its_floors() {
    check("workbench/src", WORKBENCH);
    check("workbench/src/model", WORKBENCH_MODEL);
}

#[test]
fn no_folder_has_a_cycle_between_its_modules() {
    for name in ["kernels", "experiments", "workbench"] {
        let found = cycles(&Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(name).join("src"));
        assert!(found.is_empty(), "{name}:\n{}", found.join("\n"));
    }
}

/// Fails with a line for each fault: an import from the same floor, a higher floor or the root module; a module that the list lacks or names twice; a
/// listed module that does not exist; a module whose file is not found. `folder` is relative to the workspace's root: the `src` of a crate, or a
/// folder of a module inside it.
fn check(folder: &str, floors: &Floors) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(folder);
    let faults = faults(&root, floors);
    assert!(faults.is_empty(), "{folder}:\n{}", faults.join("\n"));
}

/// Returns a line for each fault of a folder, as described for [`check`].
fn faults(folder: &Path, floors: &Floors) -> Vec<String> {
    let mut floor_of: BTreeMap<&str, usize> = BTreeMap::new();
    let mut faults = Vec::new();
    for (number, floor) in (1..).zip(floors) {
        for name in *floor {
            if floor_of.insert(name, number).is_some() {
                faults.push(format!("`{name}` is listed twice"));
            }
        }
    }
    let (modules, mut reading) = read(folder);
    for module in modules.iter().filter(|module| !floor_of.contains_key(module.as_str())) {
        faults.push(format!("`{module}` is not in the list: give it a floor"));
    }
    let exists = |name: &str| modules.iter().any(|module| module == name);
    faults.extend(floor_of.keys().filter(|name| !exists(name)).map(|name| format!("the list names `{name}`, which does not exist")));
    for Import { file, line, path, from, to } in &reading.imports {
        let place = format!("{}:{line}: `{path}`", file.strip_prefix(folder).unwrap_or(file).display());
        if !exists(to) {
            faults.push(format!("{place}: `{from}` imports from the root, which only the root's own file may do"));
        } else if let (Some(own), Some(other)) = (floor_of.get(from.as_str()), floor_of.get(to.as_str()))
            && own <= other
            && from != to
        {
            let how = if own == other { "the same floor" } else { "a higher floor" };
            faults.push(format!("{place}: `{from}` (floor {own}) imports from `{to}` (floor {other}), {how}"));
        }
    }
    faults.append(&mut reading.faults);
    faults
}

/// The file that declares the modules of a folder.
fn root_of(folder: &Path) -> Option<PathBuf> {
    [folder.join("lib.rs"), folder.join("mod.rs"), folder.with_extension("rs")].into_iter().find(|file| file.is_file())
}

/// The modules that the root file of a folder declares, and what they import from the same folder.
fn read(folder: &Path) -> (Vec<String>, Reading) {
    let root = root_of(folder).unwrap_or_else(|| panic!("{} has no lib.rs, no mod.rs and no .rs file with its name", folder.display()));
    let inside: Vec<String> = folder.iter().map(|name| name.to_string_lossy().into_owned()).collect();
    let source = inside.iter().rposition(|name| name == "src").expect("folders are inside a `src`");
    let mut reading = Reading { prefix: inside[source + 1..].to_vec(), imports: Vec::new(), faults: Vec::new() };
    let items = parsed(&root);
    let modules = modules_of(&items).map(|module| {
        reading.module(&root, folder, &reading.prefix.clone(), module);
        module.ident.to_string()
    });
    (modules.collect(), reading)
}

/// Returns a line for each import that is part of a cycle between modules of the same folder, or that leads from one such cycle to another. Searches
/// `folder` and all folders below it. Imports between a module and its own submodules do not count.
fn cycles(folder: &Path) -> Vec<String> {
    let mut found = Vec::new();
    if root_of(folder).is_some() {
        let (mut left, reading) = read(folder);
        found.extend(reading.faults);
        let mut imports: Vec<&Import> = reading.imports.iter().filter(|import| import.from != import.to).collect();
        // A module is not part of a cycle if it imports none of the remaining modules, or if none of the remaining modules imports it.
        loop {
            imports.retain(|import| left.contains(&import.from) && left.contains(&import.to));
            let before = left.len();
            left.retain(|module| imports.iter().any(|import| import.from == *module) && imports.iter().any(|import| import.to == *module));
            if left.len() == before {
                break;
            }
        }
        found.extend(imports.iter().map(|Import { file, line, path, from, to }| {
            format!("{}:{line}: `{path}`: `{from}` and `{to}` are part of a cycle", file.strip_prefix(folder).unwrap_or(file).display())
        }));
    }
    let entries = fs::read_dir(folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    let mut below: Vec<PathBuf> = entries.map(|entry| entry.expect("an entry").path()).filter(|path| path.is_dir()).collect();
    below.sort();
    found.extend(below.iter().flat_map(|folder| cycles(folder)));
    found
}

/// An import by a module of the folder, of another module or an item in the same folder.
struct Import {
    file: PathBuf,
    line: usize,
    /// The imported path, resolved from the crate's root.
    path: String,
    /// The module of the folder that contains the import.
    from: String,
    /// The first name of the path inside the folder: a module, or an item of the folder's root.
    to: String,
}

/// Reads the modules of a folder.
struct Reading {
    /// Path of the folder's own module, from the crate's root.
    prefix: Vec<String>,
    imports: Vec<Import>,
    faults: Vec<String>,
}

impl Reading {
    /// Reads a module that `file` declares. `folder` = the folder of the submodules of `file`; `path` = the module that declares this one.
    fn module(&mut self, file: &Path, folder: &Path, path: &[String], module: &ItemMod) {
        let name = module.ident.to_string();
        let path = [path, std::slice::from_ref(&name)].concat();
        let below = folder.join(&name);
        if let Some((_, items)) = &module.content {
            self.items(file, &below, &path, items);
            return;
        }
        let files = [folder.join(format!("{name}.rs")), below.join("mod.rs")];
        match files.iter().find(|file| file.is_file()) {
            Some(file) => self.items(file, &below, &path, &parsed(file)),
            None => self.faults.push(format!("{}: the file of module `{name}` was not found", file.display())),
        }
    }

    fn items(&mut self, file: &Path, folder: &Path, path: &[String], items: &[Item]) {
        for item in items {
            let mut paths = Paths { module: path, found: Vec::new(), inner: Vec::new() };
            paths.visit_item(item);
            let Paths { found, inner, .. } = paths;
            for (full, span) in found {
                self.import(file, path, &full, span);
            }
            for module in inner {
                self.module(file, folder, path, &module);
            }
        }
    }

    fn import(&mut self, file: &Path, module: &[String], full: &[String], span: Span) {
        let depth = self.prefix.len();
        // Imports that lead out of this folder are checked with the list of the parent folder.
        if !full.starts_with(&self.prefix) {
            return;
        }
        let to = full.get(depth).cloned().unwrap_or_else(|| "self".to_owned());
        let path = ["crate"].into_iter().chain(full.iter().map(String::as_str)).collect::<Vec<_>>().join("::");
        self.imports.push(Import { file: file.to_owned(), line: span.start().line, path, from: module[depth].clone(), to });
    }
}

fn parsed(file: &Path) -> Vec<Item> {
    let text = fs::read_to_string(file).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
    syn::parse_file(&text).unwrap_or_else(|error| panic!("{}: {error}", file.display())).items
}

/// The modules that items declare, without test modules.
fn modules_of(items: &[Item]) -> impl Iterator<Item = &ItemMod> {
    items.iter().filter_map(|item| match item {
        Item::Mod(module) if !is_of_tests(&module.attrs) => Some(module),
        _ => None,
    })
}

/// Whether an item is compiled for tests only.
fn is_of_tests(attributes: &[Attribute]) -> bool {
    attributes.iter().any(|attribute| match &attribute.meta {
        Meta::List(list) => list.path.is_ident("cfg") && list.tokens.to_string() == "test",
        _ => false,
    })
}

/// Finds the paths in an item that begin with `crate`, `super` or `self`. Modules inside the item are collected, but not searched.
struct Paths<'a> {
    /// The module that contains the item.
    module: &'a [String],
    /// Paths from the crate's root.
    found: Vec<(Vec<String>, Span)>,
    inner: Vec<ItemMod>,
}

impl Paths<'_> {
    /// Records a path if it begins with `crate`, `super` or `self`.
    fn take(&mut self, names: &[String], span: Span) {
        let mut base = match names.first().map(String::as_str) {
            Some("crate") => Vec::new(),
            Some("super" | "self") => self.module.to_vec(),
            _ => return,
        };
        let mut rest = names;
        while let Some((first, others)) = rest.split_first() {
            match first.as_str() {
                "super" => drop(base.pop()),
                "crate" | "self" => {}
                _ => break,
            }
            rest = others;
        }
        base.extend_from_slice(rest);
        self.found.push((base, span));
    }

    fn take_use(&mut self, before: &[String], tree: &UseTree) {
        let with = |name: String| [before, &[name]].concat();
        match tree {
            UseTree::Path(path) => self.take_use(&with(path.ident.to_string()), &path.tree),
            UseTree::Name(name) => self.take(&with(name.ident.to_string()), name.ident.span()),
            UseTree::Rename(rename) => self.take(&with(rename.ident.to_string()), rename.ident.span()),
            UseTree::Glob(glob) => self.take(&with("*".to_owned()), glob.star_token.spans[0]),
            UseTree::Group(group) => group.items.iter().for_each(|tree| self.take_use(before, tree)),
        }
    }

    /// Records the paths in the arguments of a macro, which the parser leaves as tokens.
    fn take_tokens(&mut self, tokens: TokenStream) {
        let tokens: Vec<TokenTree> = tokens.into_iter().collect();
        let is_colon = |at: usize| matches!(tokens.get(at), Some(TokenTree::Punct(mark)) if mark.as_char() == ':');
        let mut at = 0;
        while at < tokens.len() {
            match &tokens[at] {
                TokenTree::Group(group) => self.take_tokens(group.stream()),
                TokenTree::Ident(first) => {
                    let span = first.span();
                    let mut names = vec![first.to_string()];
                    while is_colon(at + 1)
                        && is_colon(at + 2)
                        && let Some(TokenTree::Ident(next)) = tokens.get(at + 3)
                    {
                        names.push(next.to_string());
                        at += 3;
                    }
                    if names.len() > 1 {
                        self.take(&names, span);
                    }
                }
                _ => {}
            }
            at += 1;
        }
    }
}

impl<'ast> Visit<'ast> for Paths<'_> {
    fn visit_item(&mut self, item: &'ast Item) {
        let attributes: &[Attribute] = match item {
            Item::Const(item) => &item.attrs,
            Item::Enum(item) => &item.attrs,
            Item::ExternCrate(item) => &item.attrs,
            Item::Fn(item) => &item.attrs,
            Item::ForeignMod(item) => &item.attrs,
            Item::Impl(item) => &item.attrs,
            Item::Macro(item) => &item.attrs,
            Item::Mod(item) => &item.attrs,
            Item::Static(item) => &item.attrs,
            Item::Struct(item) => &item.attrs,
            Item::Trait(item) => &item.attrs,
            Item::TraitAlias(item) => &item.attrs,
            Item::Type(item) => &item.attrs,
            Item::Union(item) => &item.attrs,
            Item::Use(item) => &item.attrs,
            _ => &[],
        };
        if !is_of_tests(attributes) {
            visit::visit_item(self, item);
        }
    }

    fn visit_impl_item(&mut self, item: &'ast syn::ImplItem) {
        let attributes: &[Attribute] = match item {
            syn::ImplItem::Const(item) => &item.attrs,
            syn::ImplItem::Fn(item) => &item.attrs,
            syn::ImplItem::Type(item) => &item.attrs,
            syn::ImplItem::Macro(item) => &item.attrs,
            _ => &[],
        };
        if !is_of_tests(attributes) {
            visit::visit_impl_item(self, item);
        }
    }

    fn visit_item_mod(&mut self, module: &'ast ItemMod) {
        self.inner.push(module.clone());
    }

    fn visit_item_use(&mut self, item: &'ast ItemUse) {
        if item.leading_colon.is_none() {
            self.take_use(&[], &item.tree);
        }
    }

    fn visit_path(&mut self, path: &'ast syn::Path) {
        let names: Vec<String> = path.segments.iter().map(|segment| segment.ident.to_string()).collect();
        if path.leading_colon.is_none()
            && names.len() > 1
            && let Some(first) = path.segments.first()
        {
            self.take(&names, first.ident.span());
        }
        visit::visit_path(self, path);
    }

    fn visit_macro(&mut self, of: &'ast syn::Macro) {
        visit::visit_macro(self, of);
        self.take_tokens(of.tokens.clone());
    }

    /// Skips visibilities: the paths in `pub(...)` import nothing.
    fn visit_visibility(&mut self, _: &'ast Visibility) {}
}

/// Creates a temporary folder with a `src` that contains these files.
fn crate_of(name: &str, files: &[(&str, &str)]) -> Folder {
    let folder = Folder::new(&format!("floors-{name}"));
    for (file, text) in files {
        let file = folder.0.join("src").join(file);
        fs::create_dir_all(file.parent().expect("it lies in a folder")).expect("a temporary folder can be made");
        fs::write(file, text).expect("a temporary file can be written");
    }
    folder
}

/// Returns the faults of these floors in a temporary folder with these files.
fn faults_of(name: &str, files: &[(&str, &str)], floors: &Floors) -> Vec<String> {
    let folder = crate_of(name, files);
    faults(&folder.0.join("src"), floors)
}

#[test]
fn imports_that_go_up_or_sideways_are_found_wherever_they_hide() {
    const FLOORS: &Floors = &[&["low", "beside"], &["high"]];
    let of = |name: &str, low: &str| {
        let files = [("lib.rs", "mod low; mod beside; mod high; pub use low::X;"), ("low.rs", low), ("beside.rs", ""), ("high.rs", "")];
        faults_of(name, &files, FLOORS)
    };
    let higher = "`low` (floor 1) imports from `high` (floor 2), a higher floor";
    for (name, low, expected) in [
        ("upward", "\nuse crate::high::X;", vec![("low.rs:2: `crate::high::X`", higher)]),
        ("sideways", "use super::beside::X;", vec![("low.rs:1: `crate::beside::X`", "imports from `beside` (floor 1), the same floor")]),
        (
            "group",
            "use std::{fs, io};\nuse crate::{low::{A, B},\n beside as b, high::{self, inner::{X, Y as Z}}};",
            vec![
                ("low.rs:3: `crate::beside`", "the same floor"),
                ("low.rs:3: `crate::high::self`", higher),
                ("low.rs:3: `crate::high::inner::X`", higher),
                ("low.rs:3: `crate::high::inner::Y`", higher),
            ],
        ),
        ("glob", "use crate::high::*;", vec![("low.rs:1: `crate::high::*`", higher)]),
        ("path", "fn f() { crate::high::f(); }", vec![("low.rs:1: `crate::high::f`", higher)]),
        ("type", "struct S(Vec<super::high::T>);", vec![("low.rs:1: `crate::high::T`", higher)]),
        ("macro", "fn f() { println!(\"{}\", [crate::high::X][0]); }", vec![("low.rs:1: `crate::high::X`", higher)]),
        ("inline", "mod a { mod b { use super::super::super::high; } }", vec![("low.rs:1: `crate::high`", higher)]),
        ("root", "use crate::X;", vec![("low.rs:1: `crate::X`", "imports from the root")]),
        ("root-glob", "use super::*;", vec![("low.rs:1: `crate::*`", "imports from the root")]),
    ] {
        let found = of(name, low);
        assert_eq!(found.len(), expected.len(), "{name}: {found:?}");
        for (place, what) in expected {
            assert!(found.iter().any(|line| line.starts_with(place) && line.contains(what)), "{name}: {place}, {what}: {found:?}");
        }
    }
    for (name, low) in [
        ("own", "use crate::low::inner::X; use self::inner::Y; mod inner { pub use super::Z; }"),
        ("comment", "// use crate::high::X;\n/// See [`crate::high::X`].\nconst T: &str = \"use crate::high::X;\";"),
        ("test", "#[cfg(test)] use crate::high::X; #[cfg(test)] mod tests { use crate::high::Y; } #[cfg(test)] mod elsewhere;"),
        ("visibility", "pub(crate) fn f() {} pub(super) fn g() {}"),
        ("other-crate", "use ::high::X; use high::Y;"),
    ] {
        assert_eq!(of(name, low), [""; 0], "{name}");
    }
}

#[test]
fn nested_files_are_followed_and_folders_inside_a_crate_have_their_own_lists() {
    let files = [
        ("lib.rs", "mod low; mod high;"),
        ("low/mod.rs", "mod one; mod two; pub struct Own;"),
        ("low/one.rs", "use super::two::X; use crate::high::Z;"),
        ("low/two/mod.rs", "mod deep;"),
        ("low/two/deep.rs", "use super::super::Own; use crate::low::one::Y; use super::super::super::high;"),
        ("high.rs", "use crate::low::Own;"),
    ];
    let upward = faults_of("nested", &files, &[&["low"], &["high"]]);
    assert_eq!(upward.len(), 2, "{upward:?}");
    assert!(
        upward[0].starts_with("low/one.rs:1: `crate::high::Z`") && upward[1].starts_with("low/two/deep.rs:1: `crate::high`"),
        "{upward:?}"
    );
    let folder = crate_of("inside", &files);
    let inside = faults(&folder.0.join("src/low"), &[&["one"], &["two"]]);
    assert_eq!(inside.len(), 2, "{inside:?}");
    assert!(inside[0].contains("`one` (floor 1) imports from `two` (floor 2)"), "{inside:?}");
    assert!(inside[1].contains("`crate::low::Own`") && inside[1].contains("imports from the root"), "{inside:?}");
}

#[test]
fn cycles_inside_folders_are_found() {
    let of = |name: &str, three: &str| {
        let files = [
            ("lib.rs", "mod low; mod high;"),
            ("low.rs", ""),
            ("high/mod.rs", "mod one; mod two; mod three; mod user; fn f() { one::f(); }"),
            ("high/one.rs", "use super::two::X; use super::f; use crate::low::Y;"),
            ("high/two.rs", "use crate::high::three::X;"),
            ("high/three.rs", three),
            ("high/user.rs", "use super::one::X;"),
        ];
        let folder = crate_of(name, &files);
        cycles(&folder.0.join("src"))
    };
    assert_eq!(of("no-cycle", "use crate::low::X;"), [""; 0]);
    let found = of("cycle", "\nuse super::one::X;");
    assert_eq!(found.len(), 3, "{found:?}");
    assert!(found.contains(&"three.rs:2: `crate::high::one::X`: `three` and `one` are part of a cycle".to_owned()), "{found:?}");
}

#[test]
fn the_list_names_each_module_once_and_no_other() {
    let files = [("lib.rs", "mod a; mod b; #[cfg(test)] mod fixture;"), ("a.rs", ""), ("b.rs", "")];
    assert_eq!(faults_of("list", &files, &[&["a"], &["b"]]), [""; 0]);
    assert_eq!(faults_of("unlisted", &files, &[&["a"]]), ["`b` is not in the list: give it a floor"]);
    assert_eq!(faults_of("gone", &files, &[&["a"], &["b", "c"]]), ["the list names `c`, which does not exist"]);
    assert_eq!(faults_of("twice", &files, &[&["a"], &["b"], &["a"]]), ["`a` is listed twice"]);
}
