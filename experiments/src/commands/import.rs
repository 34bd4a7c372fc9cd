//! `import`: creates a scene folder from a heightmap.

use std::fs;
use std::io::ErrorKind;

use anyhow::{Context, Result, bail};
use kernels::base::files::remove_unfinished;
use kernels::decode::heightmap::{NoData, ReadOptions, Voids};
use kernels::import::scene_folder::{self, ImportOptions};

use super::{check_writable, print};
use crate::cli::{ImportArgs, NoDataArg};
use crate::process::{check_interrupted, watch_interrupts};

/// Writes the scene folder completely or not at all, and prints what was understood of the files.
pub(crate) fn run(args: &ImportArgs) -> Result<()> {
    let heightmap = args.heightmap.display();
    match fs::metadata(&args.heightmap) {
        Err(error) if error.kind() == ErrorKind::NotFound => bail!("there is no file {heightmap}: give a PNG, RAW, EXR or TIFF heightmap"),
        Err(error) => return Err(error).with_context(|| format!("cannot read {heightmap}")),
        Ok(at) if at.is_dir() => bail!("{heightmap} is a folder: give a PNG, RAW, EXR or TIFF heightmap"),
        Ok(at) if !at.is_file() => bail!("{heightmap} is a device or a pipe: give a PNG, RAW, EXR or TIFF heightmap as a file"),
        Ok(_) => {}
    }
    if let Some(materials) = &args.materials
        && !materials.is_dir()
    {
        bail!("there is no folder {}: --materials takes a folder that holds images of materials", materials.display());
    }
    if let Some(out) = args.out.as_deref() {
        if out.exists() {
            if !out.is_dir() {
                bail!("{} is a file: give a folder that is empty or does not exist", out.display());
            }
            if out.read_dir()?.next().is_some() {
                bail!("{} is not empty: give a folder that is empty or does not exist", out.display());
            }
        }
        let parent = out.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(std::path::Path::new("."));
        if !args.dry_run {
            check_writable(parent)?;
        }
    }
    watch_interrupts()?;
    let stopped = || check_interrupted().is_err();
    let understood = scene_folder::examine(&args.heightmap, &options(args), &stopped)?;
    let Some(out) = args.out.as_deref().filter(|_| !args.dry_run) else {
        print(&format!("{understood}\n"))?;
        // The printed text lists materials that cannot be used. If there is one, `check` returns an error that says how to fix it.
        understood.check()?;
        return print("dry run: nothing is written\n");
    };
    check_interrupted()?;
    for left in remove_unfinished(out)? {
        print(&format!("removed {}, which an import left behind when it was ended\n", left.display()))?;
    }
    understood.write(out, &stopped)?;
    let out = out.display();
    print(&format!(
        "{understood}\n{out}: scene.toml, heightmap.png\nlook at it: experiments render --scene {out} --camera vista --out vista.png\n"
    ))
}

fn options(args: &ImportArgs) -> ImportOptions {
    let values = args.no_data.iter().filter_map(|value| match value {
        NoDataArg::Value(value) => Some(*value),
        NoDataArg::Nothing => None,
    });
    ImportOptions {
        read: ReadOptions {
            metres_per_texel: args.metres_per_texel,
            height_range_m: args.height_range,
            raw_size: args.raw_size,
            raw_big_endian: args.raw_big_endian,
            window: args.window,
            channel: args.channel.clone(),
            no_data: match args.no_data.as_slice() {
                [] => NoData::Stated,
                given if given.contains(&NoDataArg::Nothing) => NoData::Nothing,
                _ => NoData::Named(values.collect()),
            },
            voids: match (args.fill_voids, args.holes) {
                (true, _) => Voids::Fill,
                (false, true) => Voids::Holes,
                (false, false) => Voids::Refuse,
            },
        },
        materials: args.materials.clone(),
        tile_m: args.tile_size,
        detail_m: args.detail,
    }
}
