//! `import`: creates a scene folder from a heightmap.

use anyhow::{Result, bail};
use kernels::decode::heightmap::ReadOptions;
use kernels::import::scene_folder;

use super::{check_writable, print};
use crate::cli::ImportArgs;
use crate::process::watch_interrupts;

/// Writes the scene folder completely or not at all.
pub(crate) fn run(args: &ImportArgs) -> Result<()> {
    if args.heightmap.is_dir() {
        bail!("{} is a folder: give a PNG, RAW, EXR or TIFF heightmap", args.heightmap.display());
    }
    if let Some(materials) = &args.materials
        && !materials.is_dir()
    {
        bail!("there is no folder {}: --materials takes a folder that holds a folder of images per material", materials.display());
    }
    if !args.heightmap.is_file() {
        bail!("there is no file {}: give a PNG, RAW, EXR or TIFF heightmap", args.heightmap.display());
    }
    if args.out.exists() {
        if !args.out.is_dir() {
            bail!("{} is a file: give a folder that is empty or does not exist", args.out.display());
        }
        if args.out.read_dir()?.next().is_some() {
            bail!("{} is not empty: give a folder that is empty or does not exist", args.out.display());
        }
    }
    match args.out.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => check_writable(parent)?,
        _ => check_writable(std::path::Path::new("."))?,
    }
    let options = ReadOptions {
        metres_per_texel: args.metres_per_texel,
        height_range_m: args.height_range,
        raw_size: args.raw_size,
        raw_big_endian: args.raw_big_endian,
        window: args.window,
    };
    watch_interrupts()?;
    scene_folder::import(&args.heightmap, &options, args.materials.as_deref(), args.detail, &args.out)?;
    let out = args.out.display();
    print(&format!("{out}: scene.toml, heightmap.png\nlook at it: experiments render --scene {out} --camera vista --out vista.png\n"))
}
