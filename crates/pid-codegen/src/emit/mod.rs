//! From equations to Rust: the types of the user, the bodies, and the traits that join them.
//!
//! - [`types`]: parameter struct and enums; [`docs`]: their documentation;
//! - [`functions`]: straight-line bodies in blocks of bounded size, over `f64` or generic over dual numbers;
//! - [`bodies`]: which of them a robot has;
//! - [`lanes`]: the same bodies over four nodes at once;
//! - [`derivatives`]: patterns and traits of Jacobian and Hessian;
//! - [`regressor`]: regressor and base parameters;
//! - [`size`]: how many operations a part may take;
//! - [`impls`]: the typed face (inherent functions) and the slice face (traits of `pid-runtime`).
//!
//! Each declared thing keeps the user's span on one generated token; all other tokens are the
//! macro's own. Paths are absolute: a robot may be declared where nothing of `pid-runtime` is in
//! scope.

pub mod bodies;
pub mod derivatives;
pub mod docs;
pub mod fallback;
pub mod functions;
pub mod impls;
pub mod lanes;
mod names;
pub mod regressor;
pub mod size;
pub mod types;

use pid_symbolic::Graph;
use proc_macro2::{Span, TokenStream};
use quote::quote;
use thiserror::Error;

use bodies::{Bodies, Linear};
use functions::{Layout, Scalar};
pub use names::{Face, Names};
use pid_derive::Identifiability;
use pid_derive::model::Robot;
use size::TooLarge;

use crate::syntax::EmitDecl;

/// Why nothing was generated.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum Error {
    /// The equations cannot be derived.
    #[error(transparent)]
    Derivation(#[from] pid_derive::Error),
    /// A part takes more operations than allowed.
    #[error(transparent)]
    TooLarge(#[from] TooLarge),
}

impl Error {
    /// The item of `emit` that the error is about.
    pub fn place(&self, emit: Option<&EmitDecl>) -> Option<Span> {
        match self {
            Self::TooLarge(e) => emit?.place(e.part),
            Self::Derivation(_) => None,
        }
    }
}

/// Everything generated for a robot. No part of `emit` may take more than `limit` operations.
///
/// # Errors
/// If its equations cannot be derived (see [`pid_derive::Error`]) or a part is too large.
pub fn try_model(
    robot: &Robot,
    names: &Names,
    identifiability: &Identifiability,
    limit: usize,
) -> Result<TokenStream, Error> {
    let mut g = Graph::new();
    let equations = pid_derive::equations(&mut g, robot)?;
    let derivatives = size::derivatives(&mut g, robot, &equations, limit)?;
    let layout = Layout::of(robot);
    let full = names.face == Face::Full;
    let scalar = match names.face {
        Face::Full => Scalar::F64,
        Face::Core => Scalar::Core,
    };

    let bodies = Bodies::new(&mut g, &layout, &equations, scalar);
    let first = robot.emit.first_derivatives || robot.emit.second_derivatives;
    let jacobian = first.then(|| bodies::jacobian(&g, &layout, &equations, &derivatives, scalar));
    let hessian = robot
        .emit
        .second_derivatives
        .then(|| bodies::hessian(&g, &layout, &derivatives, scalar));

    let linear = match full && (robot.emit.regressor || robot.emit.base_parameters) {
        false => None,
        true => Some(Linear::new(&mut g, robot, &equations, &layout)?),
    };

    let robot_docs = docs::robot(
        robot,
        &equations,
        &bodies,
        jacobian.as_ref(),
        hessian.as_ref(),
        identifiability,
        linear.as_ref(),
    );
    let types = types::types(robot, names, &robot_docs);
    let lanes = (full && robot.emit.lanes)
        .then(|| lanes::Lanes::new(&g, &layout, &equations, jacobian.as_ref(), hessian.as_ref()));
    let lanes = lanes.as_ref();
    let values = impls::values(robot, names, &layout, &bodies, identifiability, lanes);
    let jacobian =
        jacobian.map(|jacobian| derivatives::jacobian_impls(names, &layout, &jacobian, lanes));
    let hessian =
        hessian.map(|hessian| derivatives::hessian_impls(names, &layout, &hessian, lanes));
    let lanes = lanes.map(lanes::Lanes::definitions);
    let regressor = linear.map(|linear| {
        let Linear {
            regressor,
            base,
            bodies,
        } = linear;
        regressor::impls(robot, names, &layout, &regressor, base.as_ref(), &bodies)
    });
    Ok(quote! {
        #types
        #[allow(
            clippy::all,
            clippy::excessive_precision,
            clippy::too_many_arguments,
            clippy::unreadable_literal,
            clippy::similar_names,
            dead_code,
            non_upper_case_globals,
            unused_parens,
            unused_variables
        )]
        const _: () = {
            #lanes
            #values
            #jacobian
            #hessian
            #regressor
        };
    })
}
