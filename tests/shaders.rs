//! Every shader module as naga sees it: parsed, validated, and its overrides resolved, without a device.
//!
//! What a device would only say when a variant is first wanted (and some backends never say) is said here for all of them.

use kernels::shading::{Estimator, Kernel, PipelineKey, Settings};
use kernels::shared::noise::NoiseKind;
use kernels::variant::Variant;
use kernels::{classification, composition, geometry, inspect, lighting, metrics, motion, shading, temporal, virtual_texture};
use naga::ShaderStage;
use naga::back::PipelineConstants;
use naga::back::pipeline_constants::process_overrides;
use naga::valid::{Capabilities, ModuleInfo, ValidationFlags, Validator};

type Files = Vec<(&'static str, &'static str)>;

/// A shader module as the stages make it.
pub(crate) struct Source {
    pub(crate) name: &'static str,
    pub(crate) text: String,
    /// What it needs beyond the base that every adapter has.
    needs: Capabilities,
}

fn source(name: &'static str, files: &Files, needs: Capabilities) -> Source {
    Source { name, text: files.iter().flat_map(|(_, text)| [*text, "\n"]).collect(), needs }
}

/// Every module that a device is given.
pub(crate) fn sources() -> Vec<Source> {
    let base = Capabilities::empty();
    // Packing to f16 in a word, which every adapter has: WGSL's pack2x16float.
    let half = Capabilities::SHADER_FLOAT16_IN_FLOAT32;
    vec![
        source("geometry", &geometry::files(), base),
        source("pages", &virtual_texture::page_files(), base),
        source("page requests", &virtual_texture::request_files(), base),
        source("classification, subgroups", &classification::files(true), Capabilities::SUBGROUP),
        source("classification, plain", &classification::files(false), base),
        source("shading", &shading::files(), base),
        source("lighting", &lighting::files(), base),
        source("inspect", &inspect::files(), base),
        source("composition", &composition::files(), half),
        source("motion", &motion::files(), base),
        source("temporal", &temporal::files(), half),
        source("measure", &metrics::files(), half),
        source("seeds", &metrics::seeds_files(), half),
    ]
}

/// Parses and validates, given no more than `capabilities`.
pub(crate) fn validate(text: &str, capabilities: Capabilities) -> Result<(naga::Module, ModuleInfo), String> {
    let module = naga::front::wgsl::parse_str(text).map_err(|e| e.emit_to_string(text))?;
    let info = Validator::new(ValidationFlags::all(), capabilities).validate(&module).map_err(|e| e.emit_to_string(text))?;
    Ok((module, info))
}

/// The module of an entry point with these overrides. Names that it does not declare are an error, and so are overrides without default
/// that are not given.
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

/// Values of the constants that overrides became, of those that the entry point uses.
fn resolved_value(module: &naga::Module, name: &str) -> Option<f64> {
    let (_, constant) = module.constants.iter().find(|(_, c)| c.name.as_deref() == Some(name))?;
    match module.global_expressions[constant.init] {
        naga::Expression::Literal(naga::Literal::U32(v)) => Some(f64::from(v)),
        naga::Expression::Literal(naga::Literal::Bool(v)) => Some(f64::from(u8::from(v))),
        _ => None,
    }
}

/// Overrides that a key decides: those whose default is a number of its own, and does not follow from others.
fn declared(module: &naga::Module) -> Vec<&str> {
    let is_own = |init: Option<naga::Handle<naga::Expression>>| {
        init.is_none_or(|init| matches!(module.global_expressions[init], naga::Expression::Literal(_)))
    };
    module.overrides.iter().filter(|(_, o)| is_own(o.init)).filter_map(|(_, o)| o.name.as_deref()).collect()
}

fn shading_module() -> (naga::Module, ModuleInfo) {
    let text = source("shading", &shading::files(), Capabilities::empty()).text;
    validate(&text, Capabilities::empty()).unwrap_or_else(|e| panic!("{e}"))
}

#[test]
fn every_module_is_valid() {
    for Source { name, text, needs } in sources() {
        let (module, _) = validate(&text, needs).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert!(!module.entry_points.is_empty(), "{name} has no entry point");
        // Negative controls, for each module: a wrong type, an unknown name, a text that ends early, a capability that is not given.
        let broken = text.replacen("fn hash_pcg(v: u32) -> u32 {", "fn hash_pcg(v: u32) -> f32 {", 1);
        assert!(broken != text && validate(&broken, needs).is_err(), "{name}: a function that returns the wrong type passed");
        let unknown = text.replacen("hash_pcg(seed)", "hash_pgc(seed)", 1);
        assert!(unknown != text && validate(&unknown, needs).is_err(), "{name}: a call of an unknown function passed");
        let end = text.trim_end().len() - 1;
        assert!(validate(&text[..end], needs).is_err(), "{name}: a module without its last brace passed");
        if !needs.is_empty() {
            assert!(validate(&text, Capabilities::empty()).is_err(), "{name}: valid without {needs:?}, so it does not need it");
        }
    }
}

#[test]
fn every_variant_resolves() {
    let shading = shading_module();
    let kernels = || Variant::all().map(Kernel::Variant).chain([Kernel::Generic]);
    let mut keys = Vec::new();
    for kernel in kernels() {
        for estimator in Estimator::ALL.into_iter().chain(Estimator::YARDSTICKS) {
            for diagnostics in [false, true] {
                // The rest of the key takes turns: a value is wrong for all kernels or for none.
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
                // The vertex stage uses one of them, and what is not used is taken out.
                let found = resolved_value(&resolved, name);
                assert!(found.is_none_or(|v| (v - value).abs() < 0.5), "{key:?}: {name} became {found:?}, not {value}");
            }
            assert!(resolved_value(&resolved, "VARIANT").is_some(), "{}: VARIANT is not used", entry.1);
        }
        // All that the module leaves open is decided by the key: none rests on a default.
        let mut names = overrides.map(|(name, _)| name);
        let mut open = declared(&shading.0);
        names.sort_unstable();
        open.sort_unstable();
        assert_eq!(open, names);
    }
    // Negative controls: a misspelt name, a value out of the type's range, a wrong entry point, a value that the comparison must notice.
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
    let stages: [(&Files, (ShaderStage, &str), &str); 3] = [
        (&geometry::files(), (ShaderStage::Vertex, "geometry_vertex"), "HAS_HOLES"),
        (&geometry::files(), (ShaderStage::Fragment, "geometry_fragment"), "HAS_HOLES"),
        (&virtual_texture::page_files(), (ShaderStage::Fragment, "page_fragment"), "COLOUR_MODULATION"),
    ];
    for (files, entry, name) in stages {
        let text = source("", files, Capabilities::empty()).text;
        let module = validate(&text, Capabilities::empty()).unwrap_or_else(|e| panic!("{e}"));
        for value in [0.0, 1.0] {
            let resolved = resolve(&module, entry, &[(name, value)]).unwrap_or_else(|e| panic!("{}: {e}", entry.1));
            assert_eq!(resolved_value(&resolved, name), Some(value), "{}", entry.1);
        }
        // Negative control.
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
