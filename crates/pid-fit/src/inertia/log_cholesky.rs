//! Physical consistency in every estimator: links in log-Cholesky coordinates as a wrapper of the model.
//!
//! The ten parameters of a link are replaced by the coordinates θ of its pseudo-inertia
//! ([`crate::inertia::pseudo_inertia`]); every θ is a body of positive density, so that the mass
//! matrix is positive definite in every pose at every iterate. Links are found by the names of
//! their parameters, in either form: mass, first moment and inertia about the frame's origin
//! (`LINK_m`, `LINK_mx` … `LINK_iyz`), or mass, centre of mass and inertia about it (`mass_LINK`,
//! `com_x_LINK` … `iyz_LINK`).

use std::borrow::Cow;
use std::cell::RefCell;

use num_dual::{DualNum, HyperDual64};
use pid_runtime::dynamics::{At, Dims, Hessian, InputInfo, ParamInfo};

use crate::inertia::consistent;
use crate::inertia::pseudo_inertia::{BODY, body, coordinates};
use pid_runtime::chain::{Chain, Group, Substituted};
use pid_runtime::substituted;

/// Names of the coordinates.
const COORDINATES: [&str; BODY] = [
    "alpha", "d1", "d2", "d3", "s12", "s23", "s13", "t1", "t2", "t3",
];

/// Form of the ten parameters of a link.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Form {
    /// Mass, first moment, inertia about the origin.
    Origin,
    /// Mass, centre of mass, inertia about it.
    Centre,
}

impl Form {
    /// The link's parameters of a body's `(m, h, I)`.
    fn of_body<D: DualNum<Primitive = f64> + Copy>(self, p: [D; BODY]) -> [D; BODY] {
        if self == Form::Origin {
            return p;
        }
        let [m, hx, hy, hz, ixx, iyy, izz, ixy, ixz, iyz] = p;
        let (x, y, z) = (hx / m, hy / m, hz / m);
        [
            m,
            x,
            y,
            z,
            ixx - m * (y * y + z * z),
            iyy - m * (x * x + z * z),
            izz - m * (x * x + y * y),
            ixy + m * x * y,
            ixz + m * x * z,
            iyz + m * y * z,
        ]
    }

    /// `(m, h, I)` of the link's parameters.
    fn to_body(self, p: &[f64; BODY]) -> [f64; BODY] {
        if self == Form::Origin {
            return *p;
        }
        let [m, x, y, z, ixx, iyy, izz, ixy, ixz, iyz] = *p;
        [
            m,
            m * x,
            m * y,
            m * z,
            ixx + m * (y * y + z * z),
            iyy + m * (x * x + z * z),
            izz + m * (x * x + y * y),
            ixy - m * x * y,
            ixz - m * x * z,
            iyz - m * y * z,
        ]
    }
}

/// A link in coordinates.
#[derive(Debug, Clone, PartialEq)]
struct Link {
    name: String,
    form: Form,
    /// Positions of its parameters, and of its coordinates.
    places: [usize; BODY],
}

/// Gradient (row: parameter) of a link's parameters, and the second derivatives of their weighted sum.
type Derivatives = ([[f64; BODY]; BODY], [[f64; BODY]; BODY]);

impl Link {
    fn parameters<D: DualNum<Primitive = f64> + Copy>(&self, theta: &[D; BODY]) -> [D; BODY] {
        self.form.of_body(body(theta))
    }

    fn derivatives(&self, theta: &[f64; BODY], weights: &[f64; BODY]) -> Derivatives {
        let (mut first, mut second) = ([[0.0; BODY]; BODY], [[0.0; BODY]; BODY]);
        let mut seeded = theta.map(HyperDual64::from_re);
        for i in 0..BODY {
            for j in 0..=i {
                seeded[i].eps1 = 1.0;
                seeded[j].eps2 = 1.0;
                let p = self.parameters(&seeded);
                seeded[i].eps1 = 0.0;
                seeded[j].eps2 = 0.0;
                for (row, p) in first.iter_mut().zip(&p) {
                    row[i] = p.eps1;
                }
                let sum: f64 = p.iter().zip(weights).map(|(p, w)| w * p.eps1eps2).sum();
                second[i][j] = sum;
                second[j][i] = sum;
            }
        }
        (first, second)
    }
}

thread_local! {
    /// Inner parameters; kept so that evaluations do not allocate.
    static SCRATCH: RefCell<Vec<f64>> = const { RefCell::new(Vec::new()) };
}

/// A model with links in log-Cholesky coordinates; they take the places of the links' parameters.
pub struct LogCholesky<'m> {
    inner: &'m dyn Hessian,
    dims: Dims,
    params: Vec<ParamInfo>,
    inputs: Vec<InputInfo>,
    links: Vec<Link>,
    chain: Chain,
}

impl<'m> LogCholesky<'m> {
    /// Covers every link whose ten parameters are all free: neither marked `fixed` nor in `hold`.
    /// `None` if there is none.
    pub fn new(inner: &'m dyn Hessian, hold: &[usize]) -> Option<Self> {
        let infos = inner.params();
        let names: Vec<&str> = infos.iter().map(|i| i.name.as_ref()).collect();
        let free =
            |places: &[usize; BODY]| places.iter().all(|j| !infos[*j].fixed && !hold.contains(j));
        let origin = consistent::links(&names)
            .into_iter()
            .map(|l| (l, Form::Origin));
        let links: Vec<Link> = origin
            .chain(centred(&names).into_iter().map(|l| (l, Form::Centre)))
            .filter(|((_, places), _)| free(places))
            .map(|((name, places), form)| Link { name, form, places })
            .collect();
        if links.is_empty() {
            return None;
        }
        let mut params = infos.to_vec();
        for link in &links {
            let theta = link.coordinates(&link.places.map(|j| infos[j].nominal));
            for (k, &j) in link.places.iter().enumerate() {
                params[j] = ParamInfo {
                    name: Cow::Owned(format!("{}_{}", link.name, COORDINATES[k])),
                    unit: Cow::Borrowed("1"),
                    doc: Cow::Borrowed("log-Cholesky coordinate of the pseudo-inertia"),
                    nominal: theta[k],
                    lower: f64::NEG_INFINITY,
                    upper: f64::INFINITY,
                    fixed: false,
                };
            }
        }
        let dims = inner.dims();
        let groups: Vec<Group> = links
            .iter()
            .map(|link| Group {
                replaces: link.places.iter().map(|j| dims.p() + j).collect(),
                arguments: link.places.iter().map(|j| Some(dims.p() + j)).collect(),
            })
            .collect();
        Some(Self {
            chain: Chain::new(inner, &groups, |z| z),
            inputs: inner.inputs().to_vec(),
            inner,
            dims,
            params,
            links,
        })
    }

    /// Names of the links in coordinates.
    pub fn links(&self) -> impl Iterator<Item = &str> {
        self.links.iter().map(|l| l.name.as_str())
    }

    /// Whether a parameter of the model within is one of a link in coordinates.
    pub fn replaces(&self, parameter: usize) -> bool {
        self.links.iter().any(|l| l.places.contains(&parameter))
    }

    /// The coordinates nearest to parameters of the model within. Eigenvalues of pseudo-inertias
    /// that no body has are lifted; other parameters stay.
    pub fn enter(&self, p: &[f64]) -> Vec<f64> {
        let mut out = p.to_vec();
        for link in &self.links {
            for (&j, theta) in link
                .places
                .iter()
                .zip(link.coordinates(&link.places.map(|j| p[j])))
            {
                out[j] = theta;
            }
        }
        out
    }

    /// The parameters of the model within.
    pub fn leave(&self, x: &[f64]) -> Vec<f64> {
        let mut out = x.to_vec();
        for link in &self.links {
            let p = link.parameters(&link.places.map(|j| x[j]));
            for (&j, value) in link.places.iter().zip(p) {
                out[j] = value;
            }
        }
        out
    }

    /// ∂p/∂θ of a parameter of the model within: pairs of position and derivative.
    pub fn slope(&self, x: &[f64], parameter: usize) -> Vec<(usize, f64)> {
        for link in &self.links {
            if let Some(k) = link.places.iter().position(|&j| j == parameter) {
                let theta = link.places.map(|j| x[j]);
                let (first, _) = link.derivatives(&theta, &[0.0; BODY]);
                return link.places.into_iter().zip(first[k]).collect();
            }
        }
        vec![(parameter, 1.0)]
    }
}

impl Link {
    fn coordinates(&self, p: &[f64; BODY]) -> [f64; BODY] {
        coordinates(&self.form.to_body(p))
    }
}

/// Links whose parameters are mass, centre of mass and inertia about it.
fn centred(names: &[&str]) -> Vec<(String, [usize; BODY])> {
    const STEMS: [&str; BODY] = [
        "mass", "com_x", "com_y", "com_z", "ixx", "iyy", "izz", "ixy", "ixz", "iyz",
    ];
    names
        .iter()
        .filter_map(|name| name.strip_prefix("mass_"))
        .filter_map(|link| {
            let mut places = [0; BODY];
            for (place, stem) in places.iter_mut().zip(STEMS) {
                let wanted = format!("{stem}_{link}");
                *place = names.iter().position(|n| *n == wanted)?;
            }
            Some((link.to_owned(), places))
        })
        .collect()
}

impl Substituted for LogCholesky<'_> {
    fn inner(&self) -> &dyn Hessian {
        self.inner
    }

    fn chain(&self) -> &Chain {
        &self.chain
    }

    fn within<R>(&self, at: &At<'_>, work: impl FnOnce(&At<'_>) -> R) -> R {
        let mut p = SCRATCH.with(|s| std::mem::take(&mut *s.borrow_mut()));
        p.clear();
        p.extend_from_slice(at.p);
        for link in &self.links {
            let values = link.parameters(&link.places.map(|j| at.p[j]));
            for (&j, value) in link.places.iter().zip(values) {
                p[j] = value;
            }
        }
        let out = work(&At { p: &p, ..*at });
        SCRATCH.with(|s| *s.borrow_mut() = p);
        out
    }

    fn gradients(&self, at: &At<'_>, out: &mut Vec<f64>) {
        for link in &self.links {
            let theta = link.places.map(|j| at.p[j]);
            let (first, _) = link.derivatives(&theta, &[0.0; BODY]);
            out.extend(first.as_flattened());
        }
    }

    fn curvatures(&self, at: &At<'_>, weights: &[f64], out: &mut Vec<f64>) {
        for (link, weights) in self.links.iter().zip(weights.chunks_exact(BODY)) {
            let theta = link.places.map(|j| at.p[j]);
            let weights = std::array::from_fn(|k| weights[k]);
            let (_, second) = link.derivatives(&theta, &weights);
            out.extend(second.as_flattened());
        }
    }
}

substituted!(LogCholesky);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::derivatives::derivatives_hold;
    use crate::inertia::poses::indefinite_share;
    use pid_models::Ur10e;
    use pid_runtime::dynamics::Dynamics;

    #[test]
    fn derivatives_are_those_of_differences() {
        let model = LogCholesky::new(&Ur10e, &[]).expect("has links");
        assert_eq!(model.links().count(), 6);
        let nominal: Vec<f64> = Ur10e.params().iter().map(|i| i.nominal).collect();
        let x = model.enter(&nominal);
        let p: Vec<(usize, f64)> = x.iter().copied().enumerate().collect();
        derivatives_hold(&model, &[0.3, -0.7, 1.1, 0.2, -0.4, 0.9], &p);
        // The way back, to the lifting of eigenvalues.
        for (a, b) in model.leave(&x).iter().zip(&nominal) {
            assert!((a - b).abs() < 2e-3 * (1.0 + b.abs()), "{a} {b}");
        }
    }

    #[test]
    fn both_forms_are_one_body() {
        let p = [1.3, 0.1, -0.2, 0.05, 0.02, 0.03, 0.025, 1e-3, -2e-3, 5e-4];
        let (origin, centre) = (Form::Origin, Form::Centre);
        let linear = centre.to_body(&p);
        let back = centre.of_body(linear);
        assert!(p.iter().zip(back).all(|(a, b)| (a - b).abs() < 1e-15));
        assert_eq!(origin.to_body(&linear), linear);
        // Steiner: the inertia about z grows by m (x² + y²).
        assert!((linear[6] - (p[6] + 1.3 * (0.01 + 0.04))).abs() < 1e-15);
    }

    #[test]
    fn no_coordinates_make_an_indefinite_mass_matrix() {
        let model = LogCholesky::new(&Ur10e, &[]).expect("has links");
        let nominal: Vec<f64> = Ur10e.params().iter().map(|i| i.nominal).collect();
        let mut x = model.enter(&nominal);
        for (k, value) in x.iter_mut().enumerate() {
            *value += 0.8 * (1.7 * k as f64).sin();
        }
        assert_eq!(indefinite_share(&Ur10e, &model.leave(&x), 300, 1), 0.0);
    }

    #[test]
    fn slopes_are_those_of_differences() {
        let model = LogCholesky::new(&Ur10e, &[]).expect("has links");
        let nominal: Vec<f64> = Ur10e.params().iter().map(|i| i.nominal).collect();
        let x = model.enter(&nominal);
        let j = Ur10e
            .params()
            .iter()
            .position(|i| i.name == "forearm_iyy")
            .expect("a parameter");
        for (k, slope) in model.slope(&x, j) {
            let h = 1e-5;
            let at = |d: f64| {
                let mut y = x.clone();
                y[k] += d;
                model.leave(&y)[j]
            };
            let found = (at(h) - at(-h)) / (2.0 * h);
            assert!((found - slope).abs() < 1e-6 * (1.0 + slope.abs()), "{k}");
        }
    }
}
