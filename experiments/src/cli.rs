//! The command line. Scripts depend on it, so its options and output must remain stable.
//!
//! Most values that have the wrong form or lie outside their range, and most options that exclude each other, are reported here as usage errors (exit
//! status 2).

use std::path::PathBuf;

use crate::judge::{Metric, flip};
use clap::error::ErrorKind;
use clap::{ArgGroup, Args, CommandFactory, Parser, Subcommand, ValueEnum};
use kernels::base::error::one_line;
use kernels::frame::picture::AOV_NAMES;
use kernels::frame::{MAX_PIXELS, MAX_SIDE};

use crate::definition::MAX_TIMES_BUDGET_S;
use crate::settings::{FrameArgs, SceneArgs, scene_number};
use crate::unit::Shard;

/// Measures what a cheaper terrain material blend saves, and what visible errors it causes
#[derive(Parser, Debug)]
#[command(name = "experiments", version, subcommand_required = true, arg_required_else_help = true)]
#[command(after_help = "\
Exit status: 0 = done; 1 = the work failed (stderr says what failed, where, and how to fix it); 2 = the command line was wrong.

Examples:
  experiments adapters
  experiments explain default
  experiments render --camera cliff --out cliff.png
  experiments demo --out out/demo")]
pub(crate) struct Cli {
    #[command(subcommand)]
    pub(crate) command: Command,
}

#[derive(Subcommand, Debug)]
pub(crate) enum Command {
    /// Run a small experiment on the built-in world: frames, metrics, plots, report
    Demo(DemoArgs),
    /// Run experiments from definition files and measure everything that they request
    Run(RunArgs),
    /// Run the small version of experiments; fail if a result is outside its expected range
    Check(CheckArgs),
    /// Measure times, culling and simulated streaming on the built-in world; print ratios of times and the share of culled patches, with their targets
    Bench(BenchArgs),
    /// Render pictures of a scene
    Render(Box<RenderArgs>),
    /// Turn a heightmap into a scene folder
    Import(ImportArgs),
    /// Evaluate one function of the shaders for each row of a table, on the GPU or with its reference on the CPU
    Probe(ProbeArgs),
    /// Compare functions of the shaders at extreme values with references in f64; test stored directions, derivatives, hashes and noise; write tables
    /// and a report
    Stability(StabilityArgs),
    /// Compare a picture with a reference: FLIP, MSE, MRSE, PSNR, SSIM
    Compare(CompareArgs),
    /// Show what a scene requires and what it does not (flavours, variants, textures, passes, bytes), and list its settings
    Explain(ExplainArgs),
    /// Write the report of a run again from its rows
    Report(ReportArgs),
    /// List the graphics adapters of this machine and whether they are usable
    Adapters(AdaptersArgs),
}

#[derive(Args, Debug)]
#[command(after_help = "\
The demo is a built-in experiment, experiments/definitions/demo.toml. DIR receives the same files as those of `experiments run`. An
interrupted demo continues when it is started again with the same options. A finished demo, or a demo with different options, is replaced.

Example:
  experiments demo --out out/demo --seeds 32")]
pub(crate) struct DemoArgs {
    /// Folder that receives the results; created if missing
    #[arg(long, value_name = "DIR", default_value = "out/demo")]
    pub(crate) out: PathBuf,
    /// Size of the pictures, pixels
    #[arg(long, value_name = "WxH", default_value = "320x180", value_parser = size)]
    pub(crate) size: [u32; 2],
    /// Number of seeds for bias and variance
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = clap::value_parser!(u32).range(2..=4096))]
    pub(crate) seeds: u32,
    /// Camera of the built-in scene
    #[arg(long, value_name = "NAME", default_value = "cliff")]
    pub(crate) camera: String,
}

#[derive(Args, Debug)]
#[command(after_help = "\
Results go to DIR/<name of the experiment>: report.html, report.md, metrics.parquet, metrics.csv, times.parquet, times.csv,
manifest.json, pictures/, reference/ and, if the definition requests them, video/ and scene/.
`run` only reports an expectation that does not hold; `experiments check` fails instead.
Times are measured in rounds until the 95 % interval of each ratio of shading times is at most 5 % wide on each side, or until the definition's
`times_budget_s` are spent. Ratios with a wider interval are marked as unstable; they take no part in fronts, sentences and expectations.
--resume continues a run that was stopped, by Ctrl-C or a crash; its metrics are equal to those of an uninterrupted run. Shards may
run on several machines with equal adapters; `experiments report DIR/<name>` combines them.

Examples:
  experiments run experiments/definitions/noise.toml --out out
  experiments run experiments/definitions/noise.toml --out out --resume
  experiments run experiments/definitions/noise.toml --out out --shard 2/4")]
pub(crate) struct RunArgs {
    /// Definition files, run one after another
    #[arg(value_name = "DEFINITION.toml", required = true)]
    pub(crate) definitions: Vec<PathBuf>,
    /// Folder in which each experiment gets its own folder; created if missing
    #[arg(long, value_name = "DIR", default_value = "out")]
    pub(crate) out: PathBuf,
    /// Continue a run that was stopped
    #[arg(long)]
    pub(crate) resume: bool,
    /// Divide the run into N shards and run only the K-th, 1 <= K <= N
    #[arg(long, value_name = "K/N")]
    pub(crate) shard: Option<Shard>,
    /// Number of worker threads on the CPU [default: one for each core]
    #[arg(long, value_name = "J", value_parser = jobs)]
    pub(crate) jobs: Option<usize>,
}

#[derive(Args, Debug)]
#[command(after_help = "\
Each definition is run with the changes of its [small] section. If claims do not hold, the exit status is 1, and stderr names them.

Example:
  experiments check experiments/definitions/*.toml")]
pub(crate) struct CheckArgs {
    /// Definition files, checked one after another
    #[arg(value_name = "DEFINITION.toml", required = true)]
    pub(crate) definitions: Vec<PathBuf>,
    /// Folder for the results; without this option, the results are deleted
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
}

#[derive(Args, Debug)]
#[command(after_help = "\
Times of a software adapter can only be compared with each other, so ratios are printed, each with the half-width of its 95 % interval. A round draws
each picture once, in an order that is shuffled anew for each round. Rounds are added until the interval of each ratio of shading or geometry times,
or of each share of wall-clock time, is at most 5 % wide on each side, or until SECONDS are spent. Ratios whose interval is still wider are marked
as unstable.
At the end, the patches that culling removes are counted in 32 pictures along a straight flight of 10 km. The same flight is made with simulated
streaming of terrain nodes, fast and slow: the share of the ground that is drawn too coarse is printed for each kilometre and after a teleport.

Examples:
  experiments bench --size 960x540 --record notebooks-data/bench.csv
  experiments bench --budget 120 --json")]
pub(crate) struct BenchArgs {
    /// Size of the pictures, pixels
    #[arg(long, value_name = "WxH", default_value = "480x270", value_parser = size)]
    pub(crate) size: [u32; 2],
    /// Smallest number of timed rounds; the median over the rounds is used. With fewer than 6 rounds, there is no 95 % interval
    #[arg(long, value_name = "N", default_value_t = 9, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub(crate) repeats: u32,
    /// Seconds after which no further round begins. The budget applies separately to each camera, to times of passes and of the wall clock, and to
    /// starts
    #[arg(long, value_name = "SECONDS", default_value_t = 30.0, allow_hyphen_values = true, value_parser = budget)]
    pub(crate) budget: f64,
    /// CSV file that receives the medians of the times and of their ratios, the share of culled patches, and the ratio of starts
    #[arg(long, value_name = "FILE")]
    pub(crate) record: Option<PathBuf>,
    /// Print the ratios by camera and name, the counts of culled patches, the results of simulated streaming and the ratio of starts as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Args, Debug)]
#[command(group = ArgGroup::new("view").required(true).args(["camera", "pose", "path"]))]
#[command(after_help = "\
An .exr picture is linear and has a layer for each AOV; a .png picture is for viewing.
With --path or --frames, the frame number is inserted before the extension: out.exr becomes out-0000.exr, out-0001.exr, ...

Estimators (fetches on near cliff, far cliff, splat):
  fc5        Far Cry 5: random choices on cliffs (12, 8, 48)
  exact      mean of those choices (48, 96, 48)
  biplanar   like fc5, with only the two projections of largest weight (8, 8, 32)
  hex        like fc5, with hex tiling instead of a second tiling scale (30, 10, 120)
  stf        one random tap of one texel (4, 4, 4)
  laplacian  coarse and fine detail blended separately (60, 60, 60)
  luna8      eight layers projected from above and blended over one another (28, 28, 28)
  snapped    one of five projections (16, 16, 16)

Layers of --aov:
  albedo    linear colour before lighting
  normal    unit normal, world axes
  depth     metres along the view direction; 0 = no terrain
  mask      flavours that the rules give the pixel: sum of vt 1, far-atlas 2, near-cliff 4, far-cliff 8, splat 16
  variant   flavours with which the pixel's tile was shaded, as a sum of the numbers of mask
  fetches   texture fetches of the pixel
  choice    first random choice: 1 + splat texel + 4 x projection; 0 = none
  position  world position, metres
  ddx       change of position to the next pixel on the right, on the triangle's plane, metres
  ddy       change of position to the next pixel below, on the triangle's plane, metres
  lod       LOD of the terrain node, 0 (finest) to 5; -1 = no terrain
  stride    vertex stride of the patch, 1 to 16; 0 = no terrain

Examples:
  experiments render --camera cliff --out cliff.png
  experiments render --camera ground --size 960x540 --variant near-cliff --estimator exact --out mean.exr --aov albedo,choice
  experiments render --scene alps --pose 120,-40,900,45,-10 --reference 64 --out truth.exr
  experiments render --path sideways --frames 8 --noise hashed --out frames/step.exr")]
pub(crate) struct RenderArgs {
    /// Scene: `default`, a .toml file, or a folder with scene.toml
    #[arg(long, value_name = "S", default_value = kernels::scene::DEFAULT)]
    pub(crate) scene: String,
    /// A camera of the scene
    #[arg(long, value_name = "NAME")]
    pub(crate) camera: Option<String>,
    /// Camera position in metres (Z is elevation), compass bearing and angle above the horizon in degrees
    #[arg(long, value_name = "X,Y,Z,YAW,PITCH", allow_hyphen_values = true, value_parser = pose)]
    pub(crate) pose: Option<[f64; 5]>,
    /// A camera path of the scene
    #[arg(long, value_name = "PATH")]
    pub(crate) path: Option<String>,
    /// Number of frames [default: 1, or the whole path]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub(crate) frames: Option<u32>,
    /// Vertical field of view, degrees, 1 to 175 [default: that of the camera or path; 55 with --pose]
    #[arg(long, value_name = "DEG", allow_hyphen_values = true, value_parser = fov)]
    pub(crate) fov: Option<f64>,
    /// Size of the picture, pixels: at most 16384 on each side and 2^26 in total
    #[arg(long, value_name = "WxH", default_value = "960x540", value_parser = size)]
    pub(crate) size: [u32; 2],
    #[command(flatten)]
    pub(crate) frame: FrameArgs,
    #[command(flatten)]
    pub(crate) scene_settings: SceneArgs,
    /// Render the converged 96-fetch reference instead, with this many samples per pixel
    #[arg(long, value_name = "SPP", conflicts_with_all = ["variant", "generic", "estimator", "noise", "two-tilings"], value_parser = clap::value_parser!(u32).range(1..=65_536))]
    pub(crate) reference: Option<u32>,
    /// Layers to write into the picture: albedo, normal, depth, mask, variant, fetches, choice, position, ddx, ddy, lod, stride (.exr only; each
    /// is explained below)
    #[arg(long, value_name = "LIST", value_delimiter = ',', hide_possible_values = true, value_parser = AOV_NAMES)]
    pub(crate) aov: Vec<String>,
    /// Output file: .exr or .png
    #[arg(long, value_name = "FILE.exr|FILE.png", value_parser = picture)]
    pub(crate) out: PathBuf,
    /// Print a summary as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Args, Debug)]
#[command(after_help = "\
Reads 16-bit PNG, RAW (.raw, .r16, .bin: 16-bit integers; .r32: 32-bit floats), OpenEXR and (Geo)TIFF. Whatever a file says about its samples
(unit, scale, offset, spacing, orientation, mask, no-data value) is applied. If this is impossible, the file is refused, and the message says how to
fix it. An option that does not apply to the file, or contradicts it, is an error. What was understood is printed at the end; --dry-run prints it and
writes nothing.

Floats are metres, or lie in 0..1 and are mapped to --height-range. Integers need --height-range, unless a TIFF states their unit or scale.
A value such as -9999 that the file does not declare, but that usually marks missing data, is refused until --no-data names or excludes it.

Examples:
  experiments import dem.tif --out dem
  experiments import dem.tif --no-data -9999 --fill-voids --out dem
  experiments import alps.png --metres-per-texel 10 --height-range 1399,2716 --out alps
  experiments import dump.raw --raw-size 4097x4097 --metres-per-texel 2 --height-range 0,1200 --window 0,0,1025,1025 --out corner")]
pub(crate) struct ImportArgs {
    /// The heightmap
    #[arg(value_name = "HEIGHTMAP")]
    pub(crate) heightmap: PathBuf,
    /// Sample spacing, metres; not needed if a TIFF states it
    #[arg(long, value_name = "M", allow_hyphen_values = true, value_parser = spacing)]
    pub(crate) metres_per_texel: Option<f64>,
    /// Elevations of the smallest and largest possible integer sample, or of the float samples 0 and 1, metres
    #[arg(long, value_name = "LO,HI", allow_hyphen_values = true, value_parser = height_range)]
    pub(crate) height_range: Option<[f64; 2]>,
    /// Folder that holds the images of materials (albedo, normal, height, roughness), in one or more sub-folders; without this option, materials are
    /// procedural
    #[arg(long, value_name = "DIR")]
    pub(crate) materials: Option<PathBuf>,
    /// Edge of the square that one repeat of a texture covers, metres, for all materials [default: as stated in the names of folders or files, or
    /// the usual size for the kind of ground]
    #[arg(long, value_name = "M", requires = "materials", allow_hyphen_values = true, value_parser = tile_size)]
    pub(crate) tile_size: Option<f64>,
    /// Width and height of a .raw, .r16, .bin or .r32 file; without this option, the file must be square
    #[arg(long, value_name = "WxH", value_parser = raw_size)]
    pub(crate) raw_size: Option<[u32; 2]>,
    /// The samples of a .raw, .r16, .bin or .r32 file are big-endian
    #[arg(long)]
    pub(crate) raw_big_endian: bool,
    /// Channel of an OpenEXR file that holds the heights, with or without part and layer: part.layer.channel
    #[arg(long, value_name = "NAME")]
    pub(crate) channel: Option<String>,
    /// Stored sample value that marks missing data; may be given several times. `none`: no value marks missing data
    #[arg(long, value_name = "V|none", allow_hyphen_values = true, value_parser = no_data)]
    pub(crate) no_data: Vec<NoDataArg>,
    /// Fill gaps (samples without data) with a smooth surface that meets the heights at the rim of each gap
    #[arg(long)]
    pub(crate) fill_voids: bool,
    /// Make holes in the ground where samples have no data (at most 512 samples in total)
    #[arg(long, conflicts_with = "fill_voids")]
    pub(crate) holes: bool,
    /// Read only this part: left, top, width, height, in samples
    #[arg(long, value_name = "X,Y,W,H", value_parser = window)]
    pub(crate) window: Option<[u32; 4]>,
    /// Largest offset of procedural relief at scales finer than the data, metres; without it, cliffs in coarse data are smooth ramps
    #[arg(long, value_name = "M", default_value_t = 0.0, allow_hyphen_values = true, value_parser = detail)]
    pub(crate) detail: f64,
    /// Folder of the new scene; must be empty or not exist yet
    #[arg(long, value_name = "SCENE_DIR", required_unless_present = "dry_run")]
    pub(crate) out: Option<PathBuf>,
    /// Print what was understood of the files, and write nothing
    #[arg(long)]
    pub(crate) dry_run: bool,
}

/// A value of --no-data.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum NoDataArg {
    Value(f64),
    /// No value marks missing data: each number is an elevation.
    Nothing,
}

#[derive(Args, Debug)]
#[command(after_help = "\
The table is CSV with a header, in UTF-8 or in UTF-16 with a byte order mark. Cells are separated by , ; | or tabs; a table with ; may have decimal
commas. Columns are found by name; unknown columns are ignored. `probe --list` prints kernels, columns and units.

Examples:
  experiments probe --list
  experiments probe octahedral --on f64 --input normals.csv --output decoded.csv")]
pub(crate) struct ProbeArgs {
    /// Name of the function to evaluate, from `probe --list`
    #[arg(value_name = "KERNEL", required_unless_present = "list")]
    pub(crate) kernel: Option<String>,
    /// Evaluate on the GPU, or with the reference in f32 or f64
    #[arg(long, value_enum, default_value_t = On::Gpu)]
    pub(crate) on: On,
    /// Table to read
    #[arg(long, value_name = "IN.csv", required_unless_present = "list")]
    pub(crate) input: Option<PathBuf>,
    /// Table to write: the columns of the input, then the results
    #[arg(long, value_name = "OUT.csv", required_unless_present = "list")]
    pub(crate) output: Option<PathBuf>,
    /// Print the functions (kernels) with their columns and units
    #[arg(long, conflicts_with_all = ["kernel", "input", "output"])]
    pub(crate) list: bool,
    /// Print the list as JSON
    #[arg(long, requires = "list")]
    pub(crate) json: bool,
}

#[derive(Args, Debug)]
#[command(after_help = "\
The command fails if a result of a kernel is not finite or its error exceeds the derived tolerance, or if a measured property of directions,
derivatives, hashes or noise is outside its range. Tables and report are written in any case. The table of extremes is a TOML file: copy
experiments/src/stability/extremes.toml and edit it.

Examples:
  experiments stability
  experiments stability --extremes mine.toml --out out/mine")]
pub(crate) struct StabilityArgs {
    /// Table of the extreme values at which kernels are tested [default: built in]
    #[arg(long, value_name = "FILE.toml")]
    pub(crate) extremes: Option<PathBuf>,
    /// Parts to measure, separated by commas [default: all; `kernels` with --extremes]
    #[arg(long, value_enum, value_name = "PARTS", value_delimiter = ',')]
    pub(crate) only: Vec<Part>,
    /// Measure kernels on every usable adapter of this machine, and report differences
    #[arg(long)]
    pub(crate) every_adapter: bool,
    /// Folder for results.csv, directions.csv, noise.csv, report.md and report.html; existing tables of parts that are not measured are kept
    #[arg(long, value_name = "DIR", default_value = "out/stability")]
    pub(crate) out: PathBuf,
}

/// A part of the stability lab, which can be measured separately.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Part {
    /// Functions of the shaders (kernels) at extreme values, compared with references in f64
    Kernels,
    /// Octahedral encodings of directions, and derivatives from stored planes
    Directions,
    /// Hashes and noise, at rest and in motion
    Noise,
}

impl Part {
    /// All parts.
    pub(crate) const ALL: [Part; 3] = [Part::Kernels, Part::Directions, Part::Noise];
}

#[derive(Args, Debug)]
#[command(after_help = "\
The test is t and the reference is r, both in linear colour of Rec. 709. PNG and JPEG are decoded from sRGB, or as a PNG states by gAMA and cHRM.
OpenEXR pictures are placed in their display windows (pixels without data are black), and their primaries are converted. Lines that begin with `note`
say what the metrics do not show, such as alpha or clamped values.
  flip  difference that a viewer sees when flipping between t and r, 0 (none) to 1: LDR-FLIP of 8-bit sRGB encodings; mean over
        pixels, quartiles in which each pixel is weighted by its error, and maximum
  mse   mean of (t - r)^2 over pixels and channels
  mrse  mean of (t - r)^2 / (r^2 + 0.01) over pixels and channels
  psnr  10 log10(1 / mse) of their sRGB encodings, dB; infinite (null in JSON) if they are equal
  ssim  structural similarity of their sRGB encodings, -1 to 1 (equal): Gaussian window of 11x11, sigma 1.5; no value
        (null in JSON) if no window fits into the picture
Encodings are clamped to 0..1. Layers of vectors and numbers have no encoding: they are compared only by mse and mrse.

Examples:
  experiments compare noisy.exr truth.exr --layer albedo --terrain
  experiments compare noisy.png truth.png --metric flip,ssim --map error.png")]
pub(crate) struct CompareArgs {
    /// The test: the picture to judge (.exr, .png or .jpg)
    #[arg(value_name = "A")]
    pub(crate) test: PathBuf,
    /// The reference: what the test should look like
    #[arg(value_name = "B")]
    pub(crate) reference: PathBuf,
    /// Metrics, from flip, mse, mrse, psnr, ssim [default: all that are possible for the channels]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = metric)]
    pub(crate) metric: Vec<Metric>,
    /// Layer to compare in both pictures, such as `albedo` (.exr only) [default: the picture itself, or the only layer with colour]
    #[arg(long, value_name = "NAME")]
    pub(crate) layer: Option<String>,
    /// Compare only terrain pixels, whose alpha in B is 1; elsewhere A is set equal to B before flip and ssim are computed
    #[arg(long)]
    pub(crate) terrain: bool,
    /// Write a map of FLIP errors in the magma colour map (0 is black, 1 pale yellow), even if --metric does not list flip
    #[arg(long, value_name = "FILE.png", value_parser = png)]
    pub(crate) map: Option<PathBuf>,
    /// Pixels per degree of the viewer's field of view, for flip, 4 to 400
    #[arg(long, value_name = "N", default_value_t = flip::PIXELS_PER_DEGREE, allow_hyphen_values = true, value_parser = pixels_per_degree)]
    pub(crate) pixels_per_degree: f32,
    /// Print the result as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  experiments explain default
  experiments explain alps/scene.toml --json")]
pub(crate) struct ExplainArgs {
    /// `default`, a .toml file, or a folder with scene.toml
    #[arg(value_name = "SCENE")]
    pub(crate) scene: String,
    /// Print the result as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Args, Debug)]
#[command(after_help = "\
Writes report.html, a single file that can be mailed, and report.md, for pull requests, into the folder.

Example:
  experiments report out/hash-scale")]
pub(crate) struct ReportArgs {
    /// Folder of a run
    #[arg(value_name = "DIR")]
    pub(crate) run: PathBuf,
}

#[derive(Args, Debug)]
pub(crate) struct AdaptersArgs {
    /// Print the list as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

/// Where `probe` evaluates a function.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum On {
    /// The shader
    Gpu,
    /// The reference in single precision
    F32,
    /// The reference in double precision
    F64,
}

impl Cli {
    /// Parses the command line. If it is wrong, prints one line and ends the process with exit status 2.
    pub(crate) fn read() -> Cli {
        let cli = Cli::try_parse().unwrap_or_else(|error| refuse(&error));
        if let Err((command, what)) = cli.check() {
            let mut top = Cli::command();
            let found = top.find_subcommand_mut(command).map(|c| c.clone().bin_name(format!("experiments {command}")));
            refuse(&found.unwrap_or(top).error(ErrorKind::ArgumentConflict, what));
        }
        cli
    }

    /// Checks combinations of options that clap's attributes cannot describe.
    fn check(&self) -> Result<(), (&'static str, String)> {
        match &self.command {
            Command::Render(args) if !args.aov.is_empty() && extension(&args.out) == "png" => {
                Err(("render", "--aov needs an .exr file, because .png files have no layers: change --out".to_owned()))
            }
            Command::Import(args) if args.no_data.len() > 1 && args.no_data.contains(&NoDataArg::Nothing) => {
                Err(("import", "--no-data none excludes other values: give either".to_owned()))
            }
            Command::Stability(args)
                if !args.only.is_empty() && !args.only.contains(&Part::Kernels) && (args.every_adapter || args.extremes.is_some()) =>
            {
                Err(("stability", "--extremes and --every-adapter need `kernels`: add it to --only, or omit these options".to_owned()))
            }
            _ => Ok(()),
        }
    }
}

/// Ends the process. Help and version are printed unchanged. An error is printed on one line, with exit status 2.
fn refuse(error: &clap::Error) -> ! {
    if !error.use_stderr() || error.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand {
        error.exit();
    }
    let text = error.to_string();
    // The text after the first of these marks is general usage advice, which `--help` gives in more detail.
    let end = ["\nUsage:", "\nFor more information"].iter().filter_map(|mark| text.find(mark)).min().unwrap_or(text.len());
    eprintln!("{} (`--help` explains)", one_line(&text[..end]));
    std::process::exit(2)
}

/// Returns the extension of a file in lower case.
pub(crate) fn extension(path: &std::path::Path) -> String {
    path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_lowercase()
}

fn pair(text: &str) -> Result<[u32; 2], String> {
    let wrong = || format!("`{text}` is not WIDTHxHEIGHT, as in 960x540");
    let (width, height) = text.split_once(['x', 'X']).ok_or_else(wrong)?;
    let number = |digits: &str| digits.trim().parse::<u32>().map_err(|_| wrong());
    Ok([number(width)?, number(height)?])
}

fn size(text: &str) -> Result<[u32; 2], String> {
    let [width, height] = pair(text)?;
    let pixels = u64::from(width) * u64::from(height);
    if (1..=MAX_SIDE).contains(&width) && (1..=MAX_SIDE).contains(&height) && pixels <= MAX_PIXELS {
        Ok([width, height])
    } else {
        Err(format!("each side must be 1 to {MAX_SIDE} pixels, and the picture must have at most {MAX_PIXELS} (2^26) pixels"))
    }
}

fn jobs(text: &str) -> Result<usize, String> {
    text.parse().ok().filter(|jobs| (1..=1024).contains(jobs)).ok_or_else(|| "must be a whole number from 1 to 1024".to_owned())
}

fn raw_size(text: &str) -> Result<[u32; 2], String> {
    let [width, height] = pair(text)?;
    if width >= 2 && height >= 2 { Ok([width, height]) } else { Err("a heightmap must have at least 2 samples on each side".to_owned()) }
}

/// Parses `N` finite numbers separated by commas.
fn numbers<const N: usize>(text: &str, shape: &str) -> Result<[f64; N], String> {
    let wrong = || format!("give {shape}; numbers expected: {N}");
    let parts: Vec<f64> = text.split(',').map(|part| part.trim().parse::<f64>().map_err(|_| wrong())).collect::<Result<_, _>>()?;
    let all: [f64; N] = parts.try_into().map_err(|_| wrong())?;
    if all.iter().all(|v| v.is_finite()) { Ok(all) } else { Err(format!("{shape} must be finite")) }
}

fn pose(text: &str) -> Result<[f64; 5], String> {
    let pose: [f64; 5] = numbers(text, "X,Y,Z,YAW,PITCH")?;
    if pose[..3].iter().any(|v| v.abs() > 1.0e7) {
        return Err("X, Y and Z are metres, at most 10 000 000 from the origin".to_owned());
    }
    if pose[3].abs() > 3600.0 || pose[4].abs() > 90.0 {
        return Err("YAW must lie in -3600..=3600 degrees and PITCH in -90..=90 degrees".to_owned());
    }
    Ok(pose)
}

fn fov(text: &str) -> Result<f64, String> {
    let [fov] = numbers(text, "DEG")?;
    if (1.0..=175.0).contains(&fov) { Ok(fov) } else { Err("must lie in 1..=175 degrees".to_owned()) }
}

fn budget(text: &str) -> Result<f64, String> {
    let [budget] = numbers(text, "SECONDS")?;
    if budget > 0.0 && budget <= MAX_TIMES_BUDGET_S {
        Ok(budget)
    } else {
        Err(format!("must be above 0 and at most {MAX_TIMES_BUDGET_S} s"))
    }
}

fn spacing(text: &str) -> Result<f64, String> {
    let [spacing] = numbers(text, "M")?;
    scene_number("world.metres_per_texel", spacing)
}

fn detail(text: &str) -> Result<f64, String> {
    let [detail] = numbers(text, "M")?;
    scene_number("world.detail_m", detail)
}

fn tile_size(text: &str) -> Result<f64, String> {
    let [edge] = numbers(text, "M")?;
    if edge > 0.0 && edge <= 1.0e5 { Ok(edge) } else { Err("must be above 0 and at most 100000 m".to_owned()) }
}

fn no_data(text: &str) -> Result<NoDataArg, String> {
    if text.eq_ignore_ascii_case("none") {
        return Ok(NoDataArg::Nothing);
    }
    text.trim().parse().map(NoDataArg::Value).map_err(|_| format!("`{text}` is neither a number nor `none`"))
}

fn height_range(text: &str) -> Result<[f64; 2], String> {
    let [low, high] = numbers(text, "LO,HI")?;
    if low < high { Ok([low, high]) } else { Err("LO must be below HI".to_owned()) }
}

fn window(text: &str) -> Result<[u32; 4], String> {
    let shape = "give X,Y,W,H: 4 whole numbers separated by commas, W and H at least 2";
    let parts: Vec<u32> = text.split(',').map(|part| part.trim().parse().map_err(|_| shape.to_owned())).collect::<Result<_, _>>()?;
    let all: [u32; 4] = parts.try_into().map_err(|_| shape.to_owned())?;
    if all[2] >= 2 && all[3] >= 2 { Ok(all) } else { Err(shape.to_owned()) }
}

fn metric(text: &str) -> Result<Metric, String> {
    text.parse().map_err(|error: kernels::base::error::Error| error.to_string())
}

fn pixels_per_degree(text: &str) -> Result<f32, String> {
    let [low, high] = crate::metrics::PIXELS_PER_DEGREE_RANGE;
    text.parse().ok().filter(|n| (low..=high).contains(n)).ok_or_else(|| format!("must be a number in {low}..={high}"))
}

fn png(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    if extension(&path) == "png" { Ok(path) } else { Err("must end in .png".to_owned()) }
}

fn picture(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    match extension(&path).as_str() {
        "exr" | "png" => Ok(path),
        _ => Err("must end in .exr or .png".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use kernels::shading::Estimator;
    use kernels::variant::Flavour;

    use super::*;

    #[test]
    fn definitions_are_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn sizes() {
        assert_eq!(size("960x540"), Ok([960, 540]));
        assert_eq!(size("16384x4096"), Ok([16_384, 4096]));
        for wrong in ["0x0", "1000000x1", "16384x16384", "16385x1", "960", "x", "-1x5", "9.5x4", "99999999999x1", ""] {
            assert!(size(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn poses() {
        assert_eq!(pose("-1,2.5,3,-90,10"), Ok([-1.0, 2.5, 3.0, -90.0, 10.0]));
        for wrong in ["1,2,3,4", "1,2,3,4,5,6", "nan,0,0,0,0", "0,0,inf,0,0", "0,0,0,0,91", "1e9,0,0,0,0", "a,b,c,d,e"] {
            assert!(pose(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn budgets() {
        assert_eq!([budget("30"), budget("0.5"), budget("86400")], [Ok(30.0), Ok(0.5), Ok(MAX_TIMES_BUDGET_S)]);
        for wrong in ["0", "-1", "nan", "inf", "86401", "", "a", "1,2"] {
            assert!(budget(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn values_without_data() {
        assert_eq!(no_data("-9999"), Ok(NoDataArg::Value(-9999.0)));
        assert_eq!(no_data("-3.4028234663852886e+38"), Ok(NoDataArg::Value(f64::from(f32::MIN))));
        assert_eq!(no_data("None"), Ok(NoDataArg::Nothing));
        for wrong in ["", "x", "1,2", "9999m"] {
            assert!(no_data(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn every_estimator_is_explained_with_its_fetches() {
        let mut command = Cli::command();
        let help = command.find_subcommand_mut("render").expect("a command").render_long_help().to_string();
        for e in Estimator::ALL {
            let counts = [Flavour::NearCliff, Flavour::FarCliff, Flavour::Splat].map(|f| e.promised_fetches(f).to_string());
            let line = help.lines().find(|l| l.trim_start().starts_with(&format!("{e} "))).unwrap_or_else(|| panic!("{}", e.name()));
            assert!(line.ends_with(&format!("({})", counts.join(", "))), "{line}");
        }
    }
}
