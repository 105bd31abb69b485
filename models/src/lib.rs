//! Robots declared with `robot!`, each with its source.
//!
//! | name | robot |
//! |---|---|
//! | `two_link` | [`TwoLink`]: idealised two-link arm with 19 parameters |
//! | `emps` | [`Emps`]: electro-mechanical positioning system, one prismatic joint |
//! | `double_pendulum` | [`DoublePendulum`]: two revolute joints in the vertical plane |
//! | `scara` | [`Scara`]: four axes, one of them prismatic |
//! | `arm6` | [`Arm6`]: six-axis arm of benchmarks, 84 parameters |
//! | `ur10e` | [`Ur10e`]: Universal Robots UR10e |
//! | `panda` | [`Panda`]: Franka Emika Panda, seven joints |
//! | `cart_pole` | [`CartPole`]: pole on a cart, by its Lagrangian |
//! | `servo_pendulum` | [`ServoPendulum`]: hobby servo with a weight, voltage input |
//! | `tx40` | [`Tx40`]: Stäubli TX40 with its coupled wrist |
//! | `vs050` | [`Vs050`]: DENSO VS-050 |
//! | `vs050_two_axis` | [`Vs050TwoAxis`]: DENSO VS-050 with axes 3 to 6 held |
//!
//! [`by_name`] finds a model by such a name, [`all`] lists them.

pub mod arm6;
pub mod cart_pole;
pub mod double_pendulum;
pub mod emps;
pub mod panda;
pub mod scara;
pub mod servo_pendulum;
pub mod two_link;
pub mod tx40;
pub mod ur10e;
pub mod vs050;

pub use arm6::Arm6;
pub use cart_pole::CartPole;
pub use double_pendulum::DoublePendulum;
pub use emps::Emps;
pub use panda::Panda;
pub use scara::Scara;
pub use servo_pendulum::ServoPendulum;
pub use two_link::TwoLink;
pub use tx40::Tx40;
pub use ur10e::Ur10e;
pub use vs050::{Vs050, Vs050TwoAxis};

use pid_runtime::dynamics::Hessian;
use thiserror::Error;

/// A model of this crate.
#[derive(Clone, Copy)]
#[non_exhaustive]
pub struct Entry {
    /// Name on the command line, `two_link`.
    pub name: &'static str,
    /// One line that describes it.
    pub summary: &'static str,
    /// Where equations and nominal values come from.
    pub source: &'static str,
    /// The model.
    pub model: &'static dyn Hessian,
}

impl Entry {
    /// A model of another crate, to stand beside these.
    pub const fn new(
        name: &'static str,
        summary: &'static str,
        source: &'static str,
        model: &'static dyn Hessian,
    ) -> Self {
        Self {
            name,
            summary,
            source,
            model,
        }
    }
}

impl std::fmt::Debug for Entry {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Entry")
            .field("name", &self.name)
            .field("summary", &self.summary)
            .field("source", &self.source)
            .finish_non_exhaustive()
    }
}

/// No model of this name.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("no model named `{name}`{}; the models are {known}", nearest_hint(.nearest.as_deref()))]
#[non_exhaustive]
pub struct UnknownModel {
    /// The name asked for.
    pub name: String,
    /// The name that was probably meant.
    pub nearest: Option<String>,
    /// All names, separated by commas.
    pub known: String,
}

fn nearest_hint(nearest: Option<&str>) -> String {
    nearest.map_or_else(String::new, |n| format!(", did you mean `{n}`?"))
}

static ENTRIES: [Entry; 12] = [
    Entry {
        name: "two_link",
        summary: "idealised two-link arm, yaw and pitch, 19 parameters",
        source: "K. Schäfer, M. Runge, K. Flaßkamp, C. Büskens, Parameter Identification for Dynamical Systems Using Optimal Control Techniques, Section V-A, Table II",
        model: &TwoLink,
    },
    Entry {
        name: "emps",
        summary: "electro-mechanical positioning system, one prismatic joint",
        source: "A. Janot, M. Gautier, M. Brunot, Data Set and Reference Models of EMPS, 2019",
        model: &Emps,
    },
    Entry {
        name: "double_pendulum",
        summary: "double pendulum with drives at both joints",
        source: "F. Wiebe et al., Open Source Dual-Purpose Acrobot and Pendubot Platform, IEEE Robotics & Automation Magazine 2024, parameters model_1.0 of design C.1",
        model: &DoublePendulum,
    },
    Entry {
        name: "scara",
        summary: "four-axis SCARA, one prismatic joint",
        source: "P. Corke, Robotics, Vision and Control, Springer 2011, model cobra600 (kinematics); inertias of homogeneous bodies",
        model: &Scara,
    },
    Entry {
        name: "arm6",
        summary: "six-axis arm of the size of a UR10, 84 parameters",
        source: "UR10 of example-robot-data, Gepetto team, LAAS-CNRS",
        model: &Arm6,
    },
    Entry {
        name: "ur10e",
        summary: "Universal Robots UR10e, 72 parameters",
        source: "Universal Robots, DH Parameters for calculations of kinematics and dynamics",
        model: &Ur10e,
    },
    Entry {
        name: "panda",
        summary: "Franka Emika Panda, seven joints, 84 parameters",
        source: "C. Gaz et al., Dynamic Identification of the Franka Emika Panda Robot With Retrieval of Feasible Parameters Using Penalty-Based Optimization, IEEE RA-L 2019",
        model: &Panda,
    },
    Entry {
        name: "cart_pole",
        summary: "pole on a cart, by its Lagrangian",
        source: "A. Barto, R. Sutton, C. Anderson, Neuronlike adaptive elements that can solve difficult learning control problems, 1983; R. Florian, Correct equations for the dynamics of the cart-pole system, 2007",
        model: &CartPole,
    },
    Entry {
        name: "servo_pendulum",
        summary: "hobby servo XL330 with a weight, voltage input",
        source: "M. Duclusaud, G. Passault, V. Padois, O. Ly, Extended Friction Models for the Physics Simulation of Servo Actuators, ICRA 2025; repository Rhoban/bam",
        model: &ServoPendulum,
    },
    Entry {
        name: "tx40",
        summary: "Stäubli TX40, six joints with a coupled wrist",
        source: "M. Gautier, S. Briot, Global Identification of Joint Drive Gains and Dynamic Parameters of Robots, ASME JDSMC 2014; masses assumed",
        model: &Tx40,
    },
    Entry {
        name: "vs050",
        summary: "DENSO VS-050, six joints, current input",
        source: "kinematics: repository SaltworkerMLU/robotkinematicscatalogue, class VS-050; masses and drives assumed",
        model: &Vs050,
    },
    Entry {
        name: "vs050_two_axis",
        summary: "DENSO VS-050 with axes 3 to 6 held",
        source: "as vs050",
        model: &Vs050TwoAxis,
    },
];

/// All models, in the order of the table above.
pub fn all() -> Vec<Entry> {
    ENTRIES.to_vec()
}

/// The model with this name; `-` and `_` are the same, case does not matter.
///
/// # Errors
/// [`UnknownModel`] with the nearest name.
pub fn by_name(name: &str) -> Result<&'static dyn Hessian, UnknownModel> {
    find(&ENTRIES, name).map(|e| e.model)
}

/// The entry with this name among some; names are compared as in [`by_name`], the first one counts.
///
/// # Errors
/// As [`by_name`].
pub fn find(entries: &[Entry], name: &str) -> Result<Entry, UnknownModel> {
    let key = normalised(name);
    if let Some(e) = entries.iter().find(|e| normalised(e.name) == key) {
        return Ok(*e);
    }
    let nearest = entries
        .iter()
        .map(|e| (strsim::osa_distance(&key, &normalised(e.name)), e.name))
        .filter(|(d, n)| *d <= n.len() / 2)
        .min_by_key(|(d, _)| *d);
    let known: Vec<&str> = entries.iter().map(|e| e.name).collect();
    Err(UnknownModel {
        name: name.to_string(),
        nearest: nearest.map(|(_, n)| n.to_string()),
        known: known.join(", "),
    })
}

/// Lower case without separators.
fn normalised(name: &str) -> String {
    name.chars()
        .filter(|c| !matches!(c, '_' | '-' | ' '))
        .flat_map(char::to_lowercase)
        .collect()
}
