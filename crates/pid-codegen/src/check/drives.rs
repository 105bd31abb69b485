//! Drives: armatures and force laws of joints and motors, with the contributions of `drive: …`.

use crate::si::Unit;
use crate::syntax::{self, Ast, DriveDecl, DriveKind, Motion};
use pid_derive::model::{Expr, Motor};

use super::builder::Builder;
use super::meaning::Scope;
use super::numbers::{plus, times};
use super::units::Role;

impl<'a> Builder<'a, '_> {
    /// Motor number `k`.
    pub(super) fn motor(&mut self, ast: &Ast, k: usize) -> Option<Motor> {
        let j = self.symbols.joints.len() + k;
        let decl = self.symbols.motors[k];
        let (armature, force) = (self.armature(j), self.force(ast, j));
        Some(Motor {
            name: decl.name.to_string(),
            docs: decl.docs.clone(),
            moves: self.units.moves[j].as_ref()?.affine.clone()?,
            armature: armature?,
            force: force?,
        })
    }

    fn moves(&self, j: usize) -> bool {
        self.units.moves[j].is_some() && !self.symbols.is_held(j)
    }

    /// "revolute joint `shoulder`".
    fn described(&self, j: usize) -> String {
        let kind = match self.symbols.joints.get(j).map(|s| &s.decl.motion) {
            Some(Motion::Prismatic(_)) => "prismatic joint",
            Some(Motion::Coordinate(_)) => "coordinate",
            Some(_) => "revolute joint",
            None => "motor",
        };
        format!("{kind} `{}`", self.symbols.name(j))
    }

    /// Inertia of the drives of a joint or motor.
    #[allow(
        clippy::option_option,
        reason = "outer: an error was reported; inner: no armature"
    )]
    pub(super) fn armature(&mut self, j: usize) -> Option<Option<Expr>> {
        if !self.moves(j) {
            return Some(None);
        }
        let what = match self.symbols.joints.get(j) {
            Some(_) => "joint",
            None => "motor",
        };
        let role = Role {
            what: format!("the armature of {what} `{}`", self.symbols.name(j)),
            unit: self.units.armature(j),
        };
        let blocks = self.symbols.blocks.iter().filter(|b| b.1.contains(&j));
        let laws: Vec<_> = blocks
            .filter_map(|b| Some((b.0.armature.as_ref()?, b.1.first() == Some(&j))))
            .collect();
        let written = self.sum(&laws, Scope::Drive(j), &role);
        let mut sum = written?;
        for (drive, first) in self.drives(j) {
            if let Some(rotor) = &drive.rotor {
                let rotor = self.quantity(
                    j,
                    rotor,
                    first,
                    "inertia of the rotor",
                    &[("kg", 1), ("m", 2)],
                )?;
                let ratio = self.ratio(j, drive, first)?;
                let felt = times(Expr::Powi(Box::new(ratio), 2), rotor);
                sum = Some(sum.map_or(felt.clone(), |s| plus(s, felt)));
            }
        }
        Some(sum)
    }

    /// Force on a joint or motor.
    #[allow(
        clippy::option_option,
        reason = "outer: an error was reported; inner: no force"
    )]
    pub(super) fn force(&mut self, ast: &Ast, j: usize) -> Option<Option<Expr>> {
        if !self.moves(j) {
            return Some(None);
        }
        let role = Role {
            what: format!("a force on {}", self.described(j)),
            unit: self.units.force(j),
        };
        let blocks = self.symbols.blocks.iter().filter(|b| b.1.contains(&j));
        let mut laws: Vec<_> = blocks
            .filter_map(|b| Some((b.0.force.as_ref()?, b.1.first() == Some(&j))))
            .collect();
        let name = self.symbols.name(j);
        let own = ast.forces.iter().filter(|f| f.joint == *name);
        laws.extend(own.map(|f| (&f.force, true)));
        let written = self.sum(&laws, Scope::Force(j), &role);
        let mut sum = written?;
        for (drive, first) in self.drives(j) {
            let force = self.drive(j, drive, first)?;
            sum = Some(sum.map_or(force.clone(), |s| plus(s, force)));
        }
        Some(sum)
    }

    /// The drives of a joint, and whether it is the first joint of theirs.
    fn drives(&self, j: usize) -> Vec<(&'a DriveDecl, bool)> {
        let blocks = self.symbols.blocks.iter().filter(|b| b.1.contains(&j));
        blocks
            .filter_map(|b| Some((b.0.drive.as_ref()?, b.1.first() == Some(&j))))
            .collect()
    }

    /// Force of a drive on its joint, with n the ratio of the gear: `n·u`, `n·k·i`, or, at the
    /// voltage U, `n·k·(U − k·n·v)/R`.
    fn drive(&mut self, j: usize, drive: &DriveDecl, first: bool) -> Option<Expr> {
        let input = self
            .symbols
            .inputs
            .iter()
            .position(|u| u.joint == Some(j) && u.decl.name == drive.input)?;
        let input = Expr::Input(input);
        let ratio = self.ratio(j, drive, first);
        let gain = drive.gain.as_ref().map(|e| {
            self.quantity(
                j,
                e,
                first,
                "gain of the drive",
                &[("N", 1), ("m", 1), ("A", -1)],
            )
        });
        let resistance = drive
            .resistance
            .as_ref()
            .map(|e| self.quantity(j, e, first, "resistance of the drive", &[("Ohm", 1)]));
        let ratio = ratio?;
        match drive.kind {
            DriveKind::Torque => Some(times(ratio, input)),
            DriveKind::Current => Some(times(times(ratio, gain??), input)),
            DriveKind::Voltage => {
                let (gain, resistance) = (gain??, resistance??);
                let constant = times(ratio, gain);
                let velocity = self.units.moves[j].as_ref()?.velocity.clone();
                let back = times(constant.clone(), velocity);
                let left = Expr::Sub(Box::new(input), Box::new(back));
                let current = Expr::Div(Box::new(left), Box::new(resistance));
                Some(times(constant, current))
            }
        }
    }

    fn ratio(&mut self, j: usize, drive: &DriveDecl, first: bool) -> Option<Expr> {
        match &drive.ratio {
            Some(e) => {
                let per = self.units.position(j).powi(-1);
                self.in_unit(
                    j,
                    e,
                    first,
                    "ratio of the drive",
                    per.mul(&Unit::of(&[("rad", 1)])),
                )
            }
            None if self.units.position(j).is_dimensionless() => Some(Expr::Num(1.0)),
            None => {
                self.diag.error(
                    drive.loc,
                    format!(
                        "the drive of the prismatic joint `{}` needs a ratio in `rad/m`\nhelp: write `ratio: 2*pi/(5 mm);` for a spindle of 5 mm pitch",
                        self.symbols.name(j)
                    ),
                );
                None
            }
        }
    }

    fn quantity(
        &mut self,
        j: usize,
        e: &syntax::Expr,
        first: bool,
        what: &str,
        unit: &[(&str, i32)],
    ) -> Option<Expr> {
        self.in_unit(j, e, first, what, Unit::of(unit))
    }

    fn in_unit(
        &mut self,
        j: usize,
        e: &syntax::Expr,
        first: bool,
        what: &str,
        unit: Unit,
    ) -> Option<Expr> {
        let role = Role {
            what: format!("the {what} of `{}`", self.symbols.name(j)),
            unit,
        };
        let before = self.diag.count();
        let x = self.units.entry(e, Scope::Drive(j), &role, None, self.diag);
        self.say_once(before, first);
        x
    }

    /// The sum of laws. A mistake in a law for several joints is reported once, unless the joints
    /// are of different kinds.
    #[allow(
        clippy::option_option,
        reason = "outer: an error was reported; inner: no law"
    )]
    fn sum(
        &mut self,
        laws: &[(&syntax::Expr, bool)],
        scope: Scope,
        role: &Role,
    ) -> Option<Option<Expr>> {
        let mut sum: Option<Expr> = None;
        for (law, first) in laws {
            let before = self.diag.count();
            let e = self.units.law(law, scope, role, self.diag);
            self.say_once(before, *first);
            let e = e?;
            sum = Some(match sum {
                None => e,
                Some(s) => Expr::Add(Box::new(s), Box::new(e)),
            });
        }
        Some(sum)
    }

    /// The first joint's report stands for the others; a joint of another kind may be the first to fail.
    fn say_once(&mut self, before: usize, first: bool) {
        if self.diag.count() > before && !first && before > 0 {
            while self.diag.count() > before {
                self.diag.pop();
            }
        }
    }
}
