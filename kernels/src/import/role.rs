//! The role of a material in the landscape, derived from its name.

/// The role of a material in the landscape.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Role {
    /// Vegetation.
    Green,
    /// Soil, and materials whose names contain no word for another role.
    Soil,
    Rubble,
    Rock,
    /// Snow and ice.
    Snow,
}

impl Role {
    /// Returns the role of a material with this name. Upper and lower case count as equal, but a capital letter after a small one begins a word, as
    /// in `IceCliff`.
    pub(super) fn of(name: &str) -> Role {
        // `ice` must be a whole word, because it is part of other words, such as `lattice`.
        let mut words = String::new();
        for c in name.chars() {
            if c.is_uppercase() && words.ends_with(char::is_lowercase) {
                words.push(' ');
            }
            words.push(c);
        }
        let words = words.to_lowercase();
        let is_ice = || words.split(|c: char| !c.is_alphabetic()).any(|word| matches!(word, "ice" | "icy" | "glacier"));
        let name = name.to_lowercase();
        let has = |words: &[&str]| words.iter().any(|w| name.contains(w));
        if has(&["snow"]) || is_ice() {
            Role::Snow
        } else if has(&["cliff", "granite", "limestone", "basalt"]) {
            Role::Rock
        } else if has(&["grass", "meadow", "moss", "forest", "heath", "leaves"]) {
            Role::Green
        } else if has(&["scree", "gravel", "pebble", "rubble", "talus", "boulder"]) {
            Role::Rubble
        } else if has(&["rock", "stone"]) {
            Role::Rock
        } else {
            Role::Soil
        }
    }

    /// Usual size of one repeat of a texture, metres.
    pub(super) fn tile_m(self) -> f64 {
        match self {
            Role::Rock => 5.0,
            Role::Rubble | Role::Snow => 3.5,
            Role::Green | Role::Soil => 2.5,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_tell_roles() {
        let roles = [
            "Grass 01",
            "grass_01",
            "Rock030",
            "rocky_gravel",
            "Ground054",
            "SNOW",
            "Ice003",
            "blue-ice",
            "lattice",
            "dice rock",
            "IceCliff",
        ]
        .map(Role::of);
        let expected = [
            Role::Green,
            Role::Green,
            Role::Rock,
            Role::Rubble,
            Role::Soil,
            Role::Snow,
            Role::Snow,
            Role::Snow,
            Role::Soil,
            Role::Rock,
            Role::Snow,
        ];
        assert_eq!(roles, expected);
    }
}
