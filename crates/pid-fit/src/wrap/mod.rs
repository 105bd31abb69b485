//! Models whose inputs or parameters are taken from records: lags of inputs, parameters of one
//! record, controllers.

pub mod controllers;
pub mod lag;
pub mod private;
