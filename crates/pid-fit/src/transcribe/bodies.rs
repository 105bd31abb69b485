//! Keeps links bodies of positive density during a fit: the log-determinant barrier of their
//! pseudo-inertias.
//!
//! The ten parameters of a link belong to a body with a density that is nowhere negative if and
//! only if its pseudo-inertia is positive semidefinite (P. M. Wensing, S. Kim, J.-J. E. Slotine,
//! IEEE RA-L 3, 2018):
//!
//! ```text
//! J = [ Σ  h ]      Σ = ½ tr(I) 1 − I
//!     [ hᵀ m ]
//! ```
//!
//! J is linear in mass, first moment and inertia about the frame's origin. With mass, centre of
//! mass and inertia about it, J is congruent to the block-diagonal matrix of Σ and m by a matrix of
//! determinant one, which is linear in these. In either form
//!
//! ```text
//! b(p) = w Σ_links [ tr(J₀⁻¹ J(p)) − ln det(J₀⁻¹ J(p)) − 4 ]
//! ```
//!
//! is a convex barrier, at least zero, and zero where J is that of the start, J₀ (the entropic
//! divergence of T. Lee, P. M. Wensing, F. C. Park, IEEE T-RO 36, 2020): parameters that the data
//! do not determine stay near the start. Its weight w is the barrier parameter of the solver, as
//! for bounds, down to a floor. Every iterate has a positive definite mass matrix as far as the
//! links make it up, so motions do not grow as those of a negative inertia do.

use nalgebra::{Cholesky, Const, Matrix4, SymmetricEigen};
use pid_runtime::dynamics::ParamInfo;

/// Parameters of a link.
const TEN: usize = 10;
/// Names after that of the link: mass, first moment, inertia about the origin.
const ORIGIN: [&str; TEN] = [
    "m", "mx", "my", "mz", "ixx", "iyy", "izz", "ixy", "ixz", "iyz",
];
/// Names before that of the link: mass, centre of mass, inertia about it.
const CENTRE: [&str; TEN] = [
    "mass", "com_x", "com_y", "com_z", "ixx", "iyy", "izz", "ixy", "ixz", "iyz",
];
/// Smallest eigenvalue of a start, as a share of the largest.
const LIFT: f64 = 1e-4;

/// A link all of whose ten inertial parameters the model has.
#[derive(Debug, Clone, PartialEq)]
pub struct Body {
    name: String,
    /// Whether the inertia is about the centre of mass.
    centred: bool,
    places: [usize; TEN],
    /// J₀⁻¹ and ln det J₀.
    around: (Matrix4<f64>, f64),
}

impl Body {
    /// The links of a model, by the names of its parameters: `LINK_m`, `LINK_mx` … `LINK_iyz`, or
    /// `mass_LINK`, `com_x_LINK` … `iyz_LINK`.
    pub fn all(params: &[ParamInfo]) -> Vec<Self> {
        let find = |name: &str| params.iter().position(|p| p.name == name);
        let body = |link: &str, centred: bool| {
            let mut places = [0; TEN];
            for (k, place) in places.iter_mut().enumerate() {
                *place = find(&match centred {
                    true => format!("{}_{link}", CENTRE[k]),
                    false => format!("{link}_{}", ORIGIN[k]),
                })?;
            }
            let body = Self {
                name: link.to_owned(),
                centred,
                places,
                around: (Matrix4::zeros(), 0.0),
            };
            let mut nominal: Vec<f64> = params.iter().map(|p| p.nominal).collect();
            body.lift(&mut nominal);
            Some(body.around(&nominal))
        };
        params
            .iter()
            .filter_map(|p| match p.name.strip_suffix("_m") {
                Some(link) => body(link, false),
                None => body(p.name.strip_prefix("mass_")?, true),
            })
            .collect()
    }

    /// Name of the link.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Positions of its parameters: mass, first moment or centre of mass, inertia `xx yy zz xy xz yz`.
    pub fn parameters(&self) -> &[usize; TEN] {
        &self.places
    }

    /// Parameters on which J depends, with ∂J/∂p.
    fn slopes(&self) -> impl Iterator<Item = (usize, Matrix4<f64>)> + '_ {
        let places = self.places.iter().enumerate();
        places
            .filter(|(k, _)| !self.centred || !(1..4).contains(k))
            .map(|(k, place)| (*place, slope(k)))
    }

    /// J, or for the form with a centre of mass the matrix congruent to it.
    fn matrix(&self, p: &[f64]) -> Matrix4<f64> {
        self.slopes().map(|(j, slope)| p[j] * slope).sum()
    }

    /// Whether the parameters are those of a body with a positive density.
    pub fn holds(&self, p: &[f64]) -> bool {
        Cholesky::new(self.matrix(p)).is_some()
    }

    /// The link with its reference body at these parameters; unchanged if they belong to no body.
    #[must_use]
    pub fn around(mut self, p: &[f64]) -> Self {
        if let Some(factor) = Cholesky::new(self.matrix(p)) {
            self.around = (factor.inverse(), logarithm(&factor));
        }
        self
    }

    /// Moves parameters to the nearest J whose eigenvalues are at least a ten-thousandth of the largest.
    pub fn lift(&self, p: &mut [f64]) {
        let eigen = SymmetricEigen::new(self.matrix(p));
        let largest = eigen.eigenvalues.max();
        if !(largest > 0.0 && eigen.eigenvalues.min() < LIFT * largest) {
            return;
        }
        let lifted = eigen.eigenvalues.map(|e| e.max(LIFT * largest));
        let j =
            eigen.eigenvectors * Matrix4::from_diagonal(&lifted) * eigen.eigenvectors.transpose();
        let values = [
            j[(3, 3)],
            j[(0, 3)],
            j[(1, 3)],
            j[(2, 3)],
            j[(1, 1)] + j[(2, 2)],
            j[(0, 0)] + j[(2, 2)],
            j[(0, 0)] + j[(1, 1)],
            -j[(0, 1)],
            -j[(0, 2)],
            -j[(1, 2)],
        ];
        for (k, (&place, value)) in self.places.iter().zip(values).enumerate() {
            if !self.centred || !(1..4).contains(&k) {
                p[place] = value;
            }
        }
    }
}

/// ln det of a factorised matrix.
fn logarithm(factor: &Cholesky<f64, Const<4>>) -> f64 {
    let diagonal = factor.l_dirty().diagonal();
    2.0 * diagonal.iter().map(|d| d.ln()).sum::<f64>()
}

/// ∂J/∂ of the parameter at a position.
fn slope(k: usize) -> Matrix4<f64> {
    let mut e = Matrix4::zeros();
    match k {
        0 => e[(3, 3)] = 1.0,
        1..=3 => (e[(k - 1, 3)], e[(3, k - 1)]) = (1.0, 1.0),
        4..=6 => (0..3).for_each(|i| e[(i, i)] = if i == k - 4 { -0.5 } else { 0.5 }),
        _ => {
            let (i, j) = [(0, 1), (0, 2), (1, 2)][k - 7];
            (e[(i, j)], e[(j, i)]) = (-1.0, -1.0);
        }
    }
    e
}

/// The barrier of some links in the objective of a program whose variables are the parameters over
/// their scales.
#[derive(Debug, Clone)]
pub(super) struct Barrier {
    bodies: Vec<Body>,
    scale: Vec<f64>,
    floor: f64,
    weight: f64,
}

impl Barrier {
    /// `floor`: smallest weight, in units of the objective.
    pub(super) fn new(bodies: &[Body], scale: &[f64], floor: f64) -> Self {
        Self {
            bodies: bodies.to_vec(),
            scale: scale.to_vec(),
            floor,
            weight: floor,
        }
    }

    /// Takes the solver's barrier parameter, zero for none; whether that changes the objective.
    pub(super) fn set(&mut self, mu: f64) -> bool {
        let weight = if mu == 0.0 { 0.0 } else { mu.max(self.floor) };
        let changed = !self.bodies.is_empty() && weight != self.weight;
        self.weight = weight;
        changed
    }

    /// b(p), NaN outside of its domain; first derivatives by the variables go to `add`.
    pub(super) fn value(&self, p: &[f64], mut add: impl FnMut(usize, f64)) -> f64 {
        let mut value = 0.0;
        for body in &self.bodies {
            let j = body.matrix(p);
            let Some(factor) = Cholesky::new(j) else {
                return f64::NAN;
            };
            let (around, logarithm_around) = &body.around;
            value += around.dot(&j) - 4.0 - logarithm(&factor) + logarithm_around;
            let inverse = factor.inverse();
            for (j, slope) in body.slopes() {
                add(
                    j,
                    self.weight * self.scale[j] * (around - inverse).dot(&slope),
                );
            }
        }
        self.weight * value
    }

    /// ∂²b by the variables: entries of the lower triangle (row ≥ column) of each link, in the
    /// order of [`Barrier::pattern`].
    pub(super) fn hessian(&self, p: &[f64], mut add: impl FnMut(usize, usize, f64)) {
        for body in &self.bodies {
            let inverse = Cholesky::new(body.matrix(p)).map(|f| f.inverse());
            let products: Vec<(usize, Option<Matrix4<f64>>)> = body
                .slopes()
                .map(|(j, slope)| (j, inverse.map(|i| i * slope)))
                .collect();
            for (n, (i, a)) in products.iter().enumerate() {
                for (j, b) in &products[..=n] {
                    let value = match (a, b) {
                        (Some(a), Some(b)) => self.weight * a.dot(&b.transpose()),
                        _ => f64::NAN,
                    };
                    let scales = self.scale[*i] * self.scale[*j];
                    add(*i.max(j), *i.min(j), scales * value);
                }
            }
        }
    }

    /// Entries of the Hessian, row and column.
    pub(super) fn pattern(bodies: &[Body]) -> Vec<(u32, u32)> {
        let mut entries = Vec::new();
        for body in bodies {
            let places: Vec<usize> = body.slopes().map(|(j, _)| j).collect();
            for (n, i) in places.iter().enumerate() {
                let row = places[..=n].iter();
                entries.extend(row.map(|j| (*i.max(j) as u32, *i.min(j) as u32)));
            }
        }
        entries
    }

    /// Largest α up to 1 for which variables x + α d are in the domain, times `share` where that is
    /// less than 1.
    pub(super) fn longest(&self, x: &[f64], d: &[f64], share: f64) -> f64 {
        if self.bodies.is_empty() {
            return 1.0;
        }
        let scale =
            |x: &[f64]| -> Vec<f64> { x.iter().zip(&self.scale).map(|(x, s)| x * s).collect() };
        let (p, d) = (&scale(x), &scale(d));
        let mut longest = 1.0_f64;
        for body in &self.bodies {
            let Some(factor) = Cholesky::new(body.matrix(p)) else {
                continue;
            };
            let l = factor.l();
            let Some(left) = l.solve_lower_triangular(&body.matrix(d)) else {
                continue;
            };
            let Some(both) = l.solve_lower_triangular(&left.transpose()) else {
                continue;
            };
            let least = both.symmetric_eigenvalues().min();
            if least < 0.0 {
                longest = longest.min(-share / least);
            }
        }
        longest
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::borrow::Cow;

    /// Two links, one in each form; their parameters are not those of bodies of one frame.
    fn links() -> (Vec<ParamInfo>, Vec<Body>, Vec<f64>) {
        let origin = [1.3, 0.1, -0.2, 0.05, 0.12, 0.10, 0.09, 4e-3, -8e-3, 5e-3];
        let centre = [2.0, 0.3, -0.4, 0.2, 0.02, 0.03, 0.025, 1e-3, -2e-3, 5e-4];
        let names = ORIGIN.iter().map(|o| format!("arm_{o}"));
        let names = names.chain(CENTRE.iter().map(|c| format!("{c}_hand")));
        let values = origin.iter().chain(&centre);
        let info = |(name, nominal): (String, &f64)| ParamInfo {
            name: Cow::Owned(name),
            unit: Cow::Borrowed("1"),
            doc: Cow::Borrowed(""),
            nominal: *nominal,
            lower: f64::NEG_INFINITY,
            upper: f64::INFINITY,
            fixed: false,
        };
        let mut params: Vec<ParamInfo> = names.zip(values).map(info).collect();
        // A parameter that is no link's, and a link that is not whole.
        params.insert(0, info(("gain_m".to_owned(), &3.0)));
        params.push(info(("tool_m".to_owned(), &1.0)));
        let p = params.iter().map(|p| p.nominal).collect();
        let bodies = Body::all(&params);
        (params, bodies, p)
    }

    #[test]
    fn links_are_found_in_both_forms() {
        let (_, bodies, p) = links();
        let names: Vec<&str> = bodies.iter().map(Body::name).collect();
        assert_eq!(names, ["arm", "hand"]);
        assert_eq!(bodies[0].parameters()[..3], [1, 2, 3]);
        assert!(bodies.iter().all(|b| b.holds(&p)));
    }

    /// J = Σ m (x, 1)(x, 1)ᵀ of point masses, by definition; both forms of their body have one determinant.
    #[test]
    fn the_matrix_is_that_of_point_masses() {
        let points = [
            (2.0, [0.1, 0.2, -0.3]),
            (0.5, [-0.4, 0.3, 0.2]),
            (1.0, [0.2, -0.5, 0.1]),
            (0.7, [0.0, 0.1, 0.6]),
        ];
        let (_, bodies, mut p) = links();
        let inertia = |about: [f64; 3]| {
            let mut sum = [0.0; 6];
            for (m, x) in points {
                let [x, y, z] = [x[0] - about[0], x[1] - about[1], x[2] - about[2]];
                let own = [
                    y * y + z * z,
                    x * x + z * z,
                    x * x + y * y,
                    -x * y,
                    -x * z,
                    -y * z,
                ];
                sum.iter_mut().zip(own).for_each(|(s, o)| *s += m * o);
            }
            sum
        };
        let mass: f64 = points.iter().map(|(m, _)| m).sum();
        let moment = |k: usize| points.iter().map(|(m, x)| m * x[k]).sum::<f64>();
        let moments = [moment(0), moment(1), moment(2)];
        let centre = moments.map(|h| h / mass);
        for (body, (vector, inertia)) in bodies
            .iter()
            .zip([(moments, inertia([0.0; 3])), (centre, inertia(centre))])
        {
            let values = [mass].into_iter().chain(vector).chain(inertia);
            body.places.iter().zip(values).for_each(|(j, v)| p[*j] = v);
        }
        let mut expected = Matrix4::zeros();
        for (m, [x, y, z]) in points {
            let v = nalgebra::Vector4::new(x, y, z, 1.0);
            expected += m * v * v.transpose();
        }
        assert!((bodies[0].matrix(&p) - expected).norm() < 1e-12);
        let (a, b) = (expected.determinant(), bodies[1].matrix(&p).determinant());
        assert!((a / b - 1.0).abs() < 1e-12, "{a} {b}");
    }

    #[test]
    fn derivatives_are_those_of_differences() {
        let (_, bodies, mut p) = links();
        let barrier = Barrier::new(&bodies, &vec![1.0; p.len()], 0.7);
        assert!(
            barrier.value(&p, |_, _| {}).abs() < 1e-12,
            "zero at the start"
        );
        for (k, p) in p.iter_mut().enumerate() {
            *p *= 1.0 + 0.1 * (2.3 * k as f64).sin();
        }
        assert!(barrier.value(&p, |_, _| {}) > 1e-3, "above zero elsewhere");
        let gradient = |p: &[f64]| {
            let mut g = vec![0.0; p.len()];
            barrier.value(p, |j, slope| g[j] += slope);
            g
        };
        let mut hessian = vec![0.0; p.len() * p.len()];
        let mut entries = Vec::new();
        barrier.hessian(&p, |i, j, value| {
            entries.push((i as u32, j as u32));
            hessian[i * p.len() + j] += value;
        });
        assert_eq!(entries, Barrier::pattern(&bodies));
        let found = gradient(&p);
        for j in 0..p.len() {
            let h = 1e-6 * p[j].abs().max(1e-3);
            let at = |d: f64| {
                let mut moved = p.clone();
                moved[j] += d;
                (barrier.value(&moved, |_, _| {}), gradient(&moved))
            };
            let (up, down) = (at(h), at(-h));
            let slope = (up.0 - down.0) / (2.0 * h);
            assert!((slope - found[j]).abs() < 1e-6 * (1.0 + slope.abs()), "{j}");
            for i in j..p.len() {
                let slope = (up.1[i] - down.1[i]) / (2.0 * h);
                let second = hessian[i * p.len() + j];
                assert!(
                    (slope - second).abs() < 1e-5 * (1.0 + slope.abs()),
                    "{i} {j}"
                );
            }
        }
    }

    #[test]
    fn its_weight_is_the_solvers_down_to_a_floor_and_zero_leaves_it_out() {
        let (_, bodies, mut p) = links();
        p[1] *= 1.1;
        let mut barrier = Barrier::new(&bodies, &vec![1.0; p.len()], 0.7);
        let slope = |barrier: &Barrier| {
            let mut first = 0.0;
            barrier.value(&p, |j, s| first += if j == 1 { s } else { 0.0 });
            first
        };
        let floor = slope(&barrier);
        assert!(floor.abs() > 1e-3);
        for (mu, share) in [(1.4, 2.0), (1e-9, 1.0), (0.0, 0.0)] {
            assert!(barrier.set(mu), "{mu}");
            assert!((slope(&barrier) - share * floor).abs() < 1e-12, "{mu}");
            assert!(!barrier.set(mu), "{mu} again");
        }
    }

    #[test]
    fn steps_end_before_the_boundary() {
        let (_, bodies, p) = links();
        let barrier = Barrier::new(&bodies, &vec![1.0; p.len()], 1.0);
        let mut d = vec![0.0; p.len()];
        d[bodies[0].places[4]] = 0.3;
        let longest = barrier.longest(&p, &d, 0.99);
        let at =
            |alpha: f64| -> Vec<f64> { p.iter().zip(&d).map(|(p, d)| p + alpha * d).collect() };
        assert!(longest < 1.0 && barrier.value(&at(longest), |_, _| {}).is_finite());
        let edge = bodies[0]
            .matrix(&at(longest / 0.99))
            .symmetric_eigenvalues();
        assert!(edge.min().abs() < 1e-12 * edge.max(), "{edge}");
        assert!(
            barrier
                .value(&at(1.001 * longest / 0.99), |_, _| {})
                .is_nan()
        );
        d[bodies[0].places[4]] = 1e-3;
        assert_eq!(barrier.longest(&p, &d, 0.99), 1.0);
    }

    #[test]
    fn what_no_body_has_is_lifted() {
        let (_, bodies, mut p) = links();
        for body in &bodies {
            // Principal moments of which one is above the sum of the others.
            p[body.places[4]] = 1.0;
            assert!(!body.holds(&p));
            let before = p.clone();
            body.lift(&mut p);
            assert!(body.holds(&p));
            let kept = body.matrix(&before).symmetric_eigenvalues().max();
            let largest = body.matrix(&p).symmetric_eigenvalues().max();
            assert!((largest / kept - 1.0).abs() < 1e-12);
            let again = p.clone();
            body.lift(&mut p);
            assert!(p.iter().zip(&again).all(|(a, b)| (a - b).abs() < 1e-9));
        }
    }
}
