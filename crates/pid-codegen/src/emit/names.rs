//! The identifiers of the generated items.

use proc_macro2::{Ident, Span};
use quote::format_ident;

/// What a robot is written for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Face {
    /// Everything that its `emit` asks for.
    #[default]
    Full,
    /// Programs without `std` and without a heap: types and functions on arrays. Traits, dual numbers, lanes,
    /// regressors and forward dynamics are left out.
    Core,
}

/// The user's identifiers, with their spans.
#[derive(Debug, Clone)]
pub struct Names {
    /// What is written.
    pub face: Face,
    /// Visibility of all generated types.
    pub vis: syn::Visibility,
    /// Name of the robot.
    pub robot: Ident,
    /// Parameters as generated (`dry_shoulder`), in order.
    pub params: Vec<Ident>,
    /// Moving joints in the order of coordinates.
    pub joints: Vec<Ident>,
    /// Inputs as generated, in order.
    pub inputs: Vec<Ident>,
}

impl Names {
    /// The same names without the user's places, which belong to the robot that this is a variant of.
    #[must_use]
    pub fn without_places(mut self) -> Self {
        let lists = [&mut self.params, &mut self.joints, &mut self.inputs];
        for ident in lists.into_iter().flatten() {
            ident.set_span(Span::call_site());
        }
        self
    }
}

/// `TwoLinkParams` and the like: the macro's own span.
pub(super) fn derived(names: &Names, suffix: &str) -> Ident {
    format_ident!("{}{suffix}", names.robot, span = Span::call_site())
}
