//! The workbench's program: a window, or a picture of one.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, Result, anyhow, bail};
use clap::Parser;
use eframe::egui;
use kernels::scene;
use workbench::app::Workbench;
use workbench::script;

/// Terrain shaded live: switch 31 variants, estimators and noises at a click, and see what each costs.
#[derive(Parser)]
#[command(
    version,
    about,
    after_help = "Without a display: --screenshot FILE --script STEPS draws the same window into a file; `experiments` does \
    everything that is measured."
)]
struct Args {
    /// Scene file or folder; `default` is built in
    #[arg(default_value = scene::DEFAULT)]
    scene: String,
    /// Size of the window, points
    #[arg(long, value_name = "WxH", default_value = "1280x800", value_parser = size)]
    size: [u32; 2],
    /// Draws the window into a PNG instead of opening it, once the steps of --script are done
    #[arg(long, value_name = "FILE")]
    screenshot: Option<PathBuf>,
    /// What to do before: `click NAME`, `key KEY`, `set NAME = VALUE`, `frames N`, `warm`, with `;` between them
    #[arg(long, value_name = "STEPS", requires = "screenshot", default_value = "")]
    script: String,
}

/// Smallest and largest window that is asked for on the command line.
const SIDES: [u32; 2] = [1, 8192];

fn size(text: &str) -> Result<[u32; 2], String> {
    let parse = || {
        let (width, height) = text.split_once('x')?;
        Some([width.parse::<u32>().ok()?, height.parse::<u32>().ok()?])
    };
    let wrong = || format!("give WIDTHxHEIGHT, such as 1280x800, each side from {} to {}", SIDES[0], SIDES[1]);
    parse().filter(|size| size.iter().all(|n| (SIDES[0]..=SIDES[1]).contains(n))).ok_or_else(wrong)
}

fn run(args: &Args) -> Result<()> {
    let scene = scene::load(&args.scene)?;
    if let Some(file) = &args.screenshot {
        if file.parent().is_some_and(|folder| !folder.as_os_str().is_empty() && !folder.is_dir()) {
            bail!("{}: its folder does not exist: make it first", file.display());
        }
        let steps = script::steps(&args.script).context("--script")?;
        return script::run(scene, args.size, &steps, file);
    }
    let [width, height] = args.size.map(|n| n as f32);
    let options = eframe::NativeOptions {
        viewport: egui::ViewportBuilder::default().with_title(format!("Scree - {}", scene.name)).with_inner_size([width, height]),
        ..Default::default()
    };
    eframe::run_native("scree", options, Box::new(|cc| Ok(Box::new(Workbench::new(&cc.egui_ctx, scene))))).map_err(|error| {
        // The library's own words name its source file; that there is no display is said plainly.
        let unset = |name: &str| std::env::var_os(name).is_none_or(|value| value.is_empty());
        let headless = cfg!(target_os = "linux") && unset("DISPLAY") && unset("WAYLAND_DISPLAY");
        let why = if headless { "neither DISPLAY nor WAYLAND_DISPLAY is set".to_owned() } else { error.to_string() };
        anyhow!(
            "no window could be opened ({why}): on a machine without a display use `workbench --screenshot FILE`, or `experiments`, which needs none"
        )
    })
}

fn main() -> ExitCode {
    match run(&Args::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {}", format!("{error:#}").replace('\n', " "));
            ExitCode::FAILURE
        }
    }
}
