//! The workbench's program: a window, or a picture of one.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, Result, anyhow, bail};
use clap::Parser;
use eframe::egui;
use kernels::scene;
use workbench::model::kept::{self, Keeper};
use workbench::script;
use workbench::window::{Workbench, still};

/// Terrain shaded live: switch 31 variants, estimators and noises at a click, and see what each costs.
#[derive(Parser)]
#[command(
    version,
    about,
    after_help = "Without a display: --screenshot FILE --script STEPS draws the same window into a file; `experiments` measures what is to be kept or quoted."
)]
struct Args {
    /// Scene file or folder; `default` is built in [default: the one that was open last; with --fresh or --screenshot `default`]
    scene: Option<String>,
    /// Starts as new: what is kept is neither read nor written
    #[arg(long)]
    fresh: bool,
    /// Size of the window, points
    #[arg(long, value_name = "WxH", default_value = "1280x800", value_parser = size)]
    size: [u32; 2],
    /// Draws the window into a PNG instead of opening it, once the steps of --script are done
    #[arg(long, value_name = "FILE")]
    screenshot: Option<PathBuf>,
    /// Draws with the WGSL files of this folder, laid out as kernels/src, and follows them as they are edited
    #[arg(long, value_name = "FOLDER")]
    shaders: Option<PathBuf>,
    /// What to do before the picture of --screenshot is taken: `click NAME`, `key KEY`, `set NAME = VALUE`, `type NAME = TEXT`, `open FILE`, `frames N`, `warm`, with `;` between them
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

/// What is kept, and what somebody should know of it.
fn open(fresh: bool) -> (Option<Keeper>, Vec<String>) {
    let Some(path) = kept::place().filter(|_| !fresh) else {
        let nowhere = "nothing is kept: the machine names no folder for it; set SCREE_STATE to a file";
        return (None, if fresh { Vec::new() } else { vec![nowhere.to_owned()] });
    };
    let (keeper, note) = Keeper::open(path);
    (Some(keeper), note.into_iter().collect())
}

fn run(args: &Args) -> Result<()> {
    let shaders = args.shaders.clone();
    if let Some(folder) = shaders.as_ref().filter(|folder| !folder.is_dir()) {
        bail!("--shaders {}: there is no such folder", folder.display());
    }
    if let Some(file) = &args.screenshot {
        if file.parent().is_some_and(|folder| !folder.as_os_str().is_empty() && !folder.is_dir()) {
            bail!("{}: its folder does not exist: make it first", file.display());
        }
        let steps = script::steps(&args.script).context("--script")?;
        return script::run(args.scene.as_deref().unwrap_or(scene::DEFAULT), args.size, shaders, &steps, file);
    }
    let (keeper, mut notes) = open(args.fresh);
    let last = keeper.as_ref().and_then(|keeper| keeper.kept().recent().first().cloned());
    let (name, scene) = match (&args.scene, last) {
        (Some(given), _) => (kept::scene_name(given), scene::load(given)?),
        (None, Some(last)) => match scene::load(&last) {
            Ok(scene) => (last, scene),
            Err(error) => {
                notes.push(format!("the scene that was open last is left out: {error}"));
                (scene::DEFAULT.to_owned(), scene::load(scene::DEFAULT)?)
            }
        },
        (None, None) => (scene::DEFAULT.to_owned(), scene::load(scene::DEFAULT)?),
    };
    for note in &notes {
        eprintln!("note: {note}");
    }
    let [width, height] = args.size.map(|n| n as f32);
    let options = eframe::NativeOptions {
        viewport: egui::ViewportBuilder::default().with_title(format!("Scree - {}", scene.name)).with_inner_size([width, height]),
        // A picture's texels are shown as they are, and a processor that paints the window has less to do.
        dithering: false,
        ..Default::default()
    };
    let open = |cc: &eframe::CreationContext<'_>| {
        still(&cc.egui_ctx);
        // The system's choice may be light, of which panes have the letters but not the ground; and pictures are judged before a dark one.
        cc.egui_ctx.set_theme(egui::Theme::Dark);
        let mut app = Workbench::new(&cc.egui_ctx, scene, shaders);
        app.model.come_from(&name);
        app.warm();
        if let Some(keeper) = keeper {
            app.model.keep_with(keeper, name, notes);
        }
        app
    };
    eframe::run_native("scree", options, Box::new(|cc| Ok(Box::new(open(cc))))).map_err(|error| no_window(&error))
}

/// Why there is no window, and what to do without.
fn no_window(error: &eframe::Error) -> anyhow::Error {
    // The library's own words name its source file; that there is no display is said plainly.
    let unset = |name: &str| std::env::var_os(name).is_none_or(|value| value.is_empty());
    let headless = cfg!(target_os = "linux") && unset("DISPLAY") && unset("WAYLAND_DISPLAY");
    let why = if headless { "neither DISPLAY nor WAYLAND_DISPLAY is set".to_owned() } else { error.to_string() };
    anyhow!(
        "no window could be opened ({why}): on a machine without a display use `workbench --screenshot FILE`, or `experiments`, which needs none"
    )
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
