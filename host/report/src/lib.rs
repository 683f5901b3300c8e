//! Pages and plots. The browser draws the text; fonts are not needed.
//!
//! | module | contents |
//! |---|---|
//! | [`page`] | a page: headings, text, tables, pictures |
//! | [`plots`] | curves, bands, heat maps |
//! | [`svg`] | shapes and finished pictures |
//! | [`text`] | text that is escaped where it is put in |
//! | [`wireframe`] | a machine as a picture |
//! | [`workspace`] | maps of a workspace |
//!
//! ```
//! use gantry_tau_report::page::Page;
//!
//! let mut page = Page::new("Measurements", "Measurements of L2 <3>");
//! page.section("Force");
//! page.paragraph("300 N on the tool");
//! assert!(page.html().contains("L2 &lt;3&gt;"));
//! ```
#![forbid(unsafe_code)]
#![cfg_attr(
    test,
    allow(clippy::disallowed_methods, reason = "tests write files of their own")
)]
#![deny(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "they panic when the stream fails"
)]
#![allow(
    clippy::arithmetic_side_effects,
    clippy::as_conversions,
    reason = "off the reference path; release builds keep their overflow checks, and `as` saturates where floats become integers"
)]

pub mod page;
pub mod plots;
pub mod svg;
pub mod text;
pub mod wireframe;
pub mod workspace;
