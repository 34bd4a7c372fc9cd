//! Checks every shader module with naga, without a device: the module is parsed and validated, and its overrides are resolved.
//!
//! A device reports some errors only when a variant is first used, and some backends never report them. These tests report them for all variants.

use kernels::base::wgsl::{self, Wgsl};
use kernels::frame::{DECLARATIONS, FOLLOWING};
use kernels::gpu::ShaderModule;
use kernels::shading::{Estimator, Kernel, PipelineKey, Settings};
use kernels::shared::noise::NoiseKind;
use kernels::variant::Variant;
use kernels::{geometry, metrics, shading, temporal, virtual_texture};
use naga::ShaderStage;
use naga::back::PipelineConstants;
use naga::back::pipeline_constants::process_overrides;
use naga::valid::{Capabilities, ModuleInfo, ValidationFlags, Validator};

use crate::fixtures::wgsl_files;

/// A shader module with the text that the stages compile.
pub(crate) struct Source {
    pub(crate) name: &'static str,
    pub(crate) text: String,
    /// The capabilities of naga that the module needs. By default, naga allows none of them.
    needs: Capabilities,
}

pub(crate) fn source(module: &ShaderModule) -> Source {
    let has = |path: &str| module.files().iter().any(|file| file.path == path);
    let mut needs = Capabilities::empty();
    // This capability allows `pack2x16float`, which packs two f16 numbers into a word. Every adapter supports it.
    needs.set(Capabilities::SHADER_FLOAT16_IN_FLOAT32, has("shared/signal.wgsl"));
    needs.set(Capabilities::SUBGROUP, has("classification/subgroup.wgsl"));
    Source { name: module.name, text: wgsl::joined(&module.pieces()), needs }
}

/// Every module that is compiled on a device: those that stages declare, and those of the passes that follow a sequence of frames.
pub(crate) fn sources() -> Vec<Source> {
    let declared = DECLARATIONS.iter().flat_map(|stage| stage.modules.iter().copied());
    let following = [&temporal::MODULE, &metrics::MODULE, &metrics::SEEDS_MODULE];
    let all: Vec<Source> = declared.chain(FOLLOWING).chain(following).map(source).collect();
    assert!(all.len() >= 13, "{} modules", all.len());
    all
}

/// Parses and validates a text that may use only `capabilities`.
pub(crate) fn validate(text: &str, capabilities: Capabilities) -> Result<(naga::Module, ModuleInfo), String> {
    let module = naga::front::wgsl::parse_str(text).map_err(|e| e.emit_to_string(text))?;
    let info = Validator::new(ValidationFlags::all(), capabilities).validate(&module).map_err(|e| e.emit_to_string(text))?;
    Ok((module, info))
}

/// Returns the module of an entry point with constants in place of its overrides. It is an error if `overrides` contains a name that the module does
/// not declare, or if it contains no value for an override without a default.
fn resolve(
    (module, info): &(naga::Module, ModuleInfo),
    entry: (ShaderStage, &str),
    overrides: &[(&str, f64)],
) -> Result<naga::Module, String> {
    if !module.entry_points.iter().any(|e| e.stage == entry.0 && e.name == entry.1) {
        return Err(format!("there is no entry point `{}`", entry.1));
    }
    let constants: PipelineConstants = overrides.iter().map(|&(name, value)| (name.to_owned(), value)).collect();
    let (resolved, _) = process_overrides(module, info, Some(entry), &constants).map_err(|e| e.to_string())?;
    Ok(resolved.into_owned())
}

/// The value of the constant that replaced an override; `None` if the entry point does not use it.
fn resolved_value(module: &naga::Module, name: &str) -> Option<f64> {
    let (_, constant) = module.constants.iter().find(|(_, c)| c.name.as_deref() == Some(name))?;
    match module.global_expressions[constant.init] {
        naga::Expression::Literal(naga::Literal::U32(v)) => Some(f64::from(v)),
        naga::Expression::Literal(naga::Literal::Bool(v)) => Some(f64::from(u8::from(v))),
        _ => None,
    }
}

/// Returns the overrides for which a pipeline key must give a value: those without a default, and those whose default is a literal. The defaults of
/// all other overrides are computed from them.
fn declared(module: &naga::Module) -> Vec<&str> {
    let is_own = |init: Option<naga::Handle<naga::Expression>>| {
        init.is_none_or(|init| matches!(module.global_expressions[init], naga::Expression::Literal(_)))
    };
    module.overrides.iter().filter(|(_, o)| is_own(o.init)).filter_map(|(_, o)| o.name.as_deref()).collect()
}

fn shading_module() -> (naga::Module, ModuleInfo) {
    let text = source(&shading::MODULE).text;
    validate(&text, Capabilities::empty()).unwrap_or_else(|e| panic!("{e}"))
}

#[test]
fn every_module_is_valid() {
    for Source { name, text, needs } in sources() {
        let (module, _) = validate(&text, needs).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert!(!module.entry_points.is_empty(), "{name} has no entry point");
        // Negative controls, for each module: a wrong type, an unknown name, a text that ends early, a capability that is not given.
        let with = |mistake: &str| validate(&format!("{text}\nfn planted(v: u32) -> f32 {{ return {mistake}; }}"), needs);
        assert!(with("f32(v)").is_ok(), "{name}: a valid function was refused");
        assert!(with("v").is_err(), "{name}: a function that returns the wrong type passed");
        assert!(with("nowhere(v)").is_err(), "{name}: a call of an unknown function passed");
        let end = text.trim_end().len() - 1;
        assert!(validate(&text[..end], needs).is_err(), "{name}: a module without its last brace passed");
        if !needs.is_empty() {
            assert!(validate(&text, Capabilities::empty()).is_err(), "{name}: valid without {needs:?}, so it does not need them");
        }
    }
}

/// Validates a file together with the files that it declares in `needs`, and without any other file. An error names the file.
fn alone(file: &'static Wgsl) -> Result<(), String> {
    let text = wgsl::joined(&wgsl::pieces(&[file]));
    // The file may belong to any module, so the capabilities of all modules are allowed.
    let capabilities = Capabilities::SHADER_FLOAT16_IN_FLOAT32 | Capabilities::SUBGROUP;
    validate(&text, capabilities).map(drop).map_err(|error| format!("{}: {error}", file.path))
}

#[test]
fn every_file_declares_what_it_needs_and_no_more() {
    for file in wgsl_files() {
        alone(file).unwrap_or_else(|error| panic!("{error}"));
        // A file must use a declaration of each file in its `needs`. Validation does not check this, because unused declarations are valid.
        let words = |text: &str| text.split(|c: char| !c.is_alphanumeric() && c != '_').map(str::to_owned).collect::<Vec<_>>();
        let used = words(file.text);
        for need in file.needs {
            let declares = |line: &str| {
                let line = line.trim_start_matches("@const ");
                ["fn ", "struct ", "const ", "override ", "var<private> ", "alias "]
                    .iter()
                    .find_map(|k| line.strip_prefix(k))
                    .map(|d| words(d)[0].clone())
                    .or_else(|| {
                        line.strip_prefix("@group").and_then(|rest| rest.split("var").nth(1)).and_then(|d| {
                            words(d)
                                .into_iter()
                                .find(|w| !w.is_empty() && !["uniform", "storage", "read", "read_write"].contains(&w.as_str()))
                        })
                    })
            };
            let constants = need.constants.iter().map(|(name, _)| (*name).to_owned());
            let names: Vec<String> = need.text.lines().filter_map(declares).chain(constants).collect();
            assert!(names.iter().any(|name| used.contains(name)), "{} needs {}, but uses nothing of it", file.path, need.path);
        }
    }
    // Negative control: a file is refused if one of the files that it uses is not in its `needs`. The error names the refused file.
    static LACKING: Wgsl = Wgsl::new("lacking.wgsl", "fn f(v: u32) -> u32 { return hash_pcg(v); }", &[&kernels::shared::USABLE]);
    let error = alone(&LACKING).expect_err("hash.wgsl is not among its needs");
    assert!(error.starts_with("lacking.wgsl: ") && error.contains("hash_pcg"), "{error}");
}

#[test]
fn shared_functions_begin_with_the_topic_of_their_file() {
    let text = wgsl::joined(&wgsl::pieces(kernels::shared::WGSL));
    let (module, _) = validate(&text, Capabilities::empty()).unwrap_or_else(|e| panic!("{e}"));
    assert!(module.global_variables.is_empty() && module.overrides.is_empty() && module.entry_points.is_empty());
    // Negative control: WGSL with a vector of the wrong size is invalid.
    let (right, wrong) = ("vec4<f32>(weights, 0.0)", "vec4<f32>(weights)");
    assert!(text.contains(right) && validate(&text.replacen(right, wrong, 1), Capabilities::empty()).is_err());
    let lacks = |file: &Wgsl| -> Vec<String> {
        let name = file.path.trim_start_matches("shared/");
        let topic = name.split(['_', '.']).next().expect("split gives at least one part");
        let functions = file.text.lines().filter(|line| line.starts_with("fn "));
        functions.filter(|line| !line[3..].starts_with(topic)).map(|line| format!("{name}: `{line}`")).collect()
    };
    for file in kernels::shared::WGSL {
        assert!(lacks(file).is_empty(), "functions without their topic as prefix: {:?}", lacks(file));
    }
    // Negative control: a file whose functions do not begin with its topic.
    assert!(!lacks(&Wgsl::new("shared/other.wgsl", kernels::shared::WGSL[0].text, &[])).is_empty());
}

#[test]
fn every_variant_resolves() {
    let shading = shading_module();
    let kernels = || Variant::all().map(Kernel::Variant).chain([Kernel::Generic]);
    let mut keys = Vec::new();
    for kernel in kernels() {
        for estimator in Estimator::ALL.into_iter().chain(Estimator::YARDSTICKS) {
            for diagnostics in [false, true] {
                // Do not combine every value of `noise` and `two_tilings` with every kernel, because an error in such a value does not depend on the
                // kernel. Instead, cycle through the values.
                let (noise, two_tilings) = (NoiseKind::ALL[keys.len() % NoiseKind::ALL.len()], keys.len() % 2 == 1);
                keys.push(PipelineKey { kernel, estimator, noise, two_tilings, diagnostics });
            }
        }
    }
    assert_eq!(keys.len(), (Variant::COUNT + 1) * (Estimator::ALL.len() + Estimator::YARDSTICKS.len()) * 2);
    for (index, key) in keys.into_iter().enumerate() {
        let flag = |bit: usize| index >> bit & 1 == 1;
        let overrides = key.overrides(Settings {
            colour_modulation: flag(0),
            anisotropic: flag(1),
            one_triangle: flag(2),
            tile: [4, 8, 16][index % 3],
        });
        let fragment = if key.diagnostics { "shading_fragment_counted" } else { "shading_fragment" };
        for entry in [(ShaderStage::Vertex, "shading_vertex"), (ShaderStage::Fragment, fragment)] {
            let resolved = resolve(&shading, entry, &overrides).unwrap_or_else(|e| panic!("{key:?}, {}: {e}", entry.1));
            let open = resolved.global_expressions.iter().any(|(_, e)| matches!(e, naga::Expression::Override(_)));
            assert!(!open, "{key:?}, {}: an override is left", entry.1);
            for (name, value) in overrides {
                // The vertex stage uses only some of the overrides, and naga removes the others from the result.
                let found = resolved_value(&resolved, name);
                assert!(found.is_none_or(|v| (v - value).abs() < 0.5), "{key:?}: {name} became {found:?}, not {value}");
            }
            assert!(resolved_value(&resolved, "VARIANT").is_some(), "{}: VARIANT is not used", entry.1);
        }
        // The key must give a value to every override that the module declares, so that no override keeps its default.
        let mut names = overrides.map(|(name, _)| name);
        let mut open = declared(&shading.0);
        names.sort_unstable();
        open.sort_unstable();
        assert_eq!(open, names);
    }
    // Negative controls: a misspelt name, a value out of the type's range, and a wrong entry point are errors; a given value is found in the result.
    let fragment = (ShaderStage::Fragment, "shading_fragment");
    assert!(resolve(&shading, fragment, &[("VARIANT", 3.0)]).is_ok());
    assert!(resolve(&shading, fragment, &[("VARIANTS", 3.0)]).is_err());
    assert!(resolve(&shading, fragment, &[("VARIANT", -1.0)]).is_err());
    assert!(resolve(&shading, (ShaderStage::Fragment, "shading_vertex"), &[]).is_err());
    let three = resolve(&shading, fragment, &[("VARIANT", 3.0)]).expect("just resolved");
    assert_eq!(resolved_value(&three, "VARIANT"), Some(3.0));
}

#[test]
fn other_stages_overrides_exist() {
    let stages: [(&ShaderModule, (ShaderStage, &str), &str); 4] = [
        (&geometry::MODULE, (ShaderStage::Vertex, "geometry_vertex"), "HAS_HOLES"),
        (&geometry::MODULE, (ShaderStage::Fragment, "geometry_fragment"), "HAS_HOLES"),
        (&geometry::MODULE, (ShaderStage::Vertex, "geometry_vertex"), "HAS_EDGE"),
        (&virtual_texture::PAGE_MODULE, (ShaderStage::Fragment, "page_fragment"), "COLOUR_MODULATION"),
    ];
    for (module, entry, name) in stages {
        let text = source(module).text;
        let module = validate(&text, Capabilities::empty()).unwrap_or_else(|e| panic!("{e}"));
        for value in [0.0, 1.0] {
            let resolved = resolve(&module, entry, &[(name, value)]).unwrap_or_else(|e| panic!("{}: {e}", entry.1));
            assert_eq!(resolved_value(&resolved, name), Some(value), "{}", entry.1);
        }
        // Negative control: an unknown name is an error.
        assert!(resolve(&module, entry, &[(&name[1..], 1.0)]).is_err());
    }
}

#[test]
fn overrides_without_default_must_be_given() {
    let text = "override OPEN: u32;
        @fragment fn main_fragment() -> @location(0) vec4<u32> { return vec4<u32>(OPEN); }";
    let module = validate(text, Capabilities::empty()).unwrap_or_else(|e| panic!("{e}"));
    let entry = (ShaderStage::Fragment, "main_fragment");
    assert!(resolve(&module, entry, &[]).is_err());
    assert!(resolve(&module, entry, &[("OPEN", 1.0)]).is_ok());
}
