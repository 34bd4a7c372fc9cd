//! Detail textures: where they come from, how they are stored, and the palette that refers to them.
//!
//! A terrain material is a set of maps ([`MaterialMaps`], procedural or from a folder of images), and values such as the size of a repeat on the
//! ground, the rotation and the tint. The maps become three block-compressed texture arrays ([`DetailArrays`]). The values become a table of
//! [`PaletteEntry`]; each texel of the splat map is an index into this table.
//! Source: Moore, *Terrain Rendering in Far Cry 5*, GDC 2018, on materials: at most 32 textures of a type, 256 palette entries.

use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;

use crate::base::cache::{Cache, Key};
use crate::base::error::{Error, Result};
use crate::scene::{Material, Scene};
use crate::shared::layers::LAYERS;

pub mod arrays;
pub mod folder;
pub mod procedural;

mod stored;

pub use arrays::{CompressedChain, DetailArrays, MAX_LAYERS};

/// Largest number of materials: an 8-bit splat texel can refer to this many palette entries.
pub const MAX_MATERIALS: usize = 256;

/// The number of repeats of a texture along a sector must be smaller than this. With sectors of 64 m, this excludes repeats of less than about 1 mm.
/// The limit does not come from the fixed-point format of [`PaletteEntry::per_sector_fixed`], which counts whole repeats modulo 256.
pub const MAX_REPEATS_PER_SECTOR: f64 = 65_536.0;

/// Bit of [`PaletteEntry::flags`]: the tint is not white, so the colour mask has an effect.
pub const FLAG_TINTED: u32 = 1;

/// Position of the lowest of the 3 bits in [`PaletteEntry::flags`] that hold the number of a layer, 0..=7. This layer represents the
/// material in the estimator `luna8`, which blends eight layers. Each of the first eight materials is a layer. Any other material is
/// represented by the layer with the nearest mean albedo.
pub const LAYER_SHIFT: u32 = 8;

/// Uncompressed maps of one material: `size` x `size` texels, row-major, tiling in both directions.
///
/// Texel (column i, row j) covers u in [i, i+1) / size and v in [j, j+1) / size: row 0 lies at v = 0, and v grows with the row.
#[derive(Clone, Debug, PartialEq)]
pub struct MaterialMaps {
    /// Edge length in texels.
    pub size: u32,
    /// Diffuse albedo, linear RGB, 0..1.
    pub albedo: Vec<[f32; 3]>,
    /// x and y of the unit tangent-space normal; x towards +u, y towards +v (the OpenGL convention), z = sqrt(1 - x² - y²) >= 0.
    pub normal: Vec<[f32; 2]>,
    /// 1 - perceptual roughness, 0..1.
    pub smoothness: Vec<f32>,
    /// Share of specular light that reaches the surface, 0..1.
    pub specular_occlusion: Vec<f32>,
    /// Height within the material's own relief, 0 (lowest) to 1 (highest).
    pub height: Vec<f32>,
    /// Share of the material's tint that is applied, 0..1: 0 = the albedo is unchanged, 1 = the albedo is multiplied by the tint.
    pub colour_mask: Vec<f32>,
}

/// Means of a material over its whole texture. They show how the material looks from far away.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MaterialMeans {
    /// Mean linear albedo, tint applied: the mean of albedo * mix(1, tint, colour mask).
    pub albedo: [f32; 3],
    /// Mean smoothness, 0..1.
    pub smoothness: f32,
    /// Mean specular occlusion, 0..1.
    pub specular_occlusion: f32,
}

impl MaterialMeans {
    /// Means (summed in f64) of `maps` under a linear RGB `tint`.
    pub fn of(maps: &MaterialMaps, tint: [f64; 3]) -> MaterialMeans {
        TextureMeans::of(maps).tinted(tint)
    }
}

/// Means of a texture. The means of a material with any tint follow from them.
#[derive(Clone, Copy, Debug, PartialEq)]
struct TextureMeans {
    /// Mean albedo, linear RGB.
    albedo: [f64; 3],
    /// Mean of the product of albedo and colour mask.
    masked: [f64; 3],
    smoothness: f32,
    specular_occlusion: f32,
}

impl TextureMeans {
    fn of(maps: &MaterialMaps) -> TextureMeans {
        let count = maps.albedo.len() as f64;
        let (mut albedo, mut masked) = ([0.0_f64; 3], [0.0_f64; 3]);
        for (texel, &mask) in maps.albedo.iter().zip(&maps.colour_mask) {
            for c in 0..3 {
                albedo[c] += f64::from(texel[c]);
                masked[c] += f64::from(texel[c]) * f64::from(mask);
            }
        }
        let mean = |values: &[f32]| (values.iter().copied().map(f64::from).sum::<f64>() / count) as f32;
        TextureMeans {
            albedo: albedo.map(|sum| sum / count),
            masked: masked.map(|sum| sum / count),
            smoothness: mean(&maps.smoothness),
            specular_occlusion: mean(&maps.specular_occlusion),
        }
    }

    fn tinted(&self, tint: [f64; 3]) -> MaterialMeans {
        MaterialMeans {
            albedo: [0, 1, 2].map(|c| (self.albedo[c] + (tint[c] - 1.0) * self.masked[c]) as f32),
            smoothness: self.smoothness,
            specular_occlusion: self.specular_occlusion,
        }
    }
}

/// One material as shaders read it: 64 bytes, four 16-byte rows, with the layout of `PaletteEntry` in WGSL.
///
/// Texture coordinates of a point (x east, y north, metres): u = x cos + y sin, v = -x sin + y cos, both divided by the size of one repeat,
/// `tile_m`. cos and sin are those of the orientation of the material.
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct PaletteEntry {
    /// Layer of the albedo array.
    pub albedo_layer: u32,
    /// Layer of the normal, smoothness and specular-occlusion array.
    pub normal_layer: u32,
    /// Layer of the height and colour-mask array.
    pub height_layer: u32,
    /// Bit field: [`FLAG_TINTED`], and from bit [`LAYER_SHIFT`] on the layer that represents the material in the estimator `luna8`.
    pub flags: u32,
    /// Repeats per sector times cos and times sin, in units of 2^-24 repeats. They are integers so that texture coordinates do not lose precision
    /// far from the origin.
    pub per_sector_fixed: [i32; 2],
    /// cos and sin, divided by the size of one repeat, 1/m; for coordinates inside a sector.
    pub per_metre: [f32; 2],
    /// Linear RGB multiplier where the colour mask is 1.
    pub tint: [f32; 3],
    /// Factor on the normal map's slope: 1 = as authored, 0 = flat.
    pub normal_strength: f32,
    /// Mean linear albedo of the material, as in [`MaterialMeans::albedo`].
    pub mean_albedo: [f32; 3],
    /// Mean smoothness of the material, as in [`MaterialMeans::smoothness`].
    pub mean_smoothness: f32,
}

/// Every material of a scene, ready for upload.
#[derive(Clone, Debug)]
pub struct Palette {
    /// One entry per material, in the order of the scene. The splat map contains indices into this list.
    pub entries: Vec<PaletteEntry>,
    /// The compressed textures to which the entries refer.
    pub arrays: DetailArrays,
    /// Means of each material. Node payloads are baked from them.
    pub means: Vec<MaterialMeans>,
    /// Source and means of each layer of the arrays.
    layers: Vec<Texture>,
}

/// What a layer of the texture arrays was made from, and the mean values of its texture.
#[derive(Clone, Debug, PartialEq)]
struct Texture {
    source: Source,
    contrast: f64,
    means: TextureMeans,
}

/// Seed of all procedural materials. It is constant, because textures must not change with the seed of the world.
const TEXTURE_SEED: u32 = 5;

/// Largest number of sources whose uncompressed maps are in memory at the same time. The maps of one source with 2048² texels take about
/// 150 MB.
pub(crate) const SOURCES_AT_ONCE: usize = 4;

/// The source of a set of maps. Materials with equal sources share a layer.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Source {
    Procedural(String),
    Folder(PathBuf),
}

impl Source {
    fn of(material: &Material, scene: &Scene) -> Result<Source> {
        match (&material.procedural, &material.folder) {
            (Some(kind), None) => {
                procedural::known(kind, &material.name)?;
                Ok(Source::Procedural(kind.clone()))
            }
            (None, Some(folder)) => Ok(Source::Folder(scene.folder.join(folder))),
            _ => Err(wrong(&material.name, "give exactly one of `procedural` and `folder`".to_owned())),
        }
    }

    /// The key of the texture in the cache; `None` = the texture is not kept, because its image files may change.
    fn key(&self, size: u32, contrast: f64) -> Option<Key> {
        match self {
            Source::Procedural(kind) => Some(Key::of("texture", (kind, TEXTURE_SEED, size, contrast.to_bits()))),
            Source::Folder(_) => None,
        }
    }
}

fn wrong(name: &str, what: String) -> Error {
    Error::Material { name: name.to_owned(), what }
}

impl Palette {
    /// Makes or reads every distinct texture of the scene once, compresses it, and lists the materials.
    ///
    /// `sector_m` is the edge of a sector in metres; the entries hold the number of repeats per sector. `progress` is called from worker threads
    /// with a line of text when a texture is begun; if it returns an error, `build` stops with an error. The result depends on the scene, its image
    /// files, and `sector_m`.
    ///
    /// # Errors
    /// The error that `progress` returns; no materials or more than [`MAX_MATERIALS`]; more than [`MAX_LAYERS`] distinct textures; a
    /// `detail_size` that is not a power of two in 64..=2048; an unknown procedural name; a material with both or neither of `procedural` and
    /// `folder`; and the errors of [`check_repeats`] and [`folder::load`].
    pub fn build(scene: &Scene, sector_m: f64, progress: impl Fn(&str) -> Result<()> + Sync) -> Result<Palette> {
        Palette::made(scene, scene.detail_size, sector_m, [None, None], None, &progress)
    }

    /// Does the same as [`Palette::sketch`], but reads procedural textures from `cache`, and adds those that it lacks.
    ///
    /// # Errors
    /// The same errors as [`Palette::build`].
    pub fn kept(
        scene: &Scene,
        size: u32,
        sector_m: f64,
        cache: Option<&Cache>,
        progress: impl Fn(&str) -> Result<()> + Sync,
    ) -> Result<Palette> {
        Palette::made(scene, size, sector_m, [None, None], cache, &progress)
    }

    /// Does the same as [`Palette::build`], but with textures of `size` texels along an edge instead of the scene's `detail_size`. With small
    /// textures, this is much faster. The result serves as a preview.
    ///
    /// # Errors
    /// The same errors as [`Palette::build`].
    pub fn sketch(scene: &Scene, size: u32, sector_m: f64, progress: impl Fn(&str) -> Result<()> + Sync) -> Result<Palette> {
        Palette::made(scene, size, sector_m, [None, None], None, &progress)
    }

    /// Does the same as [`Palette::build`], but copies every texture that this palette or the palette `former` already contains with the same
    /// source, size and material contrast. The image files of such a texture are not read again.
    ///
    /// # Errors
    /// The same errors as [`Palette::build`].
    pub fn rebuilt(
        &self,
        scene: &Scene,
        former: Option<&Palette>,
        sector_m: f64,
        progress: impl Fn(&str) -> Result<()> + Sync,
    ) -> Result<Palette> {
        Palette::made(scene, scene.detail_size, sector_m, [Some(self), former], None, &progress)
    }

    /// Returns the indices of the layers whose source, material contrast or means differ from those of the same layer of `before`; `None` if the
    /// number or the size of the layers differs.
    pub fn fresh_layers(&self, before: &Palette) -> Option<Vec<usize>> {
        let alike = self.arrays.size == before.arrays.size && self.layers.len() == before.layers.len();
        alike.then(|| (0..self.layers.len()).filter(|&layer| self.layers[layer] != before.layers[layer]).collect())
    }

    fn made(
        scene: &Scene,
        size: u32,
        sector_m: f64,
        before: [Option<&Palette>; 2],
        cache: Option<&Cache>,
        progress: &(dyn Fn(&str) -> Result<()> + Sync),
    ) -> Result<Palette> {
        let of_scene = |what: String| Error::Scene { where_: scene.name.clone(), what };
        let count = scene.materials.len();
        if count == 0 || count > MAX_MATERIALS {
            return Err(of_scene(format!(
                "the scene has {count} materials, but it must have 1 to {MAX_MATERIALS}, because a splat texel stores the index of a material in 8 bits: add or remove [[material]] tables"
            )));
        }
        if !size.is_power_of_two() || !(64..=2048).contains(&size) {
            return Err(of_scene(format!("detail_size = {size}: give a power of two from 64 to 2048")));
        }
        // First check what needs no texture, because reading a texture may take seconds.
        let mut sources: Vec<(Source, &str)> = Vec::new();
        let mut layer_of = Vec::with_capacity(count);
        for material in &scene.materials {
            placement(material, sector_m)?;
            let source = Source::of(material, scene)?;
            layer_of.push(sources.iter().position(|(known, _)| *known == source).unwrap_or_else(|| {
                sources.push((source, &material.name));
                sources.len() - 1
            }));
        }
        if sources.len() > MAX_LAYERS {
            return Err(of_scene(format!(
                "the scene has {} distinct detail textures of each type, but at most {MAX_LAYERS} are possible: use the same `procedural` or `folder` in several materials, which may differ in tint, tile_m and orientation_deg",
                sources.len()
            )));
        }

        let total = sources.len();
        let contrast = scene.blend.material_contrast;
        let known = |source: &Source| {
            before.into_iter().flatten().filter(|palette| palette.arrays.size == size).find_map(|palette| {
                let is_it = |t: &Texture| t.source == *source && t.contrast.to_bits() == contrast.to_bits();
                let layer = palette.layers.iter().position(is_it)?;
                Some((palette.arrays.layer(layer), palette.layers[layer].clone()))
            })
        };
        let begun = AtomicUsize::new(0);
        let mut arrays = DetailArrays { size, albedo: Vec::new(), normal: Vec::new(), height: Vec::new() };
        let mut textures = Vec::with_capacity(total);
        for chunk in sources.chunks(SOURCES_AT_ONCE) {
            let done: Vec<_> = chunk
                .par_iter()
                .map(|(source, name)| {
                    if let Some(known) = known(source) {
                        return Ok(known);
                    }
                    let kept = cache.and_then(|cache| Some((cache, source.key(size, contrast)?)));
                    let read = |(cache, key): (&Cache, Key)| stored::from_bytes(size, &cache.read(key, &size.to_string())?);
                    if let Some((layers, means)) = kept.and_then(read) {
                        return Ok((layers, Texture { source: source.clone(), contrast, means }));
                    }
                    progress(&format!("detail texture {} of {total}: {name}", begun.fetch_add(1, Ordering::Relaxed) + 1))?;
                    let mut maps = match source {
                        Source::Procedural(kind) => procedural::make(kind, size, TEXTURE_SEED)?,
                        Source::Folder(path) => folder::load(name, path, size)?,
                    };
                    set_contrast(&mut maps, contrast);
                    let texture = Texture { source: source.clone(), contrast, means: TextureMeans::of(&maps) };
                    let layers = arrays::compress(&maps);
                    if let Some((cache, key)) = kept {
                        cache.write(key, &size.to_string(), &stored::to_bytes(&layers, &texture.means));
                    }
                    Ok((layers, texture))
                })
                .collect::<Result<_>>()?;
            for (layer, texture) in done {
                arrays.push(layer);
                textures.push(texture);
            }
        }

        let means: Vec<MaterialMeans> =
            scene.materials.iter().zip(&layer_of).map(|(m, &layer)| textures[layer].means.tinted(m.tint)).collect();
        let layers = layers_of(&means);
        let flags = |material: &Material| {
            if material.tint.iter().any(|&t| (t - 1.0).abs() > f64::from(f32::EPSILON)) { FLAG_TINTED } else { 0 }
        };
        let entries = scene
            .materials
            .iter()
            .enumerate()
            .map(|(m, material)| {
                let (per_sector_fixed, per_metre) = placement(material, sector_m)?;
                let layer = u32::try_from(layer_of[m]).expect("there are at most 32 layers");
                Ok(PaletteEntry {
                    albedo_layer: layer,
                    normal_layer: layer,
                    height_layer: layer,
                    flags: flags(material) | layers[m] << LAYER_SHIFT,
                    per_sector_fixed,
                    per_metre,
                    tint: material.tint.map(|t| t as f32),
                    normal_strength: material.normal_strength as f32,
                    mean_albedo: means[m].albedo,
                    mean_smoothness: means[m].smoothness,
                })
            })
            .collect::<Result<_>>()?;
        Ok(Palette { entries, arrays, means, layers: textures })
    }
}

/// The colour towards which the mean colours of materials are moved: 18 % grey, the middle grey of photographic metering.
const MIDDLE_GREY: f64 = 0.18;

/// Multiplies the distance of the mean colour of `maps` from middle grey by `contrast`. The wanted mean of each channel is limited to the range from
/// 0.005 to 0.95. All texels of a channel are multiplied by the same factor, so that the relative contrast inside a texture does not change. Products
/// above 1 are then set to 1.
fn set_contrast(maps: &mut MaterialMaps, contrast: f64) {
    if (contrast - 1.0).abs() < f64::EPSILON {
        return;
    }
    let mean = MaterialMeans::of(maps, [1.0; 3]).albedo;
    let factor = mean.map(|m| {
        let wanted = (MIDDLE_GREY + contrast * (f64::from(m) - MIDDLE_GREY)).clamp(0.005, 0.95);
        if m > 0.0 { (wanted / f64::from(m)) as f32 } else { 1.0 }
    });
    for texel in &mut maps.albedo {
        *texel = std::array::from_fn(|c| (texel[c] * factor[c]).min(1.0));
    }
}

/// Returns, for each material, the layer that represents it in a blend of eight layers (see [`LAYER_SHIFT`]). If several layers are equally near, the
/// one with the lowest index represents the material.
fn layers_of(means: &[MaterialMeans]) -> Vec<u32> {
    let distance = |a: &MaterialMeans, b: &MaterialMeans| (0..3).map(|c| (a.albedo[c] - b.albedo[c]).powi(2)).sum::<f32>();
    let layers = &means[..means.len().min(LAYERS)];
    let nearest = |of: &MaterialMeans| (0_u32..).zip(layers).min_by(|(_, a), (_, b)| distance(a, of).total_cmp(&distance(b, of)));
    let own = 0..u32::try_from(layers.len()).expect("there are at most eight layers");
    own.chain(means[layers.len()..].iter().map(|of| nearest(of).map_or(0, |(layer, _)| layer))).collect()
}

/// Checks that the textures of the materials do not repeat too often along a sector, whose edge is `sector_m` metres.
///
/// # Errors
/// [`Error::Material`]: a texture repeats [`MAX_REPEATS_PER_SECTOR`] times or more, or the size of its repeat or its rotation is not a usable number.
pub fn check_repeats(materials: &[Material], sector_m: f64) -> Result<()> {
    materials.iter().try_for_each(|material| placement(material, sector_m).map(drop))
}

/// Returns [`PaletteEntry::per_sector_fixed`] and [`PaletteEntry::per_metre`] of a material. The errors are those of [`check_repeats`].
fn placement(material: &Material, sector_m: f64) -> Result<([i32; 2], [f32; 2])> {
    let tile_m = material.tile_m;
    let usable = tile_m > 0.0 && tile_m.is_finite() && material.orientation_deg.is_finite();
    let repeats = sector_m / tile_m;
    if !usable || repeats >= MAX_REPEATS_PER_SECTOR {
        let least = sector_m / MAX_REPEATS_PER_SECTOR;
        return Err(wrong(
            &material.name,
            format!(
                "tile_m = {tile_m} gives {repeats:.1} repeats per sector of {sector_m} m, but there must be fewer than {MAX_REPEATS_PER_SECTOR}: enlarge tile_m to more than {least} m"
            ),
        ));
    }
    let (sin, cos) = material.orientation_deg.to_radians().sin_cos();
    // Whole repeats beyond 8 bits wrap around. This does not change the picture, because textures repeat.
    let fixed = |rate: f64| (rate * f64::from(1_u32 << 24)).round() as i64 as i32;
    Ok(([fixed(repeats * cos), fixed(repeats * sin)], [(cos / tile_m) as f32, (sin / tile_m) as f32]))
}
