//! Interprets the name of an image file: which map of a material the file contains, and how the map is to be read.
//!
//! The name is split into words at every character that is neither a letter nor a digit, and where a capital letter begins a word
//! (`NormalGL`). Words that describe only the file (`2K`, `JPG`, `LOD0`, `16bit`) are not part of the name of the map or of the material.
//! If several words name a map, the last ones take precedence, because the name of a material may also contain such words: `rough_linen`,
//! `metal_plate`. The words that are left are the name of the material. The lists of names cover those of Poly Haven, ambientCG, Quixel Megascans,
//! Poliigon, Substance and glTF.

/// The direction of a normal map's y axis in the image. The green channel holds y.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Convention {
    /// Up in the image, as the name states (`nor_gl`, `NormalGL`).
    OpenGl,
    /// The name states no convention: read like [`Convention::OpenGl`].
    Unstated,
    /// Down in the image, as the name states (`nor_dx`, `NormalDX`): green is inverted.
    DirectX,
}

/// The contents of one channel of a packed map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Held {
    Height,
    Roughness,
    Occlusion,
    /// Something that the terrain does not use.
    Nothing,
}

/// The map that a file holds, according to the name of the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Albedo,
    Normal(Convention),
    Height,
    Roughness,
    /// 1 - roughness.
    Smoothness,
    Occlusion,
    /// Several maps in red, green and blue.
    Packed([Held; 3]),
    /// A map that the terrain does not use.
    Other(&'static str),
}

/// The information in the name of a file.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Label {
    pub(super) kind: Kind,
    /// The words that name the material, joined by `_`; empty if there are none.
    pub(super) material: String,
    /// Edge of the image in texels, if stated.
    pub(super) resolution: Option<u32>,
    /// Number of the level of detail, if stated; 0 is the finest.
    pub(super) lod: Option<u32>,
    /// Size of one repeat of the texture, metres, if stated.
    pub(super) tile_m: Option<f64>,
}

/// Words for a normal map.
const NORMALS: [&str; 6] = ["normal", "normals", "nor", "norm", "nrm", "nrml"];

/// Words before or after those of [`NORMALS`], and the convention that they state.
const CONVENTIONS: [(&str, Convention); 6] = [
    ("opengl", Convention::OpenGl),
    ("ogl", Convention::OpenGl),
    ("gl", Convention::OpenGl),
    ("directx", Convention::DirectX),
    ("d3d", Convention::DirectX),
    ("dx", Convention::DirectX),
];

/// All other words for maps.
const MAPS: &[(&[&str], Kind)] = &[
    (
        &[
            "albedo",
            "basecolor",
            "basecolour",
            "basecol",
            "diffuse",
            "diffusecolor",
            "diffusecolour",
            "diff",
            "color",
            "colour",
            "col",
            "albedotransparency",
        ],
        Kind::Albedo,
    ),
    (&["height", "displacement", "displace", "disp"], Kind::Height),
    (&["roughness", "rough", "rgh"], Kind::Roughness),
    (&["gloss", "glossiness", "smoothness", "smooth"], Kind::Smoothness),
    (&["ao", "ambientocclusion", "ambientocc", "occlusion", "occ", "mixedao"], Kind::Occlusion),
    // In names such as `arm`, the order of the letters is the order of the channels.
    (&["arm", "aorm", "orm", "occlusionroughnessmetallic"], Kind::Packed([Held::Occlusion, Held::Roughness, Held::Nothing])),
    (&["mra", "mrao"], Kind::Packed([Held::Nothing, Held::Roughness, Held::Occlusion])),
    (&["rma", "rmao"], Kind::Packed([Held::Roughness, Held::Nothing, Held::Occlusion])),
    (&["ord", "ordp", "ard", "ardp"], Kind::Packed([Held::Occlusion, Held::Roughness, Held::Height])),
    // glTF 2.0, 3.9.2: green is roughness, blue is metalness.
    (&["metallicroughness", "metalroughness"], Kind::Packed([Held::Nothing, Held::Roughness, Held::Nothing])),
    (&["metallic", "metalness", "metal", "metallicsmoothness", "metallicgloss", "mask"], Kind::Other("metalness or a mask")),
    (&["specular", "specularlevel", "spec", "reflection", "refl", "ior"], Kind::Other("specular reflectance")),
    (&["opacity", "alpha", "transparency", "transmission", "translucency", "thickness"], Kind::Other("opacity or transmission")),
    (&["subsurface", "sss", "scattering", "fuzz", "anisotropy"], Kind::Other("scattering")),
    (&["emission", "emissive", "emit"], Kind::Other("emission")),
    (&["cavity", "curvature", "curv"], Kind::Other("cavities")),
    (&["bump", "normalbump"], Kind::Other("bumps; a height map is called `height` or `displacement`")),
    (&["preview", "thumb", "thumbnail", "sphere", "render"], Kind::Other("a preview")),
];

/// Largest number of words that together name a map, as in `normal_map_direct_x`.
const MOST_WORDS: usize = 4;

/// Words that say nothing about the map or the material.
const OF_THE_FILE: [&str; 14] =
    ["png", "jpg", "jpeg", "exr", "tga", "tif", "tiff", "srgb", "8bit", "16bit", "32bit", "8b", "16b", "seamless"];

/// Interprets the name of a file, which is given without its extension. `None`: the name states no map.
pub(super) fn label(stem: &str) -> Option<Label> {
    let (mut resolution, mut lod, mut tile_m) = (None, None, None);
    let (mut words, mut lower) = (Vec::new(), Vec::new());
    let mut before = String::new();
    for word in words_of(stem) {
        let small = word.to_lowercase();
        if let Some(edge) = edge_in(&small) {
            resolution = Some(edge);
        } else if let Some(number) = number_after("lod", &small) {
            lod = Some(number);
        } else if let Some(metres) = metres_in(&small, &before) {
            tile_m = Some(metres);
        } else if !OF_THE_FILE.contains(&small.as_str()) && number_after("var", &small).is_none() {
            words.push(word);
            lower.push(small.clone());
        }
        before = small;
    }
    let (kind, start, end) = (1..=lower.len()).rev().find_map(|end| {
        let named = |start: usize| Some((kind_of(&lower[start..end].concat())?, start, end));
        (end.saturating_sub(MOST_WORDS)..end).find_map(named)
    })?;
    let material = [&words[..start], &words[end..]].concat().join("_");
    Some(Label { kind, material, resolution, lod, tile_m })
}

/// The size of one repeat of the texture in metres, if a word of the name states it: `2m`, `1.5m` or `250cm`, from 0.05 to 1000 m. If
/// several words state a size, the last one counts.
pub fn stated_tile_m(name: &str) -> Option<f64> {
    let mut before = String::new();
    let mut stated = None;
    for word in words_of(name) {
        let small = word.to_lowercase();
        stated = metres_in(&small, &before).or(stated);
        before = small;
    }
    stated
}

fn kind_of(word: &str) -> Option<Kind> {
    let bare = word.strip_suffix("map").unwrap_or(word);
    let normal = || {
        CONVENTIONS.iter().find_map(|&(mark, convention)| {
            let rests = [bare.strip_suffix(mark), bare.strip_prefix(mark)];
            let is_normal = |rest: &str| NORMALS.contains(&rest.strip_suffix("map").unwrap_or(rest));
            rests.into_iter().flatten().any(is_normal).then_some(Kind::Normal(convention))
        })
    };
    let other = || MAPS.iter().find(|(names, _)| names.contains(&bare)).map(|&(_, kind)| kind);
    if NORMALS.contains(&bare) { Some(Kind::Normal(Convention::Unstated)) } else { other().or_else(normal) }
}

/// Splits a name into words. A point between two digits is part of a word (`1.5m`).
fn words_of(name: &str) -> Vec<&str> {
    let chars: Vec<(usize, char)> = name.char_indices().collect();
    let mut words = Vec::new();
    // Byte offset and index of the first character of the current word.
    let mut begun: Option<(usize, usize)> = None;
    for (i, &(at, c)) in chars.iter().enumerate() {
        let before = i.checked_sub(1).and_then(|i| chars.get(i)).map(|&(_, c)| c);
        let after = chars.get(i + 1).map(|&(_, c)| c);
        let is_digit = |c: Option<char>| c.is_some_and(|c| c.is_ascii_digit());
        let belongs = c.is_alphanumeric() || (c == '.' && is_digit(before) && is_digit(after));
        match (begun, belongs) {
            (None, true) => begun = Some((at, i)),
            (Some((start, _)), false) => {
                words.push(&name[start..at]);
                begun = None;
            }
            (Some((start, first)), true) => {
                let followed_by_small = after.is_some_and(char::is_lowercase);
                let is_new = c.is_uppercase()
                    && before.is_some_and(|before| {
                        // A capital letter after a lower-case letter begins a word, unless the word so far is a single letter: `sRGB` is
                        // one word. After any other character, it begins a word only if a lower-case letter follows: `2K` is one word.
                        if before.is_lowercase() { i - first >= 2 } else { followed_by_small }
                    });
                if is_new {
                    words.push(&name[start..at]);
                    begun = Some((at, i));
                }
            }
            (None, false) => {}
        }
    }
    words.extend(begun.map(|(start, _)| &name[start..]));
    words
}

/// Edge of an image in texels, from a word such as `2k`, `2048` or `2048x2048`.
fn edge_in(word: &str) -> Option<u32> {
    if let Some(thousands) = word.strip_suffix('k') {
        return thousands.parse::<u32>().ok().filter(|n| (1..=32).contains(n)).map(|n| n * 1024);
    }
    let edge = match word.split_once('x') {
        Some((width, height)) if width == height => width,
        Some(_) => return None,
        None => word,
    };
    edge.parse::<u32>().ok().filter(|n| n.is_power_of_two() && (256..=16_384).contains(n))
}

fn number_after(prefix: &str, word: &str) -> Option<u32> {
    word.strip_prefix(prefix)?.parse().ok()
}

/// A length in metres, from a word such as `2m`, `1.5m` or `250cm`. `before`: the previous word. After a number, a word is no length: in `1_5m`, the
/// word `5m` may be part of 1.5 m.
fn metres_in(word: &str, before: &str) -> Option<f64> {
    let (number, unit_m) = match word.strip_suffix("cm") {
        Some(number) => (number, 0.01),
        None => (word.strip_suffix('m')?, 1.0),
    };
    let is_plain = !number.is_empty() && number.chars().all(|c| c.is_ascii_digit() || c == '.');
    let follows_number = !before.is_empty() && before.chars().all(|c| c.is_ascii_digit());
    let metres = number.parse::<f64>().ok().filter(|_| is_plain && !follows_number)? * unit_m;
    (0.05..=1000.0).contains(&metres).then_some(metres)
}

#[cfg(test)]
mod tests {
    use super::*;

    const ARM: Kind = Kind::Packed([Held::Occlusion, Held::Roughness, Held::Nothing]);

    #[test]
    fn names_of_the_usual_libraries_are_understood() {
        use Convention::{DirectX, OpenGl, Unstated};
        for (stem, kind, material, resolution) in [
            ("rock_face_diff_2k", Kind::Albedo, "rock_face", Some(2048)),
            ("rough_linen_diff_4k", Kind::Albedo, "rough_linen", Some(4096)),
            ("rough_linen_rough_4k", Kind::Roughness, "rough_linen", Some(4096)),
            ("rock_wall_10_nor_gl_2k", Kind::Normal(OpenGl), "rock_wall_10", Some(2048)),
            ("rock_wall_10_nor_dx_2k", Kind::Normal(DirectX), "rock_wall_10", Some(2048)),
            ("rock_wall_10_arm_2k", ARM, "rock_wall_10", Some(2048)),
            ("rock_wall_10_disp_2k", Kind::Height, "rock_wall_10", Some(2048)),
            ("rock_wall_10_ao_2k", Kind::Occlusion, "rock_wall_10", Some(2048)),
            ("Rock030_2K-PNG_Color", Kind::Albedo, "Rock030", Some(2048)),
            ("Rock030_1K-JPG_NormalGL", Kind::Normal(OpenGl), "Rock030", Some(1024)),
            ("Rock030_1K-JPG_NormalDX", Kind::Normal(DirectX), "Rock030", Some(1024)),
            ("Rock030_1K-JPG_AmbientOcclusion", Kind::Occlusion, "Rock030", Some(1024)),
            ("Rock030_1K-JPG_Displacement", Kind::Height, "Rock030", Some(1024)),
            ("xhzmbl_2K_Albedo", Kind::Albedo, "xhzmbl", Some(2048)),
            ("xhzmbl_2K_Normal_LOD0", Kind::Normal(Unstated), "xhzmbl", Some(2048)),
            ("xhzmbl_2K_Gloss", Kind::Smoothness, "xhzmbl", Some(2048)),
            ("GroundDirt_COL_VAR1_3K", Kind::Albedo, "Ground_Dirt", Some(3072)),
            ("GroundDirt_NRM_3K", Kind::Normal(Unstated), "Ground_Dirt", Some(3072)),
            ("Cliff_Base_Color", Kind::Albedo, "Cliff", None),
            ("Cliff_Normal_OpenGL", Kind::Normal(OpenGl), "Cliff", None),
            ("Cliff_NormalMapDirectX", Kind::Normal(DirectX), "Cliff", None),
            ("rocky-terrain_normal-ogl", Kind::Normal(OpenGl), "rocky_terrain", None),
            ("Cliff_Mixed_AO", Kind::Occlusion, "Cliff", None),
            ("T_Cliff_ORDp", Kind::Packed([Held::Occlusion, Held::Roughness, Held::Height]), "T_Cliff", None),
            ("T_Cliff_MRA", Kind::Packed([Held::Nothing, Held::Roughness, Held::Occlusion]), "T_Cliff", None),
            ("Cliff_occlusionRoughnessMetallic", ARM, "Cliff", None),
            ("ALBEDO", Kind::Albedo, "", None),
            ("NORMALGL", Kind::Normal(OpenGl), "", None),
            ("Albedo_sRGB", Kind::Albedo, "", None),
            ("base_color", Kind::Albedo, "", None),
            ("colour_2048x2048", Kind::Albedo, "", Some(2048)),
            ("albedo_old", Kind::Albedo, "old", None),
        ] {
            let label = label(stem).unwrap_or_else(|| panic!("{stem} names a map"));
            assert_eq!((label.kind, label.material.as_str(), label.resolution), (kind, material, resolution), "{stem}");
        }
        assert_eq!(label("xhzmbl_2K_Normal_LOD3").and_then(|label| label.lod), Some(3));
        for stem in ["", "rock", "IMG_0001", "rocknormalish", "2k", "map", "änderung", "\u{1F5FB}"] {
            assert_eq!(label(stem), None, "{stem}");
        }
        assert!(matches!(label("Rock030_Color_Preview").map(|label| label.kind), Some(Kind::Other("a preview"))));
        assert!(matches!(label("rock_metallic_2k").map(|label| label.kind), Some(Kind::Other(_))));
    }

    #[test]
    fn a_length_in_a_name_is_the_size_of_a_tile() {
        for (name, metres) in [
            ("granite_2m", Some(2.0)),
            ("Granite-1.5m", Some(1.5)),
            ("granite_250cm_albedo", Some(2.5)),
            ("2m", Some(2.0)),
            ("granite_1_5m", None),
            ("granite_m", None),
            ("granite_0m", None),
            ("granite_5000m", None),
            ("granite_-2em", None),
            ("Granite2M", None),
            ("rock030", None),
        ] {
            assert_eq!(stated_tile_m(name), metres, "{name}");
        }
        let label = label("granite_2m_albedo").expect("an albedo");
        assert_eq!((label.tile_m, label.material.as_str()), (Some(2.0), "granite"));
    }
}
