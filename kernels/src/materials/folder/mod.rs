//! Reads materials from folders of image files. The name of a file says which map the file contains.
//!
//! [`recognise`] uses only the names, and [`load_maps`] reads the files that `recognise` found. The import of a scene chooses files by
//! the same rules, and also calls `load_maps`.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use super::{MaterialMaps, wrong};
use crate::base::error::{Error, Result};

mod decode;
mod map;
mod names;
mod recognition;
mod resample;

pub use map::{Map, read};
pub use names::{Convention, stated_tile_m};
pub use recognition::{
    Listing, READABLE, Reading, Recognised, Set, Sorted, Source, Unused, few, list, recognise, shown, shown_name, sort_out,
};

/// The maps of a material, and notes for the user about them.
#[derive(Clone, Debug, PartialEq)]
pub struct Loaded {
    /// The maps.
    pub maps: MaterialMaps,
    /// Side length of the image of each map, texels, in the order of [`Recognised::maps`].
    pub edges: Vec<usize>,
    /// Remarks, one line each, with the name of the file.
    pub remarks: Vec<String>,
}

/// Reads the material in a folder and resamples its maps to `size` x `size`.
///
/// The names of the files say which map they contain, in upper or lower case. `albedo`, `normal`, `height` and `roughness` are required.
/// `ao` is optional and is used as specular occlusion; without `ao`, specular occlusion is 1. Names of Poly Haven, ambientCG, Quixel Megascans
/// and others are recognised, such as `rock_diff_2k` and `Rock030_2K-PNG_NormalGL`. If there is no roughness map, a `gloss` map is inverted. The
/// channels of `arm`, `orm` and other packed maps are separated. The green channel of `nor_dx` is inverted.
///
/// Files are .png, .jpg, .jpeg, .tga or .exr. An albedo is linear in .exr; otherwise it is sRGB, unless a PNG file states another gamma. Normals are
/// n = 2 value - 1 or, if an .exr file contains signed values, n = value. Green is up in the image (OpenGL), unless the name states DirectX. Normals
/// are renormalised, and z is computed if it is missing.
///
/// Images are squares of any size up to 8192, and the maps of a material may differ in size. Linear values are resampled: if an image is larger than
/// `size`, it is averaged over the area of each texel; if it is smaller, it is interpolated bilinearly, wrapping around at the edges. The top row of
/// an image becomes the last row, at v = 1. The colour mask is 1 everywhere: a tint applies to the whole material.
///
/// # Errors
/// An error of [`recognise`], as [`Error::Material`] with this `name`, or an error of [`load_maps`].
pub fn load(name: &str, dir: &Path, size: u32) -> Result<MaterialMaps> {
    let recognised = recognise(dir).map_err(|what| wrong(name, what))?;
    Ok(load_maps(&recognised, size)?.maps)
}

/// Reads the maps of a material and resamples them to `size` x `size`.
///
/// # Errors
/// A file cannot be opened, or an error of [`read`].
pub fn load_maps(recognised: &Recognised, size: u32) -> Result<Loaded> {
    let (mut edges, mut remarks) = (Vec::new(), Vec::new());
    let mut texels = |source: &Source| -> Result<Vec<[f32; 3]>> {
        let file = File::open(&source.file).map_err(|error| Error::File { file: shown(&source.file).into(), source: error })?;
        let map = read(BufReader::new(file), &source.file, source.reading)?;
        edges.push(map.edge);
        remarks.extend(map.remarks.iter().map(|remark| format!("{}: {remark}", shown_name(&source.file))));
        Ok(resample::resample(map.texels, map.edge, size as usize))
    };
    let albedo = texels(&recognised.albedo)?;
    let normal = texels(&recognised.normal)?;
    let height = texels(&recognised.height)?;
    let roughness = texels(&recognised.roughness)?;
    let occlusion = recognised.occlusion.as_ref().map(&mut texels).transpose()?;

    let count = (size as usize).pow(2);
    let red = |texels: &[[f32; 3]]| texels.iter().map(|t| t[0]).collect::<Vec<f32>>();
    let maps = MaterialMaps {
        size,
        albedo,
        normal: normal.iter().map(|n| [n[0], n[1]]).collect(),
        smoothness: roughness.iter().map(|t| 1.0 - t[0]).collect(),
        specular_occlusion: occlusion.map_or_else(|| vec![1.0; count], |texels| red(&texels)),
        height: red(&height),
        colour_mask: vec![1.0; count],
    };
    Ok(Loaded { maps, edges, remarks })
}
