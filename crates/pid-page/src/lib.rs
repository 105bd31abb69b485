//! Pages and plots, one layout and one kind of drawing for all reports, diagnoses and studies.
//!
//! A page is one file without scripts or links to others. It follows the reader's choice of dark or
//! light, fits a phone and prints without cut tables or plots. A plot is inline SVG whose colours
//! are CSS variables of the page.
//!
//! ```
//! use pid_page::{Axis, Footer, Ink, Page, Plot};
//!
//! let mut plot = Plot::new(
//!     "Position of the cart over time",
//!     Axis::new("time", "s", (0.0, 2.0)),
//!     Axis::new("position", "m", (-0.1, 0.1)),
//! );
//! plot.line(Ink::Measured, [(0.0, 0.0), (1.0, 0.08), (2.0, -0.02)]);
//! let page = Page {
//!     title: "Cart",
//!     lead: maud::html! { "One record." },
//!     sections: &[],
//!     body: maud::html! { section { h2 { "Motion" } (pid_page::figure(&plot.draw(), "cart", "position")) } },
//!     footer: Footer { program: "pid 0.1.0", data: "cart, 1 record", settings: "", more: "" },
//! };
//! assert!(page.html().contains("position, m"));
//! ```

mod axis;
mod date;
mod layout;
pub mod number;
mod plot;
mod range;

pub use axis::{Axis, tick};
pub use date::Date;
pub use layout::{Footer, Legend, Page, figure, legend, table};
pub use plot::{Bar, Ink, Plot, bars};
pub use range::Range;

#[cfg(test)]
mod tests;
