//! The workbench: the terrain stack live. A thread draws ([`engine`]), the window asks and shows ([`app`]); what is on screen is one value
//! ([`settings::Settings`]) that panels change and undo takes back. What is on screen can be saved and run as an experiment ([`experiment`]); what shading made of one pixel is taken apart
//! ([`inspector`]); shaders that are edited are followed
//! ([`reload`]).

pub mod app;
pub mod brush;
pub mod compare;
pub mod display;
pub mod editing;
pub mod engine;
pub mod experiment;
pub mod flight;
pub mod inspector;
pub mod kept;
pub mod layout;
pub mod live;
pub mod parameters;
pub mod places;
pub mod reload;
pub mod script;
pub mod settings;
pub mod sketch;

mod panels;
#[cfg(test)]
mod test_folder;
