//! Homogeneous bodies: mass and inertia from dimensions.
//!
//! About the centre of mass, m the mass, axes along those of the link:
//!
//! | body | mass from the density ρ | inertia |
//! |---|---|---|
//! | solid cylinder about z | ρ π r² l | Ixx = Iyy = m (3 r² + l²)/12, Izz = m r²/2 |
//! | hollow cylinder about z | ρ π (R² − r²) l | Ixx = Iyy = m (3 (R² + r²) + l²)/12, Izz = m (R² + r²)/2 |
//! | solid box | ρ a b c | Ixx = m (b² + c²)/12, and so on |
//! | solid sphere | ρ (4/3) π r³ | m (2/5) r² |

use crate::si::Unit;
use crate::syntax::{self, Amount, Shape, ShapeKind, Vector};
use pid_derive::model::{About, Expr, Inertial, Param, Tensor};

use super::builder::Builder;
use super::meaning::Scope;
use super::numbers::at_params;
use super::units::Role;

fn mul(x: Expr, y: Expr) -> Expr {
    Expr::Mul(Box::new(x), Box::new(y))
}

fn add(x: Expr, y: Expr) -> Expr {
    Expr::Add(Box::new(x), Box::new(y))
}

fn square(x: &Expr) -> Expr {
    Expr::Powi(Box::new(x.clone()), 2)
}

fn times(k: f64, x: Expr) -> Expr {
    mul(Expr::Num(k), x)
}

/// Volume, and the diagonal of the inertia divided by the mass.
struct Form {
    volume: Expr,
    gyration: [Expr; 3],
}

impl Form {
    /// A round body from the squares of its radii (their difference and their sum) and its length.
    fn round(difference: Expr, sum: Expr, length: &Expr, axis: usize) -> Self {
        let about = times(0.5, sum.clone());
        let across = times(1.0 / 12.0, add(times(3.0, sum), square(length)));
        let mut gyration = [across.clone(), across.clone(), across];
        gyration[axis] = about;
        Form {
            volume: mul(times(std::f64::consts::PI, difference), length.clone()),
            gyration,
        }
    }
}

impl Builder<'_, '_> {
    /// The mass distribution of a homogeneous body.
    pub(super) fn homogeneous(
        &mut self,
        k: usize,
        link: &str,
        shape: &Shape,
        com: Option<&Vector>,
        params: Option<&[Param]>,
    ) -> Option<Inertial> {
        let com = self.com(k, link, com);
        let form = self.form(link, shape, params);
        let (what, unit, given) = match &shape.amount {
            Amount::Mass(e) => ("mass", Unit::of(&[("kg", 1)]), e),
            Amount::Density(e) => ("density", Unit::of(&[("kg", 1), ("m", -3)]), e),
        };
        let amount = self.positive(link, what, unit, given, params);
        let (com, form, amount) = (com?, form?, amount?);
        let mass = match &shape.amount {
            Amount::Mass(_) => amount,
            Amount::Density(_) => mul(amount, form.volume),
        };
        let [xx, yy, zz] = form.gyration.map(|g| mul(mass.clone(), g));
        Some(Inertial::Body {
            mass,
            com,
            inertia: Tensor {
                xx,
                yy,
                zz,
                ..Tensor::default()
            },
            about: About::Com,
        })
    }

    fn form(&mut self, link: &str, shape: &Shape, params: Option<&[Param]>) -> Option<Form> {
        let mut length = |what: &str, e: &syntax::Expr| {
            self.positive(link, what, Unit::of(&[("m", 1)]), e, params)
        };
        match &shape.kind {
            ShapeKind::Cylinder(radius, l, axis) => {
                let (r, l) = (length("radius", radius), length("length", l));
                let (r, l) = (r?, l?);
                Some(Form::round(square(&r), square(&r), &l, *axis))
            }
            ShapeKind::Tube(outer, inner, l, axis) => {
                let (o, i) = (length("outer radius", outer), length("inner radius", inner));
                let l = length("length", l);
                let (o, i, l) = (o?, i?, l?);
                if let (Some(x), Some(y)) = (nominal(&o, params), nominal(&i, params))
                    && x <= y
                {
                    self.diag.error(
                        inner.loc,
                        format!(
                            "inner radius {y} of link `{link}` is not below the outer radius {x}"
                        ),
                    );
                    return None;
                }
                let difference = Expr::Sub(Box::new(square(&o)), Box::new(square(&i)));
                Some(Form::round(
                    difference,
                    add(square(&o), square(&i)),
                    &l,
                    *axis,
                ))
            }
            ShapeKind::Box(size) => {
                let role = Role {
                    what: format!("size of link `{link}`"),
                    unit: Unit::of(&[("m", 1)]),
                };
                let [a, b, c] = self.vector(size, Scope::Geometry("a link"), &role)?;
                for (entry, e) in size.entries.iter().zip([&a, &b, &c]) {
                    if let Some(x) = nominal(e, params)
                        && !(x > 0.0 && x.is_finite())
                    {
                        self.not_positive(link, "size", x, entry.loc());
                        return None;
                    }
                }
                let twelfth = |x: &Expr, y: &Expr| times(1.0 / 12.0, add(square(x), square(y)));
                Some(Form {
                    gyration: [twelfth(&b, &c), twelfth(&a, &c), twelfth(&a, &b)],
                    volume: mul(mul(a, b), c),
                })
            }
            ShapeKind::Sphere(radius) => {
                let r = length("radius", radius)?;
                let gyration = times(0.4, square(&r));
                Some(Form {
                    volume: times(4.0 / 3.0 * std::f64::consts::PI, Expr::Powi(Box::new(r), 3)),
                    gyration: [gyration.clone(), gyration.clone(), gyration],
                })
            }
        }
    }

    fn positive(
        &mut self,
        link: &str,
        what: &str,
        unit: Unit,
        e: &syntax::Expr,
        params: Option<&[Param]>,
    ) -> Option<Expr> {
        let role = Role {
            what: format!("{what} of link `{link}`"),
            unit,
        };
        let scope = Scope::Geometry("a link");
        let x = self.units.entry(e, scope, &role, None, self.diag)?;
        if let Some(value) = nominal(&x, params)
            && !(value > 0.0 && value.is_finite())
        {
            self.not_positive(link, what, value, e.loc);
            return None;
        }
        Some(x)
    }

    fn not_positive(&mut self, link: &str, what: &str, value: f64, at: crate::diag::Loc) {
        self.diag.error(
            at,
            format!(
                "{what} of link `{link}` is {value} at the nominal values, but must be positive"
            ),
        );
    }
}

fn nominal(e: &Expr, params: Option<&[Param]>) -> Option<f64> {
    let values: Vec<f64> = params?.iter().map(|p| p.nominal).collect();
    at_params(e, &values)
}
