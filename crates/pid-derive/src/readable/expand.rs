//! Expansion to sums of products, collected by the factors that move.

use std::collections::{BTreeMap, HashMap};

use pid_symbolic::{Function, Graph, Id, Node};

use super::{Formula, negative, number};

/// A system whose sum would have more products than this is not expanded.
const LONGEST: usize = 400;
/// Products over all results.
const TOTAL: usize = 2000;
/// A coefficient below this share of the largest one that met in it is a rounding error.
const ROUNDING: f64 = 1e-12;

/// Factors with exponents, sorted.
type Monomial = Vec<(Atom, i32)>;

/// A factor that is not expanded further: a variable, a function, or a denominator.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
enum Atom {
    /// A variable.
    Variable(u32),
    /// An expression of the graph.
    Opaque(Id),
}

/// A sum of products: coefficient, and the size of the terms added up in it.
#[derive(Debug, Clone, Default)]
struct Polynomial(BTreeMap<Monomial, (f64, f64)>);

impl Polynomial {
    fn of(monomial: Monomial, coefficient: f64) -> Self {
        let mut terms = BTreeMap::new();
        if coefficient != 0.0 {
            terms.insert(monomial, (coefficient, coefficient.abs()));
        }
        Self(terms)
    }

    fn add(&mut self, monomial: Monomial, coefficient: f64, size: f64) {
        let entry = self.0.entry(monomial).or_default();
        entry.0 += coefficient;
        entry.1 += size;
    }

    fn plus(&self, other: &Self, sign: f64) -> Self {
        let mut result = self.clone();
        for (monomial, &(c, size)) in &other.0 {
            result.add(monomial.clone(), sign * c, size);
        }
        result.cleaned()
    }

    fn times(&self, other: &Self) -> Option<Self> {
        let mut result = Self::default();
        for (x, &(a, size_a)) in &self.0 {
            for (y, &(b, size_b)) in &other.0 {
                result.add(merged(x, y), a * b, size_a * size_b);
                if result.0.len() > LONGEST {
                    return None;
                }
            }
        }
        Some(result.cleaned())
    }

    fn cleaned(mut self) -> Self {
        self.0.retain(|_, (c, size)| c.abs() > ROUNDING * *size);
        self
    }

    /// The only product, if there is one only.
    fn single(&self) -> Option<(&Monomial, f64)> {
        let mut terms = self.0.iter();
        match (terms.next(), terms.next()) {
            (Some((monomial, &(c, _))), None) => Some((monomial, c)),
            _ => None,
        }
    }
}

fn merged(x: &Monomial, y: &Monomial) -> Monomial {
    let mut factors: BTreeMap<Atom, i32> = x.iter().copied().collect();
    for &(atom, n) in y {
        *factors.entry(atom).or_default() += n;
    }
    factors.retain(|_, n| *n != 0);
    factors.into_iter().collect()
}

/// The outputs as collected sums; `None` if they grow too long. Variables from `motion` on are parameters.
pub(super) fn all(g: &Graph, outputs: &[Id], motion: usize) -> Option<Vec<Formula>> {
    let mut expander = Expander {
        g,
        motion,
        known: HashMap::new(),
    };
    let mut polynomials = Vec::new();
    let mut total = 0;
    for &output in outputs {
        let polynomial = expander.expand(output)?;
        let shortest = expander.shortest(polynomial)?;
        total += shortest.0.len();
        if total > TOTAL {
            return None;
        }
        polynomials.push(shortest);
    }
    polynomials
        .into_iter()
        .map(|polynomial| expander.collected(&polynomial))
        .collect()
}

struct Expander<'g> {
    g: &'g Graph,
    motion: usize,
    known: HashMap<Id, Polynomial>,
}

impl Expander<'_> {
    /// Operands first, so that depth does not matter.
    fn expand(&mut self, output: Id) -> Option<Polynomial> {
        for id in self.g.reachable(&[output]) {
            if !self.known.contains_key(&id) {
                let polynomial = self.operation(id)?;
                self.known.insert(id, polynomial);
            }
        }
        Some(self.known[&output].clone())
    }

    fn operation(&self, id: Id) -> Option<Polynomial> {
        let of = |x: Id| &self.known[&x];
        let one = Polynomial::of(Vec::new(), 1.0);
        let opaque = |id: Id| Polynomial::of(vec![(Atom::Opaque(id), 1)], 1.0);
        Some(match self.g.node(id) {
            Node::Const(c) => Polynomial::of(Vec::new(), c.value()),
            Node::Var(i) => Polynomial::of(vec![(Atom::Variable(i), 1)], 1.0),
            Node::Neg(x) => Polynomial::default().plus(of(x), -1.0),
            Node::Add(x, y) => of(x).plus(of(y), 1.0),
            Node::Sub(x, y) => of(x).plus(of(y), -1.0),
            Node::Mul(x, y) => of(x).times(of(y))?,
            Node::Div(x, y) => {
                let reciprocal = match of(y).single() {
                    Some((monomial, c)) => Polynomial::of(
                        monomial.iter().map(|&(atom, n)| (atom, -n)).collect(),
                        1.0 / c,
                    ),
                    None => Polynomial::of(vec![(Atom::Opaque(y), -1)], 1.0),
                };
                of(x).times(&reciprocal)?
            }
            Node::Powi(x, n) => match of(x).single() {
                Some((monomial, c)) => Polynomial::of(
                    monomial.iter().map(|&(atom, m)| (atom, m * n)).collect(),
                    c.powi(n),
                ),
                None if (0..=3).contains(&n) => {
                    let mut power = one;
                    for _ in 0..n {
                        power = power.times(of(x))?;
                    }
                    power
                }
                None => opaque(id),
            },
            Node::Call(..) => opaque(id),
        })
    }

    /// `sin² + cos² = 1` applied for either, whichever leaves fewer products.
    fn shortest(&self, polynomial: Polynomial) -> Option<Polynomial> {
        let mut best = polynomial;
        for gone in [Function::Sin, Function::Cos] {
            let other = self.without_squares(&best, gone)?;
            if other.0.len() < best.0.len() {
                best = other;
            }
        }
        Some(best)
    }

    /// Replaces squares of a sine or cosine by one minus the square of the other.
    fn without_squares(&self, polynomial: &Polynomial, gone: Function) -> Option<Polynomial> {
        let mut current = polynomial.clone();
        // Each pass lowers every power by two.
        for _ in 0..8 {
            let mut next = Polynomial::default();
            let mut changed = false;
            for (monomial, &(c, size)) in &current.0 {
                let square = monomial.iter().find_map(|&(atom, n)| {
                    let Atom::Opaque(id) = atom else { return None };
                    match self.g.node(id) {
                        Node::Call(f, x) if f == gone && n >= 2 => {
                            let other = match gone {
                                Function::Sin => Function::Cos,
                                _ => Function::Sin,
                            };
                            let twin = self.g.find(&Node::Call(other, x))?;
                            Some((atom, Atom::Opaque(twin)))
                        }
                        _ => None,
                    }
                });
                match square {
                    None => next.add(monomial.clone(), c, size),
                    Some((atom, twin)) => {
                        changed = true;
                        let rest = merged(monomial, &vec![(atom, -2)]);
                        next.add(merged(&rest, &vec![(twin, 2)]), -c, size);
                        next.add(rest, c, size);
                    }
                }
                if next.0.len() > LONGEST {
                    return None;
                }
            }
            current = next.cleaned();
            if !changed {
                break;
            }
        }
        Some(current)
    }

    fn moves(&self, atom: Atom) -> bool {
        let moving = |i: u32| (i as usize) < self.motion;
        match atom {
            Atom::Variable(i) => moving(i),
            Atom::Opaque(id) => self
                .g
                .reachable(&[id])
                .into_iter()
                .any(|id| matches!(self.g.node(id), Node::Var(i) if moving(i))),
        }
    }

    /// A sum over products that move, each with a sum of parameters as its factor.
    fn collected(&mut self, polynomial: &Polynomial) -> Option<Formula> {
        let mut groups: Vec<(Monomial, Vec<(Monomial, f64)>)> = Vec::new();
        for (monomial, &(c, _)) in &polynomial.0 {
            let (motion, constant): (Monomial, Monomial) =
                monomial.iter().partition(|(atom, _)| self.moves(*atom));
            match groups.iter_mut().find(|(known, _)| *known == motion) {
                Some((_, terms)) => terms.push((constant, c)),
                None => groups.push((motion, vec![(constant, c)])),
            }
        }
        // Constants first, then by number of factors.
        groups.sort_by(|x, y| (x.0.len(), &x.0).cmp(&(y.0.len(), &y.0)));
        let mut sum = Vec::new();
        for (motion, terms) in groups {
            if let ([], true) = (motion.as_slice(), terms.len() > 1) {
                for (constant, c) in terms {
                    sum.push(self.product(c, &constant, None, &[])?);
                }
                continue;
            }
            // The factors that all terms share, and a common number.
            let mut common: Monomial = terms[0].0.clone();
            for (constant, _) in &terms[1..] {
                common.retain_mut(|(atom, n)| {
                    let other = constant.iter().find(|(a, _)| a == atom).map_or(0, |x| x.1);
                    *n = if *n > 0 {
                        (*n).min(other).max(0)
                    } else {
                        (*n).max(other).min(0)
                    };
                    *n != 0
                });
            }
            let first = terms[0].1;
            let scale = if terms
                .iter()
                .all(|t| (t.1.abs() - first.abs()).abs() <= 1e-12 * first.abs())
            {
                first
            } else {
                1.0
            };
            let bracket = if terms.len() == 1 {
                None
            } else {
                let inverse: Monomial = common.iter().map(|&(atom, n)| (atom, -n)).collect();
                let inner: Option<Vec<Formula>> = terms
                    .iter()
                    .map(|(constant, c)| {
                        self.product(c / scale, &merged(constant, &inverse), None, &[])
                    })
                    .collect();
                Some(Formula::Sum(inner?))
            };
            let coefficient = if terms.len() == 1 { first } else { scale };
            sum.push(self.product(coefficient, &common, bracket, &motion)?);
        }
        // A sum opens with a term without sign, if it has one.
        if let Some(first) = sum.iter().position(|x| !matches!(x, Formula::Negative(_))) {
            sum[..=first].rotate_right(1);
        }
        Some(match sum.len() {
            0 => Formula::Number(0.0),
            1 => sum.remove(0),
            _ => Formula::Sum(sum),
        })
    }

    fn product(
        &mut self,
        coefficient: f64,
        constant: &[(Atom, i32)],
        bracket: Option<Formula>,
        motion: &[(Atom, i32)],
    ) -> Option<Formula> {
        // Quarters and the like are exact; other numbers lost their last digits on the way.
        let size = tidy(coefficient.abs());
        let mut above = Vec::new();
        let mut below = Vec::new();
        if size != 1.0 {
            above.push(number(size));
        }
        let mut bracket = bracket;
        for (k, &(atom, n)) in constant.iter().chain(motion).enumerate() {
            if k == constant.len() {
                above.extend(bracket.take());
            }
            let factor = self.atom(atom)?;
            let target = if n > 0 { &mut above } else { &mut below };
            target.push(match n.abs() {
                1 => factor,
                n => Formula::Power(Box::new(factor), n),
            });
        }
        above.extend(bracket.take());
        let joined = |mut factors: Vec<Formula>| match factors.len() {
            0 => Formula::Number(1.0),
            1 => factors.remove(0),
            _ => Formula::Product(factors),
        };
        let value = if below.is_empty() {
            joined(above)
        } else {
            Formula::Quotient(Box::new(joined(above)), Box::new(joined(below)))
        };
        Some(if coefficient < 0.0 {
            negative(value)
        } else {
            value
        })
    }

    fn atom(&mut self, atom: Atom) -> Option<Formula> {
        let id = match atom {
            Atom::Variable(i) => return Some(Formula::Variable(i as usize)),
            Atom::Opaque(id) => id,
        };
        match self.g.node(id) {
            Node::Call(f, x) => {
                let argument = self.inner(x)?;
                Some(Formula::Call(f, Box::new(argument)))
            }
            Node::Powi(x, n) => {
                let base = self.inner(x)?;
                Some(Formula::Power(Box::new(base), n))
            }
            _ => self.inner(id),
        }
    }

    fn inner(&mut self, id: Id) -> Option<Formula> {
        let polynomial = self.expand(id)?;
        let shortest = self.shortest(polynomial)?;
        self.collected(&shortest)
    }
}

/// A coefficient without the rounding errors of its products: the shortest number within some units
/// in the last place.
fn tidy(x: f64) -> f64 {
    let text = format!("{x:.12e}");
    match text.parse::<f64>() {
        Ok(short) if (short - x).abs() <= 4.0 * f64::EPSILON * x => short,
        _ => x,
    }
}
