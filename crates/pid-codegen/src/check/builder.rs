//! What turns declarations into parts of the resolved robot.

use proc_macro2::Span;

use super::meaning::Scope;
use super::names::Symbols;
use super::numbers::plus;
use super::units::{self, Role, Units};
use crate::diag::Diagnostics;
use crate::si::Unit;
use crate::syntax::{self, Vector};
use pid_derive::model::{Blank, Expr};

/// Symbols and units, and what has been found wanting.
pub(super) struct Builder<'a, 'd> {
    pub(super) symbols: &'a Symbols<'a>,
    pub(super) units: &'a Units<'a>,
    pub(super) diag: &'d mut Diagnostics,
    /// Entries written `_`.
    pub(super) blanks: Vec<Blank>,
    /// Where they stand.
    pub(super) blank_places: Vec<Span>,
}

impl<'a, 'd> Builder<'a, 'd> {
    pub(super) fn new(
        symbols: &'a Symbols<'a>,
        units: &'a Units<'a>,
        diag: &'d mut Diagnostics,
    ) -> Self {
        Builder {
            symbols,
            units,
            diag,
            blanks: Vec::new(),
            blank_places: Vec::new(),
        }
    }

    pub(super) fn gravity(&mut self, given: &Vector) -> Option<[Expr; 3]> {
        let role = Role {
            what: "gravity".to_string(),
            unit: Unit::of(&[("m", 1), ("s", -2)]),
        };
        self.vector(given, Scope::Geometry("gravity"), &role)
    }

    /// A vector in which `_` has no place.
    pub(super) fn vector(&mut self, v: &Vector, scope: Scope, role: &Role) -> Option<[Expr; 3]> {
        let trailing = self.units.trailing(v.unit.as_ref(), role, self.diag)?;
        let e = [0, 1, 2].map(|k| match units::split(&v.entries[k]) {
            Ok(e) => self
                .units
                .entry(e, scope, role, trailing.as_ref(), self.diag),
            Err(at) => {
                self.diag.error(
                    at,
                    format!(
                        "`_` cannot stand in {}: the entry is known or a parameter",
                        role.what
                    ),
                );
                None
            }
        });
        all(e)
    }

    /// The sum of energies, each of whose terms must be one.
    #[allow(
        clippy::option_option,
        reason = "outer: an error was reported; inner: none is given"
    )]
    pub(super) fn energies(
        &mut self,
        all: &[syntax::Expr],
        scope: Scope,
        what: &str,
    ) -> Option<Option<Expr>> {
        let role = Role {
            what: what.to_string(),
            unit: Unit::of(&[("J", 1)]),
        };
        let each: Vec<Option<Expr>> = all
            .iter()
            .map(|e| self.units.law(e, scope, &role, self.diag))
            .collect();
        let each: Option<Vec<Expr>> = each.into_iter().collect();
        Some(each?.into_iter().reduce(plus))
    }
}

/// Three entries, or none.
pub(super) fn all(e: [Option<Expr>; 3]) -> Option<[Expr; 3]> {
    let [x, y, z] = e;
    Some([x?, y?, z?])
}
