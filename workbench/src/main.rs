//! The program `workbench`: it opens the window, or writes a picture of the window to a file.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, Result, anyhow, bail};
use clap::Parser;
use eframe::egui;
use kernels::scene;
use workbench::model::kept::{self, Keeper};
use workbench::script;
use workbench::window::{Workbench, still};

/// Shades terrain interactively: choose a variant (one of 31), an estimator and a noise with a click, and see what each costs.
#[derive(Parser)]
#[command(
    version,
    about,
    after_help = "Without a display: --screenshot FILE --script STEPS draws the same window into a file. For numbers to quote, use `experiments`."
)]
struct Args {
    /// Scene file or folder, or `default` for the built-in scene. If it is not given, the scene that was open last is opened; with --fresh or
    /// --screenshot, the built-in scene
    scene: Option<String>,
    /// Starts with default settings; the saved state of the workbench is neither read nor written
    #[arg(long)]
    fresh: bool,
    /// Size of the window in points
    #[arg(long, value_name = "WxH", default_value = "1280x800", value_parser = size)]
    size: [u32; 2],
    /// Carries out the steps of --script and writes a PNG of the window, without opening a window
    #[arg(long, value_name = "FILE")]
    screenshot: Option<PathBuf>,
    /// Draws with the WGSL files in this folder, which has the layout of kernels/src, and reloads a file when it changes
    #[arg(long, value_name = "FOLDER")]
    shaders: Option<PathBuf>,
    /// Steps to carry out before the picture of --screenshot is drawn, separated by `;`: `click NAME`, `key KEY`, `set NAME = VALUE`,
    /// `type NAME = TEXT`, `open FILE`, `frames N`, `warm`. Time begins at frame 0 and advances only with `frames N`, or by one frame with
    /// `key Period` or `click Step`
    #[arg(long, value_name = "STEPS", requires = "screenshot", default_value = "")]
    script: String,
}

/// Smallest and largest side of a window that `--size` accepts, points.
const SIDES: [u32; 2] = [1, 8192];

fn size(text: &str) -> Result<[u32; 2], String> {
    let parse = || {
        let (width, height) = text.split_once('x')?;
        Some([width.parse::<u32>().ok()?, height.parse::<u32>().ok()?])
    };
    let wrong = || format!("give WIDTHxHEIGHT, such as 1280x800, each side from {} to {}", SIDES[0], SIDES[1]);
    parse().filter(|size| size.iter().all(|n| (SIDES[0]..=SIDES[1]).contains(n))).ok_or_else(wrong)
}

/// Opens the file of the saved state, unless `fresh` is set. Returns the [`Keeper`] that reads and writes the file, and notes for the user. `None` =
/// nothing is read or saved.
fn open(fresh: bool) -> (Option<Keeper>, Vec<String>) {
    let Some(path) = kept::place().filter(|_| !fresh) else {
        let nowhere = "nothing is saved between starts, because no folder for the saved state is known: set SCREE_STATE to a file";
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
            bail!("cannot write {}: its folder does not exist; create the folder first", file.display());
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
                notes.push(format!("the scene that was open last cannot be opened: {error}"));
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
        // Dithering would change the texels of the picture, and would cost time if a software adapter paints the window.
        dithering: false,
        ..Default::default()
    };
    let open = |cc: &eframe::CreationContext<'_>| {
        still(&cc.egui_ctx);
        // Use the dark theme even if the system has a light one. Otherwise, panes would show the dark text of the light theme on a dark background.
        // Pictures are also easier to judge on a dark background.
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

/// The error message for a window that cannot be opened. It gives the reason, and names the commands that need no display.
fn no_window(error: &eframe::Error) -> anyhow::Error {
    // The error message of the window library names a source file of that library. If there is no display, which is the common cause, say so instead.
    let unset = |name: &str| std::env::var_os(name).is_none_or(|value| value.is_empty());
    let headless = cfg!(target_os = "linux") && unset("DISPLAY") && unset("WAYLAND_DISPLAY");
    let why = if headless { "neither DISPLAY nor WAYLAND_DISPLAY is set".to_owned() } else { error.to_string() };
    anyhow!(
        "no window could be opened ({why}): without a display, use `workbench --screenshot FILE`, or `experiments`, which needs no display"
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
