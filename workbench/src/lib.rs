//! The workbench: the terrain stack live. A thread draws ([`engine`]), the window asks and shows ([`app`]); what is on screen is one value
//! ([`settings::Settings`]) that panels change and undo takes back.

pub mod app;
pub mod display;
pub mod engine;
pub mod flight;
pub mod parameters;
pub mod script;
pub mod settings;

mod panels;
