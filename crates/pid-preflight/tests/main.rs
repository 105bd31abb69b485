//! Tests on drawn, on made and on shared records.

mod findings;
mod plant;
mod planted;
mod reading;
mod shared;
