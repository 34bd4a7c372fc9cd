//! Compares host structs with the WGSL structs into which they are copied, by reflection: names, offsets, sizes and scalar kinds of the fields. Also
//! compares constants of the host with those of the shaders.

use std::mem::offset_of;

use kernels::base::wgsl::{self, Piece};
use kernels::classification;
use kernels::composition::CompositionStream;
use kernels::culling;
use kernels::culling::{Patch, PatchBox};
use kernels::display::DisplayUniforms;
use kernels::inspect::Inspected;
use kernels::materials::PaletteEntry;
use kernels::metrics;
use kernels::metrics::{MeasureFrame, MeasurePart, SeedFrame};
use kernels::motion::{self, MotionFrame};
use kernels::occlusion::OcclusionBatch;
use kernels::shared::flavour_weights::FlavourParams;
use kernels::shared::motion::MotionPast;
use kernels::temporal::TemporalFrame;
use kernels::view::FrameUniforms;
use kernels::virtual_texture::PageJob;
use naga::{ScalarKind, TypeInner};

use crate::shaders::{sources, validate};

/// The type of a field of a host struct. `KIND` = its scalar kind (float, unsigned or signed); `None` = a struct, which is compared separately.
trait Field {
    const KIND: Option<ScalarKind>;
}

macro_rules! kinds {
    ($($kind:ident: $type:ty),*) => { $(impl Field for $type { const KIND: Option<ScalarKind> = Some(ScalarKind::$kind); })* };
}
kinds!(Float: f32, Uint: u32, Sint: i32);

impl<T: Field, const N: usize> Field for [T; N] {
    const KIND: Option<ScalarKind> = T::KIND;
}

impl Field for FlavourParams {
    const KIND: Option<ScalarKind> = None;
}

impl Field for MotionPast {
    const KIND: Option<ScalarKind> = None;
}

/// Name, offset, size and scalar kind of a field.
type Row = (String, usize, usize, Option<ScalarKind>);

#[derive(Debug, PartialEq)]
struct Layout {
    fields: Vec<Row>,
    size: usize,
}

/// Returns the size and the scalar kind of the field that a function `|s| &s.field` returns. The function is not called; only its type is used.
fn shape<T, F: Field>(_: fn(&T) -> &F) -> (usize, Option<ScalarKind>) {
    (size_of::<F>(), F::KIND)
}

/// The layout of a host struct. If a field is left out, the macro call does not compile.
macro_rules! host {
    ($type:ident { $($field:ident),* $(,)? }) => {{
        let _ = |all: $type| { let $type { $($field: _),* } = all; };
        Layout {
            fields: vec![$({
                let (size, kind) = shape(|s: &$type| &s.$field);
                (stringify!($field).to_owned(), offset_of!($type, $field), size, kind)
            }),*],
            size: size_of::<$type>(),
        }
    }};
}

/// The layout of a struct in a shader module; `None` = the module does not declare it.
fn shader(module: &naga::Module, name: &str) -> Option<Layout> {
    let (members, span) = module.types.iter().find_map(|(_, t)| match &t.inner {
        TypeInner::Struct { members, span } if t.name.as_deref() == Some(name) => Some((members, *span)),
        _ => None,
    })?;
    let fields = members
        .iter()
        .map(|m| {
            let inner = &module.types[m.ty].inner;
            let kind = match inner {
                TypeInner::Scalar(scalar) | TypeInner::Atomic(scalar) => Some(scalar.kind),
                TypeInner::Vector { scalar, .. } | TypeInner::Matrix { scalar, .. } => Some(scalar.kind),
                _ => None,
            };
            (m.name.clone().unwrap_or_default(), m.offset as usize, inner.size(module.to_ctx()) as usize, kind)
        })
        .collect();
    Some(Layout { fields, size: span as usize })
}

/// Host structs with the name of their WGSL counterpart.
fn pairs() -> Vec<(&'static str, Layout)> {
    let mut patch = host!(Patch { node_origin, spacing, slot, patch, deltas, lod });
    // `patch` is a reserved word of WGSL, so the field is called `patch_xy` there.
    for (name, ..) in &mut patch.fields {
        if name == "patch" {
            name.push_str("_xy");
        }
    }
    vec![
        (
            "Frame",
            host!(FrameUniforms {
                clip_from_local,
                camera,
                sector_m,
                ray_00,
                near_m,
                ray_dx,
                height_low_m,
                ray_dy,
                height_span_m,
                camera_sector,
                size,
                seed,
                frame,
                forced_mask,
                page_levels,
                tiles,
                hash_scale,
                height_sharpness,
                triplanar_sharpness,
                gradient_scale,
                page_texels_per_m,
                page_anisotropy,
                flavours,
                sun_direction,
                taps,
                sun_irradiance,
                noise_world_level,
                sky_zenith,
                sample_pattern,
                sky_horizon,
                normals,
                data_low,
                data_high,
            }),
        ),
        (
            "FlavourParams",
            host!(FlavourParams {
                far_atlas_m,
                cliff_far_atlas_m,
                cliff_near_m,
                distance_blend,
                cliff_cos,
                splat_cos,
                splat_enabled,
                vt_enabled,
                padding,
            }),
        ),
        ("Patch", patch),
        (
            "PaletteEntry",
            host!(PaletteEntry {
                albedo_layer,
                normal_layer,
                height_layer,
                flags,
                per_sector_fixed,
                per_metre,
                tint,
                normal_strength,
                mean_albedo,
                mean_smoothness,
            }),
        ),
        ("Inspected", host!(Inspected { position, slot, ddx, corner, ddy, plane, splat, bilinear, blended })),
        ("DisplayUniforms", host!(DisplayUniforms { exposure, curve, pad_0, pad_1 })),
        ("PageJob", host!(PageJob { sector, origin, texel_m, border })),
        ("CompositionStream", host!(CompositionStream { mask, modulated, squared, lit })),
        ("MotionPast", host!(MotionPast { offset, x_shift, forward, y_shift, x_row, pad_0, y_row, pad_1 })),
        ("MotionFrame", host!(MotionFrame { past, lags, slot, tolerance, quarter, past_slots })),
        (
            "MeasureFrame",
            host!(MeasureFrame {
                size,
                blocks,
                slot,
                lags,
                quarter,
                referenced,
                past_slots,
                memory_slot,
                memory_before,
                adaptation,
                pad_0
            }),
        ),
        ("OcclusionBatch", host!(OcclusionBatch { first, count, order, instances })),
        ("OcclusionBox", host!(PatchBox { low, pad_0, high, pad_1 })),
        (
            "MeasurePart",
            host!(MeasurePart {
                links,
                differences,
                residuals,
                residual_squares,
                change_squares,
                reference_squares,
                products,
                terrain,
                fetches,
                rejections,
                quarter_terrain,
                invalid,
                pad_0,
                pad_1,
                pad_2
            }),
        ),
        ("SeedFrame", host!(SeedFrame { size, tiles, blocks, block, count, offset, zero, pad_1, pad_2 })),
        (
            "TemporalFrame",
            host!(TemporalFrame {
                size,
                slot,
                past_slot,
                has_past,
                flipquad,
                exponential,
                share,
                neighbour,
                past_neighbour,
                history_in,
                history_out,
                pad_0,
                pad_1,
            }),
        ),
    ]
}

#[test]
fn host_structs_have_the_shaders_layout() {
    let modules: Vec<_> = sources()
        .into_iter()
        .map(|s| (s.name, validate(&s.text, naga::valid::Capabilities::all()).unwrap_or_else(|e| panic!("{e}")).0))
        .collect();
    for (name, host) in pairs() {
        let found: Vec<_> = modules.iter().filter_map(|(module, m)| Some((module, shader(m, name)?))).collect();
        assert!(!found.is_empty(), "no module declares `{name}`");
        for (module, layout) in found {
            assert_eq!(host, layout, "`{name}` of {module}: host left, shader right");
        }
    }
}

#[test]
fn indirect_draws_have_the_shaders_layout() {
    let text = sources().into_iter().find(|s| s.name == "classification, plain").expect("there is such a module").text;
    let (module, _) = validate(&text, naga::valid::Capabilities::empty()).unwrap_or_else(|e| panic!("{e}"));
    let layout = shader(&module, "DrawArguments").expect("the classification pass writes indirect draws");
    // The WebGPU specification (drawIndirect) gives these four 32-bit words in this order.
    let names = ["vertex_count", "instance_count", "first_vertex", "first_instance"];
    let expected: Vec<Row> = (0..).zip(names).map(|(i, name)| (name.to_owned(), i * 4, 4, Some(ScalarKind::Uint))).collect();
    assert_eq!(layout, Layout { fields: expected, size: 16 });
    assert_eq!(layout.size as u64, classification::ARGUMENT_BYTES);
}

/// Negative controls: the comparison must notice each of these changes.
#[test]
fn layout_comparison_notices_drift() {
    #[allow(dead_code, reason = "only its layout is looked at")]
    #[repr(C)]
    struct Ours {
        cell: [i32; 2],
        edge_m: f32,
        slot: u32,
        place: [f32; 3],
        count: u32,
    }
    let ours = host!(Ours { cell, edge_m, slot, place, count });
    let of = |body: &str| {
        let text = format!("struct Ours {{ {body} }} @group(0) @binding(0) var<storage, read> list: array<Ours>;");
        shader(&validate(&text, naga::valid::Capabilities::empty()).unwrap_or_else(|e| panic!("{e}")).0, "Ours").expect("declared")
    };
    let right = "cell: vec2<i32>, edge_m: f32, slot: u32, place: vec3<f32>, count: u32";
    assert_eq!(ours, of(right));
    for (change, wrong) in [
        ("fields swapped", "cell: vec2<i32>, slot: u32, edge_m: f32, place: vec3<f32>, count: u32"),
        ("a field renamed", "cell: vec2<i32>, edge: f32, slot: u32, place: vec3<f32>, count: u32"),
        ("another kind of number", "cell: vec2<u32>, edge_m: f32, slot: u32, place: vec3<f32>, count: u32"),
        ("a field missing", "cell: vec2<i32>, edge_m: f32, slot: u32, place: vec3<f32>"),
        ("a field too many", "cell: vec2<i32>, edge_m: f32, slot: u32, place: vec3<f32>, count: u32, more: u32"),
        ("another width", "cell: vec3<i32>, edge_m: f32, slot: u32, place: vec3<f32>, count: u32"),
        // In WGSL, a vec3 starts at a multiple of 16 bytes. In the host struct, an array of three numbers may start elsewhere.
        ("alignment", "place: vec3<f32>, count: u32, cell: vec2<i32>, slot: u32, edge_m: f32"),
    ] {
        assert_ne!(ours, of(wrong), "{change}: not noticed");
    }
}

/// The numeric constants of a module, by name.
pub(crate) fn constants(pieces: &[Piece]) -> std::collections::BTreeMap<String, f64> {
    let module = naga::front::wgsl::parse_str(&wgsl::joined(pieces)).expect("the module parses");
    let value = |init| match &module.global_expressions[init] {
        naga::Expression::Literal(naga::Literal::F32(v)) => Some(f64::from(*v)),
        naga::Expression::Literal(naga::Literal::U32(v)) => Some(f64::from(*v)),
        naga::Expression::Literal(naga::Literal::I32(v)) => Some(f64::from(*v)),
        _ => None,
    };
    module.constants.iter().filter_map(|(_, c)| Some((c.name.clone()?, value(c.init)?))).collect()
}

#[test]
fn constants_that_the_host_hands_over_arrive() {
    use kernels::{quadtree, residency, virtual_texture as vt, world};
    let shading = constants(&kernels::shading::MODULE.pieces());
    let geometry = constants(&kernels::geometry::MODULE.pieces());
    let measure = constants(&metrics::MODULE.pieces());
    let expected = [
        (&measure, "MEASURE_BINS", metrics::BINS as f64),
        (&measure, "MEASURE_NO_LINK", f64::from(motion::NO_LINK)),
        (&shading, "VIRTUAL_STORED_TEXELS", f64::from(vt::STORED_TEXELS)),
        (&shading, "VIRTUAL_WINDOW", f64::from(vt::WINDOW)),
        (&shading, "TERRAIN_SECTORS", f64::from(world::SECTORS)),
        (&shading, "TERRAIN_LODS", f64::from(world::LODS)),
        (&geometry, "GEOMETRY_NODE_QUADS", f64::from(world::NODE_QUADS)),
        (&geometry, "GEOMETRY_PATCH_QUADS", f64::from(culling::PATCH_QUADS)),
    ];
    for (module, name, host) in expected {
        assert_eq!(module.get(name), Some(&host), "{name}");
    }
    // A slot must fit into its bits of the sector data, and the array layer of a cached page into its bits of the page table.
    const { assert!(residency::CAPACITY < 1 << quadtree::SLOT_BITS && vt::CAPACITY < 2047) };
    // No shader repeats a constant that the host passes to a different shader: each name is declared only once in all files that a renderer uses.
    let mut declared = std::collections::BTreeMap::new();
    for file in kernels::frame::shader_files() {
        let typed = file.text.lines().filter_map(|line| line.strip_prefix("const ")?.split(':').next());
        for name in typed.chain(file.constants.iter().map(|(name, _)| *name)) {
            let before = declared.insert(name.to_owned(), file.path);
            assert_eq!(before, None, "{name} is declared in {} and elsewhere", file.path);
        }
    }
}
