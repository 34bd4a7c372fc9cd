//! The report on a heightmap: how its file was interpreted, for the user to check.

use std::fmt;

/// The interpretation of a file. `Display` writes it as several lines, without a line break at the end.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// Name of the file, its format, and the kind of its samples.
    pub file: String,
    /// Width and height of the file, in samples.
    pub file_size: [u32; 2],
    /// The part that was read: x, y (from the north-west corner), width, height, in samples.
    pub window: [u32; 4],
    /// Distance between samples, metres.
    pub spacing_m: f64,
    /// Where the distance is stated: in the file or by the user.
    pub spacing_from: String,
    /// Lowest and highest sample with data, as they are stored.
    pub stored: [String; 2],
    /// Lowest and highest elevation, metres.
    pub elevations_m: [f64; 2],
    /// How stored samples are converted to metres, and where this information comes from.
    pub mapping: String,
    /// Where north is in the file.
    pub orientation: String,
    /// Number of samples without data.
    pub void_count: usize,
    /// The treatment of samples without data, and the reasons why they have none.
    pub voids: String,
    /// Notes for the user, one line each.
    pub notes: Vec<String>,
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y, width, height] = self.window;
        let [file_width, file_height] = self.file_size;
        writeln!(f, "heightmap: {}", self.file)?;
        write!(f, "  size: {width} x {height} samples")?;
        if self.file_size != [width, height] {
            write!(f, " at {x}, {y} of {file_width} x {file_height}")?;
        }
        let extent = |samples: u32| f64::from(samples.saturating_sub(1)) * self.spacing_m;
        writeln!(f, ", {:.1} x {:.1} m", extent(width), extent(height))?;
        writeln!(f, "  spacing: {} m, {}", self.spacing_m, self.spacing_from)?;
        writeln!(f, "  samples: {} to {}, {}", self.stored[0], self.stored[1], self.mapping)?;
        writeln!(f, "  elevations: {:.2} to {:.2} m", self.elevations_m[0], self.elevations_m[1])?;
        writeln!(f, "  orientation: {}", self.orientation)?;
        write!(f, "  without data: {}", self.voids)?;
        self.notes.iter().try_for_each(|note| write!(f, "\n  note: {note}"))
    }
}
