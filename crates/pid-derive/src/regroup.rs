//! Inertial parameters moved towards the base as far as the motion cannot tell (M. Gautier, W.
//! Khalil, IEEE Trans. Robotics and Automation 6(3), 1990).
//!
//! What turns about an axis without changing its mass distribution may as well be fixed to the
//! parent: the mass, the first moment along the axis, and an inertia that is equal about the two
//! other axes. A slide does not turn: all of its inertia may be the parent's. The equations in the
//! coordinates stay the same and lose operations; forces in the joints' bearings change.

use pid_symbolic::{Graph, Id};

use super::inertia::Inertia;
use super::kinematics::{Motion, Tree};
use super::vector::{Frame, Vector};

/// Moves the parameters of all bodies, from the tips to the base; the base takes up what arrives
/// there. `q` are the variables of the coordinates.
pub fn regroup(g: &mut Graph, tree: &mut Tree, q: &[Id]) {
    let zero = g.zero();
    for index in (0..tree.bodies.len()).rev() {
        let body = &mut tree.bodies[index];
        let own = &mut body.inertia;
        let mut moved = Inertia::zero(g);
        match body.motion {
            Motion::Revolute(axis) => {
                // Of axes that are no axes of the frame nothing is moved.
                let Some(k) = along(g, axis) else { continue };
                let (i, j) = ((k + 1) % 3, (k + 2) % 3);
                moved.mass = own.mass;
                moved.moment[k] = own.moment[k];
                let equal = own.tensor[i][i];
                (moved.tensor[i][i], moved.tensor[j][j]) = (equal, equal);
                own.mass = zero;
                own.moment[k] = zero;
                own.tensor[i][i] = zero;
                own.tensor[j][j] = g.sub(own.tensor[j][j], equal);
            }
            Motion::Prismatic(_) => {
                moved.tensor = own.tensor;
                own.tensor = [[zero; 3]; 3];
            }
        }
        if let Some(parent) = body.parent {
            let frame = at_zero(g, &body.frame, q);
            let seen = moved.seen_from_parent(g, &frame);
            tree.bodies[parent].inertia = tree.bodies[parent].inertia.plus(g, &seen);
        }
    }
}

/// The axis of the frame that a unit vector lies on.
fn along(g: &Graph, axis: Vector) -> Option<usize> {
    (0..3).find(|&k| g.value(axis[k]).is_some_and(|x| x.abs() == 1.0))
}

/// A frame where all coordinates are zero.
fn at_zero(g: &mut Graph, frame: &Frame, q: &[Id]) -> Frame {
    let zero = g.zero();
    let entries: Vec<Id> = (frame.rotation.iter().flatten())
        .chain(&frame.origin)
        .copied()
        .collect();
    let count = q.len();
    let entries = g.substitute(&entries, |_, var| ((var as usize) < count).then_some(zero));
    Frame {
        rotation: [0, 1, 2].map(|i| [0, 1, 2].map(|j| entries[3 * i + j])),
        origin: [entries[9], entries[10], entries[11]],
    }
}

/// Ten numbers of a body, in the order mass, first moment, xx, yy, zz, xy, xz, yz.
pub fn listed(inertia: &Inertia) -> [Id; 10] {
    let (h, t) = (inertia.moment, &inertia.tensor);
    [
        inertia.mass,
        h[0],
        h[1],
        h[2],
        t[0][0],
        t[1][1],
        t[2][2],
        t[1][0],
        t[2][0],
        t[2][1],
    ]
}

/// The inverse of [`listed`].
pub fn of_list(x: &[Id; 10]) -> Inertia {
    let [mass, hx, hy, hz, xx, yy, zz, xy, xz, yz] = *x;
    Inertia {
        mass,
        moment: [hx, hy, hz],
        tensor: [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]],
    }
}
