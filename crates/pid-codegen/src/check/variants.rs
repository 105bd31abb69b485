//! Variants: the joints they hold must move, and something must be left to move.

use crate::diag::Diagnostics;
use crate::syntax::{Ast, Lock, Motion, VariantDecl};

use super::names::{Symbols, is_own, twice, unknown_joint};

/// Reports names taken, joints that cannot be locked, and variants without motion.
pub fn check(ast: &Ast, symbols: &Symbols<'_>, diag: &mut Diagnostics) {
    for (k, variant) in ast.variants.iter().enumerate() {
        let earlier = ast.variants[..k].iter().map(|v| &v.name);
        if let Some(first) = [&ast.name]
            .into_iter()
            .chain(earlier)
            .find(|n| **n == variant.name)
        {
            twice(diag, &variant.name, first);
        }
        let before = diag.count();
        let mut locked = Vec::new();
        for lock in &variant.locks {
            locks(lock, variant, symbols, &mut locked, diag);
        }
        let own = symbols.joints.iter().filter(|j| is_own(j.decl)).count();
        if diag.count() == before && own > 0 && locked.len() == own {
            diag.error(
                &variant.name,
                format!(
                    "all joints of variant `{}` are locked, nothing is left to move\nhelp: leave one of them free",
                    variant.name
                ),
            );
        }
    }
}

fn locks(
    lock: &Lock,
    variant: &VariantDecl,
    symbols: &Symbols<'_>,
    locked: &mut Vec<usize>,
    diag: &mut Diagnostics,
) {
    for ident in &lock.joints.idents {
        let place = || {
            if lock.joints.idents.len() == 1 {
                ident.into()
            } else {
                lock.joints.loc
            }
        };
        let Some(j) = symbols.joints.iter().position(|j| j.decl.name == *ident) else {
            unknown_joint(diag, ident, &symbols.joints);
            continue;
        };
        let decl = symbols.joints[j].decl;
        if matches!(decl.motion, Motion::Fixed) {
            diag.error(
                place(),
                format!(
                    "`lock {ident}` in variant `{}`: `{ident}` is already fixed\nhelp: remove it",
                    variant.name
                ),
            );
        } else if decl.follows.is_some() {
            diag.error(
                place(),
                format!(
                    "`lock {ident}` in variant `{}`: `{ident}` follows other joints\nhelp: lock the joints it follows",
                    variant.name
                ),
            );
        } else if locked.contains(&j) {
            diag.error(
                place(),
                format!(
                    "joint `{ident}` is locked twice in variant `{}`",
                    variant.name
                ),
            );
        } else {
            locked.push(j);
        }
    }
}
