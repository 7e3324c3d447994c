//! Figures, report page and plane picture of a run.
//!
//! | file | question it answers |
//! |---|---|
//! | `run` | which data of a finished run are shown? |
//! | `figures/` | which figures does a run get, and what does each show? |
//! | `chart` | how is a figure drawn? |
//! | `svg` | how is a drawing written as SVG? |
//! | `axis` | how are values mapped to an axis, and where are its ticks? |
//! | `palette` | which colors and dashes are used? |
//! | `simplify` | which points of a curve are visible? |
//! | `rows` | which facts and table rows do screen and page share? |
//! | `screen` | what does the screen show? |
//! | `html` | what does the page of a run show? |
//! | `digits` | how are numbers shortened? |
//! | `markup` | how is text escaped in HTML and XML? |
//! | `scene` | what does the plane picture contain? |
//! | `page` | how is the picture replayed? |
//! | `animation` | how is the picture animated without a script? |
//!
//! Maps data to text: reads and writes no file, reads no clock, starts no process and does not depend on iceoryx2.

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
