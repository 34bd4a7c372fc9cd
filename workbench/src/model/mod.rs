//! The state that the panels show and change: [`state::Model`] and its parts. The model does not use the modules `window` and `engine`.

pub mod brush;
pub mod compare;
pub mod display;
pub(crate) mod drafts;
pub mod editing;
pub(crate) mod files;
pub mod flight;
pub mod kept;
pub mod metrics;
pub mod panes;
pub mod picture;
pub mod places;
pub mod settings;
pub mod state;
pub(crate) mod times;
pub mod viewpoint;
