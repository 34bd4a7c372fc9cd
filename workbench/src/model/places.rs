//! Places (stored camera poses) and recorded paths: their names, how paths are recorded, and how places and paths are stored in files.

use std::f64::consts::{FRAC_PI_2, PI};
use std::fmt;
use std::fs::{self, File};
use std::io::Read;
use std::path::Path;
use std::sync::Arc;

use glam::DVec3;
use kernels::base::error::one_line;
use kernels::scene::CameraPose;
use kernels::view::camera::Pose;
use serde::{Deserialize, Serialize};

use super::files;

/// Maximum number of frames of a path. At 60 frames a second, a path of this length takes about 28 minutes. Its poses take about 5 MB of memory.
pub const MOST_FRAMES: usize = 100_000;
/// Maximum number of frames that may be missing between two pictures of a recording. Frames are missing if the user steps through time faster than
/// pictures are drawn.
const LONGEST_GAP: usize = 60;
/// Limit of the length of a name, characters.
const NAME_LENGTH: usize = 100;
/// Limit of the size of a file that is read as a path, bytes. The file of a path of [`MOST_FRAMES`] frames usually has about 12
/// million bytes.
const MOST_BYTES: u64 = 64 << 20;
/// Columns of the file of a path. Angles are in radians, so that a replay has the poses of the recording to the last bit. Degrees would not preserve
/// them: for some angles in radians, no f64 in degrees converts back to exactly the same f64.
const COLUMNS: [&str; 7] = ["frame", "x_m", "y_m", "z_m", "yaw_rad", "pitch_rad", "fov_rad"];

/// Converts an angle to degrees. Returns an angle in degrees that converts back to exactly `radians`, if there is one. Otherwise, returns the result
/// of the ordinary conversion. Such an angle changes when it is first written to a file and read again, by a relative error of at most 2 *
/// `f64::EPSILON`. It does not change after that.
fn degrees(radians: f64) -> f64 {
    let nearest = radians.to_degrees();
    let (mut above, mut below) = (nearest, nearest);
    // Converting to degrees and back multiplies twice. Each multiplication has two roundings: its factor (180/pi or pi/180) is rounded, and so is its
    // product. Each of the four roundings has a relative error of at most 2^-53. One unit in the last place is at least 2^-53 of the value, so the
    // errors add up to at most four units. Four steps in each direction therefore reach every angle that can convert back exactly.
    for _ in 0..=4 {
        if let Some(exact) = [above, below].into_iter().find(|degrees| degrees.to_radians() == radians) {
            return exact;
        }
        (above, below) = (above.next_up(), below.next_down());
    }
    nearest
}

/// Converts a yaw to degrees. A yaw whose value in degrees would be infinite is first replaced by the angle from -pi to pi with the same direction.
/// Only a file can contain a yaw of this size.
fn yaw_in_degrees(yaw: f64) -> f64 {
    let (sin, cos) = yaw.sin_cos();
    degrees(if yaw.to_degrees().is_finite() { yaw } else { sin.atan2(cos) })
}

/// Checks that a camera can have this pose.
fn check(pose: Pose) -> Result<Pose, String> {
    if !pose.position.is_finite() || !pose.yaw.is_finite() {
        return Err("position and yaw must be finite".to_owned());
    }
    if !(-FRAC_PI_2..=FRAC_PI_2).contains(&pose.pitch) {
        return Err(format!("pitch is {} radians, must lie within pi/2 of the horizon", pose.pitch));
    }
    if !(pose.fov > 0.0 && pose.fov < PI) {
        return Err(format!("the field of view is {} radians, must lie between 0 and pi", pose.fov));
    }
    Ok(pose)
}

/// A stored camera pose. In files it has the form of a scene's camera, so that it can be copied into a scene file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "CameraPose", into = "CameraPose")]
pub struct Place {
    /// The name of the place, one line.
    pub name: String,
    /// Position, direction and field of view.
    pub pose: Pose,
}

impl From<Place> for CameraPose {
    fn from(Place { name, pose }: Place) -> CameraPose {
        CameraPose {
            name,
            position: pose.position.to_array(),
            above_ground: false,
            yaw_deg: yaw_in_degrees(pose.yaw),
            pitch_deg: degrees(pose.pitch),
            fov_deg: degrees(pose.fov),
        }
    }
}

impl TryFrom<CameraPose> for Place {
    type Error = String;

    fn try_from(camera: CameraPose) -> Result<Place, String> {
        if camera.above_ground {
            return Err(format!(
                "`{}` has `above_ground = true`, which only a camera in a scene file may have: give z as the elevation",
                camera.name
            ));
        }
        let pose = check(Pose::of(&camera, |_, _| 0.0)).map_err(|what| format!("`{}`: {what}", camera.name))?;
        Ok(Place { name: camera.name, pose })
    }
}

/// A recorded path: one pose per frame; it repeats after its last frame. Clones share the poses.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(try_from = "Written", into = "Written")]
pub struct Recorded {
    /// The name of the path, one line.
    pub name: String,
    poses: Arc<[Pose]>,
}

/// A path in the file of the saved state: rows of x, y and z in metres, then yaw, pitch and field of view in radians.
#[derive(Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Written {
    name: String,
    poses: Vec<[f64; 6]>,
}

impl From<Recorded> for Written {
    fn from(recorded: Recorded) -> Written {
        Written { poses: recorded.poses.iter().map(numbers).collect(), name: recorded.name }
    }
}

impl TryFrom<Written> for Recorded {
    type Error = String;

    fn try_from(written: Written) -> Result<Recorded, String> {
        let poses = written.poses.iter().zip(1..).map(|(&row, number)| pose(row).map_err(|what| format!("row {number}: {what}")));
        let poses = poses.collect::<Result<Vec<Pose>, String>>().map_err(|what| format!("path `{}`, {what}", written.name))?;
        Recorded::new(&written.name, poses).map_err(|what| format!("path `{}` {what}", written.name))
    }
}

fn numbers(pose: &Pose) -> [f64; 6] {
    let [x, y, z] = pose.position.to_array();
    [x, y, z, pose.yaw, pose.pitch, pose.fov]
}

fn pose([x, y, z, yaw, pitch, fov]: [f64; 6]) -> Result<Pose, String> {
    check(Pose { position: DVec3::new(x, y, z), yaw, pitch, fov })
}

impl PartialEq for Recorded {
    fn eq(&self, other: &Recorded) -> bool {
        // Viewpoints are compared each time the window is drawn. Clones share their poses, so comparing clones must not visit every pose.
        self.name == other.name && (Arc::ptr_eq(&self.poses, &other.poses) || self.poses == other.poses)
    }
}

impl Recorded {
    /// Creates a path from poses, one per frame.
    ///
    /// # Errors
    /// There are no poses, or more than [`MOST_FRAMES`].
    pub fn new(name: &str, poses: Vec<Pose>) -> Result<Recorded, String> {
        match poses.len() {
            0 => Err("has no frames".to_owned()),
            1..=MOST_FRAMES => Ok(Recorded { name: name.to_owned(), poses: poses.into() }),
            more => Err(format!("has {more} frames, more than {MOST_FRAMES}")),
        }
    }

    /// Number of frames, 1 to [`MOST_FRAMES`].
    pub fn frames(&self) -> usize {
        self.poses.len()
    }

    /// The pose of the camera in a frame. After the last frame the path begins again.
    pub fn pose(&self, frame: u32) -> Pose {
        self.poses[frame as usize % self.poses.len()]
    }

    /// The path as a table: a header with names and units, then one row per frame. Each number has the fewest digits from which exactly the same f64
    /// is read back.
    pub fn to_csv(&self) -> String {
        let mut text = COLUMNS.join(",");
        text.push('\n');
        for (frame, pose) in self.poses.iter().enumerate() {
            let row = numbers(pose).map(|number| format!("{number:?}")).join(",");
            text.push_str(&format!("{frame},{row}\n"));
        }
        text
    }

    /// Reads a table that [`Recorded::to_csv`] wrote. `place` names the table in errors.
    ///
    /// # Errors
    /// One line with `place` and, if one line of the table is wrong, the number of that line: the table is not UTF-8 text, the columns are different,
    /// frames do not count up from 0, a cell is not a number, a pose is impossible for a camera, or there are no rows or too many.
    pub fn from_csv(name: &str, table: impl Read, place: &str) -> Result<Recorded, String> {
        let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(table);
        let header = reader.headers().map_err(|error| format!("{place}: {}", one_line(&explain(&error))))?;
        if !header.iter().eq(COLUMNS) {
            let given = one_line(&header.iter().collect::<Vec<_>>().join(","));
            return Err(format!("{place}, line 1: the columns are `{given}`, must be `{}`", COLUMNS.join(",")));
        }
        let mut poses = Vec::new();
        for record in reader.records() {
            let record = record.map_err(|error| format!("{place}: {}", one_line(&explain(&error))))?;
            let line = record.position().map_or(0, csv::Position::line);
            let wrong = |what: String| format!("{place}, line {line}: {}", one_line(&what));
            let frame = record.get(0).unwrap_or_default();
            if frame.parse::<usize>() != Ok(poses.len()) {
                return Err(wrong(format!(
                    "the frame is `{frame}`, must be {}: frames count from 0, and none may be left out",
                    poses.len()
                )));
            }
            if poses.len() == MOST_FRAMES {
                return Err(wrong(format!("a path has at most {MOST_FRAMES} frames: split the table into several files")));
            }
            let mut row = [0.0; 6];
            for ((number, cell), column) in row.iter_mut().zip(record.iter().skip(1)).zip(&COLUMNS[1..]) {
                *number = cell.parse::<f64>().map_err(|_| wrong(format!("column `{column}`: `{cell}` is not a number")))?;
            }
            poses.push(pose(row).map_err(wrong)?);
        }
        Recorded::new(name, poses).map_err(|what| format!("{place} {what}: give one row per frame"))
    }

    /// Writes the table as a new file. The file is either complete or not written at all.
    ///
    /// # Errors
    /// One line: the file exists already, or cannot be written.
    pub fn write(&self, file: &Path) -> Result<(), String> {
        if file.symlink_metadata().is_ok() {
            return Err(format!("{} already exists: give another name, or remove the file first", file.display()));
        }
        files::write(file, self.to_csv().as_bytes())
    }

    /// Reads a table from a file. The path gets the name of the file, without its extension.
    ///
    /// # Errors
    /// One line: the file cannot be read, or its contents are refused (see [`Recorded::from_csv`]).
    pub fn read(file: &Path) -> Result<Recorded, String> {
        let place = file.display().to_string();
        let unreadable = |error: std::io::Error| format!("cannot read {place}: {error}");
        // Read only regular files, because reading from a device or pipe may never end.
        let metadata = fs::metadata(file).map_err(unreadable)?;
        if !metadata.is_file() || metadata.len() > MOST_BYTES {
            return Err(format!(
                "{place} is not a regular file, or is too large for a path: give a table that was written with `Write NAME to a file`"
            ));
        }
        let name = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        Recorded::from_csv(&name, File::open(file).map_err(unreadable)?, &place)
    }
}

fn explain(error: &csv::Error) -> String {
    match error.kind() {
        csv::ErrorKind::UnequalLengths { pos, len, .. } => {
            let line = pos.as_ref().map_or(0, csv::Position::line);
            format!("line {line} has {len} cells, must have {}", COLUMNS.len())
        }
        csv::ErrorKind::Utf8 { .. } => "it is not UTF-8 text: give a table that was written with `Write NAME to a file`".to_owned(),
        _ => error.to_string(),
    }
}

/// The reason why a recording ended although the user did not stop it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ended {
    /// The recording has [`MOST_FRAMES`] frames.
    Full,
    /// The frame number went back, or jumped too far ahead.
    Jumped {
        /// The last frame that was recorded.
        from: usize,
        /// The frame that followed it.
        to: usize,
    },
}

impl fmt::Display for Ended {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Ended::Full => write!(f, "recording stopped: a path has at most {MOST_FRAMES} frames"),
            Ended::Jumped { from, to } => write!(f, "recording stopped: time went from frame {from} to {to}"),
        }
    }
}

/// A path that is being recorded: one pose per frame, from frame 0 on. A replay also begins at frame 0. Noise depends on the frame number, so each
/// pose is replayed with the noise that it was recorded with.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recording {
    poses: Vec<Pose>,
}

impl Recording {
    /// Records the pose of the picture on screen. The same picture may be passed repeatedly. Pictures are ignored until a picture of frame 0 arrives.
    /// If a frame has several pictures, the pose of the last one is kept. If a frame has no picture, it gets the pose of the frame before.
    ///
    /// # Errors
    /// Why the recording ended. The frames recorded so far are kept.
    pub fn see(&mut self, frame: u32, pose: Pose) -> Result<(), Ended> {
        let (frame, next) = (frame as usize, self.poses.len());
        let Some(last) = self.poses.last_mut() else {
            if frame == 0 {
                self.poses.push(pose);
            }
            return Ok(());
        };
        if frame + 1 == next {
            *last = pose;
            return Ok(());
        }
        if frame < next || frame - next > LONGEST_GAP {
            return Err(Ended::Jumped { from: next - 1, to: frame });
        }
        let last = *last;
        self.poses.resize(frame.min(MOST_FRAMES), last);
        if frame >= MOST_FRAMES {
            return Err(Ended::Full);
        }
        self.poses.push(pose);
        Ok(())
    }

    /// Number of frames so far, at most [`MOST_FRAMES`].
    pub fn frames(&self) -> usize {
        self.poses.len()
    }

    /// The recorded path.
    ///
    /// # Errors
    /// No frame was recorded.
    pub fn finish(self, name: &str) -> Result<Recorded, String> {
        Recorded::new(name, self.poses)
            .map_err(|what| format!("the recording {what}: let time run, or advance frames, before you stop recording"))
    }
}

/// The places and paths of a scene. No two places have the same name, and no two paths have the same name.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Places {
    places: Vec<Place>,
    paths: Vec<Recorded>,
}

impl Places {
    /// Creates a collection of these places and paths. If a name occurs twice, the second place or path gets a new name.
    pub fn new(places: Vec<Place>, paths: Vec<Recorded>) -> Places {
        let mut all = Places::default();
        for Place { name, pose } in places {
            all.keep(&name, pose);
        }
        for path in paths {
            all.add(path);
        }
        all
    }

    /// The places, in the order in which they were added.
    pub fn places(&self) -> &[Place] {
        &self.places
    }

    /// The paths, in the order in which they were recorded or read.
    pub fn paths(&self) -> &[Recorded] {
        &self.paths
    }

    /// Whether there are neither places nor paths.
    pub fn is_empty(&self) -> bool {
        self.places.is_empty() && self.paths.is_empty()
    }

    /// Adds a place under the given name, or under a name derived from it if that name is taken. Returns the name of the place.
    pub fn keep(&mut self, name: &str, pose: Pose) -> &str {
        let name = unique(name, "place", |name| self.places.iter().any(|place| place.name == name));
        let at = self.places.len();
        self.places.push(Place { name, pose });
        &self.places[at].name
    }

    /// Adds a path under its name, or under a name derived from it if that name is taken. Returns the name of the path.
    pub fn add(&mut self, path: Recorded) -> &str {
        let name = unique(&path.name, "path", |name| self.paths.iter().any(|path| path.name == name));
        let at = self.paths.len();
        self.paths.push(Recorded { name, ..path });
        &self.paths[at].name
    }

    /// Removes a place.
    pub fn forget(&mut self, name: &str) {
        self.places.retain(|place| place.name != name);
    }

    /// Removes a path.
    pub fn forget_path(&mut self, name: &str) {
        self.paths.retain(|path| path.name != name);
    }
}

/// Returns a free name: the wanted name as one line of at most [`NAME_LENGTH`] characters, or `usual` if the wanted name is empty. If the name is
/// taken, the smallest number from 2 on that makes it free is appended, such as `ridge 2` for `ridge`. If the wanted name already ends in a number,
/// the new number replaces that number.
fn unique(wanted: &str, usual: &str, is_taken: impl Fn(&str) -> bool) -> String {
    let plain: String = wanted.chars().filter(|c| !c.is_control()).take(NAME_LENGTH).collect();
    let wanted = if plain.trim().is_empty() { usual } else { plain.trim() };
    if !is_taken(wanted) {
        return wanted.to_owned();
    }
    let base = match wanted.rsplit_once(' ') {
        Some((base, number)) if number.parse::<u32>().is_ok() => base,
        _ => wanted,
    };
    let mut number = 2_u64;
    loop {
        let name = format!("{base} {number}");
        if !is_taken(&name) {
            return name;
        }
        number += 1;
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;

    /// Random poses, whose numbers have many digits. The seed is fixed.
    fn poses(count: usize) -> Vec<Pose> {
        let mut state = 1_u64;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64
        };
        let mut pose = || Pose {
            position: DVec3::new(5120.0 * (next() - 0.5), 1e-7 * next(), -1e6 * next()),
            yaw: TAU * next(),
            pitch: 3.0 * (next() - 0.5),
            fov: 0.1 + 2.0 * next(),
        };
        (0..count).map(|_| pose()).collect()
    }

    fn bits(pose: &Pose) -> [u64; 6] {
        numbers(pose).map(f64::to_bits)
    }

    #[test]
    fn a_path_written_and_read_stands_where_it_stood_to_the_last_bit() {
        let mut flown = poses(500);
        flown[3].position = DVec3::new(-0.0, f64::MIN_POSITIVE, 1e300);
        let path = Recorded::new("over the ridge", flown.clone()).expect("frames");
        let read = Recorded::from_csv("over the ridge", path.to_csv().as_bytes(), "t.csv").expect("reads");
        let text = toml::to_string(&path).expect("can be written");
        let kept: Recorded = toml::from_str(&text).expect("can be read");
        for (frame, pose) in (0..).zip(&flown) {
            assert_eq!([bits(&read.pose(frame)), bits(&kept.pose(frame))], [bits(pose); 2], "frame {frame}");
        }
        assert_eq!((read.pose(500), read.pose(u32::MAX)), (flown[0], flown[u32::MAX as usize % 500]), "the path repeats");
        assert_eq!((&path, &path), (&read, &kept));
    }

    #[test]
    fn a_place_is_written_in_degrees_and_stays_the_same_from_then_on() {
        for pose in poses(2000) {
            let place = Place { name: "p".to_owned(), pose };
            let read = |place: &Place| Place::try_from(CameraPose::from(place.clone())).expect("a camera");
            let once = read(&place);
            for (a, b) in numbers(&once.pose).into_iter().zip(numbers(&pose)) {
                assert!((a - b).abs() <= 2.0 * f64::EPSILON * b.abs(), "{a} {b}");
            }
            assert_eq!(bits(&once.pose)[..3], bits(&pose)[..3], "positions are exact");
            assert_eq!(bits(&read(&once).pose), bits(&once.pose), "a second conversion changes nothing");
        }
        // The value of each of these yaws in degrees would be infinite. The conversion keeps the direction.
        for yaw in [f64::MAX, f64::MIN, 1e307] {
            let place = Place { name: "far".to_owned(), pose: Pose { position: DVec3::ONE, yaw, pitch: 0.1, fov: 1.0 } };
            let camera = CameraPose::from(place.clone());
            assert!(camera.yaw_deg.is_finite());
            let again = Place::try_from(camera).expect("it can be read back");
            let apart = again.pose.axes()[2] - place.pose.axes()[2];
            assert!(apart.length() < 1e-9, "{yaw}: {apart}");
        }
        let east = Place { name: "east".to_owned(), pose: Pose { position: DVec3::ONE, yaw: TAU / 4.0, pitch: 0.0, fov: TAU / 8.0 } };
        let camera = CameraPose::from(east.clone());
        assert_eq!((camera.yaw_deg, camera.pitch_deg, camera.fov_deg), (90.0, 0.0, 45.0));
        let grounded = CameraPose { above_ground: true, ..camera.clone() };
        assert!(Place::try_from(grounded).expect_err("there is no ground").contains("elevation"));
        let flat = CameraPose { fov_deg: 180.0, ..camera };
        assert!(Place::try_from(flat).expect_err("sees everything").contains("field of view"));
    }

    #[test]
    fn a_table_that_is_none_is_refused_with_its_line() {
        let header = COLUMNS.join(",");
        let row = "0,1,2,3,0.5,0,1";
        for (text, parts) in [
            ("frame,x_m\n0,1\n".to_owned(), ["t.csv, line 1", "yaw_rad"]),
            (format!("{header}\n"), ["t.csv has no frames", "one row per frame"]),
            (format!("{header}\n{row}\n2,1,2,3,0.5,0,1\n"), ["t.csv, line 3", "`2`, must be 1"]),
            (format!("{header}\n{row}\n1,1,2,3,0.5,0\n"), ["line 3", "6 cells, must have 7"]),
            (format!("{header}\n0,1,2,three,0.5,0,1\n"), ["t.csv, line 2", "column `z_m`: `three`"]),
            (format!("{header}\n0,1,2,NaN,0.5,0,1\n"), ["t.csv, line 2", "finite"]),
            (format!("{header}\n0,1,2,3,0.5,2,1\n"), ["t.csv, line 2", "pitch"]),
            (format!("{header}\n0,1,2,3,0.5,0,0\n"), ["t.csv, line 2", "field of view"]),
        ] {
            let error = Recorded::from_csv("t", text.as_bytes(), "t.csv").expect_err(&text);
            assert!(parts.iter().all(|part| error.contains(part)) && !error.contains('\n'), "{text}: {error}");
        }
        for picture in [&b"\x89PNG\r\n\x1a\n\0\xff"[..], &[header.as_bytes(), b"\n0,1,2,3,\xff,0,1\n"].concat()] {
            let error = Recorded::from_csv("t", picture, "t.csv").expect_err("no text");
            assert!(error.starts_with("t.csv: it is not UTF-8 text: give a table") && !error.contains('\n'), "{error}");
        }
        // Spaces around cells, empty lines and the line ends of Windows are accepted.
        assert!(Recorded::from_csv("t", format!("{header}\r\n {row}\r\n\r\n").as_bytes(), "t.csv").is_ok());
        assert!(Recorded::read(Path::new("nowhere/at/all.csv")).expect_err("no such file").contains("all.csv"));
    }

    #[test]
    fn a_file_is_never_written_over() {
        let file = std::env::temp_dir().join(format!("scree-places-{}.csv", std::process::id()));
        let _ = fs::remove_file(&file);
        let path = Recorded::new("ridge", poses(3)).expect("frames");
        path.write(&file).expect("written");
        let read = Recorded::read(&file).expect("read");
        assert!(read.name.starts_with("scree-places-") && read.poses == path.poses);
        let error = path.write(&file).expect_err("it exists");
        assert!(error.contains("exists") && error.contains("another name"), "{error}");
        fs::remove_file(&file).expect("was there");
    }

    #[test]
    fn a_recording_has_a_pose_a_frame_and_an_end() {
        let at = poses(8);
        let mut recording = Recording::default();
        // The pictures are: one from before the recording (frame 57); one of frame 0; the same one again; one of frame 0 with a moved camera, while
        // time is paused; and one of frame 1.
        for (frame, pose) in [(57, at[0]), (0, at[1]), (0, at[1]), (0, at[2]), (1, at[3])] {
            recording.see(frame, pose).expect("goes on");
        }
        // Frames 2 and 3 have no picture.
        recording.see(4, at[4]).expect("a short gap");
        assert_eq!(recording.see(2, at[5]), Err(Ended::Jumped { from: 4, to: 2 }));
        assert_eq!(recording.see(500, at[5]), Err(Ended::Jumped { from: 4, to: 500 }));
        assert_eq!(recording.frames(), 5);
        let path = recording.finish("p").expect("frames");
        assert!((0..5).map(|frame| path.pose(frame)).eq([at[2], at[3], at[3], at[3], at[4]]));
        assert!(Recording::default().finish("p").expect_err("nothing came").contains("no frames"));
    }

    #[test]
    fn a_recording_is_bounded() {
        let pose = poses(1)[0];
        let mut recording = Recording::default();
        let ended: Vec<Ended> = (0..=MOST_FRAMES as u32).filter_map(|frame| recording.see(frame, pose).err()).collect();
        assert_eq!((ended, recording.frames()), (vec![Ended::Full], MOST_FRAMES));
        assert!(Ended::Full.to_string().contains("100000"));
        assert_eq!(recording.finish("long").expect("frames").frames(), MOST_FRAMES);
        assert!(Recorded::new("too long", vec![pose; MOST_FRAMES + 1]).expect_err("too long").contains("100001"));
    }

    #[test]
    fn names_are_given_once() {
        let pose = poses(1)[0];
        let mut all = Places::default();
        let given = ["", " ridge\n", "ridge", "ridge 2", "place", "   "].map(|name| all.keep(name, pose).to_owned());
        assert_eq!(given, ["place", "ridge", "ridge 2", "ridge 3", "place 2", "place 3"]);
        all.forget("ridge 2");
        assert_eq!(all.keep("ridge", pose), "ridge 2");
        let path = Recorded::new("ridge", vec![pose]).expect("a frame");
        assert_eq!((all.add(path.clone()).to_owned(), all.add(path.clone())), ("ridge".to_owned(), "ridge 2"));
        all.forget_path("ridge");
        assert_eq!(all.paths().len(), 1);
        assert!(!all.is_empty() && Places::default().is_empty());
        let place = all.places()[0].clone();
        let doubled = Places::new(vec![place.clone(), place], vec![path.clone(), path]);
        assert_eq!((&*doubled.places()[1].name, &*doubled.paths()[1].name), ("place 2", "ridge 2"));
    }
}
