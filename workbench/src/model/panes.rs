//! The panes of the window and their arrangement. An arrangement is saved as titles of panes and shares of the window. The format in which
//! `egui_tiles` saves an arrangement is not used, for two reasons. TOML can represent neither its identifiers (unsigned 64-bit integers) nor its
//! empty values. And a version of the program that lacks one of the saved panes could not read the file, while a version with a new pane would not
//! show it.

use eframe::egui;
use egui_tiles::{Container, Grid, GridLayout, Linear, LinearDir, Tabs, Tile, TileId, Tiles, Tree};
use serde::{Deserialize, Serialize};

/// A part of the window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pane {
    /// The picture.
    Viewport,
    /// Choice of variant, estimator, noise and other settings of shading.
    Variants,
    /// Materials, their textures, and how the textures look on the ground. Also saves the scene as a file.
    Materials,
    /// Splat rules, which assign a material to each place.
    Rules,
    /// The brush, and the strokes that are painted over the rules.
    Brush,
    /// Comparison of A with B.
    Compare,
    /// Live metrics of the pictures.
    Metrics,
    /// The numeric settings of the scene and the frame, and the settings of the stages.
    Parameters,
    /// Size, shading and times of the frame, and times to draw the window.
    Frame,
    /// How one pixel was shaded.
    Inspector,
    /// What each stage reports about the frame: nodes on a map, atlases, pages, tiles.
    Machine,
    /// Saving the current settings as an experiment, and running experiments.
    Experiments,
    /// Stored places and recorded paths.
    Places,
    /// A short introduction, and the keys.
    Help,
}

impl Pane {
    /// All panes.
    pub const ALL: [Pane; 14] = [
        Pane::Viewport,
        Pane::Variants,
        Pane::Materials,
        Pane::Rules,
        Pane::Brush,
        Pane::Compare,
        Pane::Places,
        Pane::Help,
        Pane::Parameters,
        Pane::Metrics,
        Pane::Frame,
        Pane::Inspector,
        Pane::Machine,
        Pane::Experiments,
    ];

    /// The title of the pane.
    pub const fn name(self) -> &'static str {
        match self {
            Pane::Viewport => "Viewport",
            Pane::Variants => "Variants",
            Pane::Materials => "Materials",
            Pane::Rules => "Rules",
            Pane::Brush => "Brush",
            Pane::Compare => "Compare",
            Pane::Metrics => "Metrics",
            Pane::Parameters => "Parameters",
            Pane::Frame => "Frame",
            Pane::Inspector => "Inspector",
            Pane::Machine => "Machine",
            Pane::Experiments => "Experiments",
            Pane::Places => "Places",
            Pane::Help => "Help",
        }
    }
}

/// The identifier of the tree of panes in the window.
pub(crate) fn tree_id() -> egui::Id {
    egui::Id::unique("workbench")
}

/// The default arrangement: the picture on the left, all other panes in two groups of tabs on the right.
pub(crate) fn usual() -> Tree<Pane> {
    let mut tiles = Tiles::default();
    let viewport = tiles.insert_pane(Pane::Viewport);
    let upper: Vec<TileId> = [Pane::Variants, Pane::Materials, Pane::Rules, Pane::Brush, Pane::Compare, Pane::Places, Pane::Help]
        .into_iter()
        .map(|p| tiles.insert_pane(p))
        .collect();
    let lower: Vec<TileId> = [Pane::Parameters, Pane::Metrics, Pane::Frame, Pane::Inspector, Pane::Machine, Pane::Experiments]
        .into_iter()
        .map(|p| tiles.insert_pane(p))
        .collect();
    let (upper, lower) = (tiles.insert_tab_tile(upper), tiles.insert_tab_tile(lower));
    let right = tiles.insert_vertical_tile(vec![upper, lower]);
    let root = tiles.insert_horizontal_tile(vec![viewport, right]);
    if let Some(Tile::Container(Container::Linear(linear))) = tiles.get_mut(root) {
        debug_assert_eq!(linear.dir, LinearDir::Horizontal, "the root is a horizontal container");
        linear.shares.set_share(viewport, 0.66);
        linear.shares.set_share(right, 0.34);
    }
    Tree::new(tree_id(), root, tiles)
}

/// An arrangement: a pane, or a container of further arrangements. The shares of a container are positive and need not add up to 1. A share that is
/// missing or invalid counts as 1.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Layout {
    /// A pane.
    Pane {
        /// The title of the pane: [`Pane::name`].
        name: String,
    },
    /// Tabs: one child is visible at a time.
    Tabs {
        /// Index of the visible child, from 0.
        open: usize,
        /// The children, from the left.
        children: Vec<Layout>,
    },
    /// Children next to each other.
    Row {
        /// Shares of the width, one per child.
        shares: Vec<f32>,
        /// The children, from the left.
        children: Vec<Layout>,
    },
    /// Children below each other.
    Column {
        /// Shares of the height, one per child.
        shares: Vec<f32>,
        /// The children, from the top.
        children: Vec<Layout>,
    },
    /// Children in rows and columns.
    Grid {
        /// Number of columns; 0 = as many as fit.
        columns: usize,
        /// Shares of the width, one per column.
        column_shares: Vec<f32>,
        /// Shares of the height, one per row.
        row_shares: Vec<f32>,
        /// The children, row by row.
        children: Vec<Layout>,
    },
}

impl Layout {
    /// The current arrangement; `None` = there are no panes.
    pub fn of(tree: &Tree<Pane>) -> Option<Layout> {
        Layout::of_tile(&tree.tiles, tree.root()?)
    }

    fn of_tile(tiles: &Tiles<Pane>, id: TileId) -> Option<Layout> {
        let all = |children: &[TileId]| children.iter().filter_map(|&child| Layout::of_tile(tiles, child)).collect::<Vec<_>>();
        Some(match tiles.get(id)? {
            Tile::Pane(pane) => Layout::Pane { name: pane.name().to_owned() },
            Tile::Container(Container::Tabs(tabs)) => {
                let open = tabs.children.iter().position(|&child| tabs.is_active(child)).unwrap_or(0);
                Layout::Tabs { open, children: all(&tabs.children) }
            }
            Tile::Container(Container::Linear(linear)) => {
                let shares = linear.children.iter().map(|&child| linear.shares[child]).collect();
                let children = all(&linear.children);
                match linear.dir {
                    LinearDir::Horizontal => Layout::Row { shares, children },
                    LinearDir::Vertical => Layout::Column { shares, children },
                }
            }
            Tile::Container(Container::Grid(grid)) => Layout::Grid {
                columns: if let GridLayout::Columns(columns) = grid.layout { columns } else { 0 },
                column_shares: grid.col_shares.clone(),
                row_shares: grid.row_shares.clone(),
                children: all(&grid.children().copied().collect::<Vec<_>>()),
            },
        })
    }

    /// The tree for this arrangement, with the given identifier. Panes with an unknown name, or with a name that occurs a second time, are left out.
    /// Panes that the arrangement lacks are added to the last group of tabs, because there is no other way to open them. If there is no group of
    /// tabs, they form a new one at the right. `None` = no pane is left.
    pub fn tree(&self, id: egui::Id) -> Option<Tree<Pane>> {
        let mut making = Making { tiles: Tiles::default(), left: Pane::ALL.to_vec(), tabs: None };
        let mut root = making.insert(self)?;
        let Making { mut tiles, left, tabs } = making;
        let new: Vec<TileId> = left.into_iter().map(|pane| tiles.insert_pane(pane)).collect();
        let tabs = match tabs {
            Some(tabs) => tiles.get_mut(tabs),
            None => None,
        };
        match tabs {
            _ if new.is_empty() => {}
            Some(Tile::Container(container)) => new.into_iter().for_each(|pane| container.add_child(pane)),
            _ => {
                let beside = tiles.insert_tab_tile(new);
                root = tiles.insert_horizontal_tile(vec![root, beside]);
            }
        }
        Some(Tree::new(id, root, tiles))
    }
}

/// A tree while it is being built.
struct Making {
    tiles: Tiles<Pane>,
    /// Panes that are not in the tree yet.
    left: Vec<Pane>,
    /// The group of tabs that was added last.
    tabs: Option<TileId>,
}

impl Making {
    fn insert(&mut self, layout: &Layout) -> Option<TileId> {
        match layout {
            Layout::Pane { name } => {
                let at = self.left.iter().position(|pane| pane.name() == name)?;
                let pane = self.left.remove(at);
                Some(self.tiles.insert_pane(pane))
            }
            Layout::Tabs { open, children } => {
                let made = self.insert_all(children);
                let open = made.iter().find(|(place, _)| place == open).or(made.first()).map(|&(_, child)| child)?;
                let mut tabs = Tabs::new(made.into_iter().map(|(_, child)| child).collect());
                tabs.set_active(open);
                let id = self.tiles.insert_container(tabs);
                self.tabs = Some(id);
                Some(id)
            }
            Layout::Row { shares, children } => self.insert_linear(LinearDir::Horizontal, shares, children),
            Layout::Column { shares, children } => self.insert_linear(LinearDir::Vertical, shares, children),
            Layout::Grid { columns, column_shares, row_shares, children } => {
                let made = self.insert_all(children);
                if made.is_empty() {
                    return None;
                }
                let mut grid = Grid::new(made.into_iter().map(|(_, child)| child).collect());
                grid.layout = if *columns == 0 { GridLayout::Auto } else { GridLayout::Columns(*columns) };
                grid.col_shares = column_shares.iter().copied().map(usable).collect();
                grid.row_shares = row_shares.iter().copied().map(usable).collect();
                Some(self.tiles.insert_container(grid))
            }
        }
    }

    /// Adds all children. Returns the tiles of the children that contain a pane, each with the index of the child.
    fn insert_all(&mut self, children: &[Layout]) -> Vec<(usize, TileId)> {
        children.iter().enumerate().filter_map(|(place, child)| Some((place, self.insert(child)?))).collect()
    }

    fn insert_linear(&mut self, dir: LinearDir, shares: &[f32], children: &[Layout]) -> Option<TileId> {
        let made = self.insert_all(children);
        if made.is_empty() {
            return None;
        }
        let mut linear = Linear::new(dir, made.iter().map(|&(_, child)| child).collect());
        for (place, child) in made {
            linear.shares.set_share(child, usable(shares.get(place).copied().unwrap_or(1.0)));
        }
        Some(self.tiles.insert_container(linear))
    }
}

/// Returns the share. If it is not a positive finite number, it could make the pane invisible, so 1 is returned.
fn usable(share: f32) -> f32 {
    if share.is_finite() && share > 0.0 { share } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn id() -> egui::Id {
        egui::Id::unique("layout of a test")
    }

    fn pane(pane: Pane) -> Layout {
        Layout::Pane { name: pane.name().to_owned() }
    }

    /// All panes: the first one next to a column that consists of a grid and of tabs. The last tab is open.
    fn all() -> Layout {
        let [first, second, third] = [0, 1, 2].map(|i| pane(Pane::ALL[i]));
        let grid = Layout::Grid { columns: 2, column_shares: vec![0.75, 1.25], row_shares: vec![1.0], children: vec![second, third] };
        let rest: Vec<Layout> = Pane::ALL[3..].iter().map(|&p| pane(p)).collect();
        let tabs = Layout::Tabs { open: rest.len() - 1, children: rest };
        let column = Layout::Column { shares: vec![0.3, 0.7], children: vec![grid, tabs] };
        Layout::Row { shares: vec![1.5, 0.5], children: vec![first, column] }
    }

    #[test]
    fn a_layout_becomes_a_tree_and_the_same_layout_again() {
        let tree = all().tree(id()).expect("panes");
        assert_eq!(Layout::of(&tree), Some(all()));
        // Writing the layout as text and reading it again gives the same layout.
        let text = toml::to_string(&all()).expect("can be written");
        assert_eq!(toml::from_str::<Layout>(&text).expect("can be read"), all(), "{text}");
    }

    #[test]
    fn unknown_and_second_panes_are_left_out_and_new_ones_are_added() {
        let gone = Layout::Pane { name: "Gone".to_owned() };
        let known = pane(Pane::ALL[1]);
        let tabs = Layout::Tabs { open: 1, children: vec![gone.clone(), known.clone(), known.clone()] };
        let row = Layout::Row { shares: vec![f32::NAN, -1.0], children: vec![pane(Pane::ALL[0]), tabs] };
        let Some(Layout::Row { shares, children }) = row.tree(id()).as_ref().and_then(Layout::of) else { panic!("a row must stay a row") };
        assert_eq!((shares, children[0].clone()), (vec![1.0, 1.0], pane(Pane::ALL[0])));
        let Layout::Tabs { open, children } = &children[1] else { panic!("tabs must stay tabs") };
        let expected: Vec<Layout> = Pane::ALL[1..].iter().map(|&p| pane(p)).collect();
        assert_eq!((*open, children), (0, &expected));
        // A layout of a single pane becomes a row of this pane and a group of tabs with all other panes.
        let Some(Layout::Row { children, .. }) = pane(Pane::ALL[0]).tree(id()).as_ref().and_then(Layout::of) else {
            panic!("a row must be made")
        };
        assert!(matches!(&children[1], Layout::Tabs { children, .. } if children.len() == Pane::ALL.len() - 1));
        assert!(gone.tree(id()).is_none());
    }
}
