//! Materials from image files, scanned or painted: one folder per material.

use std::fs::File;
use std::io::{BufRead, BufReader, Seek};
use std::path::{Path, PathBuf};

use image::{DynamicImage, ImageDecoder, ImageReader};
use rayon::prelude::*;

use super::{MaterialMaps, wrong};
use crate::base::colour::linear_from_srgb;
use crate::base::error::{Error, Result, one_line};

/// Limit of the edge of an image, texels: four times the edge of the finest detail textures. An image of this size takes 0.8 GB of memory until it is
/// resampled.
const MAX_EDGE: u32 = 8192;

/// File name extensions of images, in the order in which they are searched for.
const EXTENSIONS: [&str; 3] = ["png", "jpg", "jpeg"];

/// Reads a material's maps and resamples them to `size` x `size`.
///
/// Looks for `albedo` (sRGB), `normal` (OpenGL: green = up in the image, n = 2 value - 1, renormalised), `height`, `roughness` (smoothness
/// = 1 - roughness) and, optionally, `ao` (used as specular occlusion; 1 without it). Each is a .png, .jpg or .jpeg file with 8 or 16 bits
/// per channel. If the image of a map with one value per texel is in colour, its red channel is used. The format is determined by content, not
/// by extension. All images of a folder must be squares of one size, which can be any size up to 8192. If the images are larger than `size`, they
/// are averaged over the area of each texel. If they are smaller, they are interpolated bilinearly. Both use linear values and wrap around at the
/// edges. The top row of an image becomes the last row, v = 1. The colour mask is 1 everywhere: a tint applies to the whole material.
///
/// # Errors
/// If the folder or a map is missing (the message lists the files of the folder), or if a file is not a readable image, is not square, or
/// differs in size from the others. `name` is the name of the material, for these messages.
pub fn load(name: &str, dir: &Path, size: u32) -> Result<MaterialMaps> {
    let entries = std::fs::read_dir(dir).map_err(|source| {
        wrong(name, format!("cannot read folder {}: {source}; correct `folder` (relative to the scene file)", dir.display()))
    })?;
    let mut files: Vec<String> = entries.filter_map(|entry| entry.ok()?.file_name().into_string().ok()).collect();
    files.sort();
    let find = |map: &str| EXTENSIONS.iter().map(|e| format!("{map}.{e}")).find(|file| files.contains(file)).map(|file| dir.join(file));
    let required = |map: &str| {
        find(map).ok_or_else(|| {
            let there = if files.is_empty() { "nothing".to_owned() } else { files.join(", ") };
            wrong(name, format!("no {map}.png, .jpg or .jpeg in {} (the folder contains: {there}); add that map", dir.display()))
        })
    };
    // All names are checked first, because decoding takes seconds, and a missing map should be reported at once.
    let paths = [required("albedo")?, required("normal")?, required("height")?, required("roughness")?];
    let ao = find("ao");

    let mut edge = None;
    let mut open = |path: &PathBuf| -> Result<Image> {
        let file = File::open(path).map_err(|source| Error::File { file: path.clone(), source })?;
        let image = Image::decode(BufReader::new(file), path)?;
        match &edge {
            None => edge = Some((image.edge, path.clone())),
            Some((first, of)) if *first != image.edge => {
                let (a, b) = (image.edge, *first);
                return Err(wrong(
                    name,
                    format!("{} is {a}x{a} but {} is {b}x{b}: give all maps the same size", path.display(), of.display()),
                ));
            }
            Some(_) => {}
        }
        Ok(image)
    };
    let albedo = open(&paths[0])?.map(|t| t.map(linear_from_srgb)).resample(size);
    let normal = open(&paths[1])?.map(unit_normal).resample(size);
    let height = open(&paths[2])?.resample(size);
    let roughness = open(&paths[3])?.resample(size);
    let ao = ao.as_ref().map(open).transpose()?.map(|image| image.resample(size));

    let count = (size as usize).pow(2);
    let red = |texels: &[[f32; 3]]| texels.iter().map(|t| t[0]).collect::<Vec<f32>>();
    Ok(MaterialMaps {
        size,
        albedo,
        normal: normal.iter().map(|n| [n[0], n[1]]).collect(),
        smoothness: roughness.iter().map(|t| 1.0 - t[0]).collect(),
        specular_occlusion: ao.map_or_else(|| vec![1.0; count], |texels| red(&texels)),
        height: red(&height),
        colour_mask: vec![1.0; count],
    })
}

/// A square image in memory; row 0 is at v = 0.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Texels along an edge, at least 1.
    pub edge: usize,
    /// Red, green, blue as stored, 0..1, row by row.
    pub texels: Vec<[f32; 3]>,
}

impl Image {
    /// Reads a map from the contents of a file. `path` is used in error messages. PNG and JPEG are distinguished by content.
    ///
    /// # Errors
    /// If the file is not a readable image, is not square, or is larger than 8192 texels per side.
    pub fn decode(input: impl BufRead + Seek, path: &Path) -> Result<Image> {
        let broken = |what: String| Error::Image { file: path.to_owned(), what: one_line(&what) };
        let reader = ImageReader::new(input).with_guessed_format().map_err(|source| Error::File { file: path.to_owned(), source })?;
        let unreadable = |e: image::ImageError| broken(format!("not a readable PNG or JPEG ({e}); save it again as 8- or 16-bit PNG"));
        let decoder = reader.into_decoder().map_err(unreadable)?;
        let (width, height) = decoder.dimensions();
        if width != height || width == 0 {
            return Err(broken(format!("the image has {width}x{height} texels, but material maps must be square: crop or resize it")));
        }
        if width > MAX_EDGE {
            return Err(broken(format!("the image has {width}x{width} texels, but at most {MAX_EDGE} per side are allowed: resize it")));
        }
        let decoded = DynamicImage::from_decoder(decoder).map_err(unreadable)?;
        let edge = width as usize;
        let mut texels: Vec<[f32; 3]> = rgb(decoded);
        for row in 0..edge / 2 {
            let (lower, upper) = texels.split_at_mut((edge - 1 - row) * edge);
            lower[row * edge..][..edge].swap_with_slice(&mut upper[..edge]);
        }
        Ok(Image { edge, texels })
    }

    fn map(mut self, f: impl Fn([f32; 3]) -> [f32; 3] + Sync) -> Image {
        self.texels.par_iter_mut().for_each(|t| *t = f(*t));
        self
    }

    /// Resamples to `size` x `size` texels: first along rows, then along columns.
    fn resample(self, size: u32) -> Vec<[f32; 3]> {
        let size = size as usize;
        if self.edge == size {
            return self.texels;
        }
        let taps = taps(self.edge, size);
        let edge = self.edge;
        let gather = |tap: &[(usize, f32)], texel: &dyn Fn(usize) -> [f32; 3]| {
            let mut sum = [0.0_f32; 3];
            for &(i, w) in tap {
                let t = texel(i);
                for c in 0..3 {
                    sum[c] += w * t[c];
                }
            }
            sum
        };
        let texels = &self.texels;
        let rows: Vec<[f32; 3]> =
            (0..edge * size).into_par_iter().map(|i| gather(&taps[i % size], &|x| texels[i / size * edge + x])).collect();
        (0..size * size).into_par_iter().map(|i| gather(&taps[i / size], &|y| rows[y * size + i % size])).collect()
    }
}

/// Returns, for each target texel along one axis, the source texels from which it is computed, with their weights (sum 1).
fn taps(from: usize, to: usize) -> Vec<Vec<(usize, f32)>> {
    let ratio = from as f64 / to as f64;
    (0..to)
        .map(|target| {
            if from > to {
                let (start, end) = (target as f64 * ratio, (target + 1) as f64 * ratio);
                let covered = |i: usize| ((end.min((i + 1) as f64) - start.max(i as f64)) / ratio) as f32;
                (start as usize..from.min(end.ceil() as usize)).map(|i| (i, covered(i))).filter(|&(_, w)| w > 0.0).collect()
            } else {
                let at = (target as f64 + 0.5) * ratio - 0.5 + from as f64;
                let (first, fraction) = (at as usize, at.fract() as f32);
                vec![(first % from, 1.0 - fraction), ((first + 1) % from, fraction)]
            }
        })
        .collect()
}

/// Converts an image to channels in 0..1. Grey is repeated in all three channels; alpha is dropped.
fn rgb(decoded: DynamicImage) -> Vec<[f32; 3]> {
    decoded.into_rgb32f().pixels().map(|p| p.0).collect()
}

/// Decodes a normal: n = 2 value - 1, scaled to unit length. If n = 0, the result is the normal of a flat surface.
fn unit_normal(value: [f32; 3]) -> [f32; 3] {
    let n = value.map(|c| 2.0 * c - 1.0);
    crate::shared::real::normalize(n)
}
