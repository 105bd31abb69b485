//! Tests across the crates: oracles, end-to-end runs, published figures.
