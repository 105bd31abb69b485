//! Evaluation of four nodes at once.
//!
//! The equations of a model are the same at every node of a record. Models with `emit { …, lanes }`
//! carry a second version of their bodies that evaluates [`LANES`] nodes together in 256-bit
//! vectors (AVX2 with fused multiply-add). The processor decides at run time which version runs.
//! Elsewhere the same call evaluates the nodes one after the other. Values agree with those of a
//! single node up to rounding, since fused operations round once.
//!
//! Arrays are arrays of lanes: entry `i` holds component `i` of all four nodes. Parameters are shared.
//!
//! # Example
//! ```
//! use pid_runtime::dynamics::Dynamics;
//! use pid_runtime::lanes::LanesAt;
//!
//! pid_runtime::robot! {
//!     /// A point mass on a rod.
//!     pub robot Pendulum {
//!         gravity: [0, 0, -9.81] m/s^2;
//!         params {
//!             m: kg = 1.0 in 0.1..=5.0;
//!             l: m = 0.5 in 0.1..=1.0;
//!         }
//!         link rod { mass: m; com: [0, 0, -l]; }
//!         joint pivot: revolute about y { base -> rod; }
//!         emit { dynamics, first_derivatives, lanes }
//!     }
//! }
//!
//! let at = LanesAt {
//!     q: &[[0.1, 0.2, 0.3, 0.4]],
//!     v: &[[0.0; 4]],
//!     a: &[[0.0; 4]],
//!     u: &[],
//!     p: &[1.0, 0.5],
//! };
//! let mut r = [[0.0; 4]];
//! Pendulum.residual_lanes(&at, &mut r);
//! assert!((r[0][2] - 9.81 * 0.5 * 0.3_f64.sin()).abs() < 1e-14);
//! ```

#[cfg(target_arch = "x86_64")]
#[doc(hidden)]
pub mod avx2;

use std::cell::RefCell;

pub use pid_lanes::{LANES, Lane};

use crate::at::At;

/// The points at which a model is evaluated; as [`At`], for [`LANES`] nodes with common parameters.
#[derive(Debug, Clone, Copy)]
pub struct LanesAt<'a> {
    /// Coordinates, rad or m.
    pub q: &'a [Lane],
    /// Velocities, rad/s or m/s.
    pub v: &'a [Lane],
    /// Accelerations, rad/s² or m/s².
    pub a: &'a [Lane],
    /// Inputs.
    pub u: &'a [Lane],
    /// Parameters.
    pub p: &'a [f64],
}

/// Scratch space of one thread: the arguments and results of one node.
#[derive(Default)]
struct Node {
    arguments: Vec<f64>,
    results: Vec<f64>,
}

thread_local! {
    static NODE: RefCell<Node> = RefCell::default();
}

/// Evaluates a function of one node at each node. `extra` is a further argument per node
/// (multipliers), `first` and `second` receive the function's two results.
///
/// Allocates once per thread and size.
#[doc(hidden)]
pub fn one_by_one(
    at: &LanesAt<'_>,
    extra: &[Lane],
    first: &mut [Lane],
    second: &mut [Lane],
    function: impl Fn(&At<'_>, &[f64], &mut [f64], &mut [f64]),
) {
    // Taken out of the cell, since the function may call this again.
    let mut node = NODE.take();
    for lane in 0..LANES {
        node.arguments.clear();
        for part in [at.q, at.v, at.a, at.u, extra] {
            node.arguments.extend(part.iter().map(|x| x[lane]));
        }
        let (q, rest) = node.arguments.split_at(at.q.len());
        let (v, rest) = rest.split_at(at.v.len());
        let (a, rest) = rest.split_at(at.a.len());
        let (u, lambda) = rest.split_at(at.u.len());
        node.results.clear();
        node.results.resize(first.len() + second.len(), 0.0);
        let (one, two) = node.results.split_at_mut(first.len());
        function(
            &At {
                q,
                v,
                a,
                u,
                p: at.p,
            },
            lambda,
            one,
            two,
        );
        for (out, x) in first.iter_mut().chain(second.iter_mut()).zip(&node.results) {
            out[lane] = *x;
        }
    }
    NODE.set(node);
}
