//! What people look at: figures, the page of a finished run, and the picture in the plane.
//!
//! | file | question it answers |
//! |---|---|
//! | `run` | what is known of a finished run? |
//! | `figures/` | which figures does it get, and what is in each? |
//! | `chart` | how is a figure drawn? |
//! | `svg` | how does a drawing become SVG? |
//! | `axis` | where on an axis is a value, and where are the ticks? |
//! | `palette` | which color and which dashes? |
//! | `simplify` | which points of a curve can be seen? |
//! | `rows` | what is said of a run, on the screen and on the page? |
//! | `screen` | what is on the screen? |
//! | `html` | what is on the page of a run? |
//! | `digits` | how does a number stay short? |
//! | `markup` | how does a text stay a text in HTML and XML? |
//! | `scene` | what is in the picture in the plane, and one instant of it? |
//! | `page` | how does that move? |
//! | `animation` | how does it move where there is no script? |
//!
//! Text in, text out: reads and writes no file, reads no clock, starts no process and knows nothing
//! of iceoryx2.

pub mod animation;
pub mod axis;
pub mod chart;
pub mod digits;
pub mod figures;
pub mod html;
mod markup;
pub mod page;
pub mod palette;
pub mod rows;
pub mod run;
pub mod scene;
pub mod screen;
mod simplify;
pub mod svg;
