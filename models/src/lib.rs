//! Robots declared with robot!, each with its source.
