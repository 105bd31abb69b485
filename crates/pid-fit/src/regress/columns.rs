//! The residual of a model as a linear function of parameters: `r = Y p_L + r₀`.

use pid_runtime::dynamics::{At, Hessian};

use pid_runtime::memory::Memory;

/// A model split into parameters in which its residual is jointly linear, and the others, which are held.
///
/// A parameter is linear if the Hessian pattern has no entry that couples it with itself or with
/// another linear one. Parameters that multiply inputs (gains, load-dependent friction) are held:
/// the measured input is what the regression explains, and with it on both sides, shrinking it
/// would pass for a fit. States of laws with a memory are inputs that nobody measured, so their
/// levels are linear.
pub struct LinearModel<'m> {
    model: &'m dyn Hessian,
    /// Positions of the linear parameters in `p`.
    linear: Vec<usize>,
    /// Parameters that are free in the model but held here.
    held: Vec<usize>,
    /// `p` with zeros at the linear parameters.
    base: Vec<f64>,
    /// Column of each entry of the Jacobian, `None` for an entry of no column.
    columns: Vec<Option<usize>>,
    /// Further columns: those of coefficients at other values of their shapes.
    variants: Vec<Variant>,
    /// The last of the model's inputs.
    memories: Vec<Memory>,
}

/// A shape parameter at several values: the column of its coefficient for each of them.
#[derive(Debug, Clone, PartialEq)]
pub struct Variant {
    /// Position of the shape parameter in `p`.
    pub shape: usize,
    /// Column of the coefficient.
    pub column: usize,
    /// Values of the shape.
    pub values: Vec<f64>,
}

impl<'m> LinearModel<'m> {
    /// Splits a model; parameters that are not linear keep the values in `p`. Those in `hold` are
    /// held besides.
    pub fn new(model: &'m dyn Hessian, p: &[f64], hold: &[usize]) -> Self {
        Self::with_memories(model, p, hold, &[])
    }

    /// As [`Self::new`] for a model whose last inputs are the states of these memories.
    pub fn with_memories(
        model: &'m dyn Hessian,
        p: &[f64],
        hold: &[usize],
        memories: &[Memory],
    ) -> Self {
        let dims = model.dims();
        let first = dims.p();
        let measured = dims.u()..first - memories.len();
        let mut free: Vec<bool> = model.params().iter().map(|i| !i.fixed).collect();
        let candidates = free.clone();
        hold.iter().for_each(|&j| free[j] = false);
        let pattern = model.hessian_pattern();
        let pairs: Vec<(usize, usize)> = pattern
            .rows
            .iter()
            .zip(pattern.cols)
            .filter_map(|(&r, &c)| {
                Some((
                    (r as usize).checked_sub(first)?,
                    (c as usize).checked_sub(first)?,
                ))
            })
            .collect();
        pairs
            .iter()
            .filter(|(i, j)| i == j)
            .for_each(|&(i, _)| free[i] = false);
        for (&r, &c) in pattern.rows.iter().zip(pattern.cols) {
            if let Some(j) = (r as usize).checked_sub(first)
                && measured.contains(&(c as usize))
            {
                free[j] = false;
            }
        }
        loop {
            let mut conflicts = vec![0_usize; dims.np];
            for &(i, j) in pairs.iter().filter(|(i, j)| i != j && free[*i] && free[*j]) {
                conflicts[i] += 1;
                conflicts[j] += 1;
            }
            // The parameter with the most conflicts goes; among equals the later one.
            match (0..dims.np)
                .filter(|&j| conflicts[j] > 0)
                .max_by_key(|&j| (conflicts[j], j))
            {
                Some(worst) => free[worst] = false,
                None => break,
            }
        }
        let linear: Vec<usize> = (0..dims.np).filter(|&j| free[j]).collect();
        let held = (0..dims.np)
            .filter(|&j| candidates[j] && !free[j])
            .collect();
        let mut base = p.to_vec();
        linear.iter().for_each(|&j| base[j] = 0.0);
        let place = |col: u32| {
            let j = (col as usize).checked_sub(first)?;
            linear.binary_search(&j).ok()
        };
        let columns = model
            .jacobian_pattern()
            .cols
            .iter()
            .map(|&c| place(c))
            .collect();
        Self {
            model,
            columns,
            linear,
            held,
            base,
            variants: Vec::new(),
            memories: memories.to_vec(),
        }
    }

    /// A split with further columns after the linear parameters: for each shape, its coefficient's
    /// column at each of the values, shape by shape. Shapes that enter with other than one linear
    /// coefficient are left out.
    pub fn with_variants(&self, shapes: &[(usize, Vec<f64>)]) -> LinearModel<'m> {
        let first = self.model.dims().p();
        let pattern = self.model.hessian_pattern();
        let coefficient = |shape: usize| -> Option<usize> {
            let pairs = pattern.rows.iter().zip(pattern.cols);
            let mut found = pairs.filter_map(|(&r, &c)| {
                let (r, c) = (r as usize, c as usize);
                let other = match (r == first + shape, c == first + shape) {
                    (true, false) => c,
                    (false, true) => r,
                    _ => return None,
                };
                self.linear.binary_search(&other.checked_sub(first)?).ok()
            });
            let column = found.next()?;
            found.all(|c| c == column).then_some(column)
        };
        let variants = shapes
            .iter()
            .filter_map(|(shape, values)| {
                Some(Variant {
                    shape: *shape,
                    column: coefficient(*shape)?,
                    values: values.clone(),
                })
            })
            .collect();
        LinearModel {
            model: self.model,
            linear: self.linear.clone(),
            held: self.held.clone(),
            base: self.base.clone(),
            columns: self.columns.clone(),
            variants,
            memories: self.memories.clone(),
        }
    }

    /// Memories whose states are the last of the model's inputs.
    pub fn memories(&self) -> &[Memory] {
        &self.memories
    }

    /// The shapes with columns of their own.
    pub fn variants(&self) -> &[Variant] {
        &self.variants
    }

    /// Number of columns of the regressor: one per linear parameter, then those of the variants.
    pub fn columns(&self) -> usize {
        self.linear.len() + self.variants.iter().map(|v| v.values.len()).sum::<usize>()
    }

    /// The model.
    pub fn model(&self) -> &'m dyn Hessian {
        self.model
    }

    /// Positions of the linear parameters in `p`, increasing.
    pub fn linear(&self) -> &[usize] {
        &self.linear
    }

    /// Positions of parameters that are free in the model but held here.
    pub fn held(&self) -> &[usize] {
        &self.held
    }

    /// Holds a parameter that is not linear at another value.
    pub fn set(&mut self, parameter: usize, value: f64) {
        if self.linear.binary_search(&parameter).is_err() {
            self.base[parameter] = value;
        }
    }

    /// Value at which a parameter is held; zero for a linear one.
    pub fn held_value(&self, parameter: usize) -> f64 {
        self.base[parameter]
    }

    /// All parameters, from values of the linear ones.
    pub fn complete(&self, linear: &[f64]) -> Vec<f64> {
        let mut p = self.base.clone();
        for (&j, value) in self.linear.iter().zip(linear) {
            p[j] = *value;
        }
        p
    }

    /// r₀ and Y (nq rows of [`columns`](Self::columns) entries) at a sample; the parameters of `at`
    /// are not read. `values` is scratch as long as the model's Jacobian pattern.
    pub fn evaluate(&self, at: &At<'_>, offset: &mut [f64], y: &mut [f64], values: &mut [f64]) {
        let n = self.columns();
        let rows = self.model.jacobian_pattern().rows;
        y.fill(0.0);
        let most = self.variants.iter().map(|v| v.values.len()).max();
        let mut p = match most {
            Some(_) => self.base.clone(),
            None => Vec::new(),
        };
        for k in 0..most.unwrap_or(0) {
            // Every shape at its k-th value at once: each moves the column of its own coefficient only.
            for variant in self.variants.iter().filter(|v| k < v.values.len()) {
                p[variant.shape] = variant.values[k];
            }
            self.model
                .residual_jacobian(&At { p: &p, ..*at }, offset, values);
            let mut place = self.linear.len() + k;
            for variant in &self.variants {
                if k < variant.values.len() {
                    for ((&row, column), value) in rows.iter().zip(&self.columns).zip(&*values) {
                        if *column == Some(variant.column) {
                            y[row as usize * n + place] += value;
                        }
                    }
                }
                place += variant.values.len();
            }
        }
        let at = At {
            p: &self.base,
            ..*at
        };
        self.model.residual_jacobian(&at, offset, values);
        for ((&row, column), value) in rows.iter().zip(&self.columns).zip(&*values) {
            if let Some(column) = column {
                y[row as usize * n + column] += value;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pid_models::{DoublePendulum, Emps, TwoLink, Ur10e};
    use pid_runtime::dynamics::Dynamics;
    use pid_runtime::extend::Extended;

    #[test]
    fn the_split_reproduces_the_residual() {
        let stribeck = Extended::new(
            &Emps,
            &["stribeck".parse().unwrap(), "load".parse().unwrap()],
        )
        .unwrap();
        for model in [&TwoLink as &dyn Hessian, &DoublePendulum, &Ur10e, &stribeck] {
            let dims = model.dims();
            let p: Vec<f64> = model
                .params()
                .iter()
                .enumerate()
                .map(|(k, i)| i.nominal + 0.01 * k as f64)
                .collect();
            let split = LinearModel::new(model, &p, &[]);
            let wave = |s: f64, n: usize| -> Vec<f64> {
                (0..n).map(|k| (s + 1.3 * k as f64).sin()).collect()
            };
            let (q, v, a, u) = (
                wave(0.1, dims.nq),
                wave(0.7, dims.nq),
                wave(1.9, dims.nq),
                wave(2.2, dims.nu),
            );
            let at = At {
                q: &q,
                v: &v,
                a: &a,
                u: &u,
                p: &p,
            };
            let n = split.linear().len();
            let (mut r0, mut y) = (vec![0.0; dims.nq], vec![0.0; dims.nq * n]);
            let mut scratch = vec![0.0; model.jacobian_pattern().nnz()];
            split.evaluate(&at, &mut r0, &mut y, &mut scratch);
            let mut r = vec![0.0; dims.nq];
            model.residual(&at, &mut r);
            for j in 0..dims.nq {
                let sum: f64 = r0[j]
                    + split
                        .linear()
                        .iter()
                        .enumerate()
                        .map(|(k, &i)| y[j * n + k] * p[i])
                        .sum::<f64>();
                assert!(
                    (sum - r[j]).abs() < 1e-9 * (1.0 + r[j].abs()),
                    "{}: {sum} {}",
                    model.name(),
                    r[j]
                );
            }
        }
    }

    #[test]
    fn gains_and_shapes_are_held() {
        let names = |model: &dyn Hessian, at: &[usize]| -> Vec<String> {
            at.iter()
                .map(|&j| model.params()[j].name.to_string())
                .collect()
        };
        let p: Vec<f64> = TwoLink.params().iter().map(|i| i.nominal).collect();
        let held = names(&TwoLink, LinearModel::new(&TwoLink, &p, &[]).held());
        assert!(held.iter().any(|n| n.contains("gain")), "{held:?}");
        let model = Extended::new(
            &Emps,
            &["stribeck".parse().unwrap(), "load".parse().unwrap()],
        )
        .unwrap();
        let p: Vec<f64> = model.params().iter().map(|i| i.nominal).collect();
        let split = LinearModel::new(&model, &p, &[]);
        let linear = names(&model, split.linear());
        assert!(
            linear.contains(&"stribeck_x".to_owned()) && !linear.contains(&"load_x".to_owned()),
            "{linear:?}"
        );
        assert!(names(&model, split.held()).contains(&"stribeck_velocity_x".to_owned()));
    }
}
